"""A rig calibrated by a board in poses, on the command line: run, record and report, all together or not at all."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from rich.table import Table

from fringecal.cli.shared.console import console
from fringecal.records import (
    CALIBRATION_FILE,
    CAMERAMODEL_FILE,
    BoardCalibrationRecord,
    Limits,
    result_folder,
    write_board_calibration,
    write_lens,
)
from fringecal.report import write_report
from fringecal.session import Session
from fringecal.uncertainty import uncertainty_text, value_text
from fringecal.workflows.commission import board_calibration_record, board_report, commission_boards


def commission_by_board(
    session: Session, out: Path, command: Sequence[str], limits: Limits, progress: Callable[[str], None]
) -> BoardCalibrationRecord:
    """Calibrate by the session's board, and write record, camera model and report."""
    found = commission_boards(session, progress=progress)
    record = board_calibration_record(found, command=command, limits=limits)
    progress("writing the report")
    with result_folder(out, last=CALIBRATION_FILE) as staging:
        write_lens(staging / CAMERAMODEL_FILE, found.fit.rig.camera)
        write_board_calibration(record, staging)
        report = board_report(found, command=" ".join(command), created=datetime.now(UTC), limits=limits)
        write_report(report, staging)
    return record


def show_board_calibration(record: BoardCalibrationRecord) -> None:
    """Print what a calibration by a board found, in one table."""
    table = Table(title="Calibration by a board; u is a standard uncertainty")
    for heading in ("quantity", "value", "u", "U (95 %)", "unit"):
        table.add_column(heading, justify="left" if heading in ("quantity", "unit") else "right")
    rows = {"baseline": record.baseline_mm, "angle of the rays amid the boards": record.angle_deg}
    for name, written in rows.items():
        estimate = written.estimate()
        texts = value_text(estimate.value, estimate.u), uncertainty_text(estimate.u)
        table.add_row(name, *texts, uncertainty_text(estimate.expanded().U), estimate.unit)
    table.add_row("residual of both pictures, rms", f"{record.stereo_rms_px:.4f}", "", "", "px")
    volume = record.volume
    span = f"{volume.u_least_mm:.2g} to {volume.u_largest_mm:.2g}"
    table.add_row("u of a point where boards were", span, "", "", "mm")
    console.print(table)
