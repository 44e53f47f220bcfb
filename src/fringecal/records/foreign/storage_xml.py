"""OpenCV's calibrations as XML: the same entries as its YAML, read without entities and within limits."""

import re
from typing import Any
from xml.parsers import expat

from fringecal.guarded import Refusal
from fringecal.records.foreign.plain_yaml import MOST_LEVELS

_NUMBER = re.compile(r"[-+]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,4})?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:nan|inf)", re.IGNORECASE)
_ROOT = "opencv_storage"


class _Tree:
    """Collects elements: the name, text and children of each that is open, with the outermost first."""

    def __init__(self) -> None:
        self.open: list[tuple[str, list[str], dict[str, Any]]] = []
        self.root: dict[str, Any] | None = None

    def start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self.open) >= MOST_LEVELS:
            raise Refusal(f"is nested deeper than the {MOST_LEVELS} levels that are read")
        if not self.open and name != _ROOT:
            raise Refusal(f"is XML, but holds no {_ROOT}, which OpenCV's calibrations are; export the calibration anew")
        del attributes
        self.open.append((name, [], {}))

    def text(self, content: str) -> None:
        if self.open:
            self.open[-1][1].append(content)

    def end(self, name: str) -> None:
        _, texts, children = self.open.pop()
        if not self.open:
            self.root = children
            return
        siblings = self.open[-1][2]
        if name == "_":  # an entry of a list of tables: poses, corners of pictures
            siblings.setdefault(f"_{len(siblings)}", children or _value("".join(texts)))
        elif name in siblings:
            raise Refusal(f"holds the entry {name} twice; keep one")
        else:
            siblings[name] = children or _value("".join(texts))

    def refuse(self, *_: object) -> None:
        raise Refusal("declares a document type or an entity, which no calibration needs; take it out")


def xml_of(content: bytes) -> dict[str, Any]:
    """Return the entries of an OpenCV storage in XML as tables, lists, numbers and texts.

    Raises
    ------
    Refusal
        It is no such storage, names an entry twice, declares entities, or is nested too deeply.

    Examples
    --------
    >>> xml_of(b"<?xml version='1.0'?><opencv_storage><a><rows>1</rows><data>1. 2.</data></a></opencv_storage>")
    {'a': {'rows': 1, 'data': [1.0, 2.0]}}
    """
    tree, parser = _Tree(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = tree.start, tree.end
    parser.CharacterDataHandler = tree.text
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = tree.refuse
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        if isinstance(error, Refusal):
            raise
        raise Refusal(f"is no whole XML ({error}); it may be cut short or edited") from error
    return tree.root or {}


def _value(text: str) -> Any:
    words = text.split()
    if not words:
        return None
    if not all(_NUMBER.fullmatch(word) or _NOT_FINITE.fullmatch(word) for word in words):
        return text.strip().strip('"')
    numbers = [_number(word) for word in words]
    return numbers if len(numbers) > 1 else numbers[0]


def _number(word: str) -> int | float:
    if re.fullmatch(r"[-+]?[0-9]+", word):
        return int(word)
    return float(re.sub(r"\.(?=[nNiI])", "", word))
