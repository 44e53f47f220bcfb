"""The report of a study: coverage by quantity, errors over u, and every rig that was refused."""

from datetime import datetime

import numpy as np

from fringecal.records import software_versions
from fringecal.report import (
    AS_U,
    Fact,
    FigureItem,
    Report,
    Section,
    Table,
    Verdict,
    coverage_bars,
    z_histograms,
)
from fringecal.workflows.shared import checks_table, severest
from fringecal.workflows.study.coverage_summary import WANTED, StudySummary

_NOTE = (
    "error = found - true; standard deviation: of the errors; stated u: root mean square; coverage of 95 % "
    "intervals with its 95 % binomial (Wilson) band. Heights are those that the calibration gives the true phase of a "
    "point: the noise of a single pixel takes no part"
)


def study_report(summary: StudySummary, *, command: str = "", created: datetime | None = None) -> Report:
    """Return the report of a study.

    Parameters
    ----------
    summary
        What the study's results say.
    command, created
        As for `commission_report`.
    """
    checks = summary.checks()
    worst = max(summary.quantities, key=lambda q: abs(q.ratio - 1))
    return Report(
        title="Coverage of the stated uncertainties",
        subtitle=f"{summary.rigs} virtual rigs",
        verdict=Verdict(severest(checks), summary.sentence),
        facts=(
            Fact("Rigs", str(summary.rigs), f"{len(summary.refused)} refused"),
            Fact("Standard deviation over stated u", f"{worst.ratio:.2f}", f"farthest from 1: {worst.name}"),
        ),
        sections=(
            Section("Coverage", (summary.sentence,), (coverage_table(summary),), _figures(summary)),
            _refusals(summary),
            Section("Checks", (), (checks_table(checks),)),
        ),
        versions=software_versions(),
        command=command,
        created=created,
    )


def coverage_table(summary: StudySummary) -> Table:
    """Tabulate bias, standard deviation and coverage of every quantity."""
    percent = dict.fromkeys(("coverage / %", "from / %", "to / %"), ".1f")
    widths = dict.fromkeys(("standard deviation", "stated u"), AS_U)
    formats = {"bias": "+.2g", "standard deviation / u": ".2f"} | widths
    return Table("Coverage", summary.frame(), _NOTE, formats | percent, {"bias": "u(bias)"})


def _figures(summary: StudySummary) -> tuple[FigureItem, ...]:
    quantities = summary.quantities
    shares, bands = [q.coverage for q in quantities], [q.band for q in quantities]
    bars = coverage_bars([q.name for q in quantities], shares, bands, wanted=WANTED)
    # Heights of one rig err together: their histogram is fuller than that of one point, not more certain.
    scores = {q.name: q.z for q in quantities if q.unit != "mm"}
    if heights := [q.z for q in quantities if q.unit == "mm"]:
        scores["heights"] = np.concatenate(heights)
    widths = ", ".join(f"{name} {float(np.std(z)):.2f}" for name, z in scores.items())
    return (
        FigureItem("Coverage of 95 % intervals", bars, summary.sentence),
        FigureItem(
            "Errors over their uncertainties",
            z_histograms(scores),
            f"Histograms beside the standard normal density, which has standard deviation 1: {widths}.",
        ),
    )


def _refusals(summary: StudySummary) -> Section:
    if not summary.refused:
        return Section("Refused rigs", ("None was refused.",))
    table = Table("Refused rigs", summary.refusals(), "they count in no coverage")
    return Section("Refused rigs", (f"{len(summary.refused)} of {summary.rigs} rigs were refused.",), (table,))
