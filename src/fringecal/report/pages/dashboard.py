"""Pages over a history, for reading in a browser: all rigs, one rig, with links to records and reports."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from urllib.parse import quote

import jinja2
import pandas as pd

from fringecal.history import Review, Standing, rate_text
from fringecal.report.views import DECISIONS

_ROWS = 500  # of the newest records on one page: what is older stands in the export
_NAMED = 3  # quantities that a rig's card names of each kind: its page names all


@dataclass(frozen=True)
class Cell:
    """A text, and where it leads if anywhere."""

    text: str
    href: str = ""


@dataclass(frozen=True)
class Block:
    """A table with its title, or what to say where it has no rows; `marks` are the decisions of its rows, if any."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    empty: str = ""
    marks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Card:
    """A rig at a glance: how it stands in a colour, a sign and words, and what is to be known in pairs."""

    name: str
    href: str
    decision: str
    sign: str
    words: str
    facts: tuple[tuple[str, Cell], ...]


@dataclass(frozen=True)
class Choice:
    """A choice of two records to be compared: where it leads, and (hash, what it is called), the newest first."""

    action: str
    options: tuple[tuple[str, str], ...]


def rigs_page(
    entries: pd.DataFrame,
    name: str,
    standings: Mapping[str, Standing],
    *,
    now: datetime,
    desk: str = "",
) -> str:
    """Show every rig of a history, the worst first: state, trend, alarm, due date, last calibration and audit.

    Parameters
    ----------
    entries
        Rows of `History.entries`, in the order of capture.
    name
        What the history is called.
    standings
        Of each rig by its name.
    now
        What due dates are compared with, with its zone.
    desk
        Where sessions are checked and run; empty where nothing can be written.
    """
    cards = [_card(str(rig), group, standings[str(rig)], now) for rig, group in entries.groupby("rig")]
    cards.sort(key=lambda card: _ORDER.index(card.decision))
    links = (Cell("Check and run a session", desk),) if desk else ()
    empty = () if cards else (Block("Rigs", (), (), "The history is empty: fringecal history add appends records."),)
    return _page("Rigs", f"{len(entries)} records in {name}", links, empty, cards=cards)


_ORDER = ("fail", "conditionalFail", "conditionalPass", "pass", "info")


def _card(rig: str, group: pd.DataFrame, standing: Standing, now: datetime) -> Card:
    decision, words = _state(standing, str(group.iloc[-1]["decision"]), now)
    facts = (
        ("Out", Cell(_named(standing.out, lambda one: one.due.reason) or "nothing")),
        ("Alarm", Cell(_alarms(standing))),
        ("Trend", Cell(_trend(standing))),
        ("Due", Cell(_due(standing, now))),
        ("Last audit", _last(group, "audit")),
        ("Last calibration", _last(group, "calibration")),
        ("Records", Cell(str(len(group)))),
    )
    return Card(rig, f"/rig?name={quote(rig, safe='')}", decision, DECISIONS[decision][1], words, facts)


def _state(standing: Standing, last: str, now: datetime) -> tuple[str, str]:
    """Return decision and words of the worst: a quantity out, the last record failed, a warning, overdue."""
    if standing.state != "out" and last in ("fail", "conditionalFail"):
        return last, "Last record failed" if last == "fail" else "Last record failed on condition"
    match standing.state:
        case "out":
            return "fail", "Out of its limit"
        case "warning":
            return "conditionalFail", "Warning"
        case "in control" if standing.due is not None and standing.due < now:
            return "conditionalPass", "Overdue"
        case "in control":
            return "pass", "In control"
    return "info", "Too few records"


def _named(reviews: Sequence[Review], more: Callable[[Review], str]) -> str:
    shown = "; ".join(f"{one.series.quantity}, {more(one)}" for one in reviews[:_NAMED])
    return shown + (f"; and {len(reviews) - _NAMED} more" if len(reviews) > _NAMED else "")


def _alarms(standing: Standing) -> str:
    if not standing.charts:
        return "no chart yet"
    return _named(standing.alarming, lambda one: " and ".join(one.alarms)) or "none"


