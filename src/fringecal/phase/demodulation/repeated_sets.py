"""The same set taken several times: its mean, and whether anything moved between the repeats."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import wrap
from fringecal.phase.demodulation.demodulate import demodulate
from fringecal.phase.demodulation.phase_shifts import SIGNIFICANT, estimate_phase_shifts
from fringecal.phase.diagnostics.evidence import Finding
from fringecal.phase.diagnostics.finding_kinds import FindingKind

LEAST_SHIFT_RAD = 0.01
"""Rms movement between repeats that is reported: 0.15 % of a fringe, the noise of one good pixel."""

_LEAST_PIXELS = 100  # with a phase in all repeats: fewer are stray light
_BATCHES = 64  # means of neighbours, whose scatter is the uncertainty, known to 9 %


@dataclass(frozen=True)
class RepeatScatter:
    """Movement between repeated sets.

    Parameters
    ----------
    shift_rad
        Mean phase of each repeat against the mean of all, rad, (R,).
    u_shift_rad
        Standard uncertainty of one of them, rad, from the scatter over the picture.
    deviation_rad
        Deviation of each phase shift from its mean over the repeats, rad, (R, N); zero where they cannot be measured.
    u_deviation_rad
        Standard uncertainty of one of them, rad.
    copies
        Pairs of repeats (from 0) of which a frame is the same bit by bit.
    """

    shift_rad: NDArray[np.float64]
    u_shift_rad: float
    deviation_rad: NDArray[np.float64]
    u_deviation_rad: float
    copies: tuple[tuple[int, int], ...]

    @property
    def moved_rad(self) -> float:
        """Return the rms movement between repeats that noise does not explain, whole sets and single frames, rad."""
        repeats = len(self.shift_rad)
        whole = self.shift_rad.var() * repeats / (repeats - 1) - self.u_shift_rad**2
        frames = (self.deviation_rad**2).sum() / max(self.deviation_rad[:, 1:].size, 1) - self.u_deviation_rad**2
        return float(np.sqrt(max(whole, 0.0) + max(frames, 0.0)))


def compare_repeats(sets: ArrayLike, phase_shifts_rad: ArrayLike, *, white_level: float | None = None) -> RepeatScatter:
    """Compare repeats of one set: whether the phase of the whole, or of single frames, changes between them.

    Parameters
    ----------
    sets
        Grey values, (R, N, H, W), R >= 2.
    phase_shifts_rad
        Stated phase shifts, rad, (N,).
    white_level
        Saturation, grey levels.

    Notes
    -----
    Between repeats everything but noise and movement cancels: gamma, wrong phase shifts and shading are the same.
    The mean difference to the first repeat is taken over the picture; its uncertainty from the means of patches,
    as neighbouring pixels and the ripple are correlated.

    Raises
    ------
    PhaseError
        Fewer than two repeats, or no pixel with a phase in all of them.
    """
    grey = np.asarray(sets)
    if grey.ndim != 4 or grey.shape[0] < 2:
        raise PhaseError(f"found an array of shape {grey.shape}; repeats need (R, N, H, W) with R >= 2")
    maps = [demodulate(one, phase_shifts_rad, white_level=white_level, max_residual=np.inf) for one in grey]
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
    phase_shifts, u_deviation = _phase_shifts(grey, phase_shifts_rad, white_level)
    return RepeatScatter(shifts - shifts.mean(), u, phase_shifts, u_deviation, _copies(grey))


def _u_of_mean(values: NDArray) -> float:
    """Return the standard uncertainty of a mean over a picture from the means of batches of neighbours."""
    batches = [part.mean() for part in np.array_split(values, min(_BATCHES, values.size // 2))]
    return float(np.std(batches, ddof=1) / np.sqrt(len(batches)))


def _phase_shifts(grey: NDArray, stated: ArrayLike, white_level: float | None) -> tuple[NDArray, float]:
    """Return the phase shifts of each repeat against their mean, and the uncertainty of one; zeros where unknown."""
    try:
        found = [estimate_phase_shifts(one, stated, white_level=white_level) for one in grey]
    except PhaseError:
        return np.zeros((len(grey), grey.shape[1])), 0.0
    phase_shifts = np.array([one.phase_shifts_rad for one in found])
    return phase_shifts - phase_shifts.mean(axis=0), float(np.median([one.u_rad[1:] for one in found]))


def _copies(grey: NDArray) -> tuple[tuple[int, int], ...]:
    """Return pairs of repeats that hold a frame in common."""
    count = len(grey)
    pairs = ((i, j) for i in range(count) for j in range(i + 1, count))
    return tuple((i, j) for i, j in pairs if any(np.array_equal(a, b) for a, b in zip(grey[i], grey[j], strict=True)))


def findings_of_repeats(scatter: RepeatScatter) -> tuple[Finding, ...]:
    """Return the findings between repeats: movement, or a picture stored twice."""
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
    u = np.hypot(scatter.u_shift_rad, scatter.u_deviation_rad)
    if scatter.moved_rad > max(LEAST_SHIFT_RAD, SIGNIFICANT * u):
        largest = float(np.abs(scatter.shift_rad).max())
        single = float(np.abs(scatter.deviation_rad).max())
        findings.append(
            Finding(
                FindingKind.VIBRATION_BETWEEN_REPEATS,
                "the fringes are displaced from repeat to repeat: rig, plate or projector moved between frames",
                f"whole sets up to {largest:.3f} rad, single frames up to {single:.3f} rad",
                scatter.moved_rad,
                "let the vibration decay, isolate it from the floor, take the repeats again",
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

    Examples
    --------
    >>> mean_of_repeats(np.stack([np.full((3, 1, 2), 10), np.full((3, 1, 2), 12)]))[0].tolist()
    [[11.0, 11.0]]
    """
    grey = np.asarray(sets)
    mean = grey.mean(axis=0, dtype=np.float32)
    if white_level is not None:
        mean[(grey >= white_level).any(axis=0)] = white_level
    return mean
