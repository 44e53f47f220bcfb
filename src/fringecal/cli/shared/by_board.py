"""A rig calibrated by a board in poses, on the command line: run, record and report, all together or not at all."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from fringecal.cli.shared.console import console
from fringecal.errors import SessionError
from fringecal.reconstruct import cloud_of_map
from fringecal.records import (
    CALIBRATION_FILE,
    CAMERAMODEL_FILE,
    BoardCalibrationRecord,
    Limits,
    read_board_calibration,
    result_folder,
    write_board_calibration,
    write_cloud,
    write_further,
    write_lens,
    write_points,
    write_surfaces,
)
from fringecal.report import write_report
from fringecal.session import Session
from fringecal.uncertainty import uncertainty_text, value_text
from fringecal.workflows.commission import board_calibration_record, board_report, commission_boards
from fringecal.workflows.reconstruct import measure_volume, volume_report, volume_shares
from fringecal.workflows.shared import demand_same_rig

MESH_PIXELS = 1_000_000  # meshes of larger pictures are thinned: programs that open them choke
_ENDINGS = {"ply": ".ply", "ply-text": "-text.ply", "las": ".las", "e57": ".e57"}


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


def reconstruct_by_board(
    session: Session,
    capture: str | None,
    calibration: Path,
    out: Path,
    *,
    also: Sequence[str] = (),
    command: str = "",
    progress: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Measure a capture by a rig that a board has calibrated, write points, surfaces and report, and sum it up.

    Parameters
    ----------
    session, capture
        The session, and the capture's name; the only one of kind object where None.
    calibration, out
        The calibration's record, and the folder for results.
    also
        Further formats of the surface, or of the points where there is no plate.
    command
        The command line, for the report.
    progress
        Called with a short sentence before each step.
    """
    written = read_board_calibration(calibration)
    demand_same_rig(session, written.session.rig)
    found = measure_volume(session, capture, written, progress=progress)
    if found.heights is None and "gwy" in also:
        raise SessionError(["gwy holds heights over a plate; capture the bare plate (kind reference) in this session"])
    progress("writing points, surfaces and report")
    with result_folder(out, last="report.html") as staging:
        write_points(staging / "points.npz", found.volume, found.place_px)
        if found.heights is not None:
            stride = max(1, round((found.heights.z.size / MESH_PIXELS) ** 0.5))
            write_surfaces(staging, found.heights, stride=stride)
            write_further(staging, found.heights, also)
        else:
            for form in also:
                cloud = cloud_of_map(found.volume, "camera")
                write_cloud(staging / f"points{_ENDINGS[form]}", cloud, form)
        write_report(volume_report(found, command=command, created=datetime.now(UTC)), staging)
    z = found.volume.z[found.volume.mask] if found.heights is None else found.heights.z[found.heights.mask]
    u = found.volume.u_z[found.volume.mask] if found.heights is None else found.heights.u_z[found.heights.mask]
    return {
        "capture": found.capture.name,
        "frame": "camera" if found.heights is None else "plate",
        "shares": volume_shares(found),
        "z_min_mm": float(np.min(z)),
        "z_max_mm": float(np.max(z)),
        "u_z_median_mm": float(np.median(u)),
        "points": str(out / "points.npz"),
        "report": str(out / "report.html"),
    }
