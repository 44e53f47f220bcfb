"""The diagnostics in a report: what is wrong with the frames, the error it causes, what to do, with pictures."""

from collections.abc import Sequence

import pandas as pd

from fringecal.report import FigureItem, Section, Table, diagnostics_overview
from fringecal.workflows.shared.capture_diagnosis import CaptureDiagnosis


def findings_section(diagnosed: Sequence[CaptureDiagnosis]) -> Section:
    """Tabulate the findings of all captures and show the observations behind them."""
    clean = [one.phase.capture.name for one in diagnosed if not one.findings]
    paragraphs = []
    if clean:
        paragraphs.append(f"Nothing wrong was found in: {', '.join(clean)}.")
    paragraphs += [f"{one.phase.capture.name}: {note}." for one in diagnosed for note in one.diagnosis.notes]
    paragraphs += [f"{one.phase.capture.name}: {part}." for one in diagnosed for part in one.diagnosis.looked()]
    rows = [_row(one, k) for one in diagnosed for k in range(len(one.findings))]
    formats = {"rms error /  rad": ".3f", "rms error /  mm": ".3f"}
    note = "errors are rms over a fringe with the stated phase shifts; corrected effects do not reach the heights"
    tables = (Table("Findings", pd.DataFrame(rows), note, formats),) if rows else ()
    return Section("Diagnostics of the frames", tuple(paragraphs), tables, tuple(_figure(one) for one in diagnosed))


def _row(one: CaptureDiagnosis, number: int) -> dict[str, object]:
    finding = one.findings[number]
    return {
        "capture": one.phase.capture.name,
        "finding": finding.kind.text,
        "what": finding.what,
        "how large": finding.how_large,
        "rms error /  rad": finding.cost_rad,
        "rms error /  mm": finding.cost_mm,
        "corrected": "yes" if finding.kind in one.corrected else "no",
        "what to do": finding.remedy,
    }


def _figure(one: CaptureDiagnosis) -> FigureItem:
    name = one.phase.capture.name
    found = ", ".join(dict.fromkeys(kind.text for kind in one.diagnosis.kinds())) or "nothing wrong"
    return FigureItem(
        f"Frames of {name}",
        diagnostics_overview(one.diagnosis, title=name),
        f"{name}: {found}. Phase error over one fringe with the stated phase shifts, the same by order, the waveform "
        "against a cosine, and how each frame differs from the stated one.",
    )
