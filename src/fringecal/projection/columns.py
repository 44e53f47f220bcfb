"""Table 3.5: the projection angle column by column, from the fringes' breaks, beside theory (table 3.6)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate import PlateCamera
from fringecal.projection.angle import (
    ProjectorPosition,
    angles_from_breaks,
    apparent_angle,
    projection_tangent,
    theoretical_angle,
)
from fringecal.projection.calibration import RigCalibration
from fringecal.projection.fit import PhasePoints
from fringecal.uncertainty.estimates import Estimate

Array = NDArray[np.float64]

_MIN_PIXELS = 30


@dataclass(frozen=True)
class ColumnAngle:
    """The projection angle at one picture column, on the line y = 0; angles in deg from the plate's normal."""

    u_px: float
    x_mm: float
    breaks: int
    pixels: int
    angle: Estimate
    apparent_deg: float
    theory: Estimate | None

    @property
    def difference_deg(self) -> float | None:
        """Measured minus theoretical angle."""
        return None if self.theory is None else self.angle.value - self.theory.value

    @property
    def en(self) -> float | None:
        """Difference over the root sum of squares of the two expanded uncertainties (k = 2)."""
        if self.theory is None or self.difference_deg is None:
            return None
        return self.difference_deg / (2 * math.hypot(self.angle.u, self.theory.u))


def column_angles(
    calibration: RigCalibration,
    strips: PhasePoints,
    columns_px: Array,
    u_px: Array,
    *,
    half_width_px: float,
    systematic_deg: float,
    projector: ProjectorPosition | None = None,
) -> tuple[ColumnAngle, ...]:
    """Return the angle that the breaks in each column show, reduced to the line y = 0.

    Every pixel of a strip's top within `half_width_px` of the column gives one tangent; a straight line over y,
    whose slope comes from the rig model, brings them to y = 0. Scatter between blocks of pixels gives u,
    `systematic_deg` (strip height, scale, camera) is added.

    Parameters
    ----------
    calibration
        The rig; its plate phase locates the foot of each break.
    strips
        Points on strip tops with absolute phase; `u_px` their columns.
    columns_px
        Columns to report.
    """
    tangent, x, y = angles_from_breaks(calibration.model, strips)
    reduced = tangent - projection_tangent(calibration.model, x, y)
    rows = []
    for column in columns_px:
        near = (np.abs(u_px - column) <= half_width_px) & np.isfinite(reduced)
        if np.count_nonzero(near) >= _MIN_PIXELS:
            rows.append(_column(calibration, strips, column, reduced, near, systematic_deg, projector))
    return tuple(rows)


def _column(  # noqa: PLR0913, PLR0917 -- private: one row of the table
    calibration: RigCalibration,
    strips: PhasePoints,
    column: float,
    reduced: Array,
    near: NDArray[np.bool_],
    systematic_deg: float,
    projector: ProjectorPosition | None,
) -> ColumnAngle:
    x0 = _column_on_axis(calibration.camera, column)
    offset, u_offset, dof = _robust_mean(reduced[near], strips.cluster[near])
    tangent = float(projection_tangent(calibration.model, x0, 0.0)) + offset
    to_deg = math.degrees(1 / (1 + tangent**2))
    angle = Estimate(
        math.degrees(math.atan(tangent)),
        math.hypot(to_deg * u_offset, systematic_deg),
        "deg",
        "projection angle",
        dof,
    )
    fringes = np.ptp(strips.phase_rad[near]) / (2 * math.pi)
    apparent = math.degrees(float(apparent_angle(calibration.model, calibration.camera, x0, 0.0)))
    model_angle = math.degrees(math.atan(float(projection_tangent(calibration.model, x0, 0.0))))
    theory = None if projector is None else theoretical_angle(calibration.model, projector, x0, 0.0)
    return ColumnAngle(
        u_px=float(column),
        x_mm=x0,
        breaks=2 * round(float(fringes)),
        pixels=int(np.count_nonzero(near)),
        angle=angle,
        apparent_deg=apparent + angle.value - model_angle,
        theory=theory,
    )


def _column_on_axis(camera: PlateCamera, column: float) -> float:
    """X in mm at which a picture column crosses the line y = 0."""
    v = camera.centre_px[1]
    for _ in range(4):
        rays = camera.rays(column, v)
        below = camera.rays(column, v + 1.0)
        v -= float(rays.ay) / float(below.ay - rays.ay)
    return float(camera.rays(column, v).ax)


def _robust_mean(values: Array, cluster: NDArray[np.intp]) -> tuple[float, float, float]:
    """Mean over pixels with u from the scatter of block means; blocks far off are left out."""
    _, index = np.unique(cluster, return_inverse=True)
    weight = np.bincount(index).astype(float)
    means = np.bincount(index, weights=values) / weight
    centre = float(np.median(means))
    spread = 1.4826 * float(np.median(np.abs(means - centre)))
    keep = np.abs(means - centre) <= 4 * max(spread, 1e-9)
    means, weight = means[keep], weight[keep]
    mean = float(np.average(means, weights=weight))
    number = means.size
    if number < 2:
        return mean, abs(mean) + spread, 1.0
    share = weight / weight.sum()
    u = math.sqrt(float(np.sum((share * (means - mean)) ** 2)) * number / (number - 1))
    return mean, u, number - 1.0
