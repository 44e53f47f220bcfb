"""Where a session says that its projector stands, and how far the projector found lies from there."""

from fringecal.errors import FitError
from fringecal.projector import Displacement, ProjectorPosition, RigCalibration, displacement, reflected_source
from fringecal.session import Session


def projector_of(session: Session) -> ProjectorPosition | None:
    """Return the stated position of the projector, if the session states one: of its image, if there is a mirror."""
    if session.projector is None or session.projector.position_mm is None:
        return None
    position, mirror = session.projector.position_mm, session.projector.mirror
    stated = ProjectorPosition(position.array(3), position.u_array(3))
    if mirror is None:
        return stated
    point = ProjectorPosition(mirror.point_mm.array(3), mirror.point_mm.u_array(3))
    return reflected_source(stated, point, mirror.normal)


def displaced(calibration: RigCalibration, stated: ProjectorPosition | None) -> Displacement | None:
    """Compare the projector found with the stated one; None where there is nothing to compare."""
    try:
        return None if stated is None else displacement(calibration, stated)
    except FitError:  # parallel light has no position; the theory table still holds
        return None
