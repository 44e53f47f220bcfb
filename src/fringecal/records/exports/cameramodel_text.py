"""The text of a `.cameramodel`: one Python literal of tables, lists, texts and numbers, read without Python's parser.

Python's own parser can end the whole process on a text that is nested deeply enough.
"""

import re
from collections.abc import Iterator
from typing import Any

from fringecal.guarded import Refusal

MOST_LEVELS = 16  # of brackets; a camera model has 3
_TOKEN = re.compile(
    r"""(?P<skip>\s+|\#[^\n]*)
    |(?P<text>[bu]?'[^'\\\n]*'|[bu]?"[^"\\\n]*")
    |(?P<number>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,4})?(?![0-9A-Za-z_.]))
    |(?P<word>True|False|None)\b
    |(?P<mark>[\[\](){}:,])""",
    re.VERBOSE,
)
_WORDS = {"True": True, "False": False, "None": None}
_CLOSES = {"[": "]", "(": ")", "{": "}"}
_MOST_DIGITS = 40  # of a number that a file writes: float64 has 17
_NONE = (
    "is neither a .cameramodel nor OpenCV's YAML or XML, ROS's camera_info or Bouguet's .mat; export the camera anew"
)


def entries_of(text: str) -> dict[str, Any]:
    r"""Return the entries of a `.cameramodel`.

    Raises
    ------
    Refusal
        It is none, or nested too deeply.

    Examples
    --------
    >>> entries_of("# ours\n{ 'lensmodel': 'LENSMODEL_PINHOLE', 'imagersize': [ 40, 30 ], }")
    {'lensmodel': 'LENSMODEL_PINHOLE', 'imagersize': [40, 30]}
    """
    tokens = _tokens(text)
    if next(tokens, None) != ("mark", "{"):
        raise Refusal(_NONE)
    entries = _table(tokens, 1)
    if next(tokens, None) is not None:
        raise Refusal(_NONE)
    return entries


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    place = 0
    while place < len(text):
        found = _TOKEN.match(text, place)
        if found is None:
            raise Refusal(f"{_NONE} (line {text.count(chr(10), 0, place) + 1})")
        place = found.end()
        if found.lastgroup != "skip":
            yield str(found.lastgroup), found[0]


def _table(tokens: Iterator[tuple[str, str]], level: int) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for kind, word in tokens:
        if (kind, word) == ("mark", "}"):
            return table
        if kind != "text" or next(tokens, None) != ("mark", ":"):
            break
        table[_value((kind, word), tokens, level)] = _value(next(tokens, ("", "")), tokens, level)
        if _ends(tokens, "}"):
            return table
    raise Refusal(_NONE)


def _list(tokens: Iterator[tuple[str, str]], level: int, closes: str) -> list[Any]:
    values: list[Any] = []
    for token in tokens:
        if token == ("mark", closes):
            return values
        values.append(_value(token, tokens, level))
        if _ends(tokens, closes):
            return values
    raise Refusal(_NONE)


def _ends(tokens: Iterator[tuple[str, str]], closes: str) -> bool:
    """Take the comma or the bracket after a value, and say whether it was the bracket."""
    token = next(tokens, None)
    if token not in (("mark", ","), ("mark", closes)):
        raise Refusal(_NONE)
    return token == ("mark", closes)


def _value(token: tuple[str, str], tokens: Iterator[tuple[str, str]], level: int) -> Any:
    kind, word = token
    if kind == "number":
        return _number(word)
    if kind == "text":
        return word.lstrip("bu")[1:-1]
    if kind == "word":
        return _WORDS[word]
    if kind != "mark" or word not in _CLOSES:
        raise Refusal(_NONE)
    if level >= MOST_LEVELS:
        raise Refusal(f"is nested deeper than the {MOST_LEVELS} levels that are read")
    return _table(tokens, level + 1) if word == "{" else _list(tokens, level + 1, _CLOSES[word])


def _number(word: str) -> int | float:
    if len(word) > _MOST_DIGITS:
        raise Refusal(f"holds a number of more than the {_MOST_DIGITS} characters that are read")
    return int(word) if re.fullmatch(r"[-+]?[0-9]+", word) else float(word)
