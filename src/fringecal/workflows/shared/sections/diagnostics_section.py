"""The doctor's part of a report: what is wrong with the frames, what it costs, what to do, with pictures."""

from collections.abc import Sequence

import pandas as pd

from fringecal.report import FigureItem, Section, Table, doctor_overview
from fringecal.workflows.shared.examination import Examination


def doctor_section(examined: Sequence[Examination]) -> Section:
    """Tabulate the findings of all captures and show what they rest on."""
    clean = [one.phase.capture.name for one in examined if not one.findings]
    paragraphs = []
    if clean:
        paragraphs.append(f"Nothing wrong was found in: {', '.join(clean)}.")
    paragraphs += [f"{one.phase.capture.name}: {note}." for one in examined for note in one.diagnosis.notes]
    rows = [_row(one, k) for one in examined for k in range(len(one.findings))]
    formats = {"cost / rad": ".3f", "cost / mm": ".3f"}
    note = "costs are rms over a fringe, with the stated model; what is undone does not reach the heights"
    tables = (Table("Findings", pd.DataFrame(rows), note, formats),) if rows else ()
    return Section("Frames under examination", tuple(paragraphs), tables, tuple(_figure(one) for one in examined))


def _row(one: Examination, number: int) -> dict[str, object]:
    finding = one.findings[number]
    return {
        "capture": one.phase.capture.name,
        "finding": finding.kind.text,
        "what": finding.what,
        "how large": finding.how_large,
        "cost / rad": finding.cost_rad,
        "cost / mm": finding.cost_mm,
        "undone": "yes" if finding.kind in one.undone else "no",
        "what to do": finding.remedy,
    }


def _figure(one: Examination) -> FigureItem:
    name = one.phase.capture.name
    found = ", ".join(dict.fromkeys(kind.text for kind in one.diagnosis.kinds())) or "nothing wrong"
    return FigureItem(
        f"Frames of {name}",
        doctor_overview(one.diagnosis, title=name),
        f"{name}: {found}. Error of the phase over one fringe with the stated steps, the same by order, the shape of "
        "the fringes against a cosine, and how each frame differs from the stated one.",
    )
