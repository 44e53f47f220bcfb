"""The camera of a session: its grid picture, and what the session states of lens and height."""

from fringecal.calibration import CameraFindings, CameraKnowledge, camera_from_grid
from fringecal.camera import board_view, ruled_pitch
from fringecal.detect import GridDetection, find_grid, grid_of_board, ruling_of
from fringecal.errors import DetectionError, SessionError
from fringecal.session import Capture, Session
from fringecal.targets import Charuco, Chessboard, Dots, LineGrid, Target
from fringecal.uncertainty import Estimate, Influence
from fringecal.workflows.lens import known_lens

SCALED = (LineGrid, Chessboard, Charuco, Dots)
"""Targets whose one picture gives the scale, lying on the plate."""


def measure_camera(session: Session) -> CameraFindings:
    """Find the grid in its picture and fit the camera on the plate.

    Raises
    ------
    SessionError
        The grid's target is neither a line grid nor a board.
    DetectionError, FitError
        No grid shows, or it does not determine the camera.
    """
    capture = session.one("grid")
    if not isinstance(capture.target, SCALED):
        raise SessionError([f"capture {capture.name!r}: its target is neither a line grid nor a board; name one"])
    try:
        detection, pitch = grid_with_pitch(capture, capture.target)
    except DetectionError as error:
        raise DetectionError(f"capture {capture.name!r} ({capture.paths[0].name}): {error}") from error
    return camera_from_grid(detection, pitch, camera_knowledge(session), thermal_rel_u=capture.target.thermal_rel_u)


def grid_with_pitch(capture: Capture, target: Target) -> tuple[GridDetection, Estimate]:
    """Find the grid or the board in its picture, and the distance of its lines, corners or dots, mm.

    Raises
    ------
    DetectionError
        No grid shows, or what lies between its lines contradicts what the target states.
    """
    picture = capture.read()[0]
    if isinstance(target, Dots) and target.asymmetric:
        raise DetectionError(
            "asymmetric dots stand on no lines along both axes; for the scale use symmetric dots, a chessboard, a "
            "ChArUco board or a line grid"
        )
    if not isinstance(target, LineGrid):
        stated = target.pitch_mm if isinstance(target, Dots) else target.square_mm  # type: ignore[union-attr]
        found = grid_of_board(board_view(picture, target).points_px, picture.shape[:2])
        return found, stated.estimate(Influence.GRID_PITCH, "mm")
    detection = find_grid(picture, polarity=target.polarity)
    stated = target.pitch_mm.estimate(Influence.GRID_PITCH, "mm")
    return detection, ruled_pitch(ruling_of(picture, detection), stated, target.heavy_every)


def camera_knowledge(session: Session) -> CameraKnowledge:
    """Return what a session states of its camera, its lens by file or board pictures included.

    Raises
    ------
    SessionError, RecordError, DetectionError, FitError
        As `fringecal.workflows.lens.known_lens`.
    """
    return CameraKnowledge(stated_height(session), session.camera.telecentric, known_lens(session))


def stated_height(session: Session) -> Estimate | None:
    """Return the camera's height as the session states it, mm; None where it does not."""
    stated = session.camera.height_mm
    return None if stated is None else stated.estimate(Influence.CAMERA_HEIGHT, "mm")
