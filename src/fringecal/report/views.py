"""What every form of a report shares: the words of a decision, tables as text, figures as bytes."""

import io
import weakref
from collections.abc import Hashable
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
import pandas as pd

from fringecal.report.structure import FigureItem, Report, Table
from fringecal.report.style import RC

# Word and sign: no reader has to tell a verdict by its colour alone.
DECISIONS = {
    "pass": ("Pass", "✓"),
    "conditionalPass": ("Conditional pass (within the guard band)", "✓?"),
    "conditionalFail": ("Conditional fail (within the guard band)", "✗?"),
    "fail": ("Fail", "✗"),
    "info": ("For information", "i"),
}
_MISSING = "–"
_PNG_DPI = 120
_ENCODED: weakref.WeakKeyDictionary[FigureItem, bytes] = weakref.WeakKeyDictionary()


@dataclass(frozen=True)
class TableText:
    """A table as it is printed; each text goes with whether it is a number, which is set right-aligned."""

    columns: list[tuple[str, bool]]
    rows: list[list[tuple[str, bool]]]


def table_text(table: Table) -> TableText:
    """Print every value of a table as its formats say.

    Examples
    --------
    >>> table_text(Table("T", pd.DataFrame({"line": ["A"], "z / mm": [-0.125]}), formats={"z / mm": ".1f"}))
    TableText(columns=[('line', False), ('z / mm', True)], rows=[[('A', False), ('−0.1', True)]])
    """
    heads = [str(column) for column in table.frame.columns]
    formatted = [
        [_format_value(value, table.formats.get(head)) for value in table.frame.iloc[:, place]]
        for place, head in enumerate(heads)
    ]
    numbers = [any(number for _, number in cells) for cells in formatted]
    rows = [list(cells) for cells in zip(*formatted, strict=True)]
    return TableText(list(zip(heads, numbers, strict=True)), rows)


def inputs_table(report: Report) -> Table | None:
    """Tabulate the input files of a report with their hashes; None if it names none."""
    if not report.inputs:
        return None
    rows = [(entry.capture, entry.file, entry.sha256) for entry in report.inputs]
    return Table("Input files", pd.DataFrame(rows, columns=["capture", "file", "SHA-256"]))


def figure_bytes(item: FigureItem) -> bytes:
    """Encode a figure as its item says, without a date, so that equal figures give equal bytes.

    An item is encoded once, since a page, a sheet and a file beside them show the same figure.
    """
    if item not in _ENCODED:
        _ENCODED[item] = _encoded(item)
    return _ENCODED[item]


def _encoded(item: FigureItem) -> bytes:
    buffer = io.BytesIO()
    metadata = {"Date": None} if item.encoding == "svg" else {"Software": None}
    with mpl.rc_context(RC):
        item.figure.savefig(buffer, format=item.encoding, dpi=_PNG_DPI, metadata=metadata)
    return buffer.getvalue()


def _format_value(value: Hashable, specification: str | None) -> tuple[str, bool]:
    """Print one value, and tell whether it is a number."""
    if value is None or value is pd.NA or (isinstance(value, float | np.floating) and np.isnan(value)):
        return _MISSING, False
    if isinstance(value, bool | np.bool_):
        return ("yes" if value else "no"), False
    if isinstance(value, int | float | np.integer | np.floating):
        default = "d" if isinstance(value, int | np.integer) else ".4g"
        return _signed(format(value, specification or default)), True
    return str(value), False


def _signed(text: str) -> str:
    """Print a minus as such, and what was rounded to nothing without a sign.

    Examples
    --------
    >>> _signed("-0.12"), _signed("-0.00"), _signed("+0.00")
    ('−0.12', '0.00', '0.00')
    """
    nothing = not any(digit in text for digit in "123456789")
    return (text.lstrip("+-") if nothing else text).replace("-", "\N{MINUS SIGN}")
