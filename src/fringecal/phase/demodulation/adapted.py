"""Demodulation with the model that the frames show where it differs significantly from the stated one.

Phase shifts, their change over the field, the brightness of each frame and the waveform of the fringes are measured
first; what differs significantly from the stated model, affects the phase, and explains the frames better when it is
corrected, is corrected; the rest is left as stated.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, wrap
from fringecal.phase.demodulation.blocks import RIPPLE_ORDERS, Block
from fringecal.phase.demodulation.corrections import correct_phase_shifts
from fringecal.phase.demodulation.demodulate import RESIDUAL_SHARE, PhaseMap, demodulate
from fringecal.phase.demodulation.fringe_period import fringe_period
from fringecal.phase.demodulation.model_residual import ResidualSample
from fringecal.phase.demodulation.noise import Noise
from fringecal.phase.demodulation.phase_shifts import SIGNIFICANT, PhaseShiftEstimate, phase_shifts_and_blocks
from fringecal.phase.demodulation.schemes import Scheme, least_squares
from fringecal.phase.demodulation.waveform import (
    Waveform,
    correct_gamma,
    phase_error,
    ripple_rms,
    third_stands_alone,
    waveform_of_blocks,
)

LEAST_CHANGE_RAD = np.deg2rad(0.7)
"""Change of a phase shift from edge to edge below which it is not corrected: 0.003 rad of ripple at the edge."""
_SAMPLES = 12  # of a fringe that thinned pictures keep: the sixth order of ripple has two of them
_NO_RISE = 1e-3  # rad/px: a fringe of 6283 px, longer than pictures are


@dataclass(frozen=True)
class AdaptationRules:
    """What is corrected of what the frames show, and when the plate's waveform no longer applies.

    Parameters
    ----------
    cost_rad
        Rms ripple below which phase shifts and brightness are not corrected, rad: a third of the noise of one good
        pixel.
    change_rad
        Change of a phase shift from edge to edge below which it is not corrected, rad.
    blocks_to_contradict
        Blocks that a set needs for its own waveform to replace the plate's: of fewer the scatter is poorly known.
    same_harmonic
        Most that the second harmonics of set and plate may differ by, as shares of the first; an object's own shape
        shows as so much.
    noise_ratio
        Scatter of the frames over a few fringes against what neighbouring pixels show, from which a note states
        that u(phase) is too small; the surface's own roughness makes less.
    most_pixels
        Pixels from which on only every second (third, ...) one of each row and column is measured on, where fringes
        are still long then.
    """

    cost_rad: float = 0.003
    change_rad: float = LEAST_CHANGE_RAD
    blocks_to_contradict: int = 12
    same_harmonic: float = 0.03
    noise_ratio: float = 2.0
    most_pixels: float = np.inf


ADAPTATION_RULES = AdaptationRules()


@dataclass(frozen=True)
class Adapted:
    """A set demodulated with the model that its frames show.

    Parameters
    ----------
    map
        The phase map, corrected.
    scheme
        Phase shifts, gains and backgrounds that were used.
    change_rad_px
        Change of each phase shift over the field that was corrected, rad/px along u and v, (N, 2); zero where none was.
    wave
        Waveform of the fringes, of the plate or of these frames; None where it is not known.
    phase_shifts, found_wave
        As measured on these frames; None where the scene does not allow it.
    undone
        What was corrected, one sentence each.
    notes
        What could not be checked, and why.
    """

    map: PhaseMap
    scheme: Scheme
    change_rad_px: NDArray[np.float64]
    wave: Waveform | None
    phase_shifts: PhaseShiftEstimate | None
    found_wave: Waveform | None
    undone: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def again(self, frames: ArrayLike, *, white_level: float | None = None) -> PhaseMap:
        """Demodulate other frames of the same set, such as filtered ones, with the same corrections."""
        return _demodulated(frames, self.scheme, self.change_rad_px, self.wave, white_level)


def demodulate_adapted(
    frames: ArrayLike,
    phase_shifts_rad: ArrayLike,
    *,
    white_level: float | None = None,
    wave: Waveform | None = None,
    rules: AdaptationRules = ADAPTATION_RULES,
) -> Adapted:
    """Demodulate a set and correct what its frames show to differ from the stated model.

    Parameters
    ----------
    frames
        Grey values, (N, H, W).
    phase_shifts_rad
        Stated phase shifts, rad, (N,).
    white_level
        Saturation, grey levels.
    wave
        Waveform of the fringes as found on the bare plate with the same projector and camera settings. It is used
        unless these frames contradict it.
    rules
        What is corrected.

    Raises
    ------
    PhaseError
        Frames and phase shifts that do not fit together, as in `demodulate`.
    """
    stated = np.asarray(phase_shifts_rad, np.float64).ravel()
    step = _thinning(frames, stated, white_level, rules)
    thinned = frames if step == 1 else np.asarray(frames)[:, ::step, ::step]
    phase_shifts, found_wave, blocks, notes = _measured(thinned, stated, white_level)
    if phase_shifts is not None and step > 1:
        slopes = phase_shifts.gradient_rad_px / step, phase_shifts.u_gradient_rad_px / step
        phase_shifts = replace(phase_shifts, gradient_rad_px=slopes[0], u_gradient_rad_px=slopes[1])
    scheme, undone, refused = _scheme(frames, stated, phase_shifts, white_level, rules)
    notes += refused
    change = np.zeros((stated.size, 2))
    if phase_shifts is not None:
        shape = np.shape(frames)[1:]
        change, sentence = _change(phase_shifts, shape, rules)
        undone += sentence
    shape_used, effects, caveats = _wave(scheme, found_wave, wave, blocks, rules)
    map_ = _demodulated(frames, scheme, change, shape_used, white_level)
    notes += caveats + smoothed_noise(map_, phase_shifts, rules=rules)
    return Adapted(map_, scheme, change, shape_used, phase_shifts, found_wave, undone + effects, notes)


def _thinning(frames: ArrayLike, stated: NDArray, white_level: float | None, rules: AdaptationRules) -> int:
    """Return which of the pixels of each row and column are measured on: every one, or fewer of long fringes."""
    step = int(np.sqrt(np.prod(np.shape(frames)[1:]) / rules.most_pixels))
    if step < 2:
        return 1
    grey = np.asarray(frames)
    shortest = min(
        _usual_period(strips, stated, white_level, axis)
        for strips, axis in ((grey[:, :: 8 * step], 1), (grey[:, :, :: 8 * step], 0))
    )
    return max(1, min(step, int(shortest / _SAMPLES)))


def _usual_period(strips: NDArray, stated: NDArray, white_level: float | None, axis: int) -> float:
    """Return the length of most fringes along whole rows (axis 1) or columns (0), px; infinite where none are seen."""
    map_ = demodulate(strips, stated, white_level=white_level, noise=Noise(1.0), max_residual=np.inf)
    rises = wrap(np.diff(map_.phase, axis=axis))
    known = np.abs(rises[np.isfinite(rises)])
    return float(TURN / max(float(np.median(known)), _NO_RISE)) if known.size else np.inf


def _measured(
    frames: ArrayLike, stated: NDArray, white_level: float | None
) -> tuple[PhaseShiftEstimate | None, Waveform | None, list[Block], tuple[str, ...]]:
    """Measure phase shifts, brightness and waveform, or state why that is impossible."""
    try:
        phase_shifts, blocks = phase_shifts_and_blocks(frames, stated, white_level=white_level)
    except PhaseError as error:
        return None, None, [], (f"they could not be checked ({str(error).split('.')[0].rstrip(',;:')})",)
    return phase_shifts, waveform_of_blocks(blocks), blocks, ()


def _scheme(
    frames: ArrayLike,
    stated: NDArray,
    found: PhaseShiftEstimate | None,
    white_level: float | None,
    rules: AdaptationRules,
) -> tuple[Scheme, tuple[str, ...], tuple[str, ...]]:
    """Choose phase shifts and brightness of the frames: as found where that is sure, matters and helps."""
    scheme = least_squares(stated)
    if found is None:
        return scheme, (), ()
    offered = [one for one in (_by_phase_shifts(found, rules), _by_brightness(found, rules)) if one is not None]
    if not offered:
        return scheme, (), ()
    sample = _residual_sample(frames, stated, white_level)
    left = None if sample is None else sample.left_by(scheme)
    undone, refused = [], []
    for offer in offered:
        changed, sentence = offer(scheme)
        less = None if sample is None else sample.left_by(changed)
        if left is not None and less is not None and less >= left:
            refused.append(f"not corrected, as that explains the frames no better: {sentence}")
            continue
        scheme, left = changed, less
        undone.append(sentence)
    return scheme, tuple(undone), tuple(refused)


Offer = Callable[[Scheme], tuple[Scheme, str]]


def _residual_sample(frames: ArrayLike, stated: NDArray, white_level: float | None) -> ResidualSample | None:
    """Take the lines that judge a correction; None where there is no fringe to be followed."""
    map_ = demodulate(frames, stated, white_level=white_level, noise=Noise(1.0), max_residual=np.inf)
    try:
        return ResidualSample.of(frames, fringe_period(map_.phase, map_.valid), white_level)
    except PhaseError:
        return None


def _by_phase_shifts(found: PhaseShiftEstimate, rules: AdaptationRules) -> Offer | None:
    """Offer the phase shifts found, if they are significant and cost something.

    Only differences of phase shifts can be seen; which of them is right cannot. Their errors are taken to have no
    mean, so that the phase keeps its mean too, where one frame taken as exact would shift it by that frame's error.
    """
    shifts = found.phase_shifts_rad - found.errors_rad.mean()
    cost = ripple_rms(phase_error(found.stated_rad, true_phase_shifts_rad=shifts))
    if not found.significant or cost < rules.cost_rad:
        return None
    return lambda _: (least_squares(shifts), f"{_degrees(shifts)} deg were used")


def _by_brightness(found: PhaseShiftEstimate, rules: AdaptationRules) -> Offer | None:
    """Offer the frames' brightness as found, if it is significant and costs something."""
    offsets = found.level_per_frame / found.modulation_level
    cost = ripple_rms(phase_error(found.stated_rad, gains=found.gain_per_frame, offsets=offsets))
    if not found.uneven or cost < rules.cost_rad:
        return None
    worst = float(np.abs(found.level_per_frame / found.background_level - 1).max())
    weakest = float(np.abs(found.gain_per_frame - 1).max())
    sentence = (
        f"the frames' brightness was made equal (background up to {worst:.1%}, modulation up to {weakest:.1%} "
        f"from the mean; uncorrected, the phase error would be {cost:.3f} rad)"
    )

    def equalised(scheme: Scheme) -> tuple[Scheme, str]:
        parts = {
            "gains": found.gain_per_frame,
            "offsets": found.offset_per_frame,
            "backgrounds": found.background_per_frame,
        }
        return least_squares(scheme.phase_shifts_rad, name="equalised", **parts), sentence

    return equalised


