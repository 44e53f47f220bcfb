"""The strips' phase, pixel by pixel: which strip, how high, and its phase difference to the plate."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.detect import StripRegions, find_strips
from fringecal.errors import DetectionError, FitError
from fringecal.numerics import wrap
from fringecal.phase import PhaseMap, unwrap
from fringecal.projector.standards.strip_heights import seen_heights
from fringecal.targets import Strips
from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]

_MIN_PIECE = 40  # pixels; smaller pieces of a strip top are left out: their phase is known no better than a few pixels'
_MIN_SHARE = 0.02  # of the largest piece; crumbs would weigh like whole strips where strips differ
_BINS, _MODES = 24, 2  # of phase differences, 15 deg each: the plate's and the tops' are the two most frequent
_ALIKE = 0.02  # of their mean: strips measured one by one differ by micrometres, steps by more
_MOVED_RAD = 0.15  # median phase difference on bare plate above which plate or lamp moved between captures


@dataclass(frozen=True)
class StripPhase:
    """Strip tops with their phase difference to the plate.

    Parameters
    ----------
    regions
        Which pixel is which strip, and where the edges are.
    difference_rad
        Phase of the strips minus phase of the bare plate, continuous within each piece, NaN elsewhere; every
        piece's own multiple of 2 pi is still open.
    pieces
        Map: 0 nothing, 1.. the connected pieces of strip tops.
    heights_mm
        Height of each strip of the target, one estimate per strip.
    plate_drift_rad
        Median phase difference on the bare plate between the two captures, already taken off `difference_rad`.
    target
        The set as it is stated.
    """

    regions: StripRegions
    difference_rad: Array
    pieces: NDArray[np.int32]
    heights_mm: tuple[Estimate, ...]
    plate_drift_rad: float
    target: Strips | None = None


def measure_strips(reference: PhaseMap, strips: PhaseMap, target: Strips, camera: PlateCamera) -> StripPhase:
    """Find the strips by the phase they add.

    Parameters
    ----------
    reference, strips
        Phase of the bare plate and of the plate with strips.
    target
        Count, width, gap and height of the strips.
    camera
        The camera on the plate: in its millimetres strips are straight.

    Raises
    ------
    DetectionError
        The strips do not show.
    FitError
        Plate or lamp moved between the two captures, too little of the strips is lit, or the strips are of another
        size than the grid's pitch makes them.
    """
    valid = reference.valid & strips.valid
    step = np.where(valid, wrap(strips.phase.astype(float) - reference.phase), 0.0)
    try:
        return strips_from_step(step, valid, target, camera)
    except DetectionError:
        _demand_rest(step, valid, target, camera)
        raise


def strips_from_step(step: Array, valid: NDArray[np.bool_], target: Strips, camera: PlateCamera) -> StripPhase:
    """Find the strips in a map of the wrapped phase that they add to the plate's (see `measure_strips`)."""
    heights = seen_heights(target)
    scale = camera.scale("mean").value
    regions = find_strips(
        step,
        valid,
        count=target.count,
        width_px=target.width_mm.array(target.count) / scale,
        gap_px=_gaps_mm(target) / scale,
        straight_px=_straight(camera, float(np.mean([h.value for h in heights]))),
    )
    _demand_size(regions, target)
    drift = _plate_drift(step, regions)
    found = unwrap(step - drift, regions.labels > 0)
    pieces = _large(found.pieces)
    return StripPhase(regions, np.where(pieces > 0, found.phase, np.nan), pieces, heights, drift, target)


def _demand_rest(step: Array, valid: NDArray[np.bool_], target: Strips, camera: PlateCamera) -> None:
    """Refuse a plate that moved between the captures: strips show where the phase that most pixels share is none."""
    number, edges = np.histogram(step[valid], _BINS, (-np.pi, np.pi))
    for shared in (edges[:-1] + edges[1:])[np.argsort(-number)[:_MODES]] / 2:
        if abs(shared) > _MOVED_RAD:
            try:
                found = strips_from_step(wrap(step - shared), valid, target, camera)
            except (DetectionError, FitError):
                continue
            raise _moved(float(shared) + found.plate_drift_rad)


