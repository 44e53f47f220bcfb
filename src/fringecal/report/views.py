"""What every form of a report shares: the words of a decision, tables as text, figures as bytes."""

import io
import weakref
from collections.abc import Hashable
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG

from fringecal.report.structure import AS_U, DOF, FigureItem, Report, Table
from fringecal.report.style import RC
from fringecal.uncertainty import dof_text, uncertainty_text, value_text

# Word and sign: no reader has to tell a verdict by its colour alone.
DECISIONS = {
    "pass": ("Pass", "✓"),
    "conditionalPass": ("Conditional pass (not proved: see the checks)", "✓?"),
    "conditionalFail": ("Conditional fail (not proved: see the checks)", "✗?"),
    "fail": ("Fail", "✗"),
    "info": ("For information", "i"),
}
_MISSING = "–"
_PNG_DPI = 120  # sharp on a screen, and on paper at the width of a column
_ENCODED: weakref.WeakKeyDictionary[FigureItem, bytes] = weakref.WeakKeyDictionary()


@dataclass(frozen=True)
class TableText:
    """A table as it is printed; each text goes with whether it is a number, which is set right-aligned."""

    columns: list[tuple[str, bool]]
    rows: list[list[tuple[str, bool]]]


def table_text(table: Table) -> TableText:
    """Print every value of a table as its formats say, and no digit beyond its doubt.

    Examples
    --------
    >>> table_text(Table("T", pd.DataFrame({"line": ["A"], "z / mm": [-0.125]}), formats={"z / mm": ".1f"}))
    TableText(columns=[('line', False), ('z / mm', True)], rows=[[('A', False), ('−0.1', True)]])
    >>> frame = pd.DataFrame({"value": [-4.0e-7, 50.70412], "u": [1.0e-3, 0.0496]})
    >>> [[text for text, _ in row] for row in table_text(Table("T", frame, uncertainties={"value": "u"})).rows]
    [['0.0000', '0.0010'], ['50.704', '0.050']]
    """
    heads = [str(column) for column in table.frame.columns]
    formatted = [_column_texts(table, head, table.frame.iloc[:, place]) for place, head in enumerate(heads)]
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
    """Draw and encode by the canvas itself: `savefig` draws everything twice, the first time for the layout only."""
    buffer, figure = io.BytesIO(), item.figure
    figure.set_dpi(_PNG_DPI)
    with mpl.rc_context(RC):
        if item.encoding == "svg":
            FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
        else:
            FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def _column_texts(table: Table, head: str, values: "pd.Series") -> list[tuple[str, bool]]:
    formats = dict.fromkeys(table.uncertainties.values(), AS_U) | dict(table.formats)
    specification = formats.get(head)
    if head not in table.uncertainties:
        return [_format_value(value, specification) for value in values]
    uncertainties = table.frame[table.uncertainties[head]]
    return [_format_value(value, specification, doubt) for value, doubt in zip(values, uncertainties, strict=True)]


def _format_value(value: Hashable, specification: str | None, doubt: float | None = None) -> tuple[str, bool]:
    """Print one value, to the second digit of its doubt where there is one, and tell whether it is a number."""
    if value is None or value is pd.NA or (isinstance(value, float | np.floating) and np.isnan(value)):
        return _MISSING, False
    if isinstance(value, bool | np.bool_):
        return ("yes" if value else "no"), False
    if isinstance(value, int | float | np.integer | np.floating):
        default = "d" if isinstance(value, int | np.integer) else ".4g"
        return _signed(_number_text(float(value), specification or default, doubt)), True
    return str(value), False


def _number_text(value: float, specification: str, doubt: float | None) -> str:
    if specification == AS_U:
        return uncertainty_text(value)
    if specification == DOF:
        return dof_text(value)
    if specification == "d":
        return f"{value:.0f}"
    plain = specification.lstrip("+z")
    if doubt is not None and doubt > 0:
        return value_text(value, doubt, sign=specification.startswith("+"), otherwise=plain)
    return format(value, specification)


def _signed(text: str) -> str:
    """Print a minus as such, and what was rounded to nothing without a sign.

    Examples
    --------
    >>> _signed("-0.12"), _signed("-0.00"), _signed("+0.00")
    ('−0.12', '0.00', '0.00')
    """
    nothing = not any(digit in text for digit in "123456789")
    return (text.lstrip("+-") if nothing else text).replace("-", "\N{MINUS SIGN}")
