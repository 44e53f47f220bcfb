"""Find parallel strips in a picture from the phase they add: which pixels are strip top, which are plate.

The strips' number, widths, gaps and length in pixels are known from the target and the scale; their direction
and place are found. The plate is where the phase did not change; a strip is where it did, by whatever amount.
Everything here is in pixels.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from fringecal.detect.strip_comb import Comb, Pixels, better_size, find_comb, refined_edges
from fringecal.errors import DetectionError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PLATE, EDGE = 0, -1
_SEARCH_WIDTH_PX = 9.0  # pictures are reduced until a strip or gap is about so wide ...
_REFINE_WIDTH_PX = 36.0  # ... and so wide where edges are measured
_SIZE_TOLERANCE = 0.2  # of a strip's width, besides two px, before the target is called wrong
_SEEN_CONTRAST = 0.35  # a strip with less of the others' contrast is not there, or shows a whole fringe
_LEAST_PLATE = 0.45  # share of plate pixels in the gaps that must agree with the reference
_LEAST_PIXELS = 400
_REFINE_SAMPLE = 500_000
_CLEAN_RAD = 0.08  # noise of the step below which smoothing would only blur the edges
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
    step_rad: ArrayLike,
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
    step_rad
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
        No pattern of strips: nothing on the plate, other strips, or a phase step of a whole fringe.
    """
    step, usable = _checked(step_rad, valid)
    layout = strip_layout(count, width_px, gap_px)
    u, v = _coordinates(step.shape) if straight_px is None else straight_px
    least = float(min(np.diff(layout, axis=1).min(), *(layout[1:, 0] - layout[:-1, 1]), math.inf))
    factor = max(1, int(least / _REFINE_WIDTH_PX))
    unchanged = _likeness(step, usable, factor)
    fine = _pixels(unchanged, u, v, factor)
    coarser = max(1, int(least / _SEARCH_WIDTH_PX))
    coarse = fine if coarser == factor else _pixels(_likeness(step, usable, coarser), u, v, coarser)
    comb = find_comb(coarse, layout, least)
    size = better_size(coarse, comb, layout, least)
    fine = fine.sample(_REFINE_SAMPLE)
    edges = refined_edges(fine, comb, 0.3 * least)
    seen = _seen(fine, comb, edges, layout)
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
    if not np.isfinite(layout).all() or min(widths.min(), gaps.min(initial=np.inf)) < 4:
        raise DetectionError(
            f"strips of {widths.min():.1f} px and gaps of {gaps.min(initial=math.inf):.1f} px cannot be told apart: at "
            "least 4 px each are needed. Use wider strips, or a camera nearer to the plate."
        )
    return layout


def _checked(step_rad: ArrayLike, valid: ArrayLike) -> tuple[Array, Mask]:
    step, usable = np.asarray(step_rad, float), np.asarray(valid, bool)
    if step.ndim != 2 or step.shape != usable.shape:
        raise DetectionError(f"phase step {step.shape} and mask {usable.shape} must be maps of one shape")
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
    return Pixels(_reduced(u, factor)[known], _reduced(v, factor)[known], likeness[known])


def _likeness(step: Array, usable: Mask, factor: int) -> tuple[Array, Mask]:
    """Map the agreement with the bare plate, 0 to 1, and where it is known.

    On a strip the step may be anything, even a whole fringe along some line, so only its absence is
    judged: over the noise, and over what the plate as a whole has drifted.
    """
    single = step.astype(np.float32)
    parts = [_reduced(np.where(usable, wave(single), np.float32(0)), factor) for wave in (np.sin, np.cos)]
    known = _reduced(usable.astype(np.float32), factor) > 0.6
    angle = np.arctan2(*parts)
    if factor == 1 and _noise(angle, known) > _CLEAN_RAD:
        angle = np.arctan2(*(ndimage.uniform_filter(part, 3) for part in parts))
    tolerance = float(np.clip(5 * _noise(angle, known) + 0.04, 0.08, 0.9))
    off = np.abs(angle - np.float32(_drift(angle[known], tolerance)))
    return np.clip(2 - np.minimum(off, 2 * math.pi - off) / tolerance, 0, 1), known


def _spread(unchanged: tuple[Array, Mask], shape: tuple[int, ...], margin_px: float, factor: int) -> Mask:
    """Find pixels whose phase is the plate's, and their neighbours within the margin."""
    plate = ndimage.uniform_filter(np.where(unchanged[1], unchanged[0], 0.0), 3) > 0.5
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
        margin = min(margin_px + 0.1 * (high - low), 0.35 * (high - low))
        table[(place > low - margin) & (place < high + margin)] = EDGE
        table[(place > low + margin) & (place < high - margin)] = number + 1
    return table[((across - start) * (1 / _TABLE_PX)).astype(np.int32)]


def _reduced(picture: NDArray, factor: int) -> NDArray:
    """Mean over blocks of factor x factor px; what is left over at the far sides is dropped."""
    if factor == 1:
        return picture
    height, width = (n // factor for n in picture.shape)
    whole = np.ascontiguousarray(picture[: height * factor, : width * factor], dtype=np.float32)
    return cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)


