"""`fringecal verify`: a calibrated rig against an artefact of known geometry."""

from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import typer
from rich import box
from rich.table import Table

from fringecal.cli.history import append_record
from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.saving import LIMITS_HELP, demand_folder, print_outcome, progress
from fringecal.report import write_report
from fringecal.uncertainty import EXPANDED_BY, uncertainty_text, value_text
from fringecal.workflows.shared import command_line, given

HELP = """Measure an artefact with a calibrated rig and set its errors beside the certificate.

Angle bars (zigzag) give height errors along profiles; a flat, steps, a wedge, a box, a sphere or a ball bar give
flatness, heights, amplification and linearity, angle, size, form and spacing. By a rig that a board has calibrated a
flat, steps, a sphere or a ball bar are judged in any pose in the volume, without a plate.
Writes verification.json, tables, figures and report.html into DIR.
Exit code 0 if all agrees with the certificate (|En| <= 1), 3 if something does not, 1 if nothing could be verified.

Example: fringecal verify bench/2026-11-22 --capture bars --calibration calibration/calibration.json --out verification
"""


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="verify", help=HELP)(verify)


def verify(
    session: Path = typer.Argument(..., help="Folder that holds session.toml.", show_default=False),
    calibration: Path = typer.Option(..., "--calibration", help="calibration.json of the rig."),
    out: Path = typer.Option(..., "--out", help="Folder for the results."),
    capture: str = typer.Option("", "--capture", help="Capture of the artefact; the only one of its kind by default."),
    rows: str = typer.Option("", "--rows", help="Rows of the profiles in px, comma-separated."),
    limits: Path | None = typer.Option(None, "--limits", help=LIMITS_HELP, show_default=False),
    filters: bool = typer.Option(True, "--filters/--no-filters", help="Rank median and mean filters."),
    history: str = typer.Option("", "--history", help="History to append the record to: SQLite file or URL."),
    as_json: bool = typer.Option(False, "--json", help="Print the record as one JSON document."),
) -> None:
    """Load, verify, save, print."""
    from fringecal.records import (
        VERIFICATION_FILE,
        CalibrationUsed,
        is_board_calibration,
        limits_for,
        read_calibration,
        result_folder,
        write_verification,
        written_document,
    )
    from fringecal.session import load_session
    from fringecal.targets import Zigzag
    from fringecal.workflows.shared import calibration_of, demand_same_rig
    from fringecal.workflows.verify import artefact_capture

    demand_folder(out)
    stated = given({"--capture": capture, "--rows": rows, "--limits": limits})
    plain = () if filters else ("--no-filters",)
    command = command_line("verify", [session, "--calibration", calibration, "--out", out, *stated, *plain])
    with progress(quiet=as_json) as show:
        allowed = limits_for(session, limits)
        loaded = load_session(session)
        if is_board_calibration(calibration):
            record, report, table = _in_volume(loaded, capture or None, calibration, command, show, allowed)
        else:
            in_force = read_calibration(calibration)
            rig = calibration_of(in_force)
            demand_same_rig(loaded, in_force.session.rig)
            chosen = artefact_capture(loaded, capture or None, rig)
            bars = isinstance(chosen.target, Zigzag)
            judge = partial(_bars, rows=_rows(rows), filters=filters) if bars else _artefact
            used = CalibrationUsed.of(in_force, _record_file(calibration))
            record, report, table = judge(loaded, chosen, rig, used, command, show, allowed)
        show("writing the report")
        with result_folder(out, last=VERIFICATION_FILE) as staging:
            write_report(report, staging)
            write_verification(record, staging)
    if history:
        append_record(out / VERIFICATION_FILE, history)
    if as_json:
        print_json(written_document(record))
        raise typer.Exit(3 if any(check.decision == "fail" for check in record.checks) else 0)
    console.print(table)
    print_outcome(record.checks, (record.sentence,), out)


def _bars(session, capture, rig, used, command, show, limits, *, rows, filters):  # type: ignore[no-untyped-def]
    """Judge angle bars: record, report and the table to print."""
    from fringecal.workflows.verify import verification_record, verification_report
    from fringecal.workflows.verify import verify as run

    found = run(session, capture.name, rig, rows_px=rows, with_filters=filters, progress=show)
    record = verification_record(found, session, used, command=command, limits=limits)
    report = verification_report(found, command=" ".join(command), created=datetime.now(UTC), limits=limits)
    return record, report, _table(found.errors)


