"""Which captures of a session the rig is fitted to: strips, and artefacts that state it."""

from fringecal.errors import SessionError
from fringecal.session import Capture, Session
from fringecal.targets import Strips


def strips_captures(session: Session) -> tuple[Capture, ...]:
    """Return the captures of strips that the rig is fitted to, the lowest strips first.

    The lowest strips have the smallest phase difference, so that their fringe order is the easiest to decide.

    Raises
    ------
    SessionError
        There is none, or one has a target that is no set of strips.
    """
    chosen = [capture for capture in session.find("strips") if capture.use == "calibration"]
    if not chosen:
        raise SessionError(['every capture of kind "strips" states use = "verification"; the rig needs one to fit to'])
    return tuple(sorted(chosen, key=lambda capture: max(strips_target(capture).height_mm.values)))


def strips_target(capture: Capture) -> Strips:
    """Return the strips that a capture shows.

    Raises
    ------
    SessionError
        Its target is something else.
    """
    if not isinstance(capture.target, Strips):
        raise SessionError([f"capture {capture.name!r}: its target is no set of strips; name one"])
    return capture.target


def further_captures(session: Session) -> tuple[Capture, ...]:
    """Return all captures but the lowest strips that the rig is to be fitted to."""
    artefacts = (c for c in session.find("artefact") if c.use == "calibration")
    return (*strips_captures(session)[1:], *artefacts)
