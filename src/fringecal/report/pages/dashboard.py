"""Pages over a history, for reading in a browser: all rigs, one rig, with links to records and reports."""

from dataclasses import dataclass
from urllib.parse import quote

import jinja2
import pandas as pd

_ROWS = 500  # of the newest records on one page: what is older stands in the export


@dataclass(frozen=True)
class Cell:
    """A text, and where it leads if anywhere."""

    text: str
    href: str = ""


@dataclass(frozen=True)
class Block:
    """A table with its title, or what to say where it has no rows."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    empty: str = ""


@dataclass(frozen=True)
class Choice:
    """A choice of two records to be compared: where it leads, and (hash, what it is called), the newest first."""

    action: str
    options: tuple[tuple[str, str], ...]


def rigs_page(entries: pd.DataFrame, name: str, *, desk: str = "") -> str:
    """Show every rig of a history: how many records, the last one, the last calibration and audit.

    Parameters
    ----------
    entries
        Rows of `History.entries`, in the order of capture.
    name
        What the history is called.
    desk
        Where sessions are checked and run; empty where nothing can be written.
    """
    columns = ("rig", "records", "last record", "verdict", "last calibration", "last audit", "its verdict")
    rows = tuple(_rig_row(str(rig), group) for rig, group in entries.groupby("rig"))
    block = Block("Rigs", columns, rows, "The history is empty: fringecal history add appends records.")
    links = (Cell("Check and run a session", desk),) if desk else ()
    return _page("Rigs", f"{len(entries)} records in {name}", links, (block,))


def _rig_row(rig: str, group: pd.DataFrame) -> tuple[Cell, ...]:
    last = group.iloc[-1]
    audits = group[group["kind"] == "audit"]
    verdict = str(audits.iloc[-1]["decision"]) if len(audits) else "-"
    days = (_last_day(group, "calibration"), _last_day(group, "audit"))
    texts = (str(len(group)), _day(last["captured"]), str(last["decision"]), *days, verdict)
    return (Cell(rig, f"/rig?name={quote(rig, safe='')}"), *map(Cell, texts))


def _last_day(group: pd.DataFrame, kind: str) -> str:
    found = group[group["kind"] == kind]
    return _day(found.iloc[-1]["captured"]) if len(found) else "-"


def _day(captured: object) -> str:
    return str(captured)[:16].replace("T", " ")


def rig_page(rig: str, entries: pd.DataFrame) -> str:
    """Show one rig's records, the newest first, each with its document.

    Parameters
    ----------
    rig
        Name of the rig.
    entries
        Its rows of `History.entries`, in the order of capture.
    """
    newest = entries.iloc[::-1].head(_ROWS)
    rows = tuple(
        (
            Cell(_day(row["captured"]), f"/record/{row['sha256']}"),
            *(Cell(_text(row[key])) for key in ("kind", "decision", "operator", "temperature_degC", "source")),
        )
        for row in newest.to_dict("records")
    )
    columns = ("captured", "kind", "verdict", "operator", "temperature / degC", "source")
    links = (Cell("All rigs", "/"), Cell("Charts, drift and intervals", f"/report?name={quote(rig, safe='')}"))
    blocks = (Block("Records", columns, rows),)
    return _page(rig, f"{len(entries)} records", links, blocks, _calibrations(newest))


def _calibrations(newest: pd.DataFrame) -> Choice | None:
    """Offer the calibrations for comparison; none where there are fewer than two."""
    found = newest[newest["kind"] == "calibration"]
    options = tuple((str(r["sha256"]), f"{_day(r['captured'])}, {r['decision']}") for r in found.to_dict("records"))
    return Choice("/compare", options) if len(options) > 1 else None


def message_page(title: str, words: str) -> str:
    """Say that something is not there, or not to be had."""
    return _page(title, words, (Cell("All rigs", "/"),), ())


def _text(value: object) -> str:
    return "-" if value is None or value != value else str(value)  # noqa: PLR0124 -- NaN alone differs from itself


def _page(
    title: str, subtitle: str, links: tuple[Cell, ...], sections: tuple[Block, ...], choice: Choice | None = None
) -> str:
    return render("dashboard.html.j2", title=title, subtitle=subtitle, links=links, sections=sections, choice=choice)


def render(template: str, **values: object) -> str:
    """Fill a template of the dashboard; every text is escaped, and a value that is missing is an error."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fringecal.report"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    return environment.get_template(template).render(values)
