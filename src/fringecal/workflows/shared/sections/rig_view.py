"""The rig drawn to scale, as found and as stated."""

import math

import numpy as np

from fringecal.projector import RigCalibration, projector_estimates
from fringecal.report import FigureItem, Pupil, rig_drawing
from fringecal.session import Session
from fringecal.workflows.shared.stated_projector import projector_of


def rig_figure(session: Session, calibration: RigCalibration) -> tuple[FigureItem, ...]:
    """Draw the rig to scale, as fitted and as stated; parallel light has no place to draw."""
    projector = projector_estimates(calibration, projector_of(session))
    if not projector:
        return ()
    camera = calibration.camera
    eye = stated_eye = stated = None
    if not camera.telecentric:
        u_height = math.sqrt(camera.covariance[-1, -1])
        # A grid alone shows no height: it is the stated one, and only the tilt is fitted.
        seen = session.camera.model is not None or bool(session.find("board"))
        stated_height = "camera, height as stated" if session.camera.height_mm is not None else "camera, height assumed"
        name = "camera, fitted" if seen else stated_height
        eye = Pupil(name, camera.position_mm, np.array([0.0, 0.0, u_height]))
        if seen and session.camera.height_mm is not None:
            height = session.camera.height_mm
            stated_eye = Pupil("camera, stated", np.array([0.0, 0.0, height.values[0]]), np.array([0, 0, height.us[0]]))
    if (position := projector_of(session)) is not None:
        stated = Pupil("projector, stated", position.value_mm, position.u_mm)
    place = np.array([e.value for e in projector])
    figure = rig_drawing(
        field_mm(calibration),
        Pupil("projector, fitted", place, np.array([e.u for e in projector])),
        eye,
        stated_projector=stated,
        stated_camera=stated_eye,
        title=session.rig,
    )
    where = ", ".join(f"{value:.0f}" for value in place)
    alt = f"Side view and plan of the rig: projector at ({where}) mm, camera above the plate, rays to the corners."
    return (FigureItem("The rig to scale", figure, alt),)


def field_mm(calibration: RigCalibration) -> tuple[float, float, float, float]:
    """Return x_min, x_max, y_min, y_max of the field on the plate, mm."""
    camera = calibration.camera
    corners = camera.rays(
        np.array([0.0, camera.width_px - 1, 0.0, camera.width_px - 1]),
        np.array([0.0, 0.0, camera.height_px - 1, camera.height_px - 1]),
    )
    return float(corners.ax.min()), float(corners.ax.max()), float(corners.ay.min()), float(corners.ay.max())
