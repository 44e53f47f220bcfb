"""A report as one HTML file that needs nothing else: no network, no script, figures and tables inside."""

import base64
import io
import weakref
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path

import jinja2
import matplotlib as mpl
import numpy as np
import pandas as pd

from fringecal.records.files import write_text
from fringecal.report.structure import FigureItem, Report, Table, slug
from fringecal.report.style import RC

# Word, sign and colour class: no reader has to tell a verdict by colour alone.
_DECISIONS = {
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
class _Row:
    head: str | None
    cells: list[tuple[str, bool]]


@dataclass(frozen=True)
class _TableView:
    caption: str
    note: str
    columns: list[tuple[str, bool]]
    rows: list[_Row]
    csv_uri: str
    file_name: str


@dataclass(frozen=True)
class _FigureView:
    caption: str
    alt: str
    uri: str
    width_px: int
    height_px: int


def render_html(report: Report) -> str:
    """Render a report as the text of one self-contained HTML page.

    Parameters
    ----------
    report
        What to say; text is escaped, figures are embedded as SVG or PNG, and each table can be
        downloaded as CSV with all its digits.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fringecal.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    word, sign = _DECISIONS[report.verdict.decision]
    sections = [
        {
            "title": section.title,
            "id": f"section-{number}",
            "sentences": section.sentences,
            "tables": [_view_table(table) for table in section.tables],
            "figures": [_view_figure(item) for item in section.figures],
        }
        for number, section in enumerate(report.sections, start=1)
    ]
    page = environment.get_template("report.html.j2")
    return page.render(report=report, word=word, sign=sign, sections=sections, inputs=_view_inputs(report))


def write_html(report: Report, path: str | Path) -> Path:
    """Write a report as one HTML file, whole or not at all, and return its path."""
    return write_text(path, render_html(report))


def figure_bytes(item: FigureItem) -> bytes:
    """Encode a figure as its item says, without a date, so that equal figures give equal bytes.

    An item is encoded once, since a page and a file beside it show the same figure.
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


def _view_figure(item: FigureItem) -> _FigureView:
    kind = "image/svg+xml" if item.encoding == "svg" else "image/png"
    width, height = (round(96 * inches) for inches in item.figure.get_size_inches())
    return _FigureView(item.caption, item.alt, _data_uri(kind, figure_bytes(item)), width, height)


def _view_table(table: Table) -> _TableView:
    frame = table.frame.reset_index(drop=True)
    heads = [str(column) for column in frame.columns]
    formatted = [
        [_format_value(value, table.formats.get(head)) for value in frame[column]]
        for head, column in zip(heads, frame.columns, strict=True)
    ]
    rows = [
        _Row(cells[0][0] if table.row_header else None, list(cells[1:] if table.row_header else cells))
        for cells in zip(*formatted, strict=True)
    ]
    csv = frame.to_csv(index=False, lineterminator="\n").encode()
    columns = [(head, any(number for _, number in cells)) for head, cells in zip(heads, formatted, strict=True)]
    return _TableView(
        table.caption,
        table.header_note,
        columns,
        rows,
        _data_uri("text/csv;charset=utf-8", csv),
        f"{slug(table.caption)}.csv",
    )


def _view_inputs(report: Report) -> _TableView | None:
    if not report.inputs:
        return None
    frame = pd.DataFrame(
        [(entry.capture, entry.file, entry.sha256) for entry in report.inputs],
        columns=["capture", "file", "SHA-256"],
    )
    return _view_table(Table("Input files", frame))


def _format_value(value: Hashable, specification: str | None) -> tuple[str, bool]:
    """Print one value; the flag tells numbers, which are set right-aligned."""
    if value is None or value is pd.NA or (isinstance(value, float | np.floating) and np.isnan(value)):
        return _MISSING, False
    if isinstance(value, bool | np.bool_):
        return ("yes" if value else "no"), False
    if isinstance(value, int | float | np.integer | np.floating):
        default = "d" if isinstance(value, int | np.integer) else ".4g"
        return format(value, specification or default).replace("-", "\N{MINUS SIGN}"), True
    return str(value), False


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
