"""TOML files that a laboratory owns, format 1: read whole, every fault named."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from fringecal.errors import RecordError


def read_owned[Document: BaseModel](
    path: str | Path, model: type[Document], *, name: str, fault: Callable[[Any], str] | None = None
) -> Document:
    """Read a laboratory's TOML file as a checked document.

    Parameters
    ----------
    path
        The file.
    model
        What it must be.
    name
        What to give instead of a file that cannot be read.
    fault
        Puts one of pydantic's errors into words; by default the key and pydantic's own.

    Raises
    ------
    RecordError
        The file cannot be read, is not TOML, states no format 1, or holds keys or values that do not belong there.
    """
    file = Path(path)
    try:
        stated = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordError(f"{file}: cannot be read ({error.strerror or error}); give {name}") from error
    except ValueError as error:  # text that is not UTF-8, or not TOML
        raise RecordError(f"{file}: is no TOML document ({error})") from error
    if "format" not in stated:
        raise RecordError(f'{file}: states no format; write "format = 1" as its first line')
    try:
        return model.model_validate(stated)
    except ValidationError as error:
        faults = "; ".join((fault or _plainly)(found) for found in error.errors())
        raise RecordError(f"{file}: {faults}") from error


def _plainly(found: Any) -> str:
    return f"{'.'.join(map(str, found['loc']))}: {found['msg']}"
