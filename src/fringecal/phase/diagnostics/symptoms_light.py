"""Light that is not what the fringes need: too much, too little contrast, drifting, or no cosine."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import TURN
from fringecal.phase.demodulation.blocks import HARMONICS
from fringecal.phase.demodulation.demodulate import Reason
from fringecal.phase.demodulation.phase_shifts import SIGNIFICANT, share_of_mean
from fringecal.phase.demodulation.waveform import cost_of_harmonic, phase_error, ripple_rms, third_stands_alone
from fringecal.phase.diagnostics.evidence import Evidence, Finding
from fringecal.phase.diagnostics.finding_kinds import FindingKind

_MOST_FRAMES = 8  # that a remedy asks for
_NO_LIGHT = 1e-6  # grey levels, instead of a division by 0


def saturated(evidence: Evidence) -> Iterator[Finding]:
    """Find clipped crests: pixels at the white level."""
    share = float(((evidence.map.reasons & Reason.SATURATED) > 0).mean())
    if share > evidence.limits.saturated:
        yield Finding(
            FindingKind.SATURATION,
            "pixels reach the white level at the crest of the fringes and are masked",
            f"{share:.1%} of the picture",
            None,
            "shorten the exposure or close the aperture until the crests are at 80 % of the white level",
        )


def brightness(evidence: Evidence) -> Iterator[Finding]:
    """Find frames of other brightness (lamp) or of weaker fringes at the same brightness (vibration)."""
    if len(evidence.blocks) == 0:
        return
    gain, u_modulation = share_of_mean(np.abs([block.signal for block in evidence.blocks]))
    share, u_background = share_of_mean(np.array([block.background for block in evidence.blocks]))
    modulation, background = gain - 1, share - 1
    blurred = modulation - background
    worst = int(np.abs(background).argmax())
    level = float(np.median([b.background.mean() / np.abs(b.signal).mean() for b in evidence.blocks]))
    cost = ripple_rms(phase_error(evidence.phase_shifts_rad, gains=1 + modulation, offsets=level * background))
    other = abs(background[worst]) > max(evidence.limits.background, SIGNIFICANT * u_background[worst])
    if other and cost > evidence.limits.least_cost_rad:
        yield Finding(
            FindingKind.LAMP_DRIFT,
            f"frame {worst + 1} is {'brighter' if background[worst] > 0 else 'darker'} than the set's mean",
            f"{background[worst]:+.1%} in background, {modulation[worst]:+.1%} in modulation",
            cost,
            "let the lamp warm up, keep room light out; commission, verify and reconstruct correct it",
        )
    weakest = int(blurred.argmin())
    u_blurred = float(np.hypot(u_modulation[weakest], u_background[weakest]))
    least = evidence.limits.blur
    cost = ripple_rms(phase_error(evidence.phase_shifts_rad, gains=1 + modulation))
    weaker = -blurred[weakest] > max(least, SIGNIFICANT * u_blurred) and abs(background[worst]) < least
    if weaker and cost > evidence.limits.least_cost_rad:
        yield Finding(
            FindingKind.VIBRATION,
            f"the fringes of frame {weakest + 1} are weaker at the same brightness: they moved while it was exposed",
            f"{blurred[weakest]:+.1%} in modulation",
            cost,
            "let the vibration decay before each frame, or use a shorter exposure; take the set again",
        )


def waveform(evidence: Evidence) -> Iterator[Finding]:
    """Find fringes that are no cosine, named by the harmonic that costs most with the phase shifts at hand."""
    wave, limits, shifts = evidence.wave, evidence.limits, evidence.phase_shifts_rad
    if wave is None:
        return
    second, third = (float(ratio.real) for ratio in wave.ratios[:2])
    of_gamma = second * (wave.gamma - 2) / (wave.gamma + 3)
    # Light that is added after a strong gamma, or two gammas one after the other, leave a third harmonic too.
    flat = of_gamma - third > max(limits.clipping, SIGNIFICANT * wave.u[1], limits.of_second * abs(second))
    ratios = _clipped_ratios(third - of_gamma) if flat else wave.significant
    cost = ripple_rms(phase_error(shifts, ratios=ratios))
    if cost < limits.gamma_rad:
        return
    costs = [cost_of_harmonic(shifts, wave.significant, order) for order in HARMONICS]
    if flat:
        kind, what = FindingKind.CLIPPED_SLIDE, "the fringes have flat tops and bottoms: the slide or projector clips"
        remedy = "lower the contrast of the printed or displayed fringes"
    elif third_stands_alone(wave, shifts):
        kind, what = FindingKind.THIRD_HARMONIC, "the fringes have a third harmonic that no gamma explains"
        remedy = "display or print fringes as cosines"
    else:
        kind, what = FindingKind.GAMMA, "projector or camera does not respond in proportion to light"
        remedy = "switch gamma off in projector and camera"
    named = zip(("second", "third", "fourth"), wave.ratios, costs, strict=True)
    shown = ", ".join(f"{name} {ratio.real:+.1%} of the first ({alone:.3f} rad)" for name, ratio, alone in named)
    size = f"exponent {wave.gamma:.2f} (u {wave.u_gamma:.2g}); " if kind is FindingKind.GAMMA else ""
    more = _enough_frames(len(shifts), ratios, limits.gamma_rad)
    remedy += f", or take {more} frames" if more else ""
    yield Finding(kind, what, size + shown, cost, f"{remedy}; commission, verify, reconstruct correct it")


def _clipped_ratios(third: float) -> NDArray[np.float64]:
    """Return harmonics 2, 3, ... of a cosine cut at both ends so that its third is this share of the first.

    Only the first few can be measured, and of a cut cosine the fifth and seventh cost most with three or four frames.
    """
    angle = TURN * np.arange(_CUT_SAMPLES) / _CUT_SAMPLES
    waves = np.clip(np.cos(angle), -_CUTS[:, None], _CUTS[:, None])
    parts = np.fft.rfft(waves, axis=1).real[:, 1 : _CUT_HARMONICS + 1]
    ratios = parts[:, 1:] / parts[:, :1]
    return np.asarray(ratios[np.abs(ratios[:, 1] - third).argmin()])


_CUTS = np.linspace(0.05, 1.0, 96)  # of the amplitude, at which a cosine is cut
_CUT_SAMPLES, _CUT_HARMONICS = 256, 20


def _enough_frames(count: int, ratios: NDArray, most_rad: float) -> int | None:
    """Return the least number of evenly spaced frames, more than now, whose ripple is too small to be named."""
    for more in range(count + 1, _MOST_FRAMES + 1):
        if ripple_rms(phase_error(TURN * np.arange(more) / more, ratios=ratios)) < most_rad:
            return more
    return None


def contrast(evidence: Evidence) -> Iterator[Finding]:
    """Find fringes that are weak against their background."""
    map_ = evidence.map
    lit = (map_.reasons & (Reason.DARK | Reason.OUTSIDE | Reason.SATURATED)) == 0
    if not map_.valid.any():
        return
    use = map_.valid & lit
    ratio = float(np.median(map_.modulation[use] / np.maximum(map_.background[use], _NO_LIGHT))) if use.any() else 0.0
    if ratio < evidence.limits.contrast:
        yield Finding(
            FindingKind.DEFOCUS,
            "the fringes are weak against their background: out of focus, or too much other light",
            f"modulation is {ratio:.0%} of the background, where a sharp slide gives 60 to 90 %",
            float(np.median(map_.sigma[use])) if use.any() else None,
            "focus the projector on the plate, shade the room light",
        )
