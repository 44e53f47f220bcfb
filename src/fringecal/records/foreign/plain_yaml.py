"""The part of YAML that calibrations are written in: tables by indentation, lists, numbers and texts; OpenCV's tags.

No reader of YAML takes OpenCV's `%YAML:1.0`; and anchors, by which a few lines become gigabytes, are refused here.
"""

import re
from collections.abc import Iterator
from typing import Any

from fringecal.guarded import Refusal, shortened

MOST_LEVELS = 16  # of tables and lists in one another; a calibration has 4
_KEY = re.compile(r"(?P<dash>- +)?(?P<key>[A-Za-z_][\w .-]*|'[^']*'|\"[^\"]*\")\s*:(?:\s+(?P<rest>.*)|$)")
_TAG = re.compile(r"!!?[\w.-]*\s*")
_TOKEN = re.compile(r"\s*(?P<mark>[\[\]{},])|\s*(?P<text>'[^']*'|\"[^\"]*\")|\s*(?P<plain>[^\s\[\]{},][^\[\]{},]*)")
_NUMBER = re.compile(r"[-+]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,4})?")
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}
_NOT_FINITE = {".nan", ".inf", "-.inf", "+.inf"}
_NONE = "cannot be taken apart as YAML at {}; export it anew"

type Line = tuple[int, str]


def yaml_of(text: str) -> dict[str, Any]:
    r"""Return the entries of a YAML file as tables, lists, numbers and texts.

    Raises
    ------
    Refusal
        It is no table of that kind, names a key twice, or is nested too deeply.

    Examples
    --------
    >>> yaml_of("%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 1\n   data: [ 1., 2.,\n      .5 ]\nname: a b")
    {'M1': {'rows': 1, 'data': [1.0, 2.0, 0.5]}, 'name': 'a b'}
    """
    lines = list(_lines(text))
    table, rest = _table(lines, 0, 1)
    if rest < len(lines) or not table:
        raise Refusal(_NONE.format(shortened(lines[rest][1], 60) if rest < len(lines) else "its beginning"))
    return table


def _lines(text: str) -> Iterator[Line]:
    """Give indentation and content of each line; what brackets hold together is one line."""
    open_, content, indent = 0, "", 0
    for raw in text.splitlines():
        line = re.sub(r"(^|\s)#.*", "", raw).rstrip()
        if not line.strip() or (not open_ and line.startswith(("%", "---", "..."))):
            continue
        if not open_:
            content, indent = line.strip(), len(line) - len(line.lstrip())
        else:
            content += " " + line.strip()
        open_ += sum(line.count(mark) for mark in "[{") - sum(line.count(mark) for mark in "]}")
        if open_ <= 0:
            yield indent, content
            open_ = 0
    if open_:
        raise Refusal("ends inside a list; it may be cut short")


def _table(lines: list[Line], start: int, level: int) -> tuple[dict[str, Any], int]:
    """Read a table whose lines are indented alike, from a line on; return it and the first line behind it."""
    if level > MOST_LEVELS:
        raise Refusal(f"is nested deeper than the {MOST_LEVELS} levels that are read")
    table: dict[str, Any] = {}
    indent, place = lines[start][0] if start < len(lines) else 0, start
    while place < len(lines) and lines[place][0] == indent:
        found = _KEY.fullmatch(lines[place][1])
        if found is None or found["dash"]:
            break
        key = found["key"].strip("'\"").strip()
        if key in table:
            raise Refusal(f"holds the key {shortened(key, 60)} twice in one table; keep one")
        table[key], place = _entry(lines, place, found["rest"] or "", level)
    return table, place


def _entry(lines: list[Line], place: int, rest: str, level: int) -> tuple[Any, int]:
    """Read what stands behind a key: on its line, or in the lines below."""
    content = _TAG.sub("", rest, count=1) if rest.startswith("!") else rest
    if content:
        return _inline(content), place + 1
    below = place + 1
    if below < len(lines) and lines[below][1].startswith("-") and lines[below][0] >= lines[place][0]:
        return _listed(lines, below)
    if below < len(lines) and lines[below][0] > lines[place][0]:
        return _table(lines, below, level + 1)
    return None, below


def _listed(lines: list[Line], place: int) -> tuple[list[Any], int]:
    """Read a list of one value a line."""
    values, indent = [], lines[place][0]
    while place < len(lines) and lines[place][0] == indent and lines[place][1].startswith("-"):
        if lines[place][1] != "-" and not lines[place][1].startswith("- "):
            break
        values.append(_inline(lines[place][1][1:].strip()))
        place += 1
    return values, place


def _inline(content: str) -> Any:
    if not content.startswith(("[", "{")):
        return _scalar(content)
    tokens = _tokens(content)
    value = _flow(next(tokens, ""), tokens, 1)
    if next(tokens, None) is not None:
        raise Refusal(_NONE.format(shortened(content, 60)))
    return value


def _tokens(content: str) -> Iterator[str]:
    place = 0
    while place < len(content):
        found = _TOKEN.match(content, place)
        if found is None:
            if content[place:].strip():
                raise Refusal(_NONE.format(shortened(content[place:], 60)))
            return
        place = found.end()
        yield (found["mark"] or found["text"] or found["plain"]).strip()


def _flow(token: str, tokens: Iterator[str], level: int) -> Any:
    """Read a value inside brackets."""
    if level > MOST_LEVELS:
        raise Refusal(f"is nested deeper than the {MOST_LEVELS} levels that are read")
    if token == "[":
        return _items(tokens, level)
    if token == "{":
        return _pairs(tokens, level)
    return _scalar(token)


def _items(tokens: Iterator[str], level: int) -> list[Any]:
    values: list[Any] = []
    for token in tokens:
        if token == "]":
            return values
        if token != ",":
            values.append(_flow(token, tokens, level + 1))
    raise Refusal("ends inside a list; it may be cut short")


def _pairs(tokens: Iterator[str], level: int) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for token in tokens:
        if token == "}":
            return table
        if token == ",":
            continue
        key, mark, rest = token.partition(":")
        if not mark or key.strip() in table:
            raise Refusal(_NONE.format(shortened(token, 60)))
        table[key.strip()] = _scalar(rest) if rest.strip() else _flow(next(tokens, ""), tokens, level + 1)
    raise Refusal("ends inside a table; it may be cut short")


def _scalar(content: str) -> Any:
    word = content.strip()
    if word[:1] in "'\"" and len(word) > 1 and word[-1] == word[0]:
        return word[1:-1]
    if word.lower() in _WORDS:
        return _WORDS[word.lower()]
    if word.lower() in _NOT_FINITE:
        return float(word.lower().replace(".", "", 1))
    if word.startswith(("&", "*")):
        raise Refusal("holds an anchor or alias of YAML, which is not read; write its values out")
    if _NUMBER.fullmatch(word):
        return float(word) if re.search(r"[.eE]", word) else int(word)
    return word
