"""TOML files that a laboratory owns, format 1: read whole, every fault named."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from fringecal.errors import RecordError
from fringecal.guarded import MOST_TOML, Refusal, bytes_of, first_few, shortened, text_of, toml_of


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
        stated = toml_of(text_of(bytes_of(file, MOST_TOML)))
    except Refusal as error:
        raise RecordError(f"{file}: {error}; give {name}") from error
    if "format" not in stated:
        raise RecordError(f'{file}: states no format; write "format = 1" as its first line')
    try:
        return model.model_validate(stated)
    except ValidationError as error:
        faults = first_few([(fault or _plainly)(found) for found in error.errors()])
        raise RecordError(f"{file}: {'; '.join(faults)}") from error


def _plainly(found: Any) -> str:
    return f"{shortened('.'.join(map(str, found['loc'])))}: {shortened(found['msg'])}"