def _noise(angle: Array, known: Mask) -> float:
    """Scatter of the smoothed step, from differences of neighbours three apart: edges are few."""
    rows = slice(None, None, max(1, angle.size // 100_000))
    angle, known = angle[rows], known[rows]
    difference = np.angle(np.exp(1j * (angle[:, 3:] - angle[:, :-3])))
    both = known[:, 3:] & known[:, :-3]
    return 1.4826 * float(np.median(np.abs(difference[both]))) / math.sqrt(2) if both.any() else 0.0


def _drift(angle: Array, tolerance: float) -> float:
    """Common phase shift of the plate between the captures, if it is small."""
    centre = 0.0
    angle = angle[:: max(1, angle.size // 50_000)]
    for _ in range(4):
        left = np.angle(np.exp(1j * (angle - centre)))
        near = np.abs(left) < 1.5 * tolerance
        if not near.any():
            return 0.0
        centre += float(np.mean(left[near]))
    return centre if abs(centre) < 2 * tolerance else 0.0


def _seen(pixels: Pixels, comb: Comb, edges: Array, layout: Array) -> Mask:
    """Tell which strips are there; refuse a picture that is not the target's."""
    across = pixels.across(comb.direction_rad)
    strip = np.array([_mean(pixels, across, low, high) for low, high in edges])
    between = [_mean(pixels, across, a, b) for a, b in _gaps(edges)]
    gaps = np.array(
        [
            np.nanmax([before, after]) if np.isfinite([before, after]).any() else np.nan
            for before, after in zip(between[:-1], between[1:], strict=True)
        ]
    )
    plate = float(np.nanmedian(between)) if np.isfinite(between).any() else 0.0
    contrast = gaps - strip
    if plate < _LEAST_PLATE:
        raise DetectionError(
            f"only {100 * plate:.0f} % of the plate between the strips has the phase of the reference capture: lamp, "
            "plate or mirror moved between the two, or the target's strips are not those in the picture."
        )
    seen = np.nan_to_num(contrast, nan=-1.0) > max(_SEEN_CONTRAST * float(np.nanmedian(contrast)), 0.12)
    if np.count_nonzero(seen) < min(2, len(edges)):
        raise DetectionError(_nothing(layout, float(np.nanmax(contrast))))
    if seen.all():
        _demand_width(pixels, across, edges, np.diff(layout, axis=1))
    _demand_no_more(pixels, across, edges, plate)
    return seen


def _gaps(edges: Array) -> list[tuple[float, float]]:
    """Return the gaps between strips, and one beyond each outer strip."""
    outer = float(np.median(edges[1:, 0] - edges[:-1, 1])) if len(edges) > 1 else float(np.ptp(edges))
    lows = [edges[0, 0] - outer, *edges[:, 1]]
    highs = [*edges[:, 0], edges[-1, 1] + outer]
    return list(zip(lows, highs, strict=True))


def _mean(pixels: Pixels, across: Array, low: float, high: float, *, rim: float = 0.2) -> float:
    """Mean likeness over a zone without its rims; NaN where too little of it is in the picture."""
    rim *= high - low
    inside = (across > low + rim) & (across < high - rim)
    return float(pixels.likeness[inside].mean()) if np.count_nonzero(inside) >= 12 else math.nan


def _nothing(layout: Array, contrast: float) -> str:
    width = float(np.mean(np.diff(layout, axis=1)))
    return (
        f"{len(layout)} strips of {width:.1f} px width do not show in the phase (contrast {contrast:.2f} between plate "
        "and strips): strips and reference are the same pictures, the target names other strips, fringes run along "
        "the plane of light and strips shift nothing, or the step is a whole fringe everywhere (then change the "
        "fringe pitch)."
    )


def _demand_width(pixels: Pixels, across: Array, edges: Array, stated_px: Array) -> None:
    """Refuse strips of another width: of the zone around each, the share that is not plate tells it."""
    gaps = _gaps(edges)
    found = []
    for (low, high), before, after in zip(edges, gaps[:-1], gaps[1:], strict=True):
        left, right = (sum(before) / 2, sum(after) / 2)
        if left < across.min() or right > across.max():
            continue
        plate = np.nanmean([_mean(pixels, across, *gap, rim=0.4) for gap in (before, after)])
        strip = _mean(pixels, across, low, high, rim=0.4)
        share = (plate - _mean(pixels, across, left, right, rim=0.0)) / (plate - strip)
        found.append(share * (right - left))
    if not found:
        return
    width, stated = float(np.nanmedian(found)), float(np.median(stated_px))
    if abs(width - stated) > 2.0 + _SIZE_TOLERANCE * stated:
        raise DetectionError(
            f"the strips are {width:.1f} px wide, but the target and the scale ask for {stated:.1f} px: the "
            "target names other strips, or its width or gap is wrong; or the step is near a whole fringe in part of "
            "the field, where tops look like plate (then change the fringe pitch or the strips' height)"
        )


def _demand_no_more(pixels: Pixels, across: Array, edges: Array, plate: float) -> None:
    """Refuse a picture in which the row of strips goes on beyond the target's count."""
    if len(edges) < 2:
        return
    period = float(np.median(np.diff(edges[:, 0])))
    for end, shift in ((0, -period), (-1, period)):
        beyond = _mean(pixels, across, *(edges[end] + shift))
        within = np.nanmedian([_mean(pixels, across, low, high) for low, high in edges])
        if math.isfinite(beyond) and beyond < within + 0.25 * (plate - within):
            raise DetectionError(
                f"the picture shows more strips than the {len(edges)} that the target states: correct its count, or "
                "take the others away"
            )
