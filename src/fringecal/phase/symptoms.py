"""What can be wrong with a phase-shifted set, one test for each cause; `doctor.diagnose` runs them all.

Every test looks at what its cause does first hand (two equal frames, a frame's background, a harmonic), because
the ripple of the phase alone names a family only: order 1 a frame's brightness, order 2 steps, order N gamma.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from fringecal.phase.blocks import Block
from fringecal.phase.demodulate import PhaseMap, Reason
from fringecal.phase.period import FringePeriod
from fringecal.phase.steps import StepEstimate
from fringecal.phase.waveform import Waveform, phase_error, ripple_rms

LEAST_COST_RAD = 0.004
"""A systematic error of the phase below this (rms) is not worth a word: the noise of one good pixel is 0.01."""

EQUAL_SHARE = 0.15
"""Two frames are of one step if they differ by less than this share of what frames of this set differ by."""

LEAST_GAIN_ERROR = 0.01
LEAST_BLUR = 0.04
LEAST_CLIPPING = 0.045
LEAST_SECOND_HARMONIC = 0.04
LEAST_RIPPLE_RAD = 0.012
LEAST_SATURATED = 0.003
LEAST_CONTRAST = 0.25
LEAST_PERIOD_PX = 6.0
LEAST_FRINGES = 4.0
LEAST_GRADIENT_RAD = np.deg2rad(0.7)
_SIGNIFICANT = 4.0
_CHANCE = 1e-4
_MISORDERED = 0.3
_SAMPLES_ALONG = 160
_MOST_PERMUTED = 6


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Parameters
    ----------
    name
        Short and fixed, for programs and tables.
    what
        What the frames show.
    how_large
        Its size, in words and numbers.
    cost_rad
        What it does to the phase, rms over a fringe, rad; None where pixels are lost rather than wrong.
    remedy
        What to do.
    cost_mm
        The same as height, mm, where the scale is known.
    """

    name: str
    what: str
    how_large: str
    cost_rad: float | None
    remedy: str
    cost_mm: float | None = None


@dataclass(frozen=True)
class Evidence:
    """What the tests look at; what could not be measured is None or empty.

    Parameters
    ----------
    frames
        Sparse sample of the lit part of the picture, grey levels, (N, M).
    steps_rad
        Stated steps, rad, (N,).
    map
        The set demodulated with them.
    period, steps, blocks, wave
        As measured.
    reference, reference_period
        The same sample of the reference frames, (N, M), and their fringe period.
    """

    frames: NDArray[np.float64]
    steps_rad: NDArray[np.float64]
    map: PhaseMap
    period: FringePeriod | None = None
    steps: StepEstimate | None = None
    blocks: list[Block] = field(default_factory=list)
    wave: Waveform | None = None
    reference: NDArray[np.float64] | None = None
    reference_period: FringePeriod | None = None


