"""`fringecal audit`: a smaller session against the calibration in force."""

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich import box
from rich.table import Table

from fringecal.cli.history import append_record, history_beside
from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.saving import LIMITS_HELP, demand_folder, print_outcome, progress
from fringecal.report import write_report
from fringecal.uncertainty import EXPANDED_BY, Estimate, uncertainty_text, value_text
from fringecal.workflows.shared import command_line, given

if TYPE_CHECKING:
    from fringecal.records import Check

HELP = """Compare a rig with its calibration in force: what changed, by how much, and what probably moved.

A grid shows changes of the camera; the bare plate those of projector, slide and plate; strips beside it that of the
projection angle; artefacts show height errors. The captures of the session decide what can be compared. The
calibration is never changed. Writes audit.json, tables, figures and report.html into DIR.
Exit code 0 within the limits, 3 beyond one, 1 if nothing could be compared.

Example: fringecal audit bench/2026-12-22 --calibration calibration/calibration.json --out audit
"""


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="audit", help=HELP)(audit)


def audit(
    session: Path = typer.Argument(..., help="Folder that holds session.toml.", show_default=False),
    calibration: Path = typer.Option(..., "--calibration", help="calibration.json in force."),
    out: Path = typer.Option(..., "--out", help="Folder for the results."),
    limits: Path | None = typer.Option(None, "--limits", help=LIMITS_HELP, show_default=False),
    history: str = typer.Option("", "--history", help="History to append the record to: SQLite file or URL."),
    as_json: bool = typer.Option(False, "--json", help="Print the record as one JSON document."),
) -> None:
    """Load, audit, save, print."""
    from fringecal.records import (
        AUDIT_FILE,
        CALIBRATION_FILE,
        CalibrationUsed,
        limits_for,
        read_calibration,
        result_folder,
        write_audit,
        written_document,
    )
    from fringecal.session import load_session
    from fringecal.workflows.audit import audit as run
    from fringecal.workflows.audit import (
        audit_record,
        audit_report,
        change_sentence,
        consequence_sentence,
        reuse_sentence,
    )
    from fringecal.workflows.shared import calibration_of

    demand_folder(out)
    stated = given({"--limits": limits})
    command = command_line("audit", [session, "--calibration", calibration, "--out", out, *stated])
    with progress(quiet=as_json) as show:
        allowed = limits_for(session, limits)
        in_force = read_calibration(calibration)
        found = run(load_session(session), calibration_of(in_force), in_force, progress=show)
        file = calibration / CALIBRATION_FILE if calibration.is_dir() else calibration
        record = audit_record(found, CalibrationUsed.of(in_force, file), command=command, limits=allowed)
        show("writing the report")
        with result_folder(out, last=AUDIT_FILE) as staging:
            write_audit(record, staging)
            report = audit_report(
                found,
                command=" ".join(command),
                created=datetime.now(UTC),
                limits=allowed,
                history=history_beside(staging, history),
            )
            write_report(report, staging)
    if history:
        append_record(out / AUDIT_FILE, history)
    if as_json:
        print_json(written_document(record))
        raise typer.Exit(3 if record.verdict == "fail" else 0)
    if warning := reuse_sentence(found):
        console.print(f"WARNING: {warning}", style="bold yellow", markup=False, highlight=False, soft_wrap=True)
    console.print(_table(record.changes))
    shown = {f"change of {change.name}" for change in record.changes}
    console.print(_others_table([check for check in record.checks if check.name not in shown]))
    told = (consequence_sentence(record.checks), *record.notes, change_sentence(found))
    print_outcome(record.checks, tuple(filter(None, told)), out)


_TOO_SMALL = 1e-6  # smaller probabilities are no longer to be taken by their number


def _others_table(checks: list["Check"]) -> Table:
    """Tabulate the checks that are not the change of one quantity."""
    table = Table(title="The rig as a whole, and artefacts by the calibration in force", box=box.SIMPLE_HEAD, padding=0)
    for heading in ("check", "value", "limit", "outcome"):
        table.add_column(heading, justify="left" if heading in ("check", "outcome") else "right")
    for check in checks:
        limit = "" if check.limit is None else f"{check.limit:g}"
        table.add_row(check.name, _value(check), limit, check.decision)
    return table


def _value(check: "Check") -> str:
    """Print what was compared with the limit: an En, a chance, or a quantity with its unit."""
    if check.value is None:
        return ""
    if check.score == "En":
        # A value that rounds onto its limit gets the digits that show on which side it lies.
        near = check.limit is not None and abs(abs(check.value) - check.limit) < 0.01
        return f"En {check.value:+z.4f}" if near else f"En {check.value:+z.2f}"
    if check.rule.startswith("chance"):
        return "p < 1e-6" if check.value < _TOO_SMALL else f"p {check.value:.2g}"
    return f"{check.value:.3g} {check.unit}".rstrip()


def _table(changes) -> Table:  # type: ignore[no-untyped-def]
    table = Table(
        title=f"Change since the calibration; En = change / U, none of an rms; {EXPANDED_BY}",
        box=box.SIMPLE_HEAD,
        padding=0,
    )
    for heading in ("quantity", "change", "U", "unit", "En", "limit", "outcome"):
        table.add_column(heading, justify="left" if heading in ("quantity", "unit", "outcome") else "right")
    for c in changes:
        en = "" if c.en is None else f"{c.en:+z.2f}"
        expanded = Estimate(c.value, c.u, dof=math.inf if c.dof is None else c.dof).expanded().U
        numbers = value_text(c.value, expanded, sign=True), uncertainty_text(expanded)
        table.add_row(c.name, *numbers, c.unit, en, f"{c.limit:g}", c.decision)
    return table