def _demand_size(regions: StripRegions, target: Strips) -> None:
    """Refuse strips of another size than stated: nothing says whether they or the grid's pitch are wrong."""
    if regions.size == 1.0:
        return
    width = float(np.mean(target.width_mm.array(target.count)))
    raise FitError(
        f"By the scale of the grid the strips are {regions.size:.2f} times as wide and as far apart as their target "
        f"says ({width * regions.size:.1f} mm wide instead of {width:g} mm): either the grid's pitch is "
        f"{1 / regions.size:.2f} times what its target states, or the strips' widths and gaps are not as stated. "
        "Measure both with a ruler."
    )


def _gaps_mm(target: Strips) -> Array:
    return np.zeros(0) if target.gap_mm is None else target.gap_mm.array(max(target.count - 1, 1))[: target.count - 1]


def _straight(camera: PlateCamera, z_mm: float) -> tuple[Array, Array]:
    """Maps of where pixels lie at the strips' height, in px of the mean scale, v downward."""
    x, y = camera.pixel_rays().at(z_mm)
    scale = camera.scale("mean").value
    u0, v0 = camera.centre_px
    return u0 + x / scale, v0 - y / scale


def _plate_drift(step: Array, regions: StripRegions) -> float:
    """Median phase difference on the bare plate; walls of strips and crumbs beside them are outvoted."""
    plate = step[regions.labels == 0]
    if plate.size == 0:
        return 0.0
    drift = float(np.median(plate))
    if abs(drift) > _MOVED_RAD:
        raise _moved(drift)
    return drift


def _moved(drift_rad: float) -> FitError:
    return FitError(
        f"On the bare plate beside the strips the phase differs by {drift_rad:+z.2f} rad from the reference "
        "capture: plate, projector or mirror moved between the two. Take reference and strips again without "
        "touching the rig."
    )


def _large(pieces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Leave out pieces of a few pixels and number the others anew."""
    sizes = np.bincount(pieces.ravel())
    keep = sizes >= max(_MIN_PIECE, _MIN_SHARE * sizes[1:].max(initial=0))
    keep[0] = False
    if not keep.any():
        raise FitError("No strip top has enough valid pixels: more light, wider strips or finer pixels are needed.")
    return np.where(keep, np.cumsum(keep), 0).astype(np.int32)[pieces]


def numberings(strips: StripPhase) -> tuple[tuple[int, ...], ...]:
    """Return all ways in which the strips seen may be the target's: items of the target, by label - 1.

    Strips alike in height have one. Others may lie turned round; where some lie outside the picture, the row may
    also start at another strip. An item is -1 for a label that is not seen.
    """
    heights = [h.value for h in strips.heights_mm]
    count, seen = len(heights), [int(k) - 1 for k in np.unique(strips.regions.labels[strips.pieces > 0])]
    shifts = sorted(range(1 - count, count), key=abs) if len(seen) < count else [0]
    found: dict[tuple[float, ...], tuple[int, ...]] = {}
    for sign, shift in product((1, -1), shifts):
        items = {k: (k if sign > 0 else count - 1 - k) + shift for k in seen}
        if min(items.values()) >= 0 and max(items.values()) < count:
            key = tuple(heights[i] for i in items.values())
            found.setdefault(key, tuple(items.get(k, -1) for k in range(count)))
    return tuple(found.values())


def averaged_numberings(strips: StripPhase) -> StripPhase | None:
    """Return strips with the mean of the heights that each may have, for strips of which it is open which is which.

    By how much the heights that a strip may have differ from their mean is added to its uncertainty. None where they
    differ by more than 2 %: that is no set of one nominal height.
    """
    heights = np.array([h.value for h in strips.heights_mm])
    if np.ptp(heights) > _ALIKE * heights.mean():
        return None
    ways = numberings(strips)
    whole = all(item >= 0 for items in ways for item in items)
    made = []
    for label, one in enumerate(strips.heights_mm):
        may_be = heights[[items[label] for items in ways]] if whole else heights
        mean = float(may_be.mean())
        made.append(replace(one, value=mean, u=float(np.hypot(one.u, np.abs(may_be - mean).max()))))
    return replace(strips, heights_mm=tuple(made))
