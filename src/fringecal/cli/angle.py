"""`fringecal angle`: the projection angle from fringe breaks at strips, beside theory from the stated positions."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.saving import demand_folder, progress
from fringecal.report import write_report
from fringecal.uncertainty import EXPANDED_BY, uncertainty_text, value_text
from fringecal.workflows.shared import command_line

if TYPE_CHECKING:
    from fringecal.projector import AxisAngle
    from fringecal.uncertainty import Estimate
    from fringecal.workflows.commission import AngleFindings, Estimator

HELP = """Measure the projection angle by fringe breaks at strips, column by column and row by row.

SESSION holds a grid and strips. The ridge and skeleton estimators need one grey picture of each; the phase estimator
needs phase-shifted pictures of the bare plate and of the strips. Angles are from the plate's normal.

Example: fringecal angle bench/2026-11-22 --out angle

Example: fringecal angle bench/two-pictures --estimator ridge --json
"""


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="angle", help=HELP)(angle)


def angle(
    session: Path = typer.Argument(..., help="Folder that holds session.toml.", show_default=False),
    estimator: str = typer.Option("auto", "--estimator", help="phase, ridge, skeleton; auto: phase if there is one."),
    out: Path | None = typer.Option(None, "--out", help="Folder for tables (CSV), figures (PNG) and report.html."),
    as_json: bool = typer.Option(False, "--json", help="Print one JSON document (fringecal-angle/1)."),
) -> None:
    """Load, measure, save, print."""
    from fringecal.records import result_folder, write_table
    from fringecal.session import load_session
    from fringecal.workflows.angle import angle_report, break_angles

    if out is not None:
        demand_folder(out)
    with progress(quiet=as_json) as show:
        loaded = load_session(session)
        found = break_angles(loaded, estimator=_estimator(estimator, loaded), progress=show)
        if out is not None:
            show("writing the report")
            command = command_line("angle", [session, "--estimator", found.estimator, "--out", out])
            report = angle_report(found, command=" ".join(command), created=datetime.now(UTC))
            with result_folder(out, last="report.html") as staging:
                write_table(staging / "breaks.csv", found.breaks_frame())
                write_report(report, staging)
    if as_json:
        print_json(_document(found))
        return
    console.print(_table(found))
    for sentence in found.sentences:
        console.print(sentence, markup=False, highlight=False, soft_wrap=True)
    if out is not None:
        console.print(f"report: {out / 'report.html'}", markup=False, highlight=False, soft_wrap=True)


def _estimator(name: str, session: Any) -> "Estimator":
    """Check the name; "auto" is the phase where the session has one."""
    from fringecal.workflows.angle import ESTIMATORS

    if name == "auto":
        shifted = session.find("reference") and all(capture.phase_shifts_rad for capture in session.find("strips"))
        return "phase" if shifted else "ridge"
    if name not in ESTIMATORS:
        raise typer.BadParameter(f"{name!r} is none of auto, {', '.join(ESTIMATORS)}", param_hint="--estimator")
    return name  # type: ignore[return-value]


def _table(found: "AngleFindings") -> Table:
    title = f"Projection angle from the plate's normal, {found.estimator} estimator; {EXPANDED_BY}"
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    stated = found.theory is not None  # else there is no theory to compare with
    headings = (
        "at/mm",
        "breaks",
        "shift/px",
        "angle/deg",
        "U/deg",
        "apparent/deg",
        *("theory/deg", "En")[: 2 * stated],
    )
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_row(
        "origin", "", "", *_angles(found.angle, found.apparent.value, found.theory, None)[: 5 if stated else 3]
    )
    for row in (*found.columns, *found.rows):
        table.add_row(
            f"{'x' if row.axis == 'u' else 'y'} = {row.place_mm:z.1f}",
            str(row.breaks),
            f"{row.shift_px:z.2f}",
            *_angles(row.angle, row.apparent_deg, row.theory, row.en)[: 5 if stated else 3],
        )
    return table


def _angles(angle: "Estimate", apparent: float, theory: "Estimate | None", en: float | None) -> tuple[str, ...]:
    stated = "" if theory is None else f"{theory.value:z.3f}"
    return (
        value_text(angle.value, angle.u),
        uncertainty_text(angle.expanded().U),
        f"{apparent:z.3f}",
        stated,
        "" if en is None else f"{en:z.2f}",
    )


def _document(found: "AngleFindings") -> dict[str, Any]:
    """Return everything found under names with units; infinite degrees of freedom are null."""
    moved = found.displacement
    return {
        "format": "fringecal-angle/1",
        "convention": "angles in degrees from the plate's normal, in the plane across the local fringe",
        "estimator": found.estimator,
        "angle": _estimate(found.angle),
        "apparent": _estimate(found.apparent),
        "theory": None if found.theory is None else _estimate(found.theory),
        "columns": [_row(row) for row in found.columns],
        "rows": [_row(row) for row in found.rows],
        "projector": None
        if moved is None
        else {
            "found_mm": moved.found_mm.tolist(),
            "difference_mm": moved.difference_mm.tolist(),
            "u_difference_mm": moved.u_mm.tolist(),
            "probability": moved.probability,
            "agrees": moved.agrees,
        },
        "breaks": {name: column.tolist() for name, column in found.breaks.columns().items()},
        "sentences": list(found.sentences),
    }


def _estimate(estimate: "Estimate") -> dict[str, Any]:
    dof = estimate.dof if estimate.dof < float("inf") else None
    return {"value": estimate.value, "u": estimate.u, "dof": dof, "unit": estimate.unit}


def _row(row: "AxisAngle") -> dict[str, Any]:
    place = ("u_px", "x_mm") if row.axis == "u" else ("v_px", "y_mm")
    return {
        place[0]: row.place_px,
        place[1]: row.place_mm,
        "breaks": row.breaks,
        "shift_px": row.shift_px,
        "shift_mm": row.shift_mm,
        "angle_deg": row.angle.value,
        "u_deg": row.angle.u,
        "dof": _estimate(row.angle)["dof"],
        "apparent_deg": row.apparent_deg,
        "theory_deg": None if row.theory is None else row.theory.value,
        "u_theory_deg": None if row.theory is None else row.theory.u,
        "theory_apparent_deg": None if row.theory_apparent is None else row.theory_apparent.value,
        "difference_deg": row.difference_deg,
        "en": row.en,
    }
