"""Refusals of sessions and pictures that belong to another rig than the calibration."""

from fringecal.errors import SessionError
from fringecal.projector import RigCalibration
from fringecal.session import Capture, Session


def demand_same_rig(session: Session, calibrated: str) -> None:
    """Refuse a calibration of another rig.

    Raises
    ------
    SessionError
        The session names another rig than the calibration does.
    """
    if session.rig != calibrated:
        raise SessionError(
            [
                f"the session is of rig {session.rig!r}, the calibration of {calibrated!r}: name the calibration of "
                "this rig, or correct the key rig in session.toml"
            ]
        )


def demand_same_picture(capture: Capture, calibration: RigCalibration) -> None:
    """Refuse pictures of another size than the calibration's.

    Raises
    ------
    SessionError
        The sizes differ.
    """
    size = (calibration.camera.height_px, calibration.camera.width_px)
    if tuple(capture.shape) != size:
        raise SessionError(
            [
                f"capture {capture.name!r}: pictures of {capture.shape[1]} x {capture.shape[0]} px, the calibration "
                f"is for {size[1]} x {size[0]} px; use pictures of the same camera, uncropped"
            ]
        )
