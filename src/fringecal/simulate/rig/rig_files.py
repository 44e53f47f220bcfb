"""The rigs that ship with the simulator; the only module here that reads files."""

import difflib
from importlib import resources
from pathlib import Path

from fringecal.errors import FringecalError
from fringecal.guarded import MOST_TOML, Refusal, bytes_of, is_file, shortened, text_of, toml_of
from fringecal.simulate.rig.rig_spec import RigSpec, rig_from


def list_rigs() -> list[str]:
    """Names of the rigs that ship with the simulator.

    Examples
    --------
    >>> "thesis" in list_rigs()
    True
    """
    folder = resources.files("fringecal.simulate") / "rigs"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


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
    name = str(name_or_path)
    try:
        table = toml_of(text_of(_content(name)))
    except Refusal as error:
        raise FringecalError(f"rig {name}: {error}; a rig is one TOML file") from None
    return rig_from(table, f"rig {name}")


def _content(name: str) -> bytes:
    if name in list_rigs():
        return (resources.files("fringecal.simulate") / "rigs" / f"{name}.toml").read_bytes()
    if is_file(name):
        return bytes_of(name, MOST_TOML)
    name = shortened(name)
    nearest = difflib.get_close_matches(name, list_rigs(), n=1)
    hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
    raise FringecalError(f"no rig {name!r}: neither a file nor one of {', '.join(list_rigs())}{hint}")
