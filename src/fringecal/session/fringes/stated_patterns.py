"""A capture that refers to `patterns.toml`: what the set of patterns says is taken as if the capture said it."""

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from fringecal.guarded import MOST_TOML, Refusal, bytes_of, text_of, toml_of
from fringecal.session.faults import Fault
from fringecal.session.model_file import outside_fault

KEY = "patterns"
_TAKEN = ("axes", "periods", "zeros_deg", "falling")  # keys of [capture] there that hold for what a camera saw of it
_BESIDE = (*_TAKEN, "fringes", "steps_deg")  # what the set says already


class WithPatterns(NamedTuple):
    """A session's document with its sets of patterns put in: what was wrong, where, and the hash of each file."""

    table: dict[str, Any]
    faults: tuple[Fault, ...]
    broken: frozenset[tuple[str | int, ...]]
    inputs: tuple[tuple[str, str], ...]


def with_patterns(folder: Path, table: dict[str, Any]) -> WithPatterns:
    """Put what `patterns.toml` says into the captures that name it; nothing else of the document changes.

    Parameters
    ----------
    folder
        The session's.
    table
        `session.toml` as read, not yet checked.
    """
    faults: list[Fault] = []
    broken: set[tuple[str | int, ...]] = set()
    inputs: dict[str, str] = {}
    for index, capture in _naming(table):
        where = f'capture "{capture.get("name", index + 1)}": {KEY}'
        try:
            stated = _read(folder, capture[KEY], where, inputs)
        except _WrongPatterns as error:
            faults.append(error.fault)
            broken.add(("capture", index, "axes"))
            continue
        faults += _put(table, capture, stated, where)
    return WithPatterns(table, tuple(faults), frozenset(broken), tuple(inputs.items()))


def _naming(table: Mapping[str, Any]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Give the captures that name a set of patterns."""
    captures = table.get("capture")
    for index, capture in enumerate(captures if isinstance(captures, list) else []):
        if isinstance(capture, dict) and isinstance(capture.get(KEY), str):
            yield index, capture


class _WrongPatterns(Exception):
    def __init__(self, fault: Fault) -> None:
        super().__init__(str(fault))
        self.fault = fault


def _read(folder: Path, name: str, where: str, inputs: dict[str, str]) -> dict[str, Any]:
    """Read a set's description, and note its hash."""
    outside = outside_fault(folder, name, where)
    if outside is not None:
        raise _WrongPatterns(outside)
    try:
        content = bytes_of(folder / name, MOST_TOML)
        found = toml_of(text_of(content))
    except Refusal as error:
        remedy = "copy the patterns.toml of the set that was shown into the session's folder"
        raise _WrongPatterns(Fault(where, f'"{name}" {error}', remedy)) from error
    parts = [found.get(key) for key in ("projector", "phase", "capture")]
    if not all(isinstance(part, dict) for part in parts):
        remedy = "name the patterns.toml that `fringecal patterns` wrote"
        raise _WrongPatterns(Fault(where, f'"{name}" describes no set of patterns', remedy))
    inputs[name] = hashlib.sha256(content).hexdigest()
    return found


def _put(table: dict[str, Any], capture: dict[str, Any], stated: Mapping[str, Any], where: str) -> Iterator[Fault]:
    """Put the set's keys into a capture, and its projector into the document; refuse what is stated twice."""
    twice = [key for key in _BESIDE if key in capture]
    if twice:
        yield Fault(where, f"{', '.join(twice)} stated beside it, which the set says already", "leave them out")
    said = stated["capture"]
    capture |= {key: said[key] for key in _TAKEN if key in said}
    if "steps_deg" in stated["phase"]:
        capture["steps_deg"] = stated["phase"]["steps_deg"]
    if "gray" in said and "gray" not in capture:
        yield Fault(where, "the set has a Gray code, and the capture names no pictures of it", "list them in gray")
    yield from _projector(table, stated["projector"].get("resolution_px"), where)


def _projector(table: dict[str, Any], shown: object, where: str) -> Iterator[Fault]:
    """Take the projector's pixels from the set, where the session does not state them; they must be the same."""
    projector = table.setdefault("projector", {})
    if not isinstance(projector, dict):
        return
    own = projector.setdefault("resolution_px", shown)
    if own != shown:
        remedy = "the projector must show the set pixel by pixel: state the resolution that it was drawn for"
        yield Fault(where, f"the set is drawn for {shown} px, and projector.resolution_px = {own}", remedy)
