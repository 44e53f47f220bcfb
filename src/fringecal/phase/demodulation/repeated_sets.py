"""The same set taken several times: their mean, and whether anything moved between them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import wrap
from fringecal.phase.demodulation.demodulate import demodulate
from fringecal.phase.demodulation.phase_shifts import SIGNIFICANT, estimate_steps
from fringecal.phase.diagnostics.evidence import Finding
from fringecal.phase.diagnostics.finding_kinds import FindingKind

LEAST_SHIFT_RAD = 0.01
"""Rms movement between repeats that is worth a word: 0.15 % of a fringe, the noise of one good pixel."""

_LEAST_PIXELS = 100  # with a phase in all repeats: fewer are stray light
_BATCHES = 64  # means of neighbours, whose scatter is the uncertainty, known to 9 %


@dataclass(frozen=True)
class RepeatScatter:
    """How far repeated sets moved against each other.

    Parameters
    ----------
    shift_rad
        Mean phase of each repeat against the mean of all, rad, (R,).
    u_shift_rad
        Standard uncertainty of one of them, rad, from the scatter over the picture.
    steps_rad
        Deviation of each step from its mean over the repeats, rad, (R, N); zero where steps cannot be measured.
    u_steps_rad
        Standard uncertainty of one of them, rad.
    copies
        Pairs of repeats (from 0) of which a frame is the same bit by bit.
    """

    shift_rad: NDArray[np.float64]
    u_shift_rad: float
    steps_rad: NDArray[np.float64]
    u_steps_rad: float
    copies: tuple[tuple[int, int], ...]

    @property
    def moved_rad(self) -> float:
        """Return the rms movement between repeats that noise does not explain, whole sets and single frames, rad."""
        repeats = len(self.shift_rad)
        whole = self.shift_rad.var() * repeats / (repeats - 1) - self.u_shift_rad**2
        frames = (self.steps_rad**2).sum() / max(self.steps_rad[:, 1:].size, 1) - self.u_steps_rad**2
        return float(np.sqrt(max(whole, 0.0) + max(frames, 0.0)))


def compare_repeats(sets: ArrayLike, steps_rad: ArrayLike, *, white_level: float | None = None) -> RepeatScatter:
    """Compare repeats of one set: whether the phase of the whole, or of single frames, changes between them.

    Parameters
    ----------
    sets
        Grey values, (R, N, H, W), R >= 2.
    steps_rad
        Stated steps, rad, (N,).
    white_level
        Saturation, grey levels.

    Notes
    -----
    Between repeats everything but noise and movement cancels: gamma, wrong steps and shading are the same in all.
    The mean difference to the first repeat is taken over the picture; its uncertainty from the means of patches,
    as neighbours and the ripple's crests hang together.

    Raises
    ------
    PhaseError
        Fewer than two repeats, or no pixel with a phase in all of them.
    """
    grey = np.asarray(sets)
    if grey.ndim != 4 or grey.shape[0] < 2:
        raise PhaseError(f"found an array of shape {grey.shape}; repeats need (R, N, H, W) with R >= 2")
    maps = [demodulate(one, steps_rad, white_level=white_level, max_misfit=np.inf) for one in grey]
    valid = np.logical_and.reduce([map_.valid for map_ in maps])
    if np.count_nonzero(valid) < _LEAST_PIXELS:
        raise PhaseError(
            f"found {np.count_nonzero(valid)} pixels with a phase in all {len(grey)} repeats, {_LEAST_PIXELS} are "
            "needed: something moved between them, or the exposure changed"
        )
    first = maps[0].phase[valid].astype(np.float64)
    differences = [wrap(map_.phase[valid] - first) for map_ in maps]
    shifts = np.array([np.median(difference) for difference in differences])
    u = max((_u_of_mean(difference) for difference in differences[1:]), default=0.0)
    steps, u_steps = _steps(grey, steps_rad, white_level)
    return RepeatScatter(shifts - shifts.mean(), u, steps, u_steps, _copies(grey))


def _u_of_mean(values: NDArray) -> float:
    """Return the standard uncertainty of a mean over a picture from the means of batches of neighbours."""
    batches = [part.mean() for part in np.array_split(values, min(_BATCHES, values.size // 2))]
    return float(np.std(batches, ddof=1) / np.sqrt(len(batches)))


def _steps(grey: NDArray, stated: ArrayLike, white_level: float | None) -> tuple[NDArray, float]:
    """Return the steps of each repeat against their mean, and the uncertainty of one; zeros where unknown."""
    try:
        found = [estimate_steps(one, stated, white_level=white_level) for one in grey]
    except PhaseError:
        return np.zeros((len(grey), grey.shape[1])), 0.0
    steps = np.array([one.steps_rad for one in found])
    return steps - steps.mean(axis=0), float(np.median([one.u_rad[1:] for one in found]))


def _copies(grey: NDArray) -> tuple[tuple[int, int], ...]:
    """Return pairs of repeats that hold a frame in common."""
    count = len(grey)
    pairs = ((i, j) for i in range(count) for j in range(i + 1, count))
    return tuple((i, j) for i, j in pairs if any(np.array_equal(a, b) for a, b in zip(grey[i], grey[j], strict=True)))


def findings_of_repeats(scatter: RepeatScatter) -> tuple[Finding, ...]:
    """Name what is wrong between repeats: movement, or a picture stored twice."""
    findings = []
    if scatter.copies:
        i, j = scatter.copies[0]
        findings.append(
            Finding(
                FindingKind.STALE_FRAME,
                f"repeats {i + 1} and {j + 1} share a picture bit by bit",
                f"{len(scatter.copies)} pairs of {len(scatter.shift_rad)} repeats",
                None,
                "wait for a new picture before storing it, and take the repeats again",
            )
        )
    u = np.hypot(scatter.u_shift_rad, scatter.u_steps_rad)
    if scatter.moved_rad > max(LEAST_SHIFT_RAD, SIGNIFICANT * u):
        largest = float(np.abs(scatter.shift_rad).max())
        single = float(np.abs(scatter.steps_rad).max())
        findings.append(
            Finding(
                FindingKind.VIBRATION_BETWEEN_REPEATS,
                "the fringes lie elsewhere from repeat to repeat: rig, plate or projector moved between frames",
                f"whole sets up to {largest:.3f} rad, single frames up to {single:.3f} rad",
                scatter.moved_rad,
                "let the rig come to rest, isolate it from the floor, take the repeats again",
            )
        )
    return tuple(findings)


def mean_of_repeats(sets: ArrayLike, *, white_level: float | None = None) -> NDArray[np.float32]:
    """Return the mean frames of repeated sets, float32, (N, H, W); a pixel once saturated stays saturated.

    Parameters
    ----------
    sets
        Grey values, (R, N, H, W).
    white_level
        Saturation, grey levels.
    """
    grey = np.asarray(sets)
    mean = grey.mean(axis=0, dtype=np.float32)
    if white_level is not None:
        mean[(grey >= white_level).any(axis=0)] = white_level
    return mean
