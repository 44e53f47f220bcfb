"""Find parallel strips in a picture from the phase they add: which pixels are strip top, which are plate.

The strips' number, widths, gaps and length in pixels are known from the target and the scale; their direction
and place are found. The plate is where the phase did not change; a strip is where it did, by whatever amount.
Everything here is in pixels.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from fringecal.detect.strips.comb import Pixels, better_size, find_comb, refined_edges
from fringecal.detect.strips.likeness import plate_likeness, reduced
from fringecal.detect.strips.presence import strips_seen
from fringecal.errors import DetectionError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PLATE, EDGE = 0, -1
_SEARCH_WIDTH_PX = 9.0  # pictures are reduced until a strip or gap is about so wide ...
_REFINE_WIDTH_PX = 36.0  # ... and so wide where edges are measured
_LEAST_WIDTH_PX = 4  # of a strip or gap: two at either edge are blurred
_LEAST_PIXELS = 400  # with a phase: a picture of 20 px
_REFINE_SAMPLE = 500_000  # pixels at which edges are measured: hundreds for each of their bins of half a pixel
_REFINE_REACH = 0.3  # of the narrowest strip or gap, to either side of where the comb puts an edge
_MARGIN, _MOST_MARGIN = 0.1, 0.35  # of a strip's width, given to neither side at its edges besides `margin_px`; at most
_LIKE_PLATE = 0.5  # half of a pixel and its neighbours look like plate
_TABLE_PX = 0.25  # resolution at which the coordinate across is turned into labels


@dataclass(frozen=True)
class StripRegions:
    """Where the strips lie.

    Parameters
    ----------
    labels
        Map: 0 plate, 1..count the strip tops, -1 edge zones and pixels without phase.
    direction_deg
        Angle of the strips' length from +u toward +v, in [0, 180).
    across_px
        Map of the coordinate across the strips, in px.
    edges_px
        Lower and upper edge of each strip in that coordinate, shape (count, 2).
    size
        1, or by which factor strips and gaps would have to be larger to fit the picture far better.
    """

    labels: NDArray[np.int16]
    direction_deg: float
    across_px: Array
    edges_px: Array
    size: float = 1.0

    @property
    def seen(self) -> tuple[int, ...]:
        """Labels of the strips of which something is in the picture."""
        return tuple(int(k) for k in np.unique(self.labels) if k > 0)


def find_strips(
    difference_rad: ArrayLike,
    valid: ArrayLike,
    *,
    count: int,
    width_px: ArrayLike,
    gap_px: ArrayLike,
    margin_px: float = 2.0,
    straight_px: tuple[Array, Array] | None = None,
) -> StripRegions:
    """Find `count` strips from the wrapped phase difference strips minus plate.

    Parameters
    ----------
    difference_rad
        Phase of the strips' picture minus phase of the bare plate, any multiple of 2 pi, shape (H, W).
    valid
        Pixels where both phases are trustworthy.
    count, width_px, gap_px
        The strips' number, widths (one, or one each) and gaps (one, or one less than strips).
    margin_px
        Half-width of the zone at each edge that is given to neither side, besides a tenth of the width.
    straight_px
        Maps of the coordinates (u, v) in which strips are straight, where a lens or a tilt bends them in the
        picture; by default the pixels' own.

    Notes
    -----
    Where the step passes a whole fringe a strip looks like plate, as does the plate beyond a strip's end: both are
    given to no strip, so that nothing need be known of the strips' length.

    Raises
    ------
    DetectionError
        No pattern of strips: nothing on the plate, other strips, or a phase difference of a whole fringe.
    """
    step, usable = _checked(difference_rad, valid)
    layout = strip_layout(count, width_px, gap_px)
    u, v = _coordinates(step.shape) if straight_px is None else straight_px
    least = float(min(np.diff(layout, axis=1).min(), *(layout[1:, 0] - layout[:-1, 1]), math.inf))
    factor = max(1, int(least / _REFINE_WIDTH_PX))
    unchanged = plate_likeness(step, usable, factor)
    fine = _pixels(unchanged, u, v, factor)
    coarser = max(1, int(least / _SEARCH_WIDTH_PX))
    coarse = fine if coarser == factor else _pixels(plate_likeness(step, usable, coarser), u, v, coarser)
    comb = find_comb(coarse, layout, least)
    size = better_size(coarse, comb, layout, least)
    fine = fine.sample(_REFINE_SAMPLE)
    edges = refined_edges(fine, comb, _REFINE_REACH * least)
    seen = strips_seen(fine, comb, edges, layout)
    across = u * math.cos(comb.direction_rad) + v * math.sin(comb.direction_rad)
    labels = _labels(across, edges, seen, margin_px)
    labels[(labels > 0) & _spread(unchanged, step.shape, margin_px, factor)] = EDGE
    labels[~usable] = EDGE
    return StripRegions(labels, (math.degrees(comb.direction_rad) + 90.0) % 180.0, across, edges, size)


def strip_layout(count: int, width_px: ArrayLike, gap_px: ArrayLike) -> Array:
    """Return lower and upper edge of each strip, the first at 0, shape (count, 2).

    Raises
    ------
    DetectionError
        Strips or gaps without extent, or too narrow to be seen.
    """
    widths = np.broadcast_to(np.asarray(width_px, float), (count,))
    gaps = np.broadcast_to(np.asarray(gap_px, float), (max(count - 1, 0),))
    starts = np.concatenate([[0.0], np.cumsum(widths[:-1] + gaps)])
    layout = np.column_stack([starts, starts + widths])
    if not np.isfinite(layout).all() or min(widths.min(), gaps.min(initial=np.inf)) < _LEAST_WIDTH_PX:
        raise DetectionError(
            f"strips of {widths.min():.1f} px and gaps of {gaps.min(initial=math.inf):.1f} px cannot be "
            f"distinguished: at least {_LEAST_WIDTH_PX} px each are needed. Use wider strips, or a camera nearer to "
            "the plate."
        )
    return layout


def _checked(difference_rad: ArrayLike, valid: ArrayLike) -> tuple[Array, Mask]:
    step, usable = np.asarray(difference_rad, float), np.asarray(valid, bool)
    if step.ndim != 2 or step.shape != usable.shape:
        raise DetectionError(f"phase difference {step.shape} and mask {usable.shape} must be maps of one shape")
    usable = usable & np.isfinite(step)
    if np.count_nonzero(usable) < _LEAST_PIXELS:
        raise DetectionError(
            f"only {np.count_nonzero(usable)} pixels carry a phase both with and without strips: more light is needed"
        )
    return np.where(usable, step, 0.0), usable


def _coordinates(shape: tuple[int, ...]) -> tuple[Array, Array]:
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    return u, v


def _pixels(unchanged: tuple[Array, Mask], u: Array, v: Array, factor: int) -> Pixels:
    """Gather the blocks whose likeness to plate is known."""
    likeness, known = unchanged
    return Pixels(reduced(u, factor)[known], reduced(v, factor)[known], likeness[known])


def _spread(unchanged: tuple[Array, Mask], shape: tuple[int, ...], margin_px: float, factor: int) -> Mask:
    """Find pixels whose phase is the plate's, and their neighbours within the margin."""
    plate = ndimage.uniform_filter(np.where(unchanged[1], unchanged[0], 0.0), 3) > _LIKE_PLATE
    plate = ndimage.binary_dilation(plate, iterations=max(1, round(margin_px / factor)))
    if factor == 1:
        return plate
    whole = np.zeros(shape, bool)
    large = plate.repeat(factor, axis=0).repeat(factor, axis=1)
    whole[: large.shape[0], : large.shape[1]] = large
    return whole


def _labels(across: Array, edges: Array, seen: Mask, margin_px: float) -> NDArray[np.int16]:
    """Number the pixels by the strip they lie on, by a table over the coordinate across."""
    start = min(float(across.min()), float(edges.min())) - margin_px
    place = np.arange(start, max(float(across.max()), float(edges.max())) + margin_px + 1, _TABLE_PX)
    table = np.zeros(place.size, np.int16)
    for number in np.flatnonzero(seen):
        low, high = edges[number]
        margin = min(margin_px + _MARGIN * (high - low), _MOST_MARGIN * (high - low))
        table[(place > low - margin) & (place < high + margin)] = EDGE
        table[(place > low + margin) & (place < high - margin)] = number + 1
    return table[((across - start) * (1 / _TABLE_PX)).astype(np.int32)]
