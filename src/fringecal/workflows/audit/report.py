"""The report of an audit: verdict and cause first, then every change against its limit, maps, artefacts."""

from datetime import datetime

import numpy as np
import pandas as pd

from fringecal.records import DEFAULT_LIMITS, Limits, software_versions
from fringecal.report import (
    AS_U,
    Fact,
    FigureItem,
    Layer,
    Live,
    Report,
    Section,
    Table,
    Verdict,
    cause_bars,
    change_bars,
    readable_picture,
    residual_map,
)
from fringecal.uncertainty import EXPANDED_BY, decide, uncertainty_text, value_text
from fringecal.workflows.audit.checks import Change, audit_checks, changes_of
from fringecal.workflows.audit.consequences import consequence_sentence
from fringecal.workflows.audit.run import Audit
from fringecal.workflows.audit.sentences import amount_text, audit_sentence, cause_probabilities, likelihood_words
from fringecal.workflows.commission import verified_sections
from fringecal.workflows.shared import checks_table, inputs_of_capture, phase_section, severest
from fringecal.workflows.verify import Verified


def audit_report(
    found: Audit,
    *,
    command: str = "",
    created: datetime | None = None,
    limits: Limits = DEFAULT_LIMITS,
    history: Section | None = None,
) -> Report:
    """Return the report of an audit.

    Parameters
    ----------
    found
        What the audit has found.
    command, created, limits, history
        As for `commission_report`.
    """
    checks = audit_checks(found, limits)
    # What is nearest to its limit, or beyond it, is read first.
    changes = tuple(sorted(changes_of(found, limits), key=lambda change: -abs(change.found.value) / change.limit))
    phases = tuple(part.phase for part in (found.plate, *found.strips) if part is not None)
    captures = found.session.captures.values()
    return Report(
        title=f"Audit of {found.session.rig}",
        subtitle=f"Captured {found.session.captured:%Y-%m-%d %H:%M}; compared with the calibration in force",
        verdict=Verdict(severest(checks), f"{consequence_sentence(checks)} {audit_sentence(found)}".strip()),
        facts=tuple(_fact(change) for change in changes),
        sections=(
            Section("Checks", (), (checks_table(checks),)),
            _changes_section(found, changes, limits),
            *_causes_section(found),
            *_maps_section(found),
            *verified_sections(Verified(found.bars, found.artefacts)),
            *((phase_section(phases),) if phases else ()),
            *((history,) if history else ()),
        ),
        inputs=tuple(file for capture in captures for file in inputs_of_capture(capture)),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _fact(change: Change) -> Fact:
    found = change.found
    unit = f" {found.unit}" if found.unit else ""
    note = f"U = {uncertainty_text(found.expanded().U)}{unit}; limit {change.limit:g}{unit}"
    return Fact(f"Change of {change.name}", f"{value_text(found.value, found.u, sign=True)}{unit}", note)


def _changes_section(found: Audit, changes: tuple[Change, ...], limits: Limits) -> Section:
    rows = [
        {
            "quantity": c.name,
            "change": c.found.value,
            "u": c.found.u,
            "U (95 %)": c.found.expanded().U,
            "unit": c.found.unit,
            "En": c.en,
            "detection limit": c.detection_limit,
            "limit": c.limit,
            "decision": decide(c.found.value, c.found.u, lower=-c.limit, upper=c.limit, level=limits.level).outcome,
        }
        for c in changes
    ]
    formats = {
        "change": "+.3g",
        "U (95 %)": AS_U,
        "En": "+.2f",
        "detection limit": AS_U,
        "limit": "g",
    }
    note = (
        f"today minus at the calibration; En = change / U; {EXPANDED_BY}. An rms, which chance alone never makes "
        "zero, is judged by its limit and has no En. Detection limit: seen with 95 % at the chance of a false alarm "
        "that the audit takes"
    )
    shares = [c.found.value / c.limit for c in changes]
    expanded = [c.found.expanded().U / c.limit for c in changes]
    worst = max(range(len(changes)), key=lambda i: abs(shares[i]))
    figure = FigureItem(
        "Changes against limits",
        change_bars([c.name for c in changes], shares, expanded),
        f"Bars of {len(changes)} changes as shares of their limits; the largest is {changes[worst].name}, "
        f"{shares[worst]:+.2f} of its limit.",
    )
    return Section(
        "Changes", found.notes, (Table("Changes", pd.DataFrame(rows), note, formats, {"change": "u"}),), (figure,)
    )


def _causes_section(found: Audit) -> tuple[Section, ...]:
    """Show how well every single cause explains the change."""
    if not found.causes:
        return ()
    probabilities = cause_probabilities(found.causes)
    rows = [
        {
            "cause": fit.cause.text,
            "probability / %": 100 * probability,
            "in words": likelihood_words(probability),
            "amounts": ", ".join(f"{move.text} {amount_text(move, value)}" for move, value in fit.amounts.items()),
            "chi-squared": fit.chi2,
            "of": fit.dof,
        }
        for fit, probability in zip(found.causes, probabilities, strict=True)
    ]
    note = (
        "the signature of each cause, fitted to all changes at once; probability: if it was one of these alone, all as "
        "likely before; chi-squared of the residuals"
    )
    table = Table("Causes", pd.DataFrame(rows), note, {"chi-squared": ".1f", "probability / %": ".1f"})
    figure = FigureItem(
        "Causes compared",
        cause_bars([fit.cause.text for fit in found.causes], probabilities),
        f"Bars of the probability of single causes; the likeliest of {len(found.causes)} is "
        f"{found.causes[0].cause.text}, {probabilities[0]:.0%}.",
    )
    return (Section("What probably moved", (audit_sentence(found),), (table,), (figure,)),)


def _maps_section(found: Audit) -> tuple[Section, ...]:
    figures = []
    strips = ((f"phase difference of {one.phase.capture.name}", one) for one in found.strips)
    for name, part in (("plate phase", found.plate), *strips):
        if part is not None:
            change = part.change_rad
            rms = float(np.sqrt(np.nanmean(change**2)))
            figures.append(
                FigureItem(
                    f"Change of the {name}",
                    residual_map(change, label="today - calibration / rad"),
                    f"Map over the picture of today's {name} minus the calibration's: {rms:.3f} rad rms.",
                    "png",
                    Live(readable_picture(Layer("change", "rad", change, 4))),
                )
            )
    return (Section("Where it changed", (), (), tuple(figures)),) if figures else ()
