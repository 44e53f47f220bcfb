"""Which strips of a row are in the picture, and whether it is the target's row at all."""

import math

import numpy as np
from numpy.typing import NDArray

from fringecal.detect.strips.comb import LEAST_CONTRAST, Comb, Pixels
from fringecal.errors import DetectionError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SIZE_TOLERANCE, _SIZE_PX = 0.2, 2.0  # of a strip's width, and px beside it, before the target is called wrong
_SEEN_CONTRAST = 0.35  # a strip with less of the others' contrast is not there, or shows a whole fringe
_LEAST_PLATE = 0.45  # share of plate pixels in the gaps that must agree with the reference
_LEAST_STRIPS = 2  # that must be seen: one alone is a cable, a hand, a shadow
_LEAST_PIXELS = 12  # of a zone whose mean says something
_RIM, _WIDE_RIM = 0.2, 0.4  # of a zone, left out at either side: for blurred edges; where only its middle counts
_FURTHER_STRIP = 0.25  # of the way from strip to plate, up to which a zone beyond the last strip is a strip


def strips_seen(pixels: Pixels, comb: Comb, edges: Array, layout: Array) -> Mask:
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
            f"only {100 * plate:.0f} % of the plate between the strips has the phase of the reference capture: "
            "projector, plate or mirror moved between the two, or the target's strips are not those in the picture."
        )
    seen = np.nan_to_num(contrast, nan=-1.0) > max(_SEEN_CONTRAST * float(np.nanmedian(contrast)), LEAST_CONTRAST)
    if np.count_nonzero(seen) < min(_LEAST_STRIPS, len(edges)):
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


def _mean(pixels: Pixels, across: Array, low: float, high: float, *, rim: float = _RIM) -> float:
    """Mean likeness over a zone without its rims; NaN where too little of it is in the picture."""
    rim *= high - low
    inside = (across > low + rim) & (across < high - rim)
    return float(pixels.likeness[inside].mean()) if np.count_nonzero(inside) >= _LEAST_PIXELS else math.nan


def _nothing(layout: Array, contrast: float) -> str:
    width = float(np.mean(np.diff(layout, axis=1)))
    return (
        f"{len(layout)} strips of {width:.1f} px width do not show in the phase (contrast {contrast:.2f} between plate "
        "and strips): strips and reference are the same pictures, the target names other strips, fringes run along "
        "the plane of light and strips shift nothing, or the fringe shift is a whole number of fringes everywhere "
        "(then change the fringe pitch)."
    )


def _demand_width(pixels: Pixels, across: Array, edges: Array, stated_px: Array) -> None:
    """Refuse strips of another width: of the zone around each, the share that is not plate tells it."""
    gaps = _gaps(edges)
    found = []
    for (low, high), before, after in zip(edges, gaps[:-1], gaps[1:], strict=True):
        left, right = (sum(before) / 2, sum(after) / 2)
        if left < across.min() or right > across.max():
            continue
        plate = np.nanmean([_mean(pixels, across, *gap, rim=_WIDE_RIM) for gap in (before, after)])
        strip = _mean(pixels, across, low, high, rim=_WIDE_RIM)
        share = (plate - _mean(pixels, across, left, right, rim=0.0)) / (plate - strip)
        found.append(share * (right - left))
    if not found:
        return
    width, stated = float(np.nanmedian(found)), float(np.median(stated_px))
    if abs(width - stated) > _SIZE_PX + _SIZE_TOLERANCE * stated:
        raise DetectionError(
            f"the strips are {width:.1f} px wide, but the target and the scale ask for {stated:.1f} px: the "
            "target names other strips, or its width or gap is wrong; or the fringe shift is near a whole number of "
            "fringes in part of the field, where tops look like plate (then change the fringe pitch or the strips' "
            "height)"
        )


def _demand_no_more(pixels: Pixels, across: Array, edges: Array, plate: float) -> None:
    """Refuse a picture in which the row of strips goes on beyond the target's count."""
    if len(edges) < 2:
        return
    period = float(np.median(np.diff(edges[:, 0])))
    for end, shift in ((0, -period), (-1, period)):
        beyond = _mean(pixels, across, *(edges[end] + shift))
        within = np.nanmedian([_mean(pixels, across, low, high) for low, high in edges])
        if math.isfinite(beyond) and beyond < within + _FURTHER_STRIP * (plate - within):
            raise DetectionError(
                f"the picture shows more strips than the {len(edges)} that the target states: correct its count, or "
                "take the others away"
            )
