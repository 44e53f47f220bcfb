"""Table 3.5: the projection angle by columns and by rows, from the fringes' breaks; theory (3.6) beside it."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.projector.angle.angle_theory import theoretical_apparent
from fringecal.projector.angle.breaks import Breaks
from fringecal.projector.angle.projection_angle import (
    NEWTON_ROUNDS,
    ProjectorPosition,
    apparent_angle,
    projection_angle,
    projection_tangent,
    theoretical_angle,
)
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.uncertainty import Estimate, Influence, UncertaintyComponent, combined, en_score

Array = NDArray[np.float64]
Axis = Literal["u", "v"]

_MIN_BREAKS = 4  # of a row of the table: three degrees of freedom at least for its scatter
_PLACES = 9  # columns or rows along strips
_ENDS_PERCENT = (2, 98)  # of the breaks, between which those lie: the few at either end stand apart
_SIDE_BY_SIDE = 2.0  # standard deviations of a strip's own breaks that must lie between strips to tabulate at each
_STRIP_KEY = 1_000_000  # in a break's number: more than a picture has half fringes


@dataclass(frozen=True)
class AxisAngle:
    """The projection angle at one picture column on the line y = 0, or at one row on x = 0; deg from the normal.

    `axis` says which: "u" for a column, "v" for a row; `place_px` is the column (row), `place_mm` its place on x (y).
    Shifts are means over the breaks as they are, angles are brought to the line. `apparent` and its theory hold the
    camera's own angle.
    """

    place_px: float
    place_mm: float
    breaks: int
    shift_px: float
    shift_mm: float
    angle: Estimate
    apparent_deg: float
    theory: Estimate | None
    theory_apparent: Estimate | None = None
    axis: Axis = "u"

    @property
    def difference_deg(self) -> float | None:
        """Measured minus theoretical angle."""
        return None if self.theory is None else self.angle.value - self.theory.value

    @property
    def en(self) -> float | None:
        """Measured against theoretical angle, `en_score`; None without theory."""
        return None if self.theory is None else en_score(self.angle, self.theory)


def axis_angles(
    calibration: RigCalibration,
    breaks: Breaks,
    places_px: Array,
    *,
    half_width_px: float,
    axis: Axis = "u",
    by_fringe: bool = False,
    projector: ProjectorPosition | None = None,
) -> tuple[AxisAngle, ...]:
    """Return the angle that the breaks near each column show, brought to the line y = 0 (or near each row, to x = 0).

    Parameters
    ----------
    calibration
        The rig; its slope brings each break to the line, its uncertainty but for the scatter of phase is added to u.
    breaks
        The breaks; those that are "off" do not count.
    places_px
        Columns (rows) to report.
    half_width_px
        Breaks that lie no further from a column count for it.
    axis
        "u" for columns, "v" for rows.
    by_fringe
        True where breaks of one fringe err alike on all strips (thinned lines).
    projector
        The stated position, for theory.
    """
    reduced = breaks.tangent - projection_tangent(calibration.model, breaks.x_mm, breaks.y_mm)
    along = breaks.u_px if axis == "u" else breaks.v_px
    cluster = np.rint(2 * breaks.fringe).astype(np.intp)
    if not by_fringe:
        cluster = cluster + _STRIP_KEY * breaks.strip
    near = [(np.abs(along - place) <= half_width_px) & breaks.used & np.isfinite(reduced) for place in places_px]
    kept = [(float(p), n) for p, n in zip(places_px, near, strict=True) if np.count_nonzero(n) >= _MIN_BREAKS]
    points = [point_on_axis(calibration.camera, place, axis) for place, _ in kept]
    shared = _shared_components(calibration, points)
    rows = []
    for (place, some), point, components in zip(kept, points, shared, strict=True):
        offset = clustered_mean(reduced[some], cluster[some])
        seen = int(np.count_nonzero(some)), float(np.mean(breaks.shift_px[some])), float(np.mean(breaks.shift_mm[some]))
        row = _Row(place, axis, point, seen, offset, components)
        rows.append(_tabulated(calibration, row, projector))
    return tuple(rows)


def both_axes(
    calibration: RigCalibration,
    breaks: Breaks,
    *,
    by_fringe: bool = False,
    projector: ProjectorPosition | None = None,
) -> tuple[tuple[AxisAngle, ...], tuple[AxisAngle, ...]]:
    """Tabulate breaks by column and by row: at each strip across the strips, at even places along them."""

    def table(axis: Axis, along_px: Array) -> tuple[AxisAngle, ...]:
        places, half = _places(along_px, breaks.strip)
        return axis_angles(
            calibration, breaks, places, half_width_px=half, axis=axis, by_fringe=by_fringe, projector=projector
        )

    return table("u", breaks.u_px), table("v", breaks.v_px)


def _places(along_px: Array, strip: NDArray[np.intp]) -> tuple[Array, float]:
    """Return where to tabulate, and half of the width: at the strips if they stand side by side here."""
    groups = [along_px[strip == k] for k in np.unique(strip)]
    centres = np.array([float(np.mean(g)) for g in groups])
    apart = float(np.min(np.diff(np.sort(centres)))) if centres.size > 1 else 0.0
    if apart > _SIDE_BY_SIDE * max(float(np.std(g)) for g in groups):
        return np.sort(centres), apart / 2
    low, high = np.percentile(along_px, _ENDS_PERCENT)
    width = (high - low) / _PLACES
    return low + width * (np.arange(_PLACES) + 0.5), width / 2


@dataclass(frozen=True)
class _Row:
    """What one row is made of: place, point on the line, breaks and mean shifts, offset of the breaks.

    `shared` are the components of the angle's uncertainty, in deg, that all breaks share.
    """

    place_px: float
    axis: Axis
    point_mm: tuple[float, float]
    seen: tuple[int, float, float]
    offset: tuple[float, float, float]
    shared: tuple[UncertaintyComponent, ...]


def _tabulated(calibration: RigCalibration, row: _Row, projector: ProjectorPosition | None) -> AxisAngle:
    x, y = row.point_mm
    tangent = float(projection_tangent(calibration.model, x, y))
    mean, u, dof = row.offset
    scatter = UncertaintyComponent(Influence.BREAK_SCATTER, math.degrees(u / (1 + tangent**2)), dof)
    measured = math.degrees(math.atan(tangent + mean))
    angle = combined(measured, (scatter, *row.shared), unit="deg", label="projection angle").result
    apparent = math.tan(float(apparent_angle(calibration.model, calibration.camera, x, y))) + mean
    stated = () if projector is None else (calibration.model, projector)
    breaks, shift_px, shift_mm = row.seen
    return AxisAngle(
        place_px=row.place_px,
        place_mm=x if row.axis == "u" else y,
        breaks=breaks,
        shift_px=shift_px,
        shift_mm=shift_mm,
        angle=angle,
        apparent_deg=math.degrees(math.atan(apparent)),
        theory=theoretical_angle(*stated, x, y) if stated else None,
        theory_apparent=theoretical_apparent(*stated, calibration.camera, x, y) if stated else None,
        axis=row.axis,
    )


def _shared_components(
    calibration: RigCalibration, points_mm: list[tuple[float, float]]
) -> list[tuple[UncertaintyComponent, ...]]:
    """Return for each point the components of its angle's uncertainty, in deg, that all breaks share.

    The breaks' own scatter stands in the place of the calibration's scatter of phase.
    """
    x, y = np.array(points_mm).reshape(-1, 2).T
    changes = np.degrees(calibration.changes(lambda c: projection_angle(c.model, x, y)))
    pairs = zip(calibration.components, changes, strict=True)
    shared = [replace(c, effect=change) for c, change in pairs if c.influence is not Influence.PHASE_SCATTER]
    return [tuple(replace(c, effect=float(c.effect[i])) for c in shared) for i in range(len(points_mm))]


def point_on_axis(camera: PlateCamera, place_px: float, axis: Axis = "u") -> tuple[float, float]:
    """Return the plate point (x, y), mm, at which a picture column crosses y = 0 (or a row crosses x = 0)."""
    other = camera.centre_px[1 if axis == "u" else 0]

    def rays(at: float) -> tuple[float, float]:
        ray = camera.rays(place_px, at) if axis == "u" else camera.rays(at, place_px)
        x, y = float(ray.ax), float(ray.ay)
        return (x, y) if axis == "u" else (y, x)

    for _ in range(NEWTON_ROUNDS):
        off, further = rays(other)[1], rays(other + 1.0)[1]
        other -= off / (further - off)
    on, off = rays(other)
    return (on, off) if axis == "u" else (off, on)


def clustered_mean(values: Array, cluster: NDArray[np.intp]) -> tuple[float, float, float]:
    """Return the mean, its u from the scatter of the clusters' means, and degrees of freedom.

    Examples
    --------
    >>> mean, u, dof = clustered_mean(np.array([1.0, 1.0, 3.0, 3.0]), np.array([0, 0, 1, 1]))
    >>> mean, round(u, 6), dof
    (2.0, 1.0, 1.0)
    """
    _, index = np.unique(cluster, return_inverse=True)
    weight = np.bincount(index).astype(float)
    means = np.bincount(index, weights=values) / weight
    mean = float(np.average(means, weights=weight))
    number = means.size
    if number < 2:
        return mean, abs(mean), 1.0
    share = weight / weight.sum()
    u = math.sqrt(float(np.sum((share * (means - mean)) ** 2)) * number / (number - 1))
    return mean, u, number - 1.0
