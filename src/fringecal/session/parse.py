"""Read `session.toml` into its document, salvaging what is right so that one check finds every fault."""

import copy
import hashlib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from fringecal.guarded import MOST_TOML, MissingFileRefusal, Refusal, bytes_of, is_folder, text_of, toml_of
from fringecal.session.document import (
    BY_AXIS,
    FILE_NAME,
    IN_ONE,
    AxisAngles,
    AxisFiles,
    AxisLengths,
    CameraTable,
    CaptureTable,
    MapTable,
    MirrorTable,
    PhaseTable,
    ProjectorTable,
    SessionDocument,
)
from fringecal.session.faults import Fault, hint, nearest
from fringecal.session.fringes.stated_patterns import with_patterns
from fringecal.targets import Quantity

Loc = tuple[int | str, ...]

_TABLES: dict[tuple[str, ...], type[BaseModel]] = {
    (): SessionDocument,
    ("camera",): CameraTable,
    ("projector",): ProjectorTable,
    ("phase",): PhaseTable,
    ("capture",): CaptureTable,
    ("camera", "height_mm"): Quantity,
    ("projector", "position_mm"): Quantity,
    ("projector", "mirror"): MirrorTable,
    ("projector", "mirror", "point_mm"): Quantity,
    ("capture", "periods"): AxisLengths,
    ("capture", "fringes"): AxisLengths,
    ("capture", "zeros_deg"): AxisAngles,
    ("capture", "gray"): AxisFiles,
    ("capture", "maps"): MapTable,
}

# Stand-ins for what is missing or wrong, so that the rest can still be checked; never returned as data.
_CAPTURE_STAND_INS: dict[str, Any] = {"name": "unknown", "kind": "object", "images": []}
_STAND_INS: dict[str, Any] = {
    "format": 1,
    "rig": "unknown",
    "captured": datetime(1970, 1, 1, tzinfo=UTC),
    "capture": [_CAPTURE_STAND_INS],
}

_TAGS = (IN_ONE, BY_AXIS)  # parts of a place that the document does not have

_MOST_FAULTS = 100  # that one validation tells: a list of 100,000 wrong entries has as many
_SHOWN = 60  # characters of a wrong value that a message shows: half a line

_NEEDED = {
    "format": "write format = 1",
    "rig": 'name the rig, for example rig = "bench-1"',
    "captured": "write a date with time and zone, without quotes: captured = 2026-11-22T10:00:00Z",
    "capture": "describe at least one [[capture]] with name, kind and images",
    "name": 'give each capture a name, for example name = "strips"',
    "kind": "write one of grid, board, reference, strips, artefact, object",
    "images": 'list the files, for example images = ["strips-*.png"]',
    "target": 'write the name of a target or a path to one, for example target = "grid-10mm"',
    "steps_deg": "list the phase shifts in degrees in file order, for example [0.0, 120.0, 240.0]",
    "position_mm": "write position_mm = { value = [x, y, z], u = [ux, uy, uz] }",
    "point_mm": "write point_mm = { value = [x, y, z], u = [ux, uy, uz] }, any point of the mirror",
    "normal": "write normal = [nx, ny, nz], the direction across the mirror",
    "height_mm": "write height_mm = { value = 1500.0, u = 5.0 }",
    "bits": "write the camera's true bits per pixel, 8 to 16",
    "channel": 'write one of "mean", "red", "green", "blue", "luma"',
    "repeat": "write how often the whole set was taken, 1 or more",
    "use": 'write "calibration" or "verification", or leave it out',
    "periods": "list the fringe periods in file order, all greater than zero",
    "axes": 'write axes = ["u"], ["v"] or ["u", "v"]: the projector\'s columns are counted along u, its rows along v',
    "fringes": "list the numbers of fringes across the projector's picture in file order, all greater than zero",
    "zeros_deg": "list the phase of each period at the projector's first pixel, in degrees",
    "maps": 'list tables: maps = [{ file = "phase.npz", name = "u", axis = "u", fringes = 64, absolute = true }]',
    "file": "name a .npy, .npz or .mat file in the session's folder",
    "axis": 'write axis = "u" or axis = "v"',
    "falling": "list the axes along which the phase falls; [] says that it rises along each",
    "resolution_px": "write resolution_px = [columns, rows] of the projector",
    "pixel_aspect": "write the height of the projector's pixels over their width",
    "pixels": 'write "square" or "diamond"',
    "white": "list the picture or pictures lit by the projector evenly white",
    "black": "list the picture or pictures taken with the projector black",
    "value": "write a finite number, or a list of them",
    "u": "state the standard uncertainty, zero or more",
}


