"""The projection angle and all that it rests on: fringe breaks, tables 3.5 and 3.6, the map over the field."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.projector import (
    AxisAngle,
    Breaks,
    Displacement,
    OrderDecision,
    RigCalibration,
    angles_at_origin,
    apparent_angle,
    both_axes,
    fringe_pitch_mm,
    phase_breaks,
    projection_angle,
    runs_along_rows,
    with_other_causes,
)
from fringecal.session import Session
from fringecal.uncertainty import Budget, Estimate
from fringecal.workflows.commission.calibrated_session import CalibratedSession
from fringecal.workflows.commission.camera import CameraFindings
from fringecal.workflows.shared import RIM, displaced, projector_of

Estimator = Literal["phase", "ridge", "skeleton"]

_MAP = (9, 7)  # places along u and v at which the angle is tabulated: it is smooth over the field


@dataclass(frozen=True)
class AngleFindings:
    """The projection angle and all that it rests on.

    Parameters
    ----------
    session, estimator
        What was measured, and how fringe breaks were read.
    camera, calibration
        The camera on the plate, and the rig fitted to the breaks.
    breaks
        One row per fringe and strip.
    columns, rows
        Table 3.5 beside 3.6: along the line y = 0, and along x = 0.
    angle, apparent, theory
        At the plate's origin, deg from the normal; theory is None where no position is stated.
    order
        How the fringe order was decided.
    displacement
        The projector position found against the stated one, or None.
    picture
        The first picture of the strips.
    """

    session: Session
    estimator: Estimator
    camera: CameraFindings
    calibration: RigCalibration
    breaks: Breaks
    columns: tuple[AxisAngle, ...]
    rows: tuple[AxisAngle, ...]
    angle: Estimate
    apparent: Estimate
    budget: Budget
    theory: Estimate | None
    order: OrderDecision
    displacement: Displacement | None
    picture: NDArray

    @property
    def pitch_mm(self) -> float:
        """Fringe pitch on the plate at the origin, across the fringe."""
        return float(fringe_pitch_mm(self.calibration.model))

    @property
    def along(self) -> str:
        """What the fringes run along in the picture: "rows" or "columns"."""
        return "rows" if runs_along_rows(self.calibration.model, self.calibration.camera) else "columns"

    @property
    def sentences(self) -> tuple[str, ...]:
        """What a reader should know: the order, and whether the measured geometry agrees with the stated one."""
        used = int(np.count_nonzero(self.breaks.used))
        counted = f"{used} fringe breaks by the {self.estimator} estimator, {self.breaks.strip.size - used} left out."
        order = f"Fringe order: {self.order.reason}."
        found = counted, order, *self.camera.notes
        if self.displacement is None:
            return *found, "No projector position to compare with: state projector.position_mm."
        return *found, self.displacement.sentence()

    def breaks_frame(self) -> pd.DataFrame:
        """Tabulate the fringe breaks."""
        return pd.DataFrame(self.breaks.columns())


def angles_of(found: CalibratedSession) -> AngleFindings:
    """Return the angles of a commissioned rig: the phase estimator."""
    result = found.result
    labels = result.strips.found.regions.labels
    breaks = phase_breaks(result.rig, result.observations, labels, surfaces=len(result.orders))
    angles = gather_angles(
        found.session, "phase", result.camera, result.rig, breaks, next(iter(result.orders.values())),
        found.strips.capture.read()[0],
    )  # fmt: skip
    if angles.displacement is None or result.stated_projector is None:
        return angles
    fits = result.camera.fit, result.fit
    named = with_other_causes(angles.displacement, result.rig, result.stated_projector, result.observations, fits)
    return replace(angles, displacement=named)


def gather_angles(  # noqa: PLR0913, PLR0917 -- private: gathers what one estimator found
    session: Session,
    estimator: Estimator,
    camera: CameraFindings,
    calibration: RigCalibration,
    breaks: Breaks,
    order: OrderDecision,
    picture: NDArray,
) -> AngleFindings:
    """Gather what one estimator of fringe breaks found, beside what the stated positions give."""
    stated = projector_of(session)
    origin = angles_at_origin(calibration, stated)
    by_fringe = estimator == "skeleton"
    columns, rows = both_axes(calibration, breaks, by_fringe=by_fringe, projector=stated)
    return AngleFindings(
        session=session,
        estimator=estimator,
        camera=camera,
        calibration=calibration,
        breaks=breaks,
        columns=columns,
        rows=rows,
        angle=origin.angle,
        apparent=origin.apparent,
        budget=origin.budget,
        theory=origin.theory,
        order=order,
        displacement=displaced(calibration, stated),
        picture=picture,
    )


def angle_map(calibration: RigCalibration, shape: tuple[int, int] = _MAP) -> pd.DataFrame:
    """Tabulate the projection angle over the field: x, y in mm, angle, its u, apparent angle in deg."""
    camera = calibration.camera
    u, v = (
        np.linspace(RIM, 1 - RIM, n) * (size - 1)
        for n, size in zip(shape, (camera.width_px, camera.height_px), strict=True)
    )
    rays = camera.rays(*np.meshgrid(u, v))
    x, y = rays.ax.ravel(), rays.ay.ravel()
    u_rad = np.linalg.norm(calibration.changes(lambda c: projection_angle(c.model, x, y)), axis=0)
    angle, apparent = projection_angle(calibration.model, x, y), apparent_angle(calibration.model, camera, x, y)
    degrees = {"angle_deg": angle, "u_deg": u_rad, "apparent_deg": apparent}
    return pd.DataFrame({"x_mm": x, "y_mm": y} | {name: np.degrees(value) for name, value in degrees.items()})
