"""Light that is not what the fringes need: too much, too little contrast, drifting, or no cosine."""

from collections.abc import Iterator

import numpy as np

from fringecal.phase.demodulation.demodulate import Reason
from fringecal.phase.demodulation.phase_shifts import SIGNIFICANT, share_of_mean
from fringecal.phase.demodulation.waveform import phase_error, ripple_rms
from fringecal.phase.diagnostics.evidence import Evidence, Finding
from fringecal.phase.diagnostics.finding_kinds import FindingKind

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
    if abs(background[worst]) > max(evidence.limits.background, SIGNIFICANT * u_background[worst]):
        level = float(np.median([b.background.mean() / np.abs(b.signal).mean() for b in evidence.blocks]))
        error = phase_error(evidence.phase_shifts_rad, gains=1 + modulation, offsets=level * background)
        yield Finding(
            FindingKind.LAMP_DRIFT,
            f"frame {worst + 1} is {'brighter' if background[worst] > 0 else 'darker'} than the set's mean",
            f"{background[worst]:+.1%} in background, {modulation[worst]:+.1%} in modulation",
            ripple_rms(error),
            "let the lamp warm up, keep room light out; commission, verify and reconstruct correct it",
        )
    weakest = int(blurred.argmin())
    u_blurred = float(np.hypot(u_modulation[weakest], u_background[weakest]))
    least = evidence.limits.blur
    if -blurred[weakest] > max(least, SIGNIFICANT * u_blurred) and abs(background[worst]) < least:
        yield Finding(
            FindingKind.VIBRATION,
            f"the fringes of frame {weakest + 1} are weaker at the same brightness: they moved while it was exposed",
            f"{blurred[weakest]:+.1%} in modulation",
            ripple_rms(phase_error(evidence.phase_shifts_rad, gains=1 + modulation)),
            "let the vibration decay before each frame, or use a shorter exposure; take the set again",
        )


def waveform(evidence: Evidence) -> Iterator[Finding]:
    """Find fringes that are no cosine: a gamma, or a clipped slide."""
    wave, limits = evidence.wave, evidence.limits
    if wave is None:
        return
    second, third = float(wave.ratios[0].real), float(wave.ratios[1].real)
    cost = ripple_rms(phase_error(evidence.phase_shifts_rad, ratios=wave.ratios))
    of_gamma = second * (wave.gamma - 2) / (wave.gamma + 3)
    clipped = third - of_gamma
    # Light that is added after a strong gamma, or two gammas one after the other, leave a third harmonic too.
    if abs(clipped) > max(limits.clipping, SIGNIFICANT * wave.u[1], limits.of_second * abs(second)):
        yield Finding(
            FindingKind.CLIPPED_SLIDE,
            "the fringes have flat tops or bottoms: the slide or the projector clips them",
            f"third harmonic {third:+.1%} of the first, where gamma would give {of_gamma:+.1%}",
            cost,
            "lower the contrast of the printed or displayed fringes; take four frames or more",
        )
        return
    harm = ripple_rms(phase_error(evidence.phase_shifts_rad, ratios=wave.significant))
    if harm > limits.gamma_rad or abs(wave.significant[0]) > limits.second_harmonic:
        yield Finding(
            FindingKind.GAMMA,
            "projector or camera does not respond in proportion to light",
            f"exponent {wave.gamma:.2f} (u {wave.u_gamma:.2g}): second harmonic {second:+.1%} of the first, "
            f"third {third:+.1%}",
            cost,
            "switch gamma off in projector and camera, or take four frames; commission, verify, reconstruct correct it",
        )


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
