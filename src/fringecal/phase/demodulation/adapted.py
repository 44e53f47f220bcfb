"""Demodulation that trusts the frames more than what is stated of them, and says where it did.

Steps, brightness of each frame, steps that change over the field, and the shape of the fringes are measured first;
what differs significantly from the stated model and costs phase is undone, the rest is left as stated.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.phase.demodulation.corrections import correct_steps
from fringecal.phase.demodulation.demodulate import MISFIT_SHARE, PhaseMap, demodulate
from fringecal.phase.demodulation.phase_shifts import SIGNIFICANT, StepEstimate, steps_and_blocks
from fringecal.phase.demodulation.schemes import Scheme, least_squares
from fringecal.phase.demodulation.waveform import Waveform, correct_gamma, phase_error, ripple_rms, waveform_of_blocks

LEAST_CHANGE_RAD = np.deg2rad(0.7)
"""Change of a step from edge to edge below which it is left alone: 0.003 rad of ripple at the edge."""


@dataclass(frozen=True)
class AdaptationRules:
    """What is undone of what the frames show, and when the plate's wave shape no longer holds.

    Parameters
    ----------
    cost_rad
        Rms ripple below which uneven brightness is left alone, rad: a third of the noise of one good pixel.
    change_rad
        Change of a step from edge to edge below which it is left alone, rad.
    blocks_to_contradict
        Blocks that a set needs for its own wave shape to stand against the plate's: fewer say little of their scatter.
    same_harmonic
        Most that the second harmonics of set and plate may differ by, as shares of the first; an object's own shape
        shows as so much.
    noise_ratio
        Scatter of the frames over a few fringes against what neighbouring pixels show, from which u(phase) is said to
        be understated; the surface's own roughness explains less.
    """

    cost_rad: float = 0.003
    change_rad: float = LEAST_CHANGE_RAD
    blocks_to_contradict: int = 12
    same_harmonic: float = 0.03
    noise_ratio: float = 2.0


ADAPTATION_RULES = AdaptationRules()


@dataclass(frozen=True)
class Adapted:
    """A set demodulated with the model that its frames show.

    Parameters
    ----------
    map
        The phase map, corrected.
    scheme
        Steps, gains and backgrounds that were used.
    change_rad_px
        Change of each step over the field that was undone, rad/px along u and v, (N, 2); zero where none was.
    wave
        Shape of the fringes, of the plate or of these frames; None where it is not known.
    steps, found_wave
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
    steps: StepEstimate | None
    found_wave: Waveform | None
    undone: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def again(self, frames: ArrayLike, *, white_level: float | None = None) -> PhaseMap:
        """Demodulate other frames of the same set, such as filtered ones, with the same corrections."""
        return _demodulated(frames, self.scheme, self.change_rad_px, self.wave, white_level)


def demodulate_adapted(
    frames: ArrayLike,
    steps_rad: ArrayLike,
    *,
    white_level: float | None = None,
    wave: Waveform | None = None,
    rules: AdaptationRules = ADAPTATION_RULES,
) -> Adapted:
    """Demodulate a set and undo what its frames show to differ from the stated model.

    Parameters
    ----------
    frames
        Grey values, (N, H, W).
    steps_rad
        Stated steps, rad, (N,).
    white_level
        Saturation, grey levels.
    wave
        Shape of the fringes as found on the bare plate with the same projector and camera settings. It is used
        unless these frames contradict it.
    rules
        What is undone.

    Raises
    ------
    PhaseError
        Frames and steps that do not fit together, as in `demodulate`.
    """
    stated = np.asarray(steps_rad, np.float64).ravel()
    steps, found_wave, notes = _measured(frames, stated, white_level)
    scheme, undone = _scheme(stated, steps, rules)
    change = np.zeros((stated.size, 2))
    if steps is not None:
        shape = np.shape(frames)[1:]
        change, sentence = _change(steps, shape, rules)
        undone += sentence
    shape_used, said, doubts = _wave(scheme, found_wave, wave, rules)
    map_ = _demodulated(frames, scheme, change, shape_used, white_level)
    notes += doubts + smoothed_noise(map_, steps, rules=rules)
    return Adapted(map_, scheme, change, shape_used, steps, found_wave, undone + said, notes)


def _measured(
    frames: ArrayLike, stated: NDArray, white_level: float | None
) -> tuple[StepEstimate | None, Waveform | None, tuple[str, ...]]:
    """Measure steps, brightness and wave shape, or say why that is impossible."""
    try:
        steps, blocks = steps_and_blocks(frames, stated, white_level=white_level)
    except PhaseError as error:
        return None, None, (f"they could not be checked ({str(error).split('.')[0].rstrip(',;:')})",)
    return steps, waveform_of_blocks(blocks), ()