def _trend(standing: Standing) -> str:
    jumps = _named(standing.jumped, lambda one: f"jumped on {one.jumps[-1][:10]}")
    drifts = _named(standing.drifting, _rate)
    known = "steady" if standing.charts or standing.next_review else "not known"
    return "; ".join(filter(None, (drifts, jumps))) or known


def _rate(review: Review) -> str:
    return rate_text(review.drift) if review.drift else "no line"


def _due(standing: Standing, now: datetime) -> str:
    review, due = standing.next_review, standing.due
    if review is None or due is None:
        return "not enough to say"
    when = f"overdue since {due:%Y-%m-%d}" if due < now else f"{due:%Y-%m-%d}"
    return f"{'now' if review.due.days == 0 else when}, by {review.series.quantity}"


def _last(group: pd.DataFrame, kind: str) -> Cell:
    """Return day and verdict of the last record of a kind, with its page."""
    found = group[group["kind"] == kind]
    if found.empty:
        return Cell("none")
    row = found.iloc[-1]
    return Cell(f"{_day(row['captured'])}, {decision_words(row['decision'])}", f"/record/{row['sha256']}")


def decision_words(decision: object) -> str:
    """Say a decision in words, without its explanation.

    Examples
    --------
    >>> decision_words("conditionalPass"), decision_words("pass")
    ('conditional pass', 'pass')
    """
    return DECISIONS[str(decision)][0].partition(" (")[0].lower()


def _day(captured: object) -> str:
    return str(captured)[:16].replace("T", " ")


def rig_page(rig: str, entries: pd.DataFrame, standing: Standing, *, now: datetime) -> str:
    """Show how one rig stands, and its records, the newest first, each with its page.

    Parameters
    ----------
    rig
        Name of the rig.
    entries
        Its rows of `History.entries`, in the order of capture.
    standing, now
        As for `rigs_page`.
    """
    newest = entries.iloc[::-1].head(_ROWS)
    rows = tuple(
        (
            Cell(_day(row["captured"]), f"/record/{row['sha256']}"),
            Cell(str(row["kind"])),
            Cell(decision_words(row["decision"])),
            *(Cell(_text(row[key])) for key in ("operator", "temperature_degC", "source")),
        )
        for row in newest.to_dict("records")
    )
    columns = ("captured", "kind", "verdict", "operator", "temperature / degC", "source")
    report = f"/report?name={quote(rig, safe='')}"
    links = (Cell("All rigs", "/"), Cell("Charts, drift and due dates", report))
    blocks = (Block("Records", columns, rows, marks=tuple(str(decision) for decision in newest["decision"])),)
    card = _card(rig, entries, standing, now)
    return _page(rig, f"{len(entries)} records", links, blocks, choice=_calibrations(newest), cards=[card])


def _calibrations(newest: pd.DataFrame) -> Choice | None:
    """Offer the calibrations for comparison; none where there are fewer than two."""
    found = newest[newest["kind"] == "calibration"]
    options = tuple((str(r["sha256"]), f"{_day(r['captured'])}, {r['decision']}") for r in found.to_dict("records"))
    return Choice("/compare", options) if len(options) > 1 else None


def message_page(title: str, words: str) -> str:
    """Say that something is not there, or not to be had."""
    return _page(title, words, (Cell("All rigs", "/"),), ())


def record_view(title: str, subtitle: str, links: tuple[Cell, ...], sections: tuple[Block, ...], card: Card) -> str:
    """Return a page with one card over its tables."""
    return _page(title, subtitle, links, sections, cards=[card])


def _text(value: object) -> str:
    return "-" if value is None or value != value else str(value)  # noqa: PLR0124 -- NaN alone differs from itself


def _page(
    title: str,
    subtitle: str,
    links: tuple[Cell, ...],
    sections: tuple[Block, ...],
    *,
    choice: Choice | None = None,
    cards: Sequence[Card] = (),
) -> str:
    return render(
        "dashboard.html.j2",
        title=title,
        subtitle=subtitle,
        links=links,
        sections=sections,
        choice=choice,
        cards=cards,
    )


def render(template: str, **values: object) -> str:
    """Fill a template of the dashboard; every text is escaped, and a value that is missing is an error."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fringecal.report"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    return environment.get_template(template).render(values)