def _change(
    phase_shifts: PhaseShiftEstimate, shape: tuple[int, ...], rules: AdaptationRules
) -> tuple[NDArray, tuple[str, ...]]:
    """Return the phase shifts' change over the field where it is sure and matters."""
    change = phase_shifts.field_change_rad_px(shape)
    largest = float(np.abs(change * [shape[1], shape[0]]).max())
    if largest < rules.change_rad:
        return np.zeros_like(change), ()
    return change, (f"phase shifts that change by {np.rad2deg(largest):.2f} deg from edge to edge were corrected",)


def _wave(
    scheme: Scheme, found: Waveform | None, carried: Waveform | None, blocks: list[Block], rules: AdaptationRules
) -> tuple[Waveform | None, tuple[str, ...], tuple[str, ...]]:
    """Choose the waveform: the plate's, unless these frames contradict it."""
    known = found is not None and found.n_blocks >= rules.blocks_to_contradict
    if carried is None:
        chosen, whence = found, "found in these frames"
    elif known and found is not None and _differ(found, carried, rules):
        chosen, whence = found, "found in these frames, as the plate's no longer fits"
    else:
        chosen, whence = carried, "found on the plate"
    caveats = ("the plate's waveform could not be checked on them",) if carried is not None and not known else ()
    if chosen is None or not chosen.matters(scheme):
        return chosen, (), caveats
    cost = ripple_rms(phase_error(scheme, ratios=chosen.ratios))
    sentence = f"{_named(chosen, scheme)}, {whence}; uncorrected, {cost:.3f} rad)"
    if blocks and not _lowers_ripple(blocks, scheme, chosen):
        return None, (), (*caveats, f"not corrected, as the phase does not ripple so: {sentence}")
    return chosen, (sentence,), caveats