@dataclass(frozen=True)
class Parsed:
    """A document with what was wrong in it.

    Parameters
    ----------
    document
        None if nothing could be read; else its right parts, with stand-ins for the broken ones.
    broken
        Places that hold stand-ins: checks that depend on them say nothing.
    faults
        Everything that was wrong.
    sha256
        Of the very bytes that were read; empty for a text.
    pattern_files
        Sets of patterns that captures name, with the hash of each.
    """

    document: SessionDocument | None
    broken: frozenset[Loc] = frozenset()
    faults: tuple[Fault, ...] = field(default=())
    sha256: str = ""
    pattern_files: tuple[tuple[str, str], ...] = ()

    @property
    def sound_document(self) -> SessionDocument:
        """The document, once it is known that there is one."""
        assert self.document is not None
        return self.document

    def is_sound(self, table: str) -> bool:
        """Whether all of a table is what the file says."""
        return not any(place[0] == table for place in self.broken)

    def broken_keys(self, index: int) -> frozenset[str]:
        """Keys of one capture that hold stand-ins; all of them where the capture is no table."""
        places = [place for place in self.broken if place[:2] == ("capture", index)]
        if any(len(place) == 2 for place in places) or ("capture",) in self.broken:
            return frozenset(CaptureTable.model_fields)
        return frozenset(str(place[2]) for place in places)


def parse_folder(folder: Path) -> Parsed:
    """Read `session.toml` in a folder; never raises."""
    if not is_folder(folder):
        what = "is a file" if os.path.exists(folder) else "is not there, or may not be looked at"
        return _refused(str(folder), what, "give the folder that holds session.toml")
    path = folder / FILE_NAME
    try:
        content = bytes_of(path, MOST_TOML)
        parsed = parse_text(text_of(content), folder)
    except MissingFileRefusal:
        return _refused(
            str(folder),
            f"no {FILE_NAME} in the folder",
            "write one; docs/session.md lists its keys, `fringecal simulate thesis --out DIR` makes an example",
        )
    except Refusal as error:
        return _refused(FILE_NAME, str(error), "give one TOML file in UTF-8 that may be read")
    return replace(parsed, sha256=hashlib.sha256(content).hexdigest())


def parse_text(text: str, folder: Path | None = None) -> Parsed:
    """Read the text of a `session.toml`, and the sets of patterns that it names in its folder; never raises."""
    if not text.strip():
        return _refused(FILE_NAME, "empty", "describe the session in it; docs/session.md lists its keys")
    try:
        table = toml_of(text)
    except Refusal as error:
        return _refused(FILE_NAME, f"{error}{_line_named(text, str(error))}", "correct it")
    if folder is None:
        return _salvaged(table)
    found = with_patterns(folder, table)
    parsed = _salvaged(found.table)
    broken, faults = parsed.broken | found.broken, (*parsed.faults, *found.faults)
    return replace(parsed, broken=broken, faults=faults, pattern_files=found.inputs)


def _line_named(text: str, message: str) -> str:
    """Quote the line that a TOML error names; a key written twice is told by nothing else."""
    named = re.search(r"at line (\d+)", message)
    lines = text.splitlines()
    if named is None or not 0 < int(named[1]) <= len(lines):
        return ""
    return f": {_short(lines[int(named[1]) - 1].strip())}"


def _refused(where: str, found: str, remedy: str) -> Parsed:
    return Parsed(None, faults=(Fault(where, found, remedy),))