def _scheme(stated: NDArray, found: StepEstimate | None, rules: AdaptationRules) -> tuple[Scheme, tuple[str, ...]]:
    """Choose steps and brightness of the frames: as stated, or as found where that is significant."""
    if found is None:
        return least_squares(stated), ()
    undone = []
    steps = stated
    if found.significant:
        steps = found.steps_rad
        undone.append(f"{_degrees(steps)} deg were used")
    scheme = least_squares(steps)
    offsets = found.level_per_frame / found.modulation_level
    cost = ripple_rms(phase_error(scheme, gains=found.gain_per_frame, offsets=offsets))
    if found.uneven and cost > rules.cost_rad:
        scheme = least_squares(
            steps,
            name="equalised",
            gains=found.gain_per_frame,
            offsets=found.offset_per_frame,
            backgrounds=found.background_per_frame,
        )
        worst = float(np.abs(found.level_per_frame / found.background_level - 1).max())
        weakest = float(np.abs(found.gain_per_frame - 1).max())
        undone.append(
            f"the frames' brightness was made equal (background up to {worst:.1%}, modulation up to {weakest:.1%} "
            f"off the mean; it would cost {cost:.3f} rad)"
        )
    return scheme, tuple(undone)


def _change(steps: StepEstimate, shape: tuple[int, ...], rules: AdaptationRules) -> tuple[NDArray, tuple[str, ...]]:
    """Return the steps' change over the field where it is sure and matters."""
    change = steps.field_change_rad_px(shape)
    largest = float(np.abs(change * [shape[1], shape[0]]).max())
    if largest < rules.change_rad:
        return np.zeros_like(change), ()
    return change, (f"steps that change by {np.rad2deg(largest):.2f} deg from edge to edge were undone",)


def _wave(
    scheme: Scheme, found: Waveform | None, carried: Waveform | None, rules: AdaptationRules
) -> tuple[Waveform | None, tuple[str, ...], tuple[str, ...]]:
    """Choose the wave's shape: the plate's, unless these frames contradict it; and say so."""
    known = found is not None and found.n_blocks >= rules.blocks_to_contradict
    if carried is None:
        chosen, whence = found, "found in these frames"
    elif known and found is not None and _differ(found, carried, rules):
        chosen, whence = found, "found in these frames, as the plate's no longer fits"
    else:
        chosen, whence = carried, "found on the plate"
    doubts = ("the plate's wave shape could not be checked on them",) if carried is not None and not known else ()
    if chosen is None or not chosen.matters(scheme):
        return chosen, (), doubts
    cost = ripple_rms(phase_error(scheme, ratios=chosen.ratios))
    sentence = f"gamma was undone (exponent {chosen.gamma:.3f}, {whence}; it would cost {cost:.3f} rad)"
    return chosen, (sentence,), doubts


def _differ(found: Waveform, carried: Waveform, rules: AdaptationRules) -> bool:
    """Tell whether two second harmonics differ by more than chance and the surface explain."""
    apart = abs(found.ratios[0] - carried.ratios[0])
    return bool(apart > max(rules.same_harmonic, SIGNIFICANT * np.hypot(found.u[0], carried.u[0])))


def _demodulated(
    frames: ArrayLike, scheme: Scheme, change: NDArray, wave: Waveform | None, white_level: float | None
) -> PhaseMap:
    """Demodulate with all corrections."""
    # What the harmonics leave as a residual is no misfit once their cause is known; it counts per spare frame.
    count = len(scheme.steps_rad)
    harmonics = 0.0 if wave is None else float(np.abs(wave.ratios).sum())
    allowed = MISFIT_SHARE + harmonics * np.sqrt(count / max(count - 3, 1))
    map_ = demodulate(frames, scheme, white_level=white_level, max_misfit=allowed)
    if change.any():
        map_ = correct_steps(map_, scheme, change)
    return map_ if wave is None or not wave.matters(scheme) else correct_gamma(map_, scheme, wave)


def smoothed_noise(
    map_: PhaseMap, steps: StepEstimate | None, *, rules: AdaptationRules = ADAPTATION_RULES
) -> tuple[str, ...]:
    """Say so if the frames differ by more than neighbouring pixels do: then something has smoothed the noise.

    `estimate_noise` looks at neighbours, which JPEG, demosaicing and denoising make alike; the residual of the
    frames over a few fringes sees the rest too, with the surface's own roughness.
    """
    if steps is None:
        return ()
    ratio = steps.frame_noise / float(map_.noise.sigma(steps.background_level))
    if ratio < rules.noise_ratio:
        return ()
    return (
        f"the noise was smoothed (JPEG, demosaicing or denoising), or the surface is rough: over a few fringes the "
        f"frames scatter by {steps.frame_noise:.2f} grey levels, {ratio:.1f} times what neighbouring pixels show; "
        f"u(phase) may be understated as much",
    )


def _degrees(steps: NDArray) -> str:
    return ", ".join(f"{angle:.2f}" for angle in np.rad2deg(steps) + 0.0)