def _named(wave: Waveform, scheme: Scheme) -> str:
    """Name what was corrected: a gamma by its exponent, what no gamma makes by its harmonics."""
    if not third_stands_alone(wave, scheme):
        return f"gamma was corrected (exponent {wave.gamma:.3f}"
    second, third = (float(ratio.real) for ratio in wave.ratios[:2])
    return f"harmonics were corrected (second {second:+.1%}, third {third:+.1%} of the first"


def _lowers_ripple(blocks: list[Block], scheme: Scheme, wave: Waveform) -> bool:
    """Tell whether the ripple that blocks show is less by that of a waveform."""
    seen = np.array([block.ripple for block in blocks])
    seen = np.median(seen.real, axis=0) + 1j * np.median(seen.imag, axis=0)
    error = phase_error(scheme, ratios=wave.ratios)
    true = TURN * np.arange(error.size) / error.size
    by_found = np.interp(true, true + error, error, period=TURN)
    made = np.array([2 * np.mean(by_found * np.exp(1j * order * true)) for order in RIPPLE_ORDERS])
    # What phase shifts and brightness make is of the first and second order, and corrected before.
    high = np.array(RIPPLE_ORDERS) > 2  # noqa: PLR2004 -- orders of ripple
    return float(np.sum(np.abs(seen - made)[high] ** 2)) < float(np.sum(np.abs(seen)[high] ** 2))


