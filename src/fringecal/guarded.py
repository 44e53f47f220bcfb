"""Text files from outside, read within stated limits: what breaks one is refused with a sentence, never with a crash.

Every reader of TOML, JSON and camera models goes through here, so that a limit holds for all files of a format alike.
The limits stand in docs/records.md.
"""

import json
import math
import os
import reprlib
import stat
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

MIB = 1 << 20
MOST_TOML = 4 * MIB  # a session of 50,000 pictures that are listed one by one takes 2 MiB
MOST_JSON = 64 * MIB  # a calibration of 12 megapixels takes less than 1 MiB
MOST_LENS = 4 * MIB  # a splined lens of 100 x 100 knots takes 0.5 MiB
MOST_DEPTH = 32  # tables in tables; no document of fringecal has more than 8
MOST_DIGITS = 18  # of a whole number: what 64 bits hold
MOST_TABLES = 2000  # of a TOML document: as many captures, each with a table of its own
MOST_KEYS = 20_000  # of all its tables together
MOST_ENTRIES = 100_000  # of one list: 20 steps of 10 periods, 500 times over
MOST_FAULTS = 20  # of a document that a message names; one slip often makes many, and the first show it
MOST_SHOWN = 200  # characters of a text that a message quotes: two lines

_WHOLE = 10**MOST_DIGITS
_KINDS = (
    (stat.S_ISDIR, "is a folder"),
    (stat.S_ISFIFO, "is a pipe"),
    (stat.S_ISSOCK, "is a socket"),
    (stat.S_ISCHR, "is a device"),
    (stat.S_ISBLK, "is a device"),
)


class Refusal(ValueError):
    """What a file or text was refused for, as the end of a sentence that begins with its name."""


class MissingFileRefusal(Refusal):
    """Nothing lies at the path."""


def is_file(path: str | os.PathLike[str]) -> bool:
    r"""Whether a file lies at a path; no where none can be seen: a folder that may not be searched, an impossible name.

    Examples
    --------
    >>> is_file("a" * 300), is_file("nul\0byte")
    (False, False)
    """
    return os.path.isfile(path)  # catches OSError and ValueError, which Path.is_file passes on


def is_folder(path: str | os.PathLike[str]) -> bool:
    """Whether a folder lies at a path; no where none can be seen."""
    return os.path.isdir(path)


def lies_inside(path: Path, folder: Path) -> bool:
    """Whether a path, followed through links and ``..``, stays in a folder."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # loops of links, impossible names
        return False


def bytes_of(path: str | os.PathLike[str], most: int) -> bytes:
    """Read a regular file of at most `most` bytes; a pipe or a device is never opened.

    Raises
    ------
    Refusal
        It cannot be read, is no file, or is larger.
    """
    try:
        _demand_regular(os.stat(path).st_mode)
        # Not blocking: between the look and the opening a pipe may have taken the file's place.
        with open(path, "rb", opener=_without_waiting) as file:
            _demand_regular(os.fstat(file.fileno()).st_mode)
            content = file.read(most + 1)
    except FileNotFoundError as error:
        raise MissingFileRefusal("cannot be read (no such file)") from error
    except OSError as error:
        raise Refusal(f"cannot be read ({error.strerror or error})") from error
    except Refusal:
        raise
    except ValueError as error:  # a name that no file can have
        raise Refusal(f"cannot be read ({error})") from error
    if len(content) > most:
        size = f"{most // MIB} MiB" if most >= MIB else f"{most} bytes"
        raise Refusal(f"is larger than the {size} that are read of such a file")
    return content


def text_of(content: bytes) -> str:
    """Return the text of a file's bytes.

    Raises
    ------
    Refusal
        They are not UTF-8.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Refusal(f"is not UTF-8 text (byte {error.start})") from error


def toml_of(text: str) -> dict[str, Any]:
    """Return a TOML document.

    Raises
    ------
    Refusal
        It is not TOML, is nested too deeply, holds a whole number of too many digits, or too many tables, keys or
        entries of a list.
    """
    try:
        document = tomllib.loads(text)
    except RecursionError as error:
        raise Refusal(_TOO_DEEP) from error
    except ValueError as error:  # tomllib's own, and what int() says of thousands of digits
        digits = "digits" in str(error) and not isinstance(error, tomllib.TOMLDecodeError)
        raise Refusal(_TOO_LONG if digits else f"is not valid TOML: {shortened(error)}") from error
    _demand_plain(document)
    _demand_few(document)
    return document


