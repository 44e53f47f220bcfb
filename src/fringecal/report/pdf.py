"""A report as sheets of A4: the same content as the HTML page, set by Typst."""

import base64
import functools
import json
import unicodedata
from importlib import resources
from pathlib import Path
from typing import Any

import typst

from fringecal.records import write_bytes
from fringecal.report.structure import FigureItem, Report, Section, Table
from fringecal.report.views import DECISIONS, figure_bytes, inputs_table, table_text

# Beyond it lie the scripts of East Asia, for which no font comes with Typst.
_LAST_BUNDLED = "\u2e7f"
_PT_PER_IN = 72


def render_pdf(report: Report) -> bytes:
    """Render a report as a PDF of A4 sheets, numbered "n of m".

    Parameters
    ----------
    report
        What to say. Texts reach Typst as data, so that none of their characters is taken for markup;
        tables shrink, wrap and at last split by columns to stay on the sheet; figures stay whole.

    Returns
    -------
    bytes
        Equal for equal reports: the only time in it is the report's own. Fonts are Typst's; those of
        the system are asked only for East Asian letters.
    """
    keys = {item: f"figure-{n}" for n, item in enumerate(_figures(report), start=1)}
    content = json.dumps(_content(report, keys), ensure_ascii=False)
    return typst.compile(
        resources.files("fringecal.report").joinpath("templates/report.typ").read_bytes(),
        format="pdf",
        sys_inputs={"report": content} | {key: _svg(item) for item, key in keys.items()},
        font_paths=_fonts(max(content) > _LAST_BUNDLED),
        timestamp=int(report.created.timestamp()) if report.created else 0,
    )


def write_pdf(report: Report, path: str | Path) -> Path:
    """Write a report as a PDF, whole or not at all, and return its path."""
    return write_bytes(path, render_pdf(report))


@functools.cache
def _fonts(of_system: bool) -> typst.Fonts:
    return typst.Fonts(include_system_fonts=of_system)


def _figures(report: Report) -> list[FigureItem]:
    return [item for section in report.sections for item in section.figures]


def _content(report: Report, keys: dict[FigureItem, str]) -> Any:
    """Gather what the template prints, as JSON holds it."""
    word, sign = DECISIONS[report.verdict.decision]
    inputs = inputs_table(report)
    return _printable(
        {
            "title": report.title,
            "subtitle": report.subtitle,
            "decision": report.verdict.decision,
            "word": word,
            "sign": sign,
            "sentence": report.verdict.sentence,
            "facts": [{"name": fact.name, "value": fact.value, "note": fact.note} for fact in report.facts],
            "sections": [_section(section, keys) for section in report.sections],
            "inputs": None if inputs is None else _table(inputs),
            "created": "" if report.created is None else report.created.isoformat(),
            "colophon": _colophon(report),
        }
    )


def _section(section: Section, keys: dict[FigureItem, str]) -> dict[str, Any]:
    return {
        "title": section.title,
        "sentences": section.sentences,
        "tables": [_table(table) for table in section.tables],
        "figures": [_figure(item, keys[item]) for item in section.figures],
    }


def _table(table: Table) -> dict[str, Any]:
    printed = table_text(table)
    return {"caption": table.caption, "note": table.header_note, "columns": printed.columns, "rows": printed.rows}


def _figure(item: FigureItem, key: str) -> dict[str, Any]:
    width_in, height_in = item.figure.get_size_inches()
    sides = {"width_pt": _PT_PER_IN * float(width_in), "height_pt": _PT_PER_IN * float(height_in)}
    return {"caption": item.caption, "alt": item.alt, "key": key} | sides


def _svg(item: FigureItem) -> str:
    """Encode a figure as text, since Typst's binding passes no bytes: a PNG is wrapped into an SVG."""
    content = figure_bytes(item)
    if item.encoding == "svg":
        return content.decode()
    width, height = (f"{_PT_PER_IN * float(inches):g}" for inches in item.figure.get_size_inches())
    picture = base64.b64encode(content).decode("ascii")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}pt" height="{height}pt" viewBox="0 0 {width} {height}">'
        f'<image width="{width}" height="{height}" href="data:image/png;base64,{picture}"/></svg>'
    )


def _colophon(report: Report) -> list[str]:
    """Say when, by which command and with which software the report was made."""
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    return [
        *([f"Written {report.created:%Y-%m-%d %H:%M %Z}."] if report.created else []),
        *([f"Command: {report.command}"] if report.command else []),
        *([f"Software: {versions}."] if versions else []),
    ]


def _printable(value: Any) -> Any:
    """Put a space for every control character: no font has a sign for one."""
    if isinstance(value, str):
        return "".join(" " if unicodedata.category(sign) in {"Cc", "Cs"} else sign for sign in value)
    if isinstance(value, dict):
        return {key: _printable(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_printable(part) for part in value]
    return value