def _differ(found: Waveform, carried: Waveform, rules: AdaptationRules) -> bool:
    """Return whether two second harmonics differ by more than chance and the surface explain."""
    apart = abs(found.ratios[0] - carried.ratios[0])
    return bool(apart > max(rules.same_harmonic, SIGNIFICANT * np.hypot(found.u[0], carried.u[0])))


def _demodulated(
    frames: ArrayLike, scheme: Scheme, change: NDArray, wave: Waveform | None, white_level: float | None
) -> PhaseMap:
    """Demodulate with all corrections."""
    # What the harmonics leave as a residual is no fault once their cause is known; it counts per spare frame.
    count = len(scheme.phase_shifts_rad)
    harmonics = 0.0 if wave is None else float(np.abs(wave.ratios).sum())
    allowed = RESIDUAL_SHARE + harmonics * np.sqrt(count / max(count - 3, 1))
    map_ = demodulate(frames, scheme, white_level=white_level, max_residual=allowed)
    if change.any():
        map_ = correct_phase_shifts(map_, scheme, change)
    return map_ if wave is None or not wave.matters(scheme) else correct_gamma(map_, scheme, wave)


def smoothed_noise(
    map_: PhaseMap, phase_shifts: PhaseShiftEstimate | None, *, rules: AdaptationRules = ADAPTATION_RULES
) -> tuple[str, ...]:
    """Note that the noise was smoothed, where the frames differ by more than neighbouring pixels do.

    `estimate_noise` looks at neighbours, which JPEG, demosaicing and denoising make alike; the residual of the
    frames over a few fringes contains the rest too, with the surface's own roughness. Of all parts of the picture the
    smoothest fifth counts, so that ridges and edges look like nothing of the kind.
    """
    if phase_shifts is None:
        return ()
    ratio = phase_shifts.quiet_noise / float(map_.noise.sigma(phase_shifts.background_level))
    if ratio < rules.noise_ratio:
        return ()
    return (
        f"the noise was smoothed (JPEG, demosaicing or denoising), or the surface is rough: over a few fringes the "
        f"frames scatter by {phase_shifts.quiet_noise:.2f} grey levels, {ratio:.1f} times what neighbouring pixels do; "
        f"u(phase) may be too small by that factor",
    )


def _degrees(phase_shifts: NDArray) -> str:
    return ", ".join(f"{angle:.2f}" for angle in np.rad2deg(phase_shifts) + 0.0)
