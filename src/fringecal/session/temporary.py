"""A session that lives as long as its use: written to a folder of its own, read back, removed."""

import contextlib
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fringecal.session.captures import Session
from fringecal.session.checking import load_session
from fringecal.session.write import write_session


@contextlib.contextmanager
def temporary_session(
    document: Mapping[str, Any],
    frames: Mapping[str, np.ndarray],
    *,
    extra_files: Mapping[str, bytes] = MappingProxyType({}),
) -> Iterator[Session]:
    """Lend a session made of pictures in memory; it passes through files as any other, and they are then removed.

    Parameters
    ----------
    document, frames, extra_files
        As for `write_session`.

    Raises
    ------
    SessionError
        The session has faults, as if read from a folder.
    """
    with tempfile.TemporaryDirectory(prefix="fringecal-") as folder:
        yield load_session(write_session(Path(folder) / "session", document, frames, extra_files=extra_files))
