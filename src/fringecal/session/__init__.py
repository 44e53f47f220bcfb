"""The input folder: `session.toml`, its frames with their hashes, and every fault found in them."""

from fringecal.session.document import SessionDocument
from fringecal.session.write import write_session

__all__ = ["SessionDocument", "write_session"]
