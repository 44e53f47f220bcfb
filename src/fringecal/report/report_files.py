"""A report on disk: a page, sheets, and its tables and figures as files beside them."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from fringecal.records import write_bytes, write_table
from fringecal.report.html import write_html
from fringecal.report.pdf import write_pdf
from fringecal.report.structure import Report, slug
from fringecal.report.views import figure_bytes

REPORT_FILE = "report.html"
SHEETS_FILE = "report.pdf"


def write_report(report: Report, folder: Path) -> None:
    """Write a report as a page and as sheets, with its tables as CSV and its figures beside them.

    Parameters
    ----------
    report
        What is to be written.
    folder
        An existing folder; `tables` and `figures` are made in it.
    """
    for name, frame in tables_of(report).items():
        write_table(_made(folder / "tables") / name, frame)
    for name, content in figures_of(report).items():
        write_bytes(_made(folder / "figures") / name, content)
    write_html(report, folder / REPORT_FILE)
    write_pdf(report, folder / SHEETS_FILE)


def tables_of(report: Report) -> dict[str, pd.DataFrame]:
    """Return every table of a report by the file name it is saved as."""
    tables = [table for section in report.sections for table in section.tables]
    names = _unique([slug(table.caption) for table in tables])
    return {f"{name}.csv": table.frame for name, table in zip(names, tables, strict=True)}


def figures_of(report: Report) -> dict[str, bytes]:
    """Return every figure of a report, encoded, by the file name it is saved as."""
    items = [item for section in report.sections for item in section.figures]
    names = _unique([slug(item.caption) for item in items])
    return {f"{name}.{item.encoding}": figure_bytes(item) for name, item in zip(names, items, strict=True)}


def _unique(names: Sequence[str]) -> list[str]:
    """Number the names that stand more than once, so that no file takes another's place."""
    return [
        name if names.index(name) == place else f"{name}-{names[:place].count(name) + 1}"
        for place, name in enumerate(names)
    ]


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder
