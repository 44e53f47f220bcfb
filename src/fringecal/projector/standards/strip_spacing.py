"""The distance of the strips by the grid's scale against the one that their target states: two rulers, one picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.projector.standards.strip_phase import StripPhase
from fringecal.targets import Quantity, Strips
from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]

_LEAST_STRIPS = 3  # whole ones: of two the scatter of their places is not known
_BIN_PX = 0.5  # across, in which the phase is averaged along the strips
_REACH, _MARGIN = 0.45, 0.25  # of the narrower of strip and gap: about an edge, and off the edges for the levels
_LEAST_SHARE = 0.2  # of the usual pixels in a bin, for its mean to count
_LEAST_STEP = 0.3  # of a turned phase (2 sin of half the step), below which noise of the levels moves an edge
_BORDER_PX = 2.0  # from the picture's border, within which an edge is the border's


@dataclass(frozen=True)
class StripSpacing:
    """Mean distance of neighbouring strips, mm: `by_grid` on the picture with the grid's scale, and as `stated`."""

    by_grid: Estimate
    stated: Estimate

    @property
    def ratio(self) -> float:
        """Return by how much the grid's scale is too large, if the strips are right."""
        return self.by_grid.value / self.stated.value


def strip_spacing(found: StripPhase, step_rad: Array, camera: PlateCamera) -> StripSpacing | None:
    """Measure the distance of the strips with the grid's scale; None where fewer than three are seen whole.

    Parameters
    ----------
    found
        The strips in the picture.
    step_rad
        Phase with strips less that of the bare plate, any multiple of 2 pi, rad, (H, W); NaN where either is masked.
    camera
        The camera on the plate, by the grid.

    Notes
    -----
    An edge lies where the phase, averaged along it, is half way from that of the plate to that of the strip. A straight
    line through the middles of the strips against those of the target. What moves both edges of all strips
    alike (light that fades at edges, shadow) moves no distance. u of the middles is their scatter about the line; u of
    the scale is the camera's, u of the target that of widths and gaps: one value for all is one common error.
    """
    target = found.target
    if target is None or target.gap_mm is None:
        return None
    edges = _edges(found, np.exp(1j * (step_rad - found.plate_drift_rad)))
    whole = np.intersect1d(_whole(found), np.flatnonzero(np.isfinite(edges).all(axis=1)))
    if whole.size < _LEAST_STRIPS:
        return None
    widths, gaps = target.width_mm.array(target.count), target.gap_mm.array(target.count - 1)
    starts = np.concatenate([[0.0], np.cumsum(widths[:-1] + gaps)])
    stated = (starts + widths / 2)[whole]
    scale = camera.scale("mean")
    seen = edges[whole].mean(axis=1) * scale.value
    slope, u_slope = _slope(stated, seen)
    pitch = float(np.ptp(stated) / (whole[-1] - whole[0]))
    u_pitch = _u_of_pitch(target, whole)
    u_seen = pitch * float(np.hypot(u_slope, slope * scale.u / scale.value))
    return StripSpacing(
        Estimate(slope * pitch, u_seen, "mm", "distance of strips by the grid"),
        Estimate(pitch, u_pitch, "mm", "distance of strips as stated"),
    )


def _whole(found: StripPhase) -> NDArray[np.intp]:
    """Return the strips of which both edges lie in the picture, from 0."""
    across, edges = found.regions.across_px, found.regions.edges_px
    low, high = float(across.min()) + _BORDER_PX, float(across.max()) - _BORDER_PX
    inside = (edges[:, 0] > low) & (edges[:, 1] < high)
    seen = np.isin(np.arange(1, len(edges) + 1), found.regions.seen)
    return np.flatnonzero(inside & seen)


def _edges(found: StripPhase, turned: NDArray[np.complex128]) -> Array:
    """Return where each strip begins and ends, px across, (count, 2), by the phase between plate and top."""
    across, coarse = found.regions.across_px, found.regions.edges_px
    known = np.isfinite(turned)
    start = float(across.min())
    place = ((across[known] - start) / _BIN_PX).astype(np.intp)
    count = np.bincount(place)
    mean = np.bincount(place, turned[known].real) + 1j * np.bincount(place, turned[known].imag)
    centre = np.asarray(start + _BIN_PX * (np.arange(mean.size) + 0.5), np.float64)
    some = count > _LEAST_SHARE * np.median(count[count > 0])  # along the pixels every other bin is empty
    where = np.bincount(place, across[known])[some] / count[some]
    known_mean = mean[some] / count[some]
    mean = np.interp(centre, where, known_mean.real) + 1j * np.interp(centre, where, known_mean.imag)
    gaps = np.concatenate([[np.inf], coarse[1:, 0] - coarse[:-1, 1], [np.inf]])
    edges = np.full(coarse.shape, np.nan)
    for k, (low, high) in enumerate(coarse):
        top = _level(mean, centre, low, high)
        for side, (edge, gap) in enumerate(((low, gaps[k]), (high, gaps[k + 1]))):
            reach = min(gap, high - low)
            beside = _level(mean, centre, *sorted((edge, edge + (2 * side - 1) * reach)))
            edges[k, side] = _half_way(mean, centre, edge, _REACH * reach, (beside, top)[:: 1 - 2 * side])
    return edges


def _level(mean: NDArray[np.complex128], centre: Array, low: float, high: float) -> complex:
    """Return the mean over the middle of an interval."""
    margin = _MARGIN * (high - low)
    inside = (centre > low + margin) & (centre < high - margin)
    return complex(mean[inside].mean()) if inside.any() else complex(np.nan)


def _half_way(
    mean: NDArray[np.complex128], centre: Array, edge: float, reach: float, levels: tuple[complex, ...]
) -> float:
    """Return where the phase passes half of the way from one level to the next, px; NaN where it does so never."""
    first, second = levels
    inside = np.abs(centre - edge) < reach
    if not abs(second - first) > _LEAST_STEP or inside.sum() < 3:  # noqa: PLR2004 -- a crossing and both sides
        return float("nan")
    part = ((mean[inside] - first) * np.conj(second - first)).real / abs(second - first) ** 2
    # The way below half, as length: for a rise from 0 to 1 it ends at the edge, whatever its flank.
    covered = np.clip(1 - part, 0, 1).sum() * _BIN_PX
    return float(centre[inside][0] - _BIN_PX / 2 + covered)


def _slope(stated: Array, seen: Array) -> tuple[float, float]:
    """Return the slope of a straight line, and its standard uncertainty by the scatter about it."""
    x = stated - stated.mean()
    slope = float(x @ seen / (x @ x))
    left = seen - seen.mean() - slope * x
    return slope, float(np.sqrt(left @ left / max(seen.size - 2, 1) / (x @ x)))


def _u_of_pitch(target: Strips, whole: NDArray[np.intp]) -> float:
    """Return u of the mean distance from the first to the last of some strips, mm."""
    first, last = int(whole[0]), int(whole[-1])
    width_u, gap_u = target.width_mm, target.gap_mm
    assert gap_u is not None
    parts = (_u_of_sum(width_u, target.count, first, last), _u_of_sum(gap_u, target.count - 1, first, last))
    return float(np.hypot(*parts)) / (last - first)


def _u_of_sum(quantity: Quantity, count: int, first: int, last: int) -> float:
    """Return u of the sum of some of a quantity's items: one value for all errs alike, values of their own do not."""
    us = quantity.u_array(count)[first:last]
    return float(us.sum() if len(quantity.values) == 1 else np.sqrt((us**2).sum()))
