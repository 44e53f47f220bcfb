"""The few lines of TOML that a session or target document needs, as text."""

import json
from collections.abc import Mapping, Sequence
from datetime import date, datetime, time
from typing import Any

import numpy as np


def to_toml(document: Mapping[str, Any]) -> str:
    """Write a document of scalars, tables and arrays of tables as TOML 1.0 text.

    Parameters
    ----------
    document
        Top-level mappings become ``[tables]``, top-level lists of mappings ``[[tables]]``; anything
        deeper is written inline. Keys whose value is None are left out: TOML has no null.

    Raises
    ------
    TypeError
        For a value that TOML cannot hold.

    Examples
    --------
    >>> print(to_toml({"format": 1, "camera": {"height_mm": {"value": 1500.0, "u": 5.0}}}), end="")
    format = 1
    <BLANKLINE>
    [camera]
    height_mm = { value = 1500.0, u = 5.0 }
    """
    scalars, tables = [], []
    for key, value in document.items():
        if isinstance(value, Mapping):
            tables.append(f"\n[{_key(key)}]\n{_pairs(value)}")
        elif _is_table_array(value):
            tables.extend(f"\n[[{_key(key)}]]\n{_pairs(table)}" for table in value)
        elif value is not None:
            scalars.append(f"{_key(key)} = {_value(value)}\n")
    return "".join(scalars + tables)


def _pairs(table: Mapping[str, Any]) -> str:
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in table.items() if value is not None)


def _is_table_array(value: object) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("_", "a").replace("-", "a").isalnum()
    return key if bare else _text(key)


def _text(text: str) -> str:
    # A JSON string is a TOML basic string but for DEL, which TOML wants escaped.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: object) -> str:
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    return _nested(value)


def _nested(value: object) -> str:
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items() if v is not None)
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    raise TypeError(f"TOML cannot hold a {type(value).__name__}: {value!r}")
