"""Cells of an imported or exported table: what each column may hold, and texts that a spreadsheet would run."""

import math
import re
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

import pandas as pd

from fringecal.errors import HistoryError
from fringecal.history.entries import SEVERITY

# A spreadsheet takes what begins so for a formula (OWASP, CSV injection); our own sign of it among them, so that it can
# be taken off again.
_FORMULA, _ESCAPE = ("=", "+", "-", "@", "\t", "\r", "'"), "'"
_LONGEST_TEXT = 1000  # letters: rigs, quantities and places of files are shorter
_ABSOLUTE_ZERO_DEGC = -273.15

_Rule = tuple[Callable[[float], bool], str]
_ANY: _Rule = (lambda _: True, "a finite number")
_NOT_NEGATIVE: _Rule = (lambda x: x >= 0, "a finite number of zero or more")
_RULES: Mapping[str, _Rule] = {
    "temperature_degC": (lambda x: x > _ABSOLUTE_ZERO_DEGC, "a temperature above -273.15"),
    "minutes_since_power_on": _NOT_NEGATIVE,
    "value": _ANY,
    "u": _NOT_NEGATIVE,
    "dof": (lambda x: x > 0, "a finite number above zero, empty for infinite"),
    "reference": _ANY,
    "u_reference": _NOT_NEGATIVE,
    "en": _ANY,
    "limit": _ANY,
}
NUMBERS = frozenset(_RULES)
_TIMES = ("captured", "created")
_DECISIONS = ("verdict", "decision")
_HASHES = ("sha256", "supersedes")


def parsed_time(text: str) -> datetime:
    """Read a date, or a date with time; without a zone it is UTC.

    Parameters
    ----------
    text
        As ISO 8601 writes it.

    Raises
    ------
    ValueError
        It is written otherwise; the message says how it is written.

    Examples
    --------
    >>> parsed_time("2026-02-01T08:00:00+01:00").isoformat()
    '2026-02-01T07:00:00+00:00'
    >>> parsed_time("1.2.2026")
    Traceback (most recent call last):
    ValueError: a date such as 2026-02-01, or a time such as 2026-02-01T08:00:00+01:00, was needed
    """
    try:
        time = datetime.fromisoformat(text.strip())
        return (time if time.tzinfo else time.replace(tzinfo=UTC)).astimezone(UTC)
    except (ValueError, OverflowError):  # the first hours of year 1 are before it elsewhere
        needed = "a date such as 2026-02-01, or a time such as 2026-02-01T08:00:00+01:00, was needed"
        raise ValueError(needed) from None


def captured_since(frame: pd.DataFrame, first: datetime) -> pd.DataFrame:
    """Return the rows of a table of entries or readings that were captured at a time or later.

    Parameters
    ----------
    frame
        With a column `captured`.
    first
        The time, with its zone.

    Raises
    ------
    HistoryError
        A row has no time.
    """
    try:
        later = [parsed_time(str(text)) >= first for text in frame["captured"]]
    except ValueError as error:
        raise HistoryError(f"a record of the history has no time that can be read; {error}") from None
    return frame[pd.Series(later, index=frame.index, dtype=bool)]


def parsed_cell(value: Any, name: str) -> str | float:
    """Turn a cell that is not empty into what its column holds.

    Parameters
    ----------
    value
        A text, number or time.
    name
        The column.

    Raises
    ------
    ValueError
        The column cannot hold it; the message says what was needed.
    """
    if name in _RULES:
        return _number(value, *_RULES[name])
    if name in _TIMES:
        return parsed_time(str(value)).isoformat()
    text = str(value)
    if name in _DECISIONS and text not in SEVERITY:
        raise ValueError(f"one of {', '.join(SEVERITY)} was needed")
    if name in _HASHES and not re.fullmatch("[0-9a-f]{64}", text):
        raise ValueError("64 digits of 0-9 and a-f were needed, or nothing")
    if not text.strip() or len(text) > _LONGEST_TEXT:
        raise ValueError(f"a text of 1 to {_LONGEST_TEXT} letters was needed")
    return text


def _number(value: Any, is_right: Callable[[float], bool], needed: str) -> float:
    try:
        number = float(value)
    except (ValueError, TypeError):
        number = math.nan
    if not math.isfinite(number) or not is_right(number):
        raise ValueError(f"{needed} was needed")
    return number


def spreadsheet_text(cell: Any) -> Any:
    """Put an apostrophe before a text that a spreadsheet would take for a formula; all else is left as it is.

    Examples
    --------
    >>> spreadsheet_text("=1+2"), spreadsheet_text("bench-1"), spreadsheet_text(-1.5)
    ("'=1+2", 'bench-1', -1.5)
    """
    return _ESCAPE + cell if isinstance(cell, str) and cell.startswith(_FORMULA) else cell


def plain_text(cell: Any) -> Any:
    """Take the apostrophe off again that `spreadsheet_text` put there.

    Examples
    --------
    >>> plain_text("'=1+2"), plain_text("'tis")
    ('=1+2', "'tis")
    """
    return cell[1:] if isinstance(cell, str) and cell[:1] == _ESCAPE and cell[1:].startswith(_FORMULA) else cell
