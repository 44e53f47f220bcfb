"""The projection angle: fringe breaks at strips of known height, tables 3.5 and 3.6, by any of three estimators."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fringecal.calibration import CameraFindings
from fringecal.errors import SessionError
from fringecal.projector import PictureEstimator, picture_breaks
from fringecal.session import Session
from fringecal.workflows.commission import (
    AngleFindings,
    Estimator,
    angles_of,
    calibrate_session,
    gather_angles,
    measure_camera,
    strips_captures,
    strips_target,
)
from fringecal.workflows.shared import projector_of

Array = NDArray[np.float64]
Progress = Callable[[str], None]

ESTIMATORS: tuple[Estimator, ...] = ("phase", "ridge", "skeleton")


def break_angles(
    session: Session, *, estimator: Estimator = "phase", progress: Progress = lambda _: None
) -> AngleFindings:
    """Measure the projection angle of a session by the fringe breaks at its strips.

    Parameters
    ----------
    session
        Captures of kind grid and strips; "phase" needs phase-shifted ones of kind reference and strips. "ridge" and
        "skeleton" use the first picture of the strips alone, as the thesis did.
    estimator
        "phase", "ridge" or "skeleton".
    progress
        Called with a short sentence before each step.

    Raises
    ------
    SessionError
        A capture that is needed is missing, or an unknown estimator.
    DetectionError, PhaseError, FitError
        What the pictures do not show or determine, with the reason.
    """
    if estimator not in ESTIMATORS:
        raise SessionError([f"no estimator is called {estimator!r}; take one of {', '.join(ESTIMATORS)}"])
    if estimator == "phase":
        return angles_of(calibrate_session(session, progress=progress))
    progress("finding the grid and fitting the camera")
    return picture_angles(session, measure_camera(session), estimator=estimator, progress=progress)


def picture_angles(
    session: Session, camera: CameraFindings, *, estimator: PictureEstimator, progress: Progress = lambda _: None
) -> AngleFindings:
    """Return the angles that the first picture of a session's strips shows by itself."""
    capture = strips_captures(session)[0]
    picture = capture.read()[0]
    stated = projector_of(session)
    found = picture_breaks(
        picture,
        strips_target(capture),
        camera.fit,
        estimator=estimator,
        projector_mm=None if stated is None else stated.value_mm,
        progress=progress,
    )
    decision = found.ordered.decision
    return gather_angles(session, estimator, camera, found.calibration, found.breaks, decision, picture)
