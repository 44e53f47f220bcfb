"""From one grey picture of strips to a fitted rig and its breaks: the ridge and the skeleton estimators."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.camera import CameraFit
from fringecal.detect import Centres, ridge_centres, skeleton_centres
from fringecal.errors import FitError
from fringecal.projector.angle.breaks import (
    Breaks,
    FringePoints,
    breaks_of_points,
    breaks_on_plate,
    gather_centres,
    zones_of,
)
from fringecal.projector.angle.picture_strips import PictureStrips, strips_in_picture
from fringecal.projector.angle.projection_angle import projection_angle, projection_tangent
from fringecal.projector.joint_fit import RigFit
from fringecal.projector.orders.strip_orders import OrderedStrips, order_strips
from fringecal.projector.rig_calibration import Observations, RigCalibration, calibrate_rig
from fringecal.targets import Strips
from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]
PictureEstimator = Literal["ridge", "skeleton"]

_RIDGE_INDEPENDENT_PX = 3.5  # 2 sqrt(pi) of the smoothing along the fringe
_SKELETON_MIDDLE = 0.3  # of a width; nearer to an edge a thinned line bends toward its neighbour on the other level
#: A thinned line only tells which band is read: it may be upright in a strip narrower than a fringe. In eight random
#: rigs with strips of 0.35 to 0.75 periods the angle is the ridge estimator's within 0.02 deg (`angle_campaign.py`).
_LEAST_WIDTH = 0.3  # periods
_LEAST_WIDTH_PX = 8.0  # two filters of 3 px, and a middle that neither edge reaches
_LEAST_BREAKS = 12  # of a picture, and points of a surface: what is fitted to them has seven numbers
_ASTRAY_DEG = 1.0  # the coarse phase is blurred by its window; on random rigs its angle is right within 0.2 deg
_BLOCK_PX = 8  # columns that are nearer count as one: less than the narrowest strip
_LEAST_DEGREE = 2  # a plane is part of the rig's own seven numbers
_DEGREE = 3  # of the plate's smooth residual: whole fringes carry less than pixels do


@dataclass(frozen=True)
class PictureBreaks:
    """What one picture of strips gives."""

    found: PictureStrips
    ordered: OrderedStrips
    points: FringePoints
    breaks: Breaks
    observations: Observations
    calibration: RigCalibration
    fit: RigFit


def picture_breaks(
    image: ArrayLike,
    target: Strips,
    camera: CameraFit,
    *,
    estimator: PictureEstimator = "ridge",
    projector_mm: Array | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> PictureBreaks:
    """Measure the breaks of fringes at strips in one grey picture, and fit the rig to them.

    Parameters
    ----------
    image
        Grey values, (H, W): fringes on the plate and on the strips.
    target
        The strips.
    camera
        The camera on the plate.
    estimator
        "ridge": sub-pixel centres of bright and dark fringes; "skeleton": the thesis's thinned lines.
    projector_mm
        The stated position of the projector: decides the fringe order where the picture alone leaves it open.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    PhaseError
        No fringes in the picture.
    DetectionError
        No strips, or strips along the fringes.
    FitError
        Too few breaks, an open fringe order, or a rig that the breaks do not determine.
    """
    grey = np.asarray(image)
    progress("finding the strips in one picture")
    found, ordered = _ordered(
        strips_in_picture(grey, target, camera.camera, projector_mm=projector_mm), camera, projector_mm
    )
    if estimator == "skeleton":
        _demand_width(found)
    progress(f"reading the fringes ({estimator})")
    points = _points(grey, found, ordered, estimator)
    in_pixels = breaks_of_points(points)
    if in_pixels.strip.size < _LEAST_BREAKS:
        raise FitError(
            f"{in_pixels.strip.size} breaks of fringes at strips could be read, at least {_LEAST_BREAKS} are needed: "
            "finer fringes, more strips in the picture, or the phase estimator are needed"
        )
    observations = _observations(points, found, ordered, by_fringe=estimator == "skeleton")
    progress("fitting the rig")
    calibration, fit = calibrate_rig(observations, camera, residual_degree=_degree(points), projector_near=projector_mm)
    _demand_agreement(calibration, ordered)
    heights = np.array([e.value for e in found.strips.heights_mm])[np.array(ordered.items)[in_pixels.strip - 1]]
    along = found.carrier.along
    breaks = breaks_on_plate(in_pixels, calibration.model, calibration.camera, heights, along=along)
    breaks = breaks.without_outliers(projection_tangent(calibration.model, breaks.x_mm, breaks.y_mm))
    return PictureBreaks(found, ordered, points, breaks, observations, calibration, fit)


def _ordered(
    candidates: Iterator[PictureStrips], camera: CameraFit, projector_mm: Array | None
) -> tuple[PictureStrips, OrderedStrips]:
    """Take the first way to see the strips that has a fringe order."""
    errors: list[FitError] = []
    for found in candidates:
        try:
            return found, order_strips(found.plate_phase_rad, found.strips, camera.camera, projector_mm=projector_mm)
        except FitError as error:
            errors.append(error)
    raise errors[0]


def _degree(points: FringePoints) -> int:
    """Degree of the plate's smooth residual that so many zones and fringes of the plate can tell; 0 leaves it out."""
    plate = points.take(points.zone <= 0)
    columns = np.unique(np.rint(plate.u_px / _BLOCK_PX)).size
    degree = min(_DEGREE, columns - 2, np.unique(plate.fringe).size // 2 - 2)
    return degree if degree >= _LEAST_DEGREE else 0


def _demand_agreement(calibration: RigCalibration, ordered: OrderedStrips) -> None:
    """Refuse a rig whose angle is not the one that the coarse phase of all pixels has shown with the same order."""
    coarse = abs(ordered.decision.chosen.angle_deg)
    fitted = math.degrees(float(projection_angle(calibration.model, 0.0, 0.0)))
    if abs(fitted - coarse) > _ASTRAY_DEG:
        raise FitError(
            f"the fringe breaks give an angle of {fitted:.1f} deg, the phase between them {coarse:.1f} deg: there are "
            "too few fringes or strips in the picture to fit a rig. Use finer fringes, more strips, or phase-shifted "
            "pictures."
        )


def _demand_width(found: PictureStrips) -> None:
    """Refuse strips or gaps so narrow that a band of theirs runs into its neighbours after filtering."""
    edges, period = found.strips.regions.edges_px, found.carrier.period_px
    narrowest = (
        float(min(np.median(np.diff(edges)), np.median(edges[1:, 0] - edges[:-1, 1]))) if len(edges) > 1 else 0.0
    )
    if narrowest < max(_LEAST_WIDTH * period, _LEAST_WIDTH_PX):
        raise FitError(
            f"strips or gaps of {narrowest:.0f} px are too narrow for fringes of {period:.0f} px to be thinned: "
            f"{_LEAST_WIDTH_PX:g} px and {_LEAST_WIDTH:g} of a period are needed; use the ridge or phase estimator, "
            "or finer fringes"
        )


def _points(grey: NDArray, found: PictureStrips, ordered: OrderedStrips, estimator: PictureEstimator) -> FringePoints:
    """Centres of the fringes, gathered; u and v as if the fringes ran along rows."""
    along, period = found.carrier.along, found.carrier.period_px
    find = ridge_centres if estimator == "ridge" else skeleton_centres
    centres: Centres = find(grey, period, along=along)
    labels = found.strips.regions.labels
    phase = np.where(labels > 0, ordered.phase_rad, found.plate_phase_rad)
    zones = zones_of(found.strips.regions, middle=1.0 if estimator == "ridge" else _SKELETON_MIDDLE)
    if along == "columns":
        centres, phase, zones = centres.swapped(), phase.T, zones.T
    independent = _RIDGE_INDEPENDENT_PX if estimator == "ridge" else np.inf
    return gather_centres(centres, phase, zones, independent_px=independent)


def _observations(
    points: FringePoints, found: PictureStrips, ordered: OrderedStrips, *, by_fringe: bool
) -> Observations:
    """Gather plate and strips for the fit, one surface for each height.

    Every fringe of a zone errs by itself; where a threshold is read (`by_fringe`) it errs alike in all zones.
    """
    cluster = np.rint(2 * points.fringe).astype(np.intp) if by_fringe else np.arange(points.zone.size)
    u, v = (points.u_px, points.v_px) if found.carrier.along == "rows" else (points.v_px, points.u_px)
    chosen = [points.zone <= 0]
    heights = [Estimate(0.0, 0.0, "mm", "plate")]
    for labels in ordered.groups(found.strips).values():
        inside = np.isin(points.zone, labels)
        if np.count_nonzero(inside) >= _LEAST_BREAKS:
            chosen.append(inside)
            heights.append(found.strips.heights_mm[ordered.items[labels[0] - 1]])
    return Observations(
        tuple(u[part] for part in chosen),
        tuple(v[part] for part in chosen),
        tuple(points.phase_rad[part] for part in chosen),
        tuple(cluster[part] for part in chosen),
        tuple(heights),
    )