def _salvaged(table: dict[str, Any]) -> Parsed:
    """Validate; put stand-ins where it fails and validate again, until what is left is right."""
    faults: list[Fault] = []
    broken: set[Loc] = set()
    table = copy.deepcopy(table)
    # Each round repairs at least one place; a place repaired before and wrong again cannot be helped.
    while True:
        try:
            return Parsed(SessionDocument.model_validate(table), frozenset(broken), tuple(faults))
        except ValidationError as error:
            errors: list[Any] = [{**e, "loc": _untagged(e["loc"])} for e in error.errors()]
        places = {_place(tuple(e["loc"])) for e in errors} - broken
        faults += _described(errors, table)
        if not places:
            return Parsed(None, frozenset(broken), tuple(dict.fromkeys(faults)))
        for place in sorted(places, key=lambda p: [str(part) for part in p]):
            _stand_in(table, place)
        broken |= places


def _untagged(loc: Loc) -> Loc:
    """Leave out what tells one form of a key from another: the document has no such part."""
    return tuple(part for part in loc if part not in _TAGS)


def _place(loc: Loc) -> Loc:
    """Cut a location to what is replaced as one: a key of the top, of a table, or of one capture."""
    return loc[:3] if loc[0] == "capture" else loc[:2]


def _stand_in(table: dict[str, Any], place: Loc) -> None:
    """Replace what is needed, leave out what is optional."""
    top = str(place[0])
    if len(place) == 1:
        _replace(table, top, _STAND_INS)
    elif top == "capture" and len(place) == 2:
        table[top][place[1]] = copy.deepcopy(_CAPTURE_STAND_INS)
    elif top == "capture":
        _replace(table[top][place[1]], str(place[2]), _CAPTURE_STAND_INS)
    elif top == "camera":
        _replace(table[top], str(place[1]), {})
    else:  # tables that one needed key makes: the projector's and the phase's go as a whole
        table.pop(top, None)


def _replace(table: dict[str, Any], key: str, stand_ins: Mapping[str, Any]) -> None:
    table.pop(key, None)
    if key in stand_ins:
        table[key] = copy.deepcopy(stand_ins[key])


def _described(errors: list[Any], table: Mapping[str, Any]) -> list[Fault]:
    more, errors = max(0, len(errors) - _MOST_FAULTS), errors[:_MOST_FAULTS]
    guesses = {
        (*e["loc"][:-1], nearest(str(e["loc"][-1]), _known(e["loc"][:-1])))
        for e in errors
        if e["type"] == "extra_forbidden"
    }
    # A misspelt key is one fault, not two: the key it was meant to be is not called missing as well.
    faults = [_fault(e, table) for e in errors if not (e["type"] == "missing" and tuple(e["loc"]) in guesses)]
    return [*faults, Fault(FILE_NAME, f"{more} more faults", "correct these first")] if more else faults


def _known(loc: Loc) -> list[str]:
    names = tuple(part for part in loc if isinstance(part, str))
    model = _TABLES.get(names)
    return list(model.model_fields) if model else []


def _fault(error: Any, table: Mapping[str, Any]) -> Fault:
    loc: Loc = tuple(error["loc"])
    where = f"{FILE_NAME}: {_spoken(loc, table)}"
    key = next((str(part) for part in reversed(loc) if isinstance(part, str)), "")
    if error["type"] == "extra_forbidden":
        return Fault(where, f'unknown key "{loc[-1]}"', hint(str(loc[-1]), _known(loc[:-1])))
    if error["type"] == "missing":
        return Fault(where, "missing", _NEEDED.get(key, "state it"))
    if error["type"] == "value_error":
        return Fault(where, str(error["ctx"]["error"]), _NEEDED.get(key, "correct the table"))
    found = f"found {_short(error['input'])}: {_lower(error['msg'])}"
    return Fault(where, found, _NEEDED.get(key, "write a value of the right kind"))


def _lower(message: str) -> str:
    return message[:1].lower() + message[1:]


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


def _spoken(loc: Loc, table: Mapping[str, Any]) -> str:
    """Name a place as its writer would: ``capture "strips": images``."""
    if len(loc) >= 2 and loc[0] == "capture" and isinstance(loc[1], int):
        rest = ".".join(str(part) for part in loc[2:])
        return capture_label(table["capture"][loc[1]], loc[1]) + (f": {rest}" if rest else "")
    return ".".join(str(part) for part in loc) or "document"


def capture_label(capture: object, index: int) -> str:
    """Name a capture by its name, or by its place in the file where it has none."""
    name = capture.get("name") if isinstance(capture, Mapping) else None
    return f'capture "{name}"' if isinstance(name, str) and name else f"capture {index + 1}"
