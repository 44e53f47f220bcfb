"""Finding and reading target files; the only module of this room that touches the disk."""

import difflib
import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from fringecal.errors import TargetError
from fringecal.guarded import (
    MOST_TOML,
    MissingFileRefusal,
    Refusal,
    bytes_of,
    first_few,
    is_file,
    quoted,
    shortened,
    text_of,
    toml_of,
)
from fringecal.targets.aruco import ALIKE
from fringecal.targets.kinds_of_target import KINDS, Target
from fringecal.targets.quantity import HOW_TO_STATE

_MOST_SAID = 600  # characters of what a target says of itself; values of any length may stand in it
QUANTITY_KEYS = ("value", "u", "half_width", "distribution")


def shipped_folder() -> Path:
    """Folder of the shipped target files: inside the installed package, or `targets/` of the source tree."""
    installed = Path(str(resources.files("fringecal"))) / "_shared" / "targets"
    source_tree = Path(__file__).resolve().parents[3] / "targets"
    for folder in (installed, source_tree):
        if folder.is_dir():
            return folder
    raise TargetError(f"the shipped targets are missing: {installed} does not exist; install fringecal again")


def list_targets() -> list[str]:
    """Names of the shipped targets, sorted.

    Examples
    --------
    >>> "grid-10mm" in list_targets()
    True
    """
    return sorted(file.stem for file in shipped_folder().glob("*.toml"))


def load_target(name_or_path: str | os.PathLike[str], *, folder: str | os.PathLike[str] | None = None) -> Target:
    """Read a target by the name of a shipped file or by a path.

    Parameters
    ----------
    name_or_path
        A shipped name such as ``"grid-10mm"``; or a path, known by its ending ``.toml``.
    folder
        Where a relative path starts; the working directory when not given.

    Raises
    ------
    TargetError
        Unknown name, unreadable file, or contradictions in it: every fault, each with its remedy.

    Examples
    --------
    >>> load_target("glass-strips").height_mm.value
    3.0
    """
    return read_target(name_or_path, folder=folder)[0]


def read_target(
    name_or_path: str | os.PathLike[str], *, folder: str | os.PathLike[str] | None = None
) -> tuple[Target, bytes]:
    """Read a target, and the very bytes that it was read from, by which it can be hashed.

    Parameters and errors are those of `load_target`.
    """
    file = _find(os.fspath(name_or_path), Path(folder or "."))
    content = _read(file)
    return parse_target(_table(content, file), where=str(file)), content


def parse_target(stated: Mapping[str, Any], *, where: str = "target") -> Target:
    """Turn the content of a target file into a target; `where` names it in the error message."""
    faults = _header_faults(stated)
    model = KINDS.get(stated["kind"]) if isinstance(stated.get("kind"), str) else None
    if model is not None:
        try:
            target = model.model_validate({key: value for key, value in stated.items() if key != "format"})
        except ValidationError as error:
            faults += [_fault(dict(found), list(model.model_fields)) for found in error.errors()]
    if faults:
        count = "1 fault" if len(faults) == 1 else f"{len(faults)} faults"
        raise TargetError(
            f"{where}: {count} in this target\n" + "\n".join(f"  - {fault}" for fault in first_few(faults))
        )
    return target  # type: ignore[return-value]  # every model in KINDS is a member of Target


def _find(name: str, folder: Path) -> Path:
    if name.endswith(".toml"):
        return folder / name
    if name in list_targets():
        return shipped_folder() / f"{name}.toml"
    if is_file(folder / f"{name}.toml"):
        raise TargetError(f'no shipped target is called "{name}"; for the file beside it write "{name}.toml"')
    name = shortened(name)
    nearest = difflib.get_close_matches(name, list_targets(), n=3, cutoff=ALIKE) or list_targets()
    raise TargetError(
        f'no shipped target is called "{name}"; nearest: {", ".join(nearest)}. '
        "For a file of your own give its path, which ends in .toml"
    )


def _read(file: Path) -> bytes:
    try:
        return bytes_of(file, MOST_TOML)
    except MissingFileRefusal:
        raise TargetError(f"{file}: no such target file; check the path, or see the shipped targets") from None
    except Refusal as error:
        raise TargetError(f"{file}: {error}; a target is one TOML file") from None


def _table(content: bytes, file: Path) -> dict[str, Any]:
    try:
        return toml_of(text_of(content))
    except Refusal as error:
        raise TargetError(f"{file}: {error}; a target is one TOML file") from None


def _header_faults(stated: Mapping[str, Any]) -> list[str]:
    faults = []
    if type(stated.get("format")) is not int or stated["format"] != 1:
        found = quoted(stated["format"]) if "format" in stated else "nothing"
        faults.append(f"format: this version reads format = 1, found {found}")
    kind = stated.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        nearest = difflib.get_close_matches(shortened(kind), KINDS, n=1)
        hint = f'did you mean "{nearest[0]}"?' if nearest else f"known are {', '.join(KINDS)}"
        found = "is missing" if kind is None else f"{quoted(kind)} is unknown"
        faults.append(f"kind: {found}; {hint}")
    return faults


def _fault(found: Mapping[str, Any], fields: list[str]) -> str:
    """One pydantic error as a sentence: where, what was found, what to do."""
    *parents, key = [shortened(str(part)) for part in found["loc"]]
    where = ".".join([*parents, key])
    match found["type"]:
        case "extra_forbidden":
            known = QUANTITY_KEYS if parents else fields
            nearest = difflib.get_close_matches(key, known, n=1)
            hint = f'did you mean "{nearest[0]}"?' if nearest else f"known are {', '.join(known)}"
            return f"{where}: unknown key; {hint}"
        case "missing":
            return f"{where}: is missing; {_how_to_state(key)}"
        case "value_error":
            return f"{where}: {shortened(found['ctx']['error'], _MOST_SAID)}"
    return f"{where}: {found['msg']}, found {quoted(found['input'])}"


def _how_to_state(key: str) -> str:
    if key == "certificate":
        return 'state where the numbers come from, or "nominal, not calibrated"'
    if key.endswith(("_mm", "_deg")) or key in QUANTITY_KEYS:
        return HOW_TO_STATE
    return "every target of this kind needs it"
