"""A record of the history as a page: its checks, what failed first, and its quantities."""

import json
import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Any
from urllib.parse import quote

import pandas as pd

from fringecal.report.pages.dashboard import Block, Card, Cell, decision_words, record_view
from fringecal.report.views import DECISIONS
from fringecal.uncertainty import EXPANDED_BY, Estimate, uncertainty_text, value_text

_WORST_FIRST = ("fail", "conditionalFail", "conditionalPass", "info", "pass")
_CHECKS = ("check", "value", "limit", "outcome", "rule")
_QUANTITIES = ("quantity", "value", "U", "unit", "reference", "En", "limit", "outcome")


def record_page(entry: Mapping[Hashable, Any], readings: pd.DataFrame, document: str | None) -> str:
    """Show one record of the history.

    Parameters
    ----------
    entry
        Its row of `History.entries`.
    readings
        Its rows of `History.readings`.
    document
        Its whole text; None where only its numbers were imported.
    """
    rig, decision = str(entry["rig"]), str(entry["decision"])
    word, sign = DECISIONS[decision]
    facts = tuple((name, Cell(text)) for name, text in _facts(entry))
    card = Card(f"{str(entry['kind']).capitalize()} of {rig}", "", decision, sign, word, facts)
    raw = (Cell("The record as JSON", f"/record/{entry['sha256']}.json"),) if document else ()
    links = (Cell("All rigs", "/"), Cell(rig, f"/rig?name={quote(rig, safe='')}"), *raw)
    blocks = (*_checks(document), _quantities(readings))
    title = f"{str(entry['kind']).capitalize()} of {rig}"
    return record_view(title, f"Captured {_time(entry['captured'])}", links, blocks, card)


def _time(captured: object) -> str:
    return str(captured)[:16].replace("T", " ")


def _facts(entry: Mapping[Hashable, Any]) -> Iterator[tuple[str, str]]:
    named = {
        "operator": "Operator",
        "temperature_degC": "Temperature / degC",
        "minutes_since_power_on": "After power-on / min",
        "source": "Source",
        "software": "Software",
    }
    for key, name in named.items():
        value = entry[key]
        if value is not None and value == value and value != "":  # noqa: PLR0124 -- NaN alone differs from itself
            yield name, str(value)


def _checks(document: str | None) -> tuple[Block, ...]:
    """Tabulate the checks of a record's text, what did not pass first; none where the text holds none."""
    checks = _listed(document)
    rows, marks = [], []
    for check in sorted(checks, key=lambda one: _WORST_FIRST.index(one["decision"])):
        unit = f" {check['unit']}" if check.get("unit") else ""
        value, limit = check.get("value"), check.get("limit")
        texts = (
            str(check["name"]),
            "-" if value is None else f"{value_text(value, check.get('u'))}{unit}",
            "-" if limit is None else f"{limit:g}{unit}",
            decision_words(check["decision"]),
            str(check.get("rule", "")),
        )
        rows.append(tuple(map(Cell, texts)))
        marks.append(str(check["decision"]))
    return (Block("Checks", _CHECKS, tuple(rows), marks=tuple(marks)),) if rows else ()


def _listed(document: str | None) -> Sequence[Mapping[str, Any]]:
    """Return what a document lists as checks, as far as it is what a check is."""
    try:
        found = json.loads(document or "{}").get("checks", [])
    except (ValueError, AttributeError):
        return ()
    known = [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []
    return [one for one in known if one.get("decision") in _WORST_FIRST and "name" in one]


def _quantities(readings: pd.DataFrame) -> Block:
    """Tabulate the quantities, without those that repeat a check."""
    shown = readings[~readings["quantity"].str.startswith("check: ")]
    rows = tuple(tuple(map(Cell, _texts(row))) for row in shown.to_dict("records"))
    return Block(f"Quantities ({EXPANDED_BY})", _QUANTITIES, rows, "The record holds no quantities of its own.")


def _texts(row: Mapping[Hashable, Any]) -> tuple[str, ...]:
    value, u, dof, reference, en, limit = (
        _number(row[key]) for key in ("value", "u", "dof", "reference", "en", "limit")
    )
    expanded = Estimate(value or 0.0, u, dof=dof or math.inf).expanded().U if u else None
    return (
        str(row["quantity"]),
        value_text(value or 0.0, u),
        "-" if expanded is None else uncertainty_text(expanded),
        str(row["unit"] or ""),
        "-" if reference is None else f"{reference:g}",
        "-" if en is None else f"{en:+.2f}",
        "-" if limit is None else f"{limit:g}",
        decision_words(row["decision"]) if row["decision"] in DECISIONS else "-",
    )


def _number(cell: Any) -> float | None:
    return None if cell is None or math.isnan(float(cell)) else float(cell)