def sparse(frames: NDArray) -> NDArray[np.float64]:
    """Return every so many pixels that are lit and finite, grey levels, (N, M)."""
    step = max(1, -(-max(frames.shape[1:]) // _SAMPLES_ALONG))
    sample = frames[:, ::step, ::step].reshape(len(frames), -1).astype(np.float64)
    level = sample.mean(axis=0)
    finite = np.isfinite(level)
    if not finite.any():
        return np.zeros((len(sample), 1))
    lit = finite & (level > 0.2 * np.percentile(level[finite], 95))
    return sample[:, lit if lit.any() else finite]


def _differences(frames: NDArray) -> dict[tuple[int, int], float]:
    """Return the rms difference of every pair of frames."""
    pairs = combinations(range(len(frames)), 2)
    return {(i, j): float(np.sqrt(np.mean((frames[i] - frames[j]) ** 2))) for i, j in pairs}


def duplicates(evidence: Evidence) -> Iterator[Finding]:
    """Find frames that show the same step: copies bit by bit (stale), or taken anew (duplicate)."""
    differences = _differences(evidence.frames)
    typical = max(differences.values())
    noise = float(evidence.map.noise.sigma(evidence.frames.mean())) * np.sqrt(2)
    for (i, j), difference in differences.items():
        apart = np.angle(np.exp(1j * (evidence.steps_rad[i] - evidence.steps_rad[j])))
        if abs(apart) < 0.1 or difference > EQUAL_SHARE * typical or typical < 3 * noise:
            continue
        copied = difference == 0
        yield Finding(
            "stale frame" if copied else "duplicate frames",
            f"frames {i + 1} and {j + 1} are {'the same picture, bit by bit' if copied else 'of the same step'}",
            f"they differ by {difference:.2f} grey levels rms, others by {typical:.0f}",
            abs(float(apart)) / np.sqrt(6),
            "wait for a new picture before storing it, and take the set again"
            if copied
            else "the fringes were not moved between them: take the set again",
        )


def misordered(evidence: Evidence) -> Iterator[Finding]:
    """Find frames in another order than their steps, from the misfit of four frames and more."""
    n = len(evidence.frames)
    if n < 4:
        return
    steps = evidence.steps_rad
    design = np.column_stack([np.ones(n), np.cos(steps), -np.sin(steps)])
    outside = np.eye(n) - design @ np.linalg.pinv(design)
    power = np.cov(evidence.frames, bias=True)
    noise = float(evidence.map.noise.sigma(evidence.frames.mean())) ** 2 * (n - 3)
    as_stated = float(np.trace(outside @ power))
    orders = list(permutations(range(n))) if n <= _MOST_PERMUTED else list(_exchanges(n))
    misfits = np.array([float(np.trace(outside @ power[np.ix_(order, order)])) for order in orders])
    best = orders[int(misfits.argmin())]
    if misfits.min() < _MISORDERED * as_stated and as_stated > 10 * noise and as_stated > 0.05 * np.trace(power):
        yield Finding(
            "swapped frames",
            f"the frames fit the stated steps in the order {', '.join(str(k + 1) for k in best)}",
            f"misfit {np.sqrt(as_stated / n):.1f} grey levels as given, {np.sqrt(misfits.min() / n):.1f} in that order",
            float(np.pi / 2),
            "put the files into the order of steps_deg",
        )


def _exchanges(n: int) -> Iterator[tuple[int, ...]]:
    """Give all orders in which two of n have changed places."""
    for i, j in combinations(range(n), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        yield tuple(order)


def mirrored(evidence: Evidence) -> Iterator[Finding]:
    """Find a phase that falls where the reference's rises: three steps in another order look perfect alone."""
    if evidence.period is None or evidence.reference_period is None:
        return
    here, there = (np.array(p.gradient_rad_px) for p in (evidence.period, evidence.reference_period))
    cosine = float(here @ there / np.hypot(*here) / np.hypot(*there))
    if cosine < -0.5:
        yield Finding(
            "swapped frames",
            "the phase falls where that of the reference rises",
            f"directions {evidence.period.direction_deg:.0f} and {evidence.reference_period.direction_deg:.0f} deg",
            float(np.pi / np.sqrt(3)),
            "two frames of one of the sets have changed places, or the fringes were moved the other way: "
            "check the order of the files",
        )


def foreign(evidence: Evidence) -> Iterator[Finding]:
    """Find a frame of an object set that still shows the reference."""
    reference = evidence.reference
    if reference is None or reference.shape != evidence.frames.shape:
        return
    differences = np.sqrt(np.mean((evidence.frames[:, None] - reference) ** 2, axis=2))
    noise = float(evidence.map.noise.sigma(evidence.frames.mean())) * np.sqrt(2)
    differences = differences.min(axis=1)  # frames in another order are another fault
    worst, rest = int(differences.argmin()), np.delete(differences, differences.argmin())
    if differences[worst] < 2 * noise and rest.min() > 4 * max(differences[worst], noise):
        yield Finding(
            "stale frame",
            f"frame {worst + 1} shows the reference and not what the other frames show",
            f"it differs from the reference by {differences[worst]:.1f} grey levels rms, others by {rest.min():.0f}",
            float(np.pi / np.sqrt(3)),
            "take the set again and wait for a new picture after placing the object",
        )


def saturated(evidence: Evidence) -> Iterator[Finding]:
    """Find clipped crests: pixels at the white level."""
    share = float(((evidence.map.reasons & Reason.SATURATED) > 0).mean())
    if share > LEAST_SATURATED:
        yield Finding(
            "saturation",
            "pixels reach the white level at the crest of the fringes and are masked",
            f"{share:.1%} of the picture",
            None,
            "shorten the exposure or close the aperture until the crests are at 80 % of the white level",
        )


def brightness(evidence: Evidence) -> Iterator[Finding]:
    """Find frames of other brightness (lamp) or of weaker fringes at the same brightness (vibration)."""
    if len(evidence.blocks) == 0:
        return
    modulation, u_modulation = _relative(np.abs([block.signal for block in evidence.blocks]))
    background, u_background = _relative(np.array([block.background for block in evidence.blocks]))
    blurred = modulation - background
    worst = int(np.abs(background).argmax())
    if abs(background[worst]) > max(LEAST_GAIN_ERROR, _SIGNIFICANT * u_background[worst]):
        level = float(np.median([b.background.mean() / np.abs(b.signal).mean() for b in evidence.blocks]))
        error = phase_error(evidence.steps_rad, gains=1 + modulation, offsets=level * background)
        yield Finding(
            "lamp drift",
            f"frame {worst + 1} is {'brighter' if background[worst] > 0 else 'darker'} than the set's mean",
            f"{background[worst]:+.1%} in background, {modulation[worst]:+.1%} in modulation",
            ripple_rms(error),
            "let the lamp warm up, keep room light out; equalise() removes what is the same all over the picture",
        )
    weakest = int(blurred.argmin())
    u_blurred = float(np.hypot(u_modulation[weakest], u_background[weakest]))
    if -blurred[weakest] > max(LEAST_BLUR, _SIGNIFICANT * u_blurred) and abs(background[worst]) < LEAST_BLUR:
        yield Finding(
            "vibration",
            f"the fringes of frame {weakest + 1} are weaker at the same brightness: they moved while it was exposed",
            f"{blurred[weakest]:+.1%} in modulation",
            ripple_rms(phase_error(evidence.steps_rad, gains=1 + modulation)),
            "let the rig come to rest before each frame, or use a shorter exposure; take the set again",
        )


def _relative(values: NDArray) -> tuple[NDArray, NDArray]:
    """Return the median deviation of each frame from the mean of its block, and its standard uncertainty."""
    relative = values / values.mean(axis=1, keepdims=True) - 1
    centre = np.median(relative, axis=0)
    spread = 1.4826 * np.median(np.abs(relative - centre), axis=0)
    return centre, 1.2533 * spread / np.sqrt(len(values))


def wrong_steps(evidence: Evidence) -> Iterator[Finding]:
    """Find steps that are not as stated, or that change over the field."""
    steps = evidence.steps
    if steps is None:
        return
    error = phase_error(steps.stated_rad, true_steps_rad=steps.steps_rad)
    worst = int(np.abs(steps.errors_rad).argmax())
    sure = abs(steps.errors_rad[worst]) > steps.coverage(_CHANCE) * steps.u_rad[worst]
    if sure and ripple_rms(error) > LEAST_COST_RAD:
        found = ", ".join(f"{angle:.2f}" for angle in np.rad2deg(steps.steps_rad))
        yield Finding(
            "wrong steps",
            f"the frames' steps are {found} deg",
            f"up to {np.rad2deg(steps.errors_rad[worst]):+.2f} deg (u {np.rad2deg(steps.u_rad[worst]):.2f}) "
            "from those stated",
            ripple_rms(error),
            "state the found steps; or set the mirror more finely",
        )
    height, width = evidence.map.phase.shape
    over_field = steps.gradient_rad_px * [width, height]
    known = np.abs(steps.gradient_rad_px) > steps.coverage(_CHANCE) * steps.u_gradient_rad_px
    # A slope among blocks that scatter as much as it rises may as well be the object's doing.
    scatter = steps.u_rad[:, None] * np.sqrt(steps.n_blocks)
    known &= np.abs(over_field) / np.sqrt(12) > scatter
    largest = float(np.abs(np.where(known, over_field, 0.0)).max())
    if largest > LEAST_GRADIENT_RAD:
        yield Finding(
            "uneven steps",
            "a step is not the same all over the field: the fringes turned or stretched as they were moved",
            f"{np.rad2deg(largest):.2f} deg from edge to edge",
            largest / 2 / np.sqrt(6),
            "correct_steps() removes a change that is linear over the field",
        )


def waveform(evidence: Evidence) -> Iterator[Finding]:
    """Find fringes that are no cosine: a gamma, or a clipped slide."""
    wave = evidence.wave
    if wave is None:
        return
    second, third = float(wave.ratios[0].real), float(wave.ratios[1].real)
    cost = ripple_rms(phase_error(evidence.steps_rad, ratios=wave.ratios))
    of_gamma = second * (wave.gamma - 2) / (wave.gamma + 3)
    clipped = third - of_gamma
    if abs(clipped) > max(LEAST_CLIPPING, _SIGNIFICANT * wave.u[1]):
        yield Finding(
            "clipped slide",
            "the fringes have flat tops or bottoms: the slide or the projector clips them",
            f"third harmonic {third:+.1%} of the first, where gamma would give {of_gamma:+.1%}",
            cost,
            "lower the contrast of the printed or displayed fringes; take four steps or more",
        )
        return
    harm = ripple_rms(phase_error(evidence.steps_rad, ratios=[second, of_gamma]))
    large = abs(second) > LEAST_SECOND_HARMONIC or harm > LEAST_RIPPLE_RAD
    if large and abs(second) > _SIGNIFICANT * wave.u[0]:
        yield Finding(
            "gamma",
            "projector or camera does not answer in proportion to light",
            f"exponent {wave.gamma:.2f} (u {wave.u_gamma:.2f}): second harmonic {second:+.1%} of the first",
            cost,
            "switch gamma off in projector and camera; correct_gamma() undoes it; four steps or more resist it",
        )


def contrast(evidence: Evidence) -> Iterator[Finding]:
    """Find fringes that are weak against their background."""
    map_ = evidence.map
    lit = (map_.reasons & (Reason.DARK | Reason.OUTSIDE | Reason.SATURATED)) == 0
    if not map_.valid.any():
        return
    use = map_.valid & lit
    ratio = float(np.median(map_.modulation[use] / np.maximum(map_.background[use], 1e-6))) if use.any() else 0.0
    if ratio < LEAST_CONTRAST:
        yield Finding(
            "defocus",
            "the fringes are weak against their background: out of focus, or drowned in other light",
            f"modulation is {ratio:.0%} of the background, where a sharp slide gives 60 to 90 %",
            float(np.median(map_.sigma[use])) if use.any() else None,
            "focus the projector on the plate, shade the room light",
        )


def sampling(evidence: Evidence) -> Iterator[Finding]:
    """Find fringes too short for the camera or too long for the picture."""
    period = evidence.period
    if period is None:
        return
    height, width = evidence.map.phase.shape
    direction = np.deg2rad(period.direction_deg)
    length = width * abs(np.cos(direction)) + height * abs(np.sin(direction))
    if period.period_px < LEAST_PERIOD_PX:
        yield Finding(
            "too few pixels per fringe",
            "a pixel averages over a large part of a fringe, and edges mix fringes",
            f"{period.period_px:.1f} px per fringe; 8 to 40 are good",
            None,
            "use a coarser slide or a closer camera",
        )
    elif length / period.period_px < LEAST_FRINGES:
        yield Finding(
            "too many pixels per fringe",
            "there are few fringes in the picture: a height moves the phase little",
            f"{period.period_px:.0f} px per fringe, {length / period.period_px:.1f} fringes in the picture",
            None,
            "use a finer slide; keep this one for the fringe order",
        )


TESTS = (
    duplicates,
    misordered,
    mirrored,
    foreign,
    saturated,
    brightness,
    wrong_steps,
    waveform,
    contrast,
    sampling,
)