def json_of(text: str) -> dict[str, Any]:
    """Return a JSON object.

    Raises
    ------
    Refusal
        It is not JSON or no object, is nested too deeply, holds a number that JSON or 64 bits cannot, a whole number of
        too many digits, or one key twice.
    """
    try:
        document = json.loads(
            text, parse_constant=_no_number, parse_int=_whole, parse_float=_finite, object_pairs_hook=_once
        )
    except RecursionError as error:
        raise Refusal(_TOO_DEEP) from error
    except Refusal:
        raise
    except ValueError as error:
        raise Refusal(f"is not a JSON document ({shortened(error)}); it may be cut short or edited") from error
    if not isinstance(document, dict):
        raise Refusal(f"holds no JSON object, which was needed, but {type(document).__name__}")
    _demand_plain(document)
    return document


def shortened(value: object, most: int = MOST_SHOWN) -> str:
    r"""Return a text, or what stands for a value, on one line that is short enough for a message.

    Examples
    --------
    >>> shortened("line\nline"), len(shortened("x" * 1000))
    ('line line', 200)
    """
    text = " ".join(str(value).split())
    return text if len(text) <= most else f"{text[: most - 3]}..."


def first_few(faults: Sequence[str]) -> list[str]:
    """Return the first faults of a document, and how many there are more.

    Examples
    --------
    >>> first_few(["a"] * 30)[-2:]
    ['a', 'and 10 more']
    """
    more = [f"and {len(faults) - MOST_FAULTS} more"] if len(faults) > MOST_FAULTS else []
    return [*faults[:MOST_FAULTS], *more]


def quoted(value: object) -> str:
    """Return a value as Python writes it, short enough for a message.

    Examples
    --------
    >>> quoted("3"), quoted(list(range(100)))
    ("'3'", '[0, 1, 2, 3, 4, 5, ...]')
    """
    return shortened(reprlib.repr(value))


_TOO_DEEP = f"is nested deeper than the {MOST_DEPTH} levels that are read"
_TOO_LONG = f"holds a whole number of more than the {MOST_DIGITS} digits that are read"


def _no_number(name: str) -> NoReturn:
    raise Refusal(f"is not a JSON document: {name} is not a JSON number")


def _whole(digits: str) -> int:
    if len(digits) > MOST_DIGITS + 1:
        raise Refusal(_TOO_LONG)
    return int(digits)


def _finite(text: str) -> float:
    if math.isinf(number := float(text)):
        raise Refusal(f"holds the number {shortened(text)}, which is beyond those of 64 bits")
    return number


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        seen: set[str] = set()
        twice = next(name for name, _ in pairs if name in seen or seen.add(name))  # type: ignore[func-returns-value]
        raise Refusal(f"holds the key {quoted(twice)} twice in one table; keep one")
    return table


def _demand_plain(document: Any) -> None:
    """Refuse what is nested too deeply or holds too long a whole number; without recursion."""
    level: list[Any] = [document]
    for _ in range(MOST_DEPTH):
        level = [inside for one in level for inside in _inside(one)]
        if not level:
            return
        if any(isinstance(value, int) and not -_WHOLE < value < _WHOLE for value in level):
            raise Refusal(_TOO_LONG)
    raise Refusal(_TOO_DEEP)


def _demand_few(document: Any) -> None:
    """Refuse more tables, keys or entries than any document has: each is checked, and a fault of each is told."""
    level, tables, keys = [document], 0, 0
    while level:
        stated = [one for one in level if isinstance(one, Mapping)]
        tables, keys = tables + len(stated), keys + sum(map(len, stated))
        if tables > MOST_TABLES or keys > MOST_KEYS:
            raise Refusal(f"holds more than the {MOST_TABLES} tables or {MOST_KEYS} keys that are read")
        if any(isinstance(one, list) and len(one) > MOST_ENTRIES for one in level):
            raise Refusal(f"holds a list of more than the {MOST_ENTRIES} entries that are read")
        level = [inside for one in level for inside in _inside(one) if isinstance(inside, Mapping | list)]


def _inside(value: Any) -> Iterator[Any]:
    if isinstance(value, Mapping):
        yield from value.values()
    elif isinstance(value, list):
        yield from value


def _demand_regular(mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise Refusal(f"{_kind(mode)}, a file was needed")


def _kind(mode: int) -> str:
    return next((words for is_kind, words in _KINDS if is_kind(mode)), "is something else")


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
