"""The rigs that ship with the simulator; the only module here that reads files."""

import difflib
from importlib import resources
from pathlib import Path
from typing import Any

from fringecal.errors import FringecalError
from fringecal.guarded import MOST_TOML, Refusal, bytes_of, is_file, shortened, text_of, toml_of
from fringecal.simulate.rig.raster_spec import RasterRigSpec, raster_rig_from
from fringecal.simulate.rig.rig_spec import RigSpec, rig_from


def list_rigs() -> list[str]:
    """Names of the rigs that ship with the simulator.

    Examples
    --------
    >>> "thesis" in list_rigs()
    True
    """
    return _names("rigs")


def list_raster_rigs() -> list[str]:
    """Names of the rigs with a raster projector that ship with the simulator.

    Examples
    --------
    >>> "dlp" in list_raster_rigs()
    True
    """
    return _names("raster_rigs")


def _names(folder: str) -> list[str]:
    entries = (resources.files("fringecal.simulate") / folder).iterdir()
    return sorted(entry.name.removesuffix(".toml") for entry in entries if entry.name.endswith(".toml"))


def load_rig(name_or_path: str | Path) -> RigSpec:
    """Load a shipped rig by name, or any rig by the path of its TOML.

    Raises
    ------
    FringecalError
        If there is no such rig, or its document has faults; all of them are listed.

    Examples
    --------
    >>> load_rig("thesis").camera.scale_mm_per_px
    0.734
    """
    return rig_from(_table(str(name_or_path)), f"rig {name_or_path}")


def load_raster_rig(name_or_path: str | Path) -> RasterRigSpec:
    """Load a shipped rig with a raster projector by name, or any by the path of its TOML.

    Raises
    ------
    FringecalError
        If there is no such rig, or its document has faults; all of them are listed.

    Examples
    --------
    >>> load_raster_rig("dlp").projector.columns
    1920
    """
    return raster_rig_from(_table(str(name_or_path)), f"rig {name_or_path}")


def is_raster_rig(name_or_path: str | Path) -> bool:
    """Tell whether a rig has a raster projector: its document says kind = "raster".

    Raises
    ------
    FringecalError
        If there is no such rig.
    """
    return _table(str(name_or_path)).get("kind") == "raster"


def _table(name: str) -> dict[str, Any]:
    try:
        return toml_of(text_of(_content(name)))
    except Refusal as error:
        raise FringecalError(f"rig {name}: {error}; a rig is one TOML file") from None


def _content(name: str) -> bytes:
    for folder in ("rigs", "raster_rigs"):
        if name in _names(folder):
            return (resources.files("fringecal.simulate") / folder / f"{name}.toml").read_bytes()
    if is_file(name):
        return bytes_of(name, MOST_TOML)
    name, known = shortened(name), [*list_rigs(), *list_raster_rigs()]
    nearest = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
    raise FringecalError(f"no rig {name!r}: neither a file nor one of {', '.join(known)}{hint}")
