"""`fringecal commission`: calibrate a rig from a session folder."""

from datetime import UTC, datetime
from pathlib import Path

import typer
from rich.markup import escape
from rich.table import Table

from fringecal.cli.history import append_record, history_beside
from fringecal.cli.shared.console import print_json
from fringecal.cli.shared.saving import LIMITS_HELP, demand_folder, print_outcome, progress
from fringecal.report import write_report
from fringecal.uncertainty import uncertainty_text, value_text
from fringecal.workflows.shared import command_line, given

HELP = """Calibrate a rig from a session with a grid, the bare plate and strips, or with a board in poses under fringes.

Writes calibration.json, camera.cameramodel, tables, figures and report.html into DIR.
Exit code 0 if all checks pass, 3 if one fails, 1 if the session cannot be used.

Example: fringecal commission bench/2026-11-22 --out calibration
"""


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="commission", help=HELP)(commission)


def commission(
    session: Path = typer.Argument(..., help="Folder that holds session.toml.", show_default=False),
    out: Path = typer.Option(..., "--out", help="Folder for the results."),
    limits: Path | None = typer.Option(None, "--limits", help=LIMITS_HELP, show_default=False),
    history: str = typer.Option("", "--history", help="History to append the record to: SQLite file or URL."),
    as_json: bool = typer.Option(False, "--json", help="Print the record as one JSON document."),
) -> None:
    """Load, commission, save, print."""
    from fringecal.cli.shared.by_board import commission_by_board, show_board_calibration
    from fringecal.records import (
        CALIBRATION_FILE,
        CAMERAMODEL_FILE,
        EARLIER,
        BoardCalibrationRecord,
        CalibrationRecord,
        limits_for,
        result_folder,
        write_calibration,
        write_cameramodel,
        written_document,
    )
    from fringecal.session import load_session
    from fringecal.workflows.commission import (
        calibration_record,
        commission_report,
        is_board_session,
        unseen_sentence,
    )
    from fringecal.workflows.commission import commission as run

    demand_folder(out)
    command = command_line("commission", [session, "--out", out, *given({"--limits": limits})])
    with progress(quiet=as_json) as show:
        allowed = limits_for(session, limits)
        loaded = load_session(session)
        record: CalibrationRecord | BoardCalibrationRecord
        if is_board_session(loaded):
            record = commission_by_board(loaded, out, command, allowed, show)
        else:
            found = run(loaded, progress=show)
            rig = found.calibrated.result.rig
            record = calibration_record(found, command=command, limits=allowed)
            show("writing the report")
            with result_folder(out, last=CALIBRATION_FILE) as staging:
                if not rig.camera.telecentric:
                    write_cameramodel(staging / CAMERAMODEL_FILE, rig.camera)
                write_calibration(record, staging)
                report = commission_report(
                    found,
                    command=" ".join(command),
                    created=datetime.now(UTC),
                    limits=allowed,
                    history=history_beside(staging, history),
                )
                write_report(report, staging)
    if history:
        append_record(out / CALIBRATION_FILE, history)
    if as_json:
        print_json(written_document(record))
        raise typer.Exit(3 if any(check.decision == "fail" for check in record.checks) else 0)
    kept = (f"earlier calibrations are kept in {out / EARLIER}",) if (out / EARLIER).is_dir() else ()
    if isinstance(record, BoardCalibrationRecord):
        show_board_calibration(record)
        print_outcome(record.checks, (*record.notes, *kept), out)
        return
    origin = found.calibrated.result.origin
    scales = found.calibrated.result.camera.scales
    table = _table(scales | {"angle": origin.angle, "apparent angle": origin.apparent})
    said = (*record.notes, *found.advice.sentences[-1:], *kept)
    print_outcome(record.checks, said, out, why=unseen_sentence(record.checks), table=table)


def _table(estimates) -> Table:  # type: ignore[no-untyped-def]
    table = Table(title="Calibration; angles from the plate's normal, u is a standard uncertainty")
    for heading in ("quantity", "value", "u", "U (95 %)", "unit"):
        table.add_column(heading, justify="left" if heading in ("quantity", "unit") else "right")
    for name, estimate in estimates.items():
        label = f"scale, {name}" if estimate.unit == "mm/px" else f"projection {name}"
        value, u = value_text(estimate.value, estimate.u), uncertainty_text(estimate.u)
        table.add_row(
            label.replace("projection apparent", "apparent projection"),
            value,
            u,
            uncertainty_text(estimate.expanded().U),
            escape(estimate.unit),
        )
    return table
