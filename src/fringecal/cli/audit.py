"""`fringecal audit`: a smaller session against the calibration in force."""

from datetime import UTC, datetime
from pathlib import Path

import typer
from rich import box
from rich.table import Table

from fringecal.cli.console import console, print_json
from fringecal.cli.history import append_record
from fringecal.cli.saving import LIMITS_HELP, command_line, demand_folder, progress, tell_outcome, write_report

HELP = """Compare a rig with its calibration in force: what changed, by how much, and what probably moved.

A grid says of the camera; the bare plate of lamp, slide and plate; strips beside it of the projection angle;
artefacts of height errors. What is there decides what can be said. The calibration is never changed.
Writes audit.json, tables, figures and report.html into DIR.
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
    from fringecal.procedures.audit import audit as run
    from fringecal.procedures.recording import calibration_of
    from fringecal.procedures.recording_audit import audit_record
    from fringecal.procedures.report_audit import audit_report
    from fringecal.records.audit import AUDIT_FILE, write_audit
    from fringecal.records.calibration import CALIBRATION_FILE, read_calibration
    from fringecal.records.files import result_folder
    from fringecal.records.limits import limits_for
    from fringecal.session import load_session

    demand_folder(out)
    stated = ("--limits", limits) if limits else ()
    command = command_line("audit", [session, "--calibration", calibration, "--out", out, *stated])
    with progress(quiet=as_json) as show:
        allowed = limits_for(session, limits)
        in_force = read_calibration(calibration)
        found = run(load_session(session), calibration_of(in_force), in_force, progress=show)
        file = calibration / CALIBRATION_FILE if calibration.is_dir() else calibration
        record = audit_record(found, file, command=command, limits=allowed)
        show("writing the report")
        report = audit_report(found, command=" ".join(command), created=datetime.now(UTC), limits=allowed)
        with result_folder(out, last=AUDIT_FILE) as staging:
            write_report(report, staging)
            write_audit(record, staging)
    if history:
        append_record(out / AUDIT_FILE, history)
    if as_json:
        print_json(record.model_dump(mode="json"))
        raise typer.Exit(3 if record.verdict == "fail" else 0)
    console.print(_table(record.changes))
    tell_outcome(record.checks, (*record.notes, record.sentence), out)


def _table(changes) -> Table:  # type: ignore[no-untyped-def]
    table = Table(title="Change since the calibration; U at 95 %, En = change / U", box=box.SIMPLE_HEAD, padding=0)
    for heading in ("quantity", "change", "U", "unit", "En", "limit", "outcome"):
        table.add_column(heading, justify="left" if heading in ("quantity", "unit", "outcome") else "right")
    for c in changes:
        en = "" if c.en is None else f"{c.en:+z.2f}"
        table.add_row(c.name, f"{c.value:+.3g}", f"{1.96 * c.u:.2g}", c.unit, en, f"{c.limit:g}", c.decision)
    return table
