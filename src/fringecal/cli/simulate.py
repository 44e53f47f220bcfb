"""`fringecal simulate`: take a session with a virtual rig, and keep the truth beside it."""

from datetime import datetime
from pathlib import Path
from typing import overload

import typer
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.history import parsed_time
from fringecal.session import write_session
from fringecal.simulate import (
    RasterRigSpec,
    RigSpec,
    SimulatedRasterSession,
    SimulatedSession,
    Truth,
    is_raster_rig,
    load_raster_rig,
    load_rig,
    raster_truth,
    simulate_raster_session,
    simulate_session,
    truth_of,
)

HELP = """Simulate a session: pictures, session.toml, and the truth in DIR/truth, which no other verb reads.

RIG is a shipped rig (thesis, thesis-7, oblique, telecentric, harder; dlp and dlp-small, which have a raster projector
and a board in poses) or the path of a rig's TOML.

Example: fringecal simulate thesis --out virtual --captures grid,reference,strips --seed 1
"""


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="simulate", help=HELP)(simulate)


def simulate(
    rig: str = typer.Argument(..., help="Name of a shipped rig, or path of a .toml file.", show_default=False),
    out: Path = typer.Option(..., "--out", help="Folder for the session; must be new, empty or a session."),
    captures: str = typer.Option("", help="Comma-separated captures to take; all of the rig's by default."),
    seed: int = typer.Option(0, min=0, help="Seed of noise and of what was measured by hand."),
    captured: str = typer.Option("", "--captured", help="Date or time that the session states; the rig's by default."),
    overwrite: bool = typer.Option(False, "--overwrite", help="Replace a session that is already there."),
    as_json: bool = typer.Option(False, "--json", help="Print one JSON document."),
) -> None:
    """Load, simulate, write, print."""
    when = _at(captured)
    if is_raster_rig(rig):
        raster = load_raster_rig(rig)
        _simulate_raster(raster.model_copy(update=when), (out, captures, seed), overwrite=overwrite, as_json=as_json)
        return
    spec = load_rig(rig).model_copy(update=when)
    names = [name.strip() for name in captures.split(",") if name.strip()] or [c.name for c in spec.capture]
    session = _taken(spec, names, seed, quiet=as_json)
    folder = write_session(out, session.document, session.frames, extra_files=session.files, overwrite=overwrite)
    truth = truth_of(spec)
    if as_json:
        print_json(_report(spec, folder, session, truth, seed))
    else:
        console.print(_table(spec, session))
        console.print(
            f"truth: scale {truth.scale_h:.5f} x {truth.scale_v:.5f} mm/px, "
            f"projection angle {truth.angle_origin_deg:.3f} deg at the origin",
            soft_wrap=True,
        )
        console.print(f"session: {folder}", markup=False, highlight=False, soft_wrap=True)


def _at(captured: str) -> dict[str, datetime]:
    """Return what a stated time changes in a rig: nothing where none is stated."""
    if not captured:
        return {}
    try:
        return {"captured": parsed_time(captured)}
    except ValueError as error:
        raise typer.BadParameter(f"{captured!r}; {error}", param_hint="--captured") from None


def _simulate_raster(spec: RasterRigSpec, wanted: tuple[Path, str, int], *, overwrite: bool, as_json: bool) -> None:
    """Simulate a rig with a raster projector, write the session, and say what its truth is."""
    out, captures, seed = wanted
    names = [name.strip() for name in captures.split(",") if name.strip()] or [c.name for c in spec.capture]
    session = _taken(spec, names, seed, quiet=as_json)
    folder = write_session(out, session.document, session.frames, extra_files=session.files, overwrite=overwrite)
    truth = raster_truth(spec)
    if as_json:
        report = {"session": str(folder), "rig": spec.name, "seed": seed, "captures": list(session.captures)}
        print_json(report | {"images": list(session.frames), "truth": truth | {"folder": str(folder / "truth")}})
        return
    baseline = ", ".join(f"{value:.2f}" for value in truth["projector_position_mm"])
    focal = f"{truth['camera'][0]:.1f} px (camera), {truth['projector'][0]:.1f} px (projector)"
    console.print(
        f"{len(session.captures)} captures, {len(session.frames)} images; truth: focal lengths {focal}; the projector "
        f"stands at {baseline} mm of the camera's frame",
        soft_wrap=True,
    )
    console.print(f"session: {folder}", markup=False, highlight=False, soft_wrap=True)


@overload
def _taken(spec: RigSpec, names: list[str], seed: int, *, quiet: bool) -> SimulatedSession: ...
@overload
def _taken(spec: RasterRigSpec, names: list[str], seed: int, *, quiet: bool) -> SimulatedRasterSession: ...
def _taken(
    spec: RigSpec | RasterRigSpec, names: list[str], seed: int, *, quiet: bool
) -> SimulatedSession | SimulatedRasterSession:
    """Take a rig's captures with a bar that shows how far it is."""
    columns = TextColumn("{task.description:<20}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, disable=quiet, transient=True) as progress:
        task = progress.add_task("simulate", total=len(names))

        def show(name: str) -> None:
            progress.update(task, description=escape(name), completed=names.index(name))

        if isinstance(spec, RasterRigSpec):
            return simulate_raster_session(spec, names, seed=seed, progress=show)
        return simulate_session(spec, names, seed=seed, progress=show)


def _report(spec: RigSpec, folder: Path, session: SimulatedSession, truth: Truth, seed: int) -> dict[str, object]:
    return {
        "session": str(folder),
        "rig": spec.name,
        "seed": seed,
        "captures": list(session.captures),
        "images": list(session.frames),
        "truth": {
            "scale_h_mm_per_px": truth.scale_h,
            "scale_v_mm_per_px": truth.scale_v,
            "angle_origin_deg": truth.angle_origin_deg,
            "distortion_at_corner_px": truth.distortion_at_corner_px,
            "folder": str(folder / "truth"),
        },
    }


def _table(spec: RigSpec, session: SimulatedSession) -> Table:
    table = Table(title=escape(f"virtual rig {spec.name}"))
    for heading in ("capture", "images", "highest mm", "lit %"):
        table.add_column(heading, justify="left" if heading == "capture" else "right")
    for name, frames in session.captures.items():
        lit = f"{100 * frames.lit.mean():.1f}" if len(frames.frames) > 1 else ""
        table.add_row(escape(name), str(len(frames.frames)), f"{frames.z.max():.3f}", lit)
    return table
