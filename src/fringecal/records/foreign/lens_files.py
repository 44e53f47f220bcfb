"""Files that state a lens: which format one has is seen in its first bytes, and each is read within limits."""

import re
from pathlib import Path
from typing import Any

from fringecal.camera import Lens
from fringecal.errors import RecordError
from fringecal.guarded import MOST_LENS, Refusal, bytes_of, text_of
from fringecal.guarded_arrays import matlab_of
from fringecal.records.exports.cameramodel import lens_of_model
from fringecal.records.exports.cameramodel_text import entries_of
from fringecal.records.foreign.bouguet import bouguet_lens
from fringecal.records.foreign.named_values import Size, lens_of_entries
from fringecal.records.foreign.plain_yaml import yaml_of
from fringecal.records.foreign.slcalib_text import SLCALIB, slcalib_of
from fringecal.records.foreign.storage_xml import xml_of

_MODEL = re.compile(r"\s*(?:#[^\n]*\n\s*)*\{")
_YAML = re.compile(r"^(?:%YAML|---|[A-Za-z_][\w .-]*:(?:\s|$))", re.MULTILINE)
MATLAB, MODEL, STORAGE = "MATLAB", ".cameramodel", "OpenCV or ROS"


def read_lens(path: str | Path, size: Size | None = None) -> Lens:
    """Read a lens from a file of any format that is known; its pose, if any, is left aside.

    Parameters
    ----------
    path
        A `.cameramodel`; OpenCV's YAML or XML, also of a camera and a projector, whose camera is then taken;
        ROS's camera_info; SLStudio's `.slcalib`; Bouguet's `.mat`.
    size
        Width and height of the picture, px, for a file that states none.

    Raises
    ------
    RecordError
        The file cannot be read, is none of these, or holds a model that has no Brown's distortion.
    """
    try:
        return lens_of_bytes(bytes_of(path, MOST_LENS), size)
    except Refusal as error:
        raise RecordError(f"{path}: {error}; give a camera model") from error
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error


def lens_of_bytes(content: bytes, size: Size | None = None) -> Lens:
    """Read a lens from the bytes of a file of any format that is known.

    Raises
    ------
    RecordError
        As `read_lens`.
    """
    try:
        form, entries = entries_of_bytes(content)
        if form == MODEL:
            return lens_of_model(entries)
        return bouguet_lens(entries, size) if form == MATLAB else lens_of_entries(entries, size)
    except Refusal as error:
        raise RecordError(str(error)) from error


def parse_lens(text: str) -> Lens:
    """Read a lens from the text of a file."""
    return lens_of_bytes(text.encode("utf-8", "surrogatepass"))


def entries_of_bytes(content: bytes) -> tuple[str, dict[str, Any]]:
    """Return how a file is written, and its entries by name.

    Raises
    ------
    Refusal
        It is none of the formats, or breaks a limit.
    """
    if content.startswith((b"MATLAB", b"\x89HDF")):
        return MATLAB, dict[str, Any](matlab_of(content))
    if content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return STORAGE, xml_of(content.lstrip(b"\xef\xbb\xbf \t\r\n"))
    text = text_of(content)
    if text.startswith(SLCALIB):
        return STORAGE, slcalib_of(text)
    if _MODEL.match(text) is None and _YAML.search(text) is not None:
        return STORAGE, yaml_of(text)
    return MODEL, entries_of(text)
