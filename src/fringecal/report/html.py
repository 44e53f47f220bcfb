"""A report as one HTML file that needs nothing else: no network, no script, figures and tables inside."""

import base64
from dataclasses import dataclass
from pathlib import Path

import jinja2

from fringecal.records.files import write_text
from fringecal.report.structure import FigureItem, Report, Table, slug
from fringecal.report.views import DECISIONS, figure_bytes, inputs_table, table_text


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
    word, sign = DECISIONS[report.verdict.decision]
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
    files = inputs_table(report)
    page = environment.get_template("report.html.j2")
    inputs = _view_table(files) if files is not None else None
    return page.render(report=report, word=word, sign=sign, sections=sections, inputs=inputs)


def write_html(report: Report, path: str | Path) -> Path:
    """Write a report as one HTML file, whole or not at all, and return its path."""
    return write_text(path, render_html(report))


def _view_figure(item: FigureItem) -> _FigureView:
    kind = "image/svg+xml" if item.encoding == "svg" else "image/png"
    width, height = (round(96 * inches) for inches in item.figure.get_size_inches())
    return _FigureView(item.caption, item.alt, _data_uri(kind, figure_bytes(item)), width, height)


def _view_table(table: Table) -> _TableView:
    printed = table_text(table)
    named = table.row_header
    rows = [_Row(cells[0][0] if named else None, cells[1:] if named else cells) for cells in printed.rows]
    csv = table.frame.to_csv(index=False, lineterminator="\n").encode()
    return _TableView(
        table.caption,
        table.header_note,
        printed.columns,
        rows,
        _data_uri("text/csv;charset=utf-8", csv),
        f"{slug(table.caption)}.csv",
    )


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
