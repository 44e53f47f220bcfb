"""The camera model that a session names: read once, so that what is hashed, checked and used are the same bytes."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fringecal.errors import FringecalError
from fringecal.guarded import MOST_LENS, MissingFileRefusal, Refusal, bytes_of, lies_inside
from fringecal.session.document import FILE_NAME, SessionDocument, is_inside
from fringecal.session.faults import Fault

type ReadModel = Callable[[bytes], object]
"""Reads a camera model from its bytes, and raises a `FringecalError` for what is none."""

_WHERE = f"{FILE_NAME}: camera.model"
_REMEDY = "add the file or leave the key out"


@dataclass(frozen=True)
class ModelFile:
    """A file with a camera model, and what stands in it."""

    path: Path
    content: bytes

    @property
    def sha256(self) -> str:
        """Hash of the content."""
        return hashlib.sha256(self.content).hexdigest()


def model_file(
    folder: Path, document: SessionDocument, read: ReadModel | None = None
) -> tuple[ModelFile | None, list[Fault]]:
    """Read the camera model that a session names; no file and no fault where it names none.

    Parameters
    ----------
    folder, document
        The session.
    read
        What tells whether the content is a camera model; None leaves that to whoever uses it.
    """
    name = document.camera.model
    if name is None:
        return None, []
    outside = outside_fault(folder, name, _WHERE)
    if outside is not None:
        return None, [outside]
    try:
        found = ModelFile(folder / name, bytes_of(folder / name, MOST_LENS))
        if read is not None:
            read(found.content)
    except MissingFileRefusal:
        return None, [Fault(_WHERE, f'"{name}" is not there', _REMEDY)]
    except Refusal as error:
        return None, [Fault(_WHERE, f'"{name}" {error}', _REMEDY)]
    except FringecalError as error:
        return None, [Fault(_WHERE, f'"{name}": {error}', "give another file or leave the key out")]
    return found, []


def outside_fault(folder: Path, name: str, where: str) -> Fault | None:
    """Refuse a name that leads out of the session's folder, also by a link: such a file would not go with it."""
    if is_inside(name) and "\0" not in name and lies_inside(folder / name, folder):
        return None
    return Fault(where, f'"{name}" is outside the session folder', "copy it in and name it relative to the folder")
