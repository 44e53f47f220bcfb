"""`fringecal demo`: the thesis's rig, virtual, from nothing to a report; then real captures."""

import json
import sys
import time
import webbrowser
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import typer
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.saving import demand_folder, progress
from fringecal.cli.shared.second_process import second_process
from fringecal.report import write_report
from fringecal.uncertainty import uncertainty_text, value_text
from fringecal.workflows.shared import command_line

if TYPE_CHECKING:
    from fringecal.workflows.commission import Commissioning
    from fringecal.workflows.reconstruct import Measurement
    from fringecal.workflows.verify import Verification

HELP = """Simulate the thesis's rig, commission and verify it, reconstruct a leaf, and read real captures.

Writes the session, all results and report.html into DIR, and prints measured against true against thesis.

Example: fringecal demo --out demo
"""

_REAL = ("fpp_tools_lens", "kamino_object1")


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="demo", help=HELP)(demo)


def demo(
    out: Path = typer.Option(Path("demo"), "--out", help="Folder for session and results."),
    seed: int = typer.Option(2008, min=0, help="Seed of the virtual rig's noise."),
    browser: bool = typer.Option(True, "--open/--no-open", help="Open the report, when run at a terminal."),
    as_json: bool = typer.Option(False, "--json", help="Print the result as one JSON document."),
) -> None:
    """Simulate, measure, save, print."""
    from fringecal.session import load_session, write_session
    from fringecal.simulate import load_rig, simulate_session, truth_of
    from fringecal.thesis import analytic_cases
    from fringecal.workflows.demo import (
        DemoTruth,
        compile_ahead,
        demonstrate,
        demonstration_report,
        read_real,
        result_table,
    )

    started = time.perf_counter()
    demand_folder(out)
    command = command_line("demo", ["--out", out])
    with progress(quiet=as_json) as show, second_process() as beside:
        beside(compile_ahead)
        rig = load_rig("thesis").at(stated={"artefact_seed": seed})
        simulated = simulate_session(rig, seed=seed, progress=lambda name: show(f"drawing {name}"))
        folder = write_session(
            out / "session", simulated.document, simulated.frames, extra_files=simulated.files, overwrite=True
        )
        true = truth_of(rig)
        truth = DemoTruth(true.scale_h, true.scale_v, true.angle_origin_deg, simulated.captures["leaf"].z)
        found = demonstrate(
            load_session(folder), truth, progress=show, done=lambda part: beside(_save, out, part, command)
        )
        real = [capture for name in _real_folders() for capture in read_real(load_session(name), progress=show)]
        table = result_table(found)
        show("writing the reports")
        analytic = tuple(analytic_cases())
        report = demonstration_report(
            found, table, real, analytic, command=" ".join(command), created=datetime.now(UTC)
        )
        write_report(report, out)
    if as_json:
        print_json({"result": json.loads(table.to_json(orient="records")), "report": str(out / "report.html")})
        return
    console.print(_table(table))
    for capture in real:
        console.print(
            f"real: {capture.name}: {capture.where} period {capture.period.period_px:.1f} px, "
            f"{100 * capture.phase.map.valid.mean():.0f} % valid",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )
    console.print(
        f"{time.perf_counter() - started:.0f} s; report: {out / 'report.html'}",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    if browser and sys.stdout.isatty():
        webbrowser.open((out / "report.html").absolute().as_uri())


def _real_folders() -> list[Path]:
    """Real captures of the source tree; an installed package has none, and the demonstration goes without."""
    data = Path(__file__).resolve().parents[3] / "tests" / "data"
    return [data / name for name in _REAL if (data / name / "session.toml").is_file()]


def _save(out: Path, part: "Commissioning | Verification | Measurement", command: tuple[str, ...]) -> None:
    """Write record and report of one part of the demonstration into its own folder."""
    from fringecal.workflows.commission import Commissioning
    from fringecal.workflows.reconstruct import Measurement

    if isinstance(part, Commissioning):
        _save_calibration(out / "calibration", part, command)
    elif isinstance(part, Measurement):
        _save_leaf(out / "leaf", part, command)
    else:
        _save_verification(out, part, command)


def _save_calibration(out: Path, found: "Commissioning", command: tuple[str, ...]) -> None:
    from fringecal.records import (
        CALIBRATION_FILE,
        CAMERAMODEL_FILE,
        result_folder,
        write_calibration,
        write_cameramodel,
    )
    from fringecal.workflows.commission import calibration_record, commission_report

    with result_folder(out, last=CALIBRATION_FILE) as staging:
        write_cameramodel(staging / CAMERAMODEL_FILE, found.calibrated.result.rig.camera)
        write_report(commission_report(found, command=" ".join(command), created=datetime.now(UTC)), staging)
        write_calibration(calibration_record(found, command=command), staging)


def _save_verification(out: Path, found: "Verification", command: tuple[str, ...]) -> None:
    from fringecal.records import (
        CALIBRATION_FILE,
        VERIFICATION_FILE,
        CalibrationUsed,
        result_folder,
        sha256_of,
        write_verification,
    )
    from fringecal.session import load_session
    from fringecal.workflows.verify import verification_record, verification_report

    used = CalibrationUsed(file=CALIBRATION_FILE, sha256=sha256_of(out / "calibration" / CALIBRATION_FILE))
    record = verification_record(found, load_session(out / "session"), used, command=command)
    with result_folder(out / "verification", last=VERIFICATION_FILE) as staging:
        write_report(verification_report(found, command=" ".join(command), created=datetime.now(UTC)), staging)
        write_verification(record, staging)


def _save_leaf(out: Path, found: "Measurement", command: tuple[str, ...]) -> None:
    from fringecal.records import result_folder, write_surfaces
    from fringecal.workflows.reconstruct import measurement_report

    with result_folder(out, last="report.html") as staging:
        write_surfaces(staging, found.surface, stride=2)
        write_report(measurement_report(found, command=" ".join(command), created=datetime.now(UTC)), staging)


def _table(frame: pd.DataFrame) -> Table:
    table = Table(title="Measured against true against the thesis of 2008 (u: standard uncertainty)")
    for heading in frame.columns:
        table.add_column(heading, justify="left" if heading in ("quantity", "unit") else "right")
    for row in frame.itertuples(index=False):
        measured, u, true, thesis = (None if np.isnan(value) else float(value) for value in row[1:5])
        numbers = ["" if value is None else value_text(value, u) for value in (measured, true)]
        others = "" if u is None else uncertainty_text(u), "" if thesis is None else f"{thesis:g}"
        table.add_row(row[0], numbers[0], others[0], numbers[1], others[1], row[5])
    return table
