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

from fringecal.detect.strip_comb import Comb, Pixels, find_comb, find_ends, refined_edges
from fringecal.errors import DetectionError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PLATE, EDGE = 0, -1
_SEARCH_WIDTH_PX = 9.0  # pictures are reduced until a strip or gap is about so wide ...
_REFINE_WIDTH_PX = 36.0  # ... and so wide where edges are measured
_SIZE_TOLERANCE = 0.15  # of a strip's width, besides two px, before the target is called wrong
_SEEN_CONTRAST = 0.35  # a strip with less of the others' contrast is not there, or shows a whole fringe
_LEAST_PLATE = 0.45  # share of plate pixels in the gaps that must agree with the reference
_LEAST_PIXELS = 400


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
    """

    labels: NDArray[np.int16]
    direction_deg: float
    across_px: Array
    edges_px: Array

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
    length_px: float = math.inf,
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
    count, width_px, gap_px, length_px
        The strips' number, widths (one, or one each), gaps (one, or one less than strips) and length.
    margin_px
        Half-width of the zone at each edge that is given to neither side, besides a tenth of the width.
    straight_px
        Maps of the coordinates (u, v) in which strips are straight, where a lens or a tilt bends them in the
        picture; by default the pixels' own.

    Raises
    ------
    DetectionError
        No pattern of strips: nothing on the plate, other strips, or a phase step of a whole fringe.
    """
    step, usable = _checked(step_rad, valid)
    layout = strip_layout(count, width_px, gap_px)
    u, v = _coordinates(step.shape) if straight_px is None else straight_px
    least = float(min(np.diff(layout, axis=1).min(), *(layout[1:, 0] - layout[:-1, 1]), math.inf))
    coarse = _plate_likeness(step, usable, u, v, max(1, int(least / _SEARCH_WIDTH_PX)))
    comb = find_comb(coarse, layout, least)
    fine = _plate_likeness(step, usable, u, v, max(1, int(least / _REFINE_WIDTH_PX)))
    edges = refined_edges(fine, comb, 0.3 * least)
    seen = _seen(fine, comb, edges, layout)
    across = u * math.cos(comb.direction_rad) + v * math.sin(comb.direction_rad)
    along = v * math.cos(comb.direction_rad) - u * math.sin(comb.direction_rad)
    labels = np.zeros(step.shape, dtype=np.int16)
    for number in np.flatnonzero(seen):
        low, high = edges[number]
        margin = min(margin_px + 0.1 * (high - low), 0.35 * (high - low))
        first, last = find_ends(fine, comb, (low, high), length_px)
        near = (
            (across > low - margin)
            & (across < high + margin)
            & (along > first - margin)
            & (along < last + margin)
        )
        inside = (across > low + margin) & (across < high - margin)
        inside &= (along > first + margin) & (along < last - margin)
        labels[near] = EDGE
        labels[inside] = number + 1
    labels[~usable] = EDGE
    return StripRegions(labels, (math.degrees(comb.direction_rad) + 90.0) % 180.0, across, edges)


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


def _plate_likeness(step: Array, usable: Mask, u: Array, v: Array, factor: int) -> Pixels:
    """Tell for blocks of `factor` px how well the phase there agrees with the bare plate, from 0 to 1.

    On a strip the step may be anything, even a whole fringe along some line, so only its absence is judged: over
    the noise, and over what the plate as a whole has drifted.
    """
    field = _reduced(np.where(usable, np.exp(1j * step), 0), factor)
    share = _reduced(usable.astype(float), factor)
    known = share > 0.6
    if factor == 1:
        size = (3, 3)
        field = ndimage.uniform_filter(field.real, size) + 1j * ndimage.uniform_filter(field.imag, size)
    angle = np.angle(field)
    tolerance = float(np.clip(5 * _noise(angle, known) + 0.06, 0.12, 0.9))
    angle = np.angle(field * np.exp(-1j * _drift(angle[known], tolerance)))
    likeness = np.clip(2 - np.abs(angle) / tolerance, 0, 1)
    at = np.nonzero(known)
    return Pixels(_reduced(u, factor)[at], _reduced(v, factor)[at], likeness[at])


def _reduced(picture: NDArray, factor: int) -> NDArray:
    """Mean over blocks of factor x factor px; what is left over at the far sides is dropped."""
    if factor == 1:
        return picture
    height, width = (n // factor * factor for n in picture.shape)
    blocks = picture[:height, :width].reshape(height // factor, factor, width // factor, factor)
    return blocks.mean(axis=(1, 3))


def _noise(angle: Array, known: Mask) -> float:
    """Scatter of the smoothed step, from differences of neighbours three apart: edges are few."""
    difference = np.angle(np.exp(1j * (angle[:, 3:] - angle[:, :-3])))
    both = known[:, 3:] & known[:, :-3]
    return 1.4826 * float(np.median(np.abs(difference[both]))) / math.sqrt(2) if both.any() else 0.0


def _drift(angle: Array, tolerance: float) -> float:
    """Common phase shift of the plate between the captures, if it is small."""
    centre = 0.0
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
    _demand_width(edges[seen], layout[seen])
    _demand_no_more(pixels, across, edges, comb, plate)
    return seen


def _gaps(edges: Array) -> list[tuple[float, float]]:
    """Return the gaps between strips, and one beyond each outer strip."""
    outer = float(np.median(edges[1:, 0] - edges[:-1, 1])) if len(edges) > 1 else float(np.ptp(edges))
    lows = [edges[0, 0] - outer, *edges[:, 1]]
    highs = [*edges[:, 0], edges[-1, 1] + outer]
    return list(zip(lows, highs, strict=True))


def _mean(pixels: Pixels, across: Array, low: float, high: float) -> float:
    """Mean likeness over the middle of a zone; NaN where too little of it is in the picture."""
    rim = 0.2 * (high - low)
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


def _demand_width(edges: Array, layout: Array) -> None:
    found, stated = (float(np.median(np.diff(e, axis=1))) for e in (edges, layout))
    if abs(found - stated) > 2.0 + _SIZE_TOLERANCE * stated:
        raise DetectionError(
            f"the strips are {found:.1f} px wide, but the target and the scale ask for {stated:.1f} px: the target "
            "names other strips, or its width is wrong"
        )


def _demand_no_more(pixels: Pixels, across: Array, edges: Array, comb: Comb, plate: float) -> None:
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
