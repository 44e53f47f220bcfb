"""The strips' phase, pixel by pixel: which strip, how high, and its absolute phase up to one common order."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.detect.strips import StripRegions, find_strips
from fringecal.errors import FitError
from fringecal.phase.demodulate import PhaseMap
from fringecal.phase.unwrap import unwrap
from fringecal.targets import Strips
from fringecal.uncertainty.estimates import Estimate

Array = NDArray[np.float64]

_MIN_PIECE = 40  # pixels; smaller pieces of a strip top are left out
_MOVED_RAD = 0.15  # median phase difference on bare plate above which plate or lamp moved between captures


@dataclass(frozen=True)
class StripPhase:
    """Strip tops with their smooth phase step over the plate.

    Parameters
    ----------
    regions
        Which pixel is which strip, and where the edges are.
    step_rad
        Phase of the strips minus phase of the bare plate, continuous over all strips, NaN elsewhere; common
        multiple of 2 pi still open.
    heights_mm
        Height of each strip, one estimate per strip.
    plate_drift_rad
        Median phase difference on the bare plate between the two captures: what moved meanwhile.
    """

    regions: StripRegions
    step_rad: Array
    heights_mm: tuple[Estimate, ...]
    plate_drift_rad: float

    def groups(self) -> dict[float, tuple[int, ...]]:
        """Return the labels of the strips seen, by nominal height."""
        found: dict[float, tuple[int, ...]] = {}
        for label in self.regions.seen:
            height = self.heights_mm[label - 1].value
            found[height] = (*found.get(height, ()), label)
        return found


def measure_strips(
    reference: PhaseMap, strips: PhaseMap, target: Strips, scale_mm_per_px: float
) -> StripPhase:
    """Find the strips by the phase they add and make that step continuous from strip to strip.

    Parameters
    ----------
    reference, strips
        Phase of the bare plate and of the plate with strips.
    target
        Count, width, gap and height of the strips.
    scale_mm_per_px
        Mean scale.

    Raises
    ------
    DetectionError
        The strips do not show.
    FitError
        Plate or lamp moved between the two captures.
    """
    valid = reference.valid & strips.valid
    step = np.where(valid, np.angle(np.exp(1j * (strips.phase.astype(float) - reference.phase))), 0.0)
    width = float(np.mean(target.width_mm.values))
    gap = float(np.mean(target.gap_mm.values)) if target.gap_mm is not None else width
    regions = find_strips(
        step, valid, count=target.count, width_px=width / scale_mm_per_px, gap_px=gap / scale_mm_per_px
    )
    drift = _plate_drift(step, regions)
    heights = tuple(
        target.height_mm.estimate("strip height", "mm", item=i) for i in range(target.count)
    )
    return StripPhase(regions, _continuous(step, regions, heights), heights, drift)


def _plate_drift(step: Array, regions: StripRegions) -> float:
    plate = step[regions.labels == 0]
    if plate.size == 0:
        return math.nan
    drift = float(np.angle(np.mean(np.exp(1j * plate))))
    if abs(drift) > _MOVED_RAD:
        raise FitError(
            f"On the bare plate beside the strips the phase differs by {drift:+.2f} rad from the reference capture: "
            "plate, lamp or mirror moved between the two. Take reference and strips again without touching the rig."
        )
    return drift


def _continuous(step: Array, regions: StripRegions, heights: tuple[Estimate, ...]) -> Array:
    """Unwrap within each strip, then line the strips up by extrapolating those already done."""
    result = np.full(step.shape, np.nan)
    pieces = unwrap(step, regions.labels > 0)
    v, u = np.mgrid[: step.shape[0], : step.shape[1]]
    done: list[tuple[Array, Array, Array]] = []
    for piece in _by_size_then_nearness(pieces.pieces, regions):
        inside = pieces.pieces == piece
        label = int(np.median(regions.labels[inside]))
        height = heights[label - 1].value
        values = pieces.phase[inside]
        if done:
            predicted = _extrapolated(done, u[inside], v[inside]) * height
            values = values + 2 * math.pi * np.round(np.median(predicted - values) / (2 * math.pi))
        result[inside] = values
        done.append((u[inside].astype(float), v[inside].astype(float), values / height))
    return result


def _by_size_then_nearness(pieces: NDArray[np.int32], regions: StripRegions) -> list[int]:
    """Largest piece first, then outward strip by strip, so that extrapolation always reaches one strip far."""
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    found = [int(k) for k in np.flatnonzero(sizes >= _MIN_PIECE)]
    if not found:
        raise FitError("No strip top has enough valid pixels: more light, wider strips or finer pixels are needed.")
    places = {k: float(np.mean(regions.across_px[pieces == k])) for k in found}
    first = max(found, key=lambda k: sizes[k])
    return sorted(found, key=lambda k: (abs(places[k] - places[first]), -sizes[k]))


def _extrapolated(done: list[tuple[Array, Array, Array]], u: NDArray[np.int_], v: NDArray[np.int_]) -> Array:
    """Step per mm of strip height, by a low polynomial through the strips already lined up."""
    us, vs, values = (np.concatenate([d[i][:: max(1, d[i].size // 2000)] for d in done]) for i in range(3))
    centre = (float(us.mean()), float(vs.mean()))
    size = max(float(np.ptp(us)), float(np.ptp(vs)), 1.0)

    def design(a: Array, b: Array) -> Array:
        s, t = (a - centre[0]) / size, (b - centre[1]) / size
        return np.column_stack([np.ones_like(s), s, t, s * s, s * t, t * t][: 3 if len(done) < 3 else 6])

    # One or two strips say nothing of the curvature across: a ridge keeps the fit from inventing it.
    matrix = design(us, vs)
    ridge = 1e-3 * us.size * np.diag([0.0, *[1.0] * (matrix.shape[1] - 1)])
    coefficients = np.linalg.solve(matrix.T @ matrix + ridge, matrix.T @ values)
    return design(u.astype(float), v.astype(float)) @ coefficients
