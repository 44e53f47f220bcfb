"""A report as one HTML file that needs nothing else: no network, figures and tables inside, a script only for maps."""

import base64
import functools
import gzip
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
from matplotlib.axes import Axes

from fringecal.records import write_text
from fringecal.report.readable import ReadableMap
from fringecal.report.structure import FigureItem, Live, Report, Section, Table, slug
from fringecal.report.views import DECISIONS, figure_bytes, inputs_table, table_text

_CSS_PX_PER_IN = 96  # as CSS has it
_OPEN = 5  # tables and figures that a page shows unasked; with more, it is a list of sections to open


@dataclass(frozen=True)
class _Row:
    """A row's cells, and the decision that it is marked by, if it holds one."""

    head: str | None
    cells: list[tuple[str, bool]]
    mark: str = ""


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
    live: "_LiveView | None"


@dataclass(frozen=True)
class _LiveView:
    """Where a figure's values stand in the page; `box` and `limits` place a flat map's axes in the picture."""

    values_id: str
    stretch: float | None
    box: dict[str, str]
    limits: str


def render_html(report: Report) -> str:
    """Render a report as the text of one self-contained HTML page.

    Parameters
    ----------
    report
        What to say; text is escaped, figures are embedded as SVG or PNG, and each table can be
        downloaded as CSV with all its digits. Figures with values are read under the pointer, or turned,
        by a script of the page's own; without it, and on paper, they are the same pictures.
    """
    word, sign = DECISIONS[report.verdict.decision]
    lives = [item.live for section in report.sections for item in section.figures if item.live]
    # Figures of one object share its values: they stand in the page once.
    values = {one: f"values-{n}" for n, one in enumerate(dict.fromkeys(live.values for live in lives), start=1)}
    files, folds = inputs_table(report), folded(report)
    return _template().render(
        report=report,
        word=word,
        sign=sign,
        sections=[
            _view_section(section, n, values) | {"fold": _contents(section) if fold else ""}
            for n, (section, fold) in enumerate(zip(report.sections, folds, strict=True), start=1)
        ],
        folded=any(folds),
        inputs=_view_table(files) if files is not None else None,
        values={name: one.text() for one, name in values.items()},
        plotly=_plotly() if any(live.stretch is not None for live in lives) else "",
    )


def write_html(report: Report, path: str | Path) -> Path:
    """Write a report as one HTML file, whole or not at all, and return its path."""
    return write_text(path, render_html(report))


def folded(report: Report) -> tuple[bool, ...]:
    """Return which sections of a long report begin folded: those beyond the first few tables and figures.

    The first section that shows anything never is, nor is any of a report that is short as a whole.
    """
    sizes = [len(section.tables) + len(section.figures) for section in report.sections]
    if sum(sizes) <= 2 * _OPEN:
        return (False,) * len(sizes)
    before = [sum(sizes[:place]) for place in range(len(sizes))]
    return tuple(bool(size and earlier and earlier + size > _OPEN) for size, earlier in zip(sizes, before, strict=True))


def _contents(section: Section) -> str:
    """Name the content of a folded section, so that a reader knows what to open."""
    captions = (*(table.caption for table in section.tables), *(figure.caption for figure in section.figures))
    return "; ".join(captions)


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fringecal.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2")


def _view_section(section: Section, number: int, values: dict[ReadableMap, str]) -> dict[str, Any]:
    return {
        "title": section.title,
        "id": f"section-{number}",
        "sentences": section.sentences,
        "tables": [_view_table(table) for table in section.tables],
        "figures": [_view_figure(item, values) for item in section.figures],
        "side_by_side": section.side_by_side,
    }


def _view_figure(item: FigureItem, values: dict[ReadableMap, str]) -> _FigureView:
    kind = "image/svg+xml" if item.encoding == "svg" else "image/png"
    width, height = (round(_CSS_PX_PER_IN * inches) for inches in item.figure.get_size_inches())
    uri = _data_uri(kind, figure_bytes(item))  # the axes have their place once they are drawn
    live = _view_live(item.live, item.figure.axes[0], values) if item.live else None
    return _FigureView(item.caption, item.alt, uri, width, height, live)


def _view_live(live: Live, axes: Axes, values: dict[ReadableMap, str]) -> _LiveView:
    place = axes.get_position()
    box = {"left": place.x0, "top": 1 - place.y1, "width": place.width, "height": place.height}
    # From the left to the right edge of the axes, and from the top to the bottom one.
    limits = (*axes.get_xlim(), *reversed(axes.get_ylim()))
    return _LiveView(
        values[live.values],
        live.stretch,
        {side: f"{100 * share:.3f}%" for side, share in box.items()},
        " ".join(f"{limit:.7g}" for limit in limits),
    )


@functools.cache
def _plotly() -> str:
    """Return the library that turns surfaces, compressed: a page unpacks it when a reader asks for it."""
    from plotly.offline import get_plotlyjs

    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode("ascii")


def _view_table(table: Table) -> _TableView:
    printed = table_text(table)
    named = table.row_header
    marks = [str(one) if one in DECISIONS else "" for one in table.frame.get("decision", [""] * len(printed.rows))]
    rows = [
        _Row(cells[0][0] if named else None, cells[1:] if named else cells, mark)
        for cells, mark in zip(printed.rows, marks, strict=True)
    ]
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
