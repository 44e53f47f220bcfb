"""Write a session folder: all of it or nothing."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from pydantic import ValidationError

from fringecal.errors import SessionError
from fringecal.replacement import hidden_beside, put_in_place, settle, signals_deferred
from fringecal.session.document import FILE_NAME, SessionDocument, is_inside
from fringecal.session.toml_text import to_toml


def write_session(
    folder: Path,
    document: Mapping[str, Any],
    frames: Mapping[str, np.ndarray],
    *,
    extra_files: Mapping[str, bytes] = MappingProxyType({}),
    overwrite: bool = False,
) -> Path:
    """Write `session.toml`, its frames as PNG and further files, and put them in place in one move.

    Parameters
    ----------
    folder
        Where the session is to stand; missing parents are made.
    document
        What `session.toml` says (format 1); ``captured`` is a datetime with a time zone.
    frames
        Pictures by relative file name ending in ``.png``: 2-D, uint8 or uint16.
    extra_files
        Further files by relative name: targets, a camera model, a simulator's truth.
    overwrite
        Replace a folder that already holds a session; any other folder with contents is refused.

    Raises
    ------
    SessionError
        If the document is not of format 1, a frame is not a grey picture, a name leaves the folder,
        or `folder` is in use. Nothing has been written then.
    """
    folder = Path(folder).absolute()
    faults = _document_faults(document) + _content_faults(frames, extra_files)
    faults += _folder_faults(folder, overwrite=overwrite)
    if faults:
        raise SessionError(faults)
    part = hidden_beside(folder)
    try:
        settle(folder)
        _fill(part, document, frames, extra_files)
        put_in_place(part, folder, keep_others=False)
    finally:
        with signals_deferred():
            shutil.rmtree(part, ignore_errors=True)
    return folder


def _document_faults(document: Mapping[str, Any]) -> list[str]:
    # Strict validation wants lists: a caller's tuples and arrays are what they are once written.
    try:
        SessionDocument.model_validate(_as_read(document))
    except ValidationError as error:
        return [f"{FILE_NAME}: {'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()]
    except TypeError as error:
        return [f"{FILE_NAME}: {error}"]
    return []


def _as_read(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _as_read(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_as_read(item) for item in value]
    return value


def _content_faults(frames: Mapping[str, np.ndarray], extra_files: Mapping[str, bytes]) -> list[str]:
    faults = [
        f"{name}: leaves the session folder; give a relative name"
        for name in (*frames, *extra_files)
        if not is_inside(name)
    ]
    faults += [f"{name}: would be written twice" for name in frames if name in extra_files]
    faults += [f"{FILE_NAME}: is made from the document; do not pass it" for name in extra_files if name == FILE_NAME]
    for name, frame in frames.items():
        if not name.lower().endswith(".png"):
            faults.append(f"{name}: frames are written as PNG; end the name in .png")
        if frame.ndim != 2 or frame.size == 0 or frame.dtype not in (np.uint8, np.uint16):
            faults.append(f"{name}: {frame.dtype} of shape {frame.shape}; a 2-D uint8 or uint16 is needed")
    return faults


def _folder_faults(folder: Path, *, overwrite: bool) -> list[str]:
    if not folder.exists():
        return []
    if not folder.is_dir():
        return [f"{folder}: is a file; name a folder"]
    if not any(folder.iterdir()):
        return []
    if not overwrite:
        return [f"{folder}: is not empty; choose another folder or allow overwriting (--overwrite)"]
    if not (folder / FILE_NAME).is_file():
        return [f"{folder}: holds files but no {FILE_NAME}; only a session is overwritten"]
    return []


def _fill(
    part: Path,
    document: Mapping[str, Any],
    frames: Mapping[str, np.ndarray],
    extra_files: Mapping[str, bytes],
) -> None:
    part.mkdir(parents=True)
    (part / FILE_NAME).write_text(to_toml(document), encoding="utf-8", newline="\n")
    for name, frame in frames.items():
        _write_bytes(part / name, cv2.imencode(".png", frame)[1].tobytes())
    for name, content in extra_files.items():
        _write_bytes(part / name, content)


def _write_bytes(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