def _artefact(session, capture, rig, used, command, show, limits):  # type: ignore[no-untyped-def]
    """Judge any other artefact: record, report and the table to print."""
    from fringecal.workflows.verify import artefact_record, artefact_report, verify_artefact

    found = verify_artefact(capture, rig, progress=show)
    record = artefact_record(found, session, used, command=command, limits=limits)
    report = artefact_report(found, command=" ".join(command), created=datetime.now(UTC), limits=limits)
    return record, report, _readings_table(found)


def _in_volume(session, capture, calibration, command, show, limits):  # type: ignore[no-untyped-def]
    """Judge an artefact in any pose by a rig that a board has calibrated: record, report and the table to print."""
    from fringecal.records import CalibrationUsed, read_board_calibration
    from fringecal.workflows.shared import demand_same_rig
    from fringecal.workflows.verify import artefact_record, verify_in_volume, volume_verification_report

    written = read_board_calibration(calibration)
    demand_same_rig(session, written.session.rig)
    found = verify_in_volume(session, capture, written, progress=show)
    used = CalibrationUsed.of(written, _record_file(calibration))
    record = artefact_record(found, session, used, command=command, limits=limits)
    report = volume_verification_report(found, command=" ".join(command), created=datetime.now(UTC), limits=limits)
    return record, report, _readings_table(found)


def _record_file(path: Path) -> Path:
    from fringecal.records import CALIBRATION_FILE

    return path / CALIBRATION_FILE if path.is_dir() else path


def _rows(text: str) -> tuple[int, ...] | None:
    if not text.strip():
        return None
    try:
        rows = tuple(int(part) for part in text.split(","))
    except ValueError:
        rows = (-1,)
    if min(rows) < 0:
        raise typer.BadParameter(f"{text!r}: rows are whole numbers from zero with commas between", param_hint="--rows")
    return rows


def _readings_table(found) -> Table:  # type: ignore[no-untyped-def]
    title = f"{found.target.name}: error = measured - certified; {EXPANDED_BY}"
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=0)
    for heading in ("number", "unit", "measured", "certified", "error", "u", "u(cert.)", "En"):
        table.add_column(heading, justify="left" if heading == "number" else "right", no_wrap=heading != "number")
    for r in found.readings:
        values = ((r.measured, r.u_measured), (r.reference, r.u_reference), (r.error, r.u_measured))
        cells = ["" if value is None else value_text(value, u, otherwise=".4f") for value, u in values]
        uncertainties = (r.u_measured, r.u_reference if r.reference is not None else None)
        cells += ["" if u is None else uncertainty_text(u) for u in uncertainties]
        table.add_row(r.name, r.unit, *cells, "" if r.en is None else f"{r.en:+z.2f}")
    return table


def _table(errors) -> Table:  # type: ignore[no-untyped-def]
    title = f"Height errors, edge zones out; percent of the full height {errors.full_height_mm:.3f} mm; {EXPANDED_BY}"
    # Narrow enough for 80 columns: a number that is cut cannot be read.
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=0)
    for heading in (
        "profile",
        "row px",
        "y mm",
        "n",
        "mean mm",
        "u(mean) mm",
        "sd mm",
        "max mm",
        "mean %",
        "max %",
        "En",
    ):
        table.add_column(heading.replace(" ", "\n"), justify="right", no_wrap=True)
    for p in (*errors.profiles, errors.pooled):
        en = "" if p.en is None else f"{p.en:+z.2f}"
        percents = (f"{p.mean_percent:+z.3f}", f"{p.max_percent:.3f}")
        table.add_row(
            p.name,
            f"{p.row_px:.0f}",
            f"{p.y_mm:.1f}",
            str(p.n),
            value_text(p.mean_mm, p.u_mm, sign=True, otherwise=".4f"),
            uncertainty_text(p.u_mm) if p.u_mm else "",
            f"{p.sd_mm:.4f}",
            f"{p.max_abs_mm:.4f}",
            *percents,
            en,
        )
    return table
