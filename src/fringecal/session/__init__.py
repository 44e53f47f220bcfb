"""The input folder: `session.toml`, its frames with their hashes, and every fault found in them."""

from fringecal.session.check import SessionCheck, check_session, load_session
from fringecal.session.document import SessionDocument
from fringecal.session.faults import Fault
from fringecal.session.report import CheckReport, check_report, check_schema
from fringecal.session.session import CameraKnown, Capture, ProjectorKnown, Session
from fringecal.session.temporary import temporary_session
from fringecal.session.write import write_session

__all__ = [
    "CameraKnown",
    "Capture",
    "CheckReport",
    "Fault",
    "ProjectorKnown",
    "Session",
    "SessionCheck",
    "SessionDocument",
    "check_report",
    "check_schema",
    "check_session",
    "load_session",
    "temporary_session",
    "write_session",
]
