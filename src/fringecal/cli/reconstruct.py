"""`fringecal reconstruct`: the surface of an object, in millimetres, with its uncertainty."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import typer

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.exit_codes import EXIT_OUT_OF_TOLERANCE, EXIT_PASS
from fringecal.cli.shared.saving import LIMITS_HELP, demand_folder, print_outcome, progress
from fringecal.report import write_report
from fringecal.workflows.shared import command_line, given

HELP = """Reconstruct an object: x, y, z and u(z) at every pixel, as maps, meshes and x3p.

Writes height.npz, height.tif, height.ply, height.stl, height.obj, height.x3p, profiles.csv and report.html into DIR;
with --also point clouds in which each point has its u(z), and Gwyddion's height.gwy.

Example: fringecal reconstruct bench/2026-11-22 --capture leaf --calibration calibration/calibration.json --out leaf
"""

_MESH_PIXELS = 1_000_000  # meshes of larger pictures are thinned: programs that open them choke


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="reconstruct", help=HELP)(reconstruct)


def reconstruct(
    session: Path = typer.Argument(..., help="Folder that holds session.toml.", show_default=False),
    calibration: Path = typer.Option(..., "--calibration", help="calibration.json of the rig."),
    out: Path = typer.Option(..., "--out", help="Folder for the results."),
    capture: str = typer.Option("", "--capture", help="Capture of the object; the only one of kind object by default."),
    model: str = typer.Option("projective", "--model", help="constant-angle, column-angle or projective."),
    lowest: float | None = typer.Option(None, "--lowest-mm", help="Lowest height the object can have."),
    highest: float | None = typer.Option(None, "--highest-mm", help="Greatest height the object can have."),
    before: str = typer.Option("none", "--before", help="Filter of the frames: none, median, mean or median+mean."),
    after: str = typer.Option("none", "--after", help="Filter of the heights: none, median, mean or median+mean."),
    minus_plate: bool = typer.Option(False, "--minus-plate", help="Subtract the heights of the bare plate's capture."),
    tie: bool = typer.Option(False, "--tie-to-plate", help="Take the plane of the plate in view off the heights."),
    faces: int | None = typer.Option(None, "--faces", min=4, help="Thin the meshes to about so many faces."),
    watertight: bool = typer.Option(False, "--watertight", help="Close the meshes down to a base 1 mm below."),
    limits: Path | None = typer.Option(None, "--limits", help=LIMITS_HELP, show_default=False),
    also: list[str] = typer.Option(
        [], "--also", help="Further format: ply, ply-text, las or e57 (point clouds), gwy; again for more."
    ),
    profile: list[int] = typer.Option([], "--profile", help="Picture row written to profiles.csv, again for more."),
    as_json: bool = typer.Option(False, "--json", help="Print a summary as one JSON document."),
) -> None:
    """Load, reconstruct, save, print."""
    from fringecal.projector import HEIGHT_MODELS
    from fringecal.records import (
        demand_further,
        is_board_calibration,
        limits_for,
        read_calibration,
        result_folder,
        write_further,
        write_profiles,
        write_surfaces,
    )
    from fringecal.session import load_session
    from fringecal.verification import FILTERS
    from fringecal.workflows.reconstruct import causes_in_words, measurement_checks, measurement_report, section_rows
    from fringecal.workflows.reconstruct import reconstruct as run
    from fringecal.workflows.shared import Treatment, calibration_of, demand_same_rig

    for name in (before, after):
        if name not in FILTERS:
            raise typer.BadParameter(f"a filter is one of {', '.join(FILTERS)}, found {name!r}")
    if model not in HEIGHT_MODELS:
        raise typer.BadParameter(f"model is one of {', '.join(HEIGHT_MODELS)}, found {model!r}")
    _demand_further(also)
    demand_further(also)
    demand_folder(out)
    if is_board_calibration(calibration):
        of_strips: dict[str, object] = {"--model": model if model != "projective" else ""}
        of_strips |= {"--lowest-mm": lowest, "--highest-mm": highest}
        of_strips |= {"--before": before if before != "none" else "", "--after": after if after != "none" else ""}
        of_strips |= {"--faces": faces, "--profile": profile, "--minus-plate": minus_plate, "--tie-to-plate": tie}
        _demand_none(of_strips | {"--watertight": watertight, "--limits": limits})
        _by_board(session, capture, calibration, out, also, as_json=as_json)
        return
    heights = {"--lowest-mm": lowest, "--highest-mm": highest}
    filters = {name: chosen for name, chosen in (("--before", before), ("--after", after)) if chosen != "none"}
    stated = given({"--capture": capture, "--model": model, **heights, **filters, "--limits": limits})
    flags = {"--minus-plate": minus_plate, "--tie-to-plate": tie}
    plate = [name for name, chosen in flags.items() if chosen]
    command = command_line("reconstruct", [session, "--calibration", calibration, "--out", out, *stated, *plate])
    with progress(quiet=as_json) as show:
        allowed = limits_for(session, limits)
        in_force = read_calibration(calibration)
        rig, loaded = calibration_of(in_force), load_session(session)
        demand_same_rig(loaded, in_force.session.rig)
        found = run(
            loaded,
            capture or None,
            rig,
            model=model,
            height_range_mm=_range(lowest, highest),
            treatment=Treatment(before, after, minus_plate),
            tie_to_plate=tie,
            progress=show,
        )
        _demand_rows(profile, found.surface.z.shape[0])
        show("writing surfaces and report")
        report = measurement_report(found, command=" ".join(command), created=datetime.now(UTC), limits=allowed)
        with result_folder(out, last="report.html") as staging:
            pixels = found.surface.z.size
            stride = max(1, round((pixels / _MESH_PIXELS) ** 0.5))
            write_surfaces(staging, found.surface, stride=stride, faces=faces, watertight=watertight)
            write_further(staging, found.surface, also)
            write_profiles(staging / "profiles.csv", found.surface, profile or section_rows(found.surface.mask))
            write_report(report, staging)
    summary = {
        "capture": found.capture.name,
        "model": model,
        "shares": found.shares(),
        "z_min_mm": float(np.nanmin(found.surface.z)),
        "z_max_mm": float(np.nanmax(found.surface.z)),
        "u_z_median_mm": float(np.nanmedian(found.surface.u_z)),
        "height": str(out / "height.npz"),
        "report": str(out / "report.html"),
    }
    if found.tied is not None:
        summary |= {"tied_mm": found.tied.offset_mm, "u_tied_mm": found.tied.u_mm, "tied_slopes": found.tied.slopes}
    checks = measurement_checks(found, allowed)
    causes = causes_in_words(found, allowed)
    if as_json:
        print_json(summary | {"checks": [check.model_dump(mode="json") for check in checks], "causes": causes})
        raise typer.Exit(EXIT_OUT_OF_TOLERANCE if any(check.decision == "fail" for check in checks) else EXIT_PASS)
    console.print(
        f"{summary['capture']}: z from {summary['z_min_mm']:.3f} to {summary['z_max_mm']:.3f} mm, median u(z) "
        f"{summary['u_z_median_mm']:.4f} mm, {100 * found.shares()['valid']:.1f} % of the picture valid",
        highlight=False,
    )
    print_outcome(checks, (*causes, f"surface: {summary['height']}"), out)


def _demand_none(options: dict[str, object]) -> None:
    """Refuse options that a rig calibrated by a board does not have."""
    for option, value in options.items():
        if value not in (None, "", False, []):
            raise typer.BadParameter("not for a rig that a board has calibrated", param_hint=option)


def _by_board(session: Path, capture: str, calibration: Path, out: Path, also: list[str], *, as_json: bool) -> None:
    """Measure by a rig that a board has calibrated, and print what was found."""
    from fringecal.cli.shared.by_board import reconstruct_by_board
    from fringecal.session import load_session

    stated = given({"--capture": capture, "--calibration": calibration})
    command = command_line("reconstruct", [session, "--out", out, *stated])
    with progress(quiet=as_json) as show:
        summary = reconstruct_by_board(
            load_session(session),
            capture or None,
            calibration,
            out,
            also=also,
            command=" ".join(command),
            progress=show,
        )
    if as_json:
        print_json(summary)
        return
    console.print(
        f"{summary['capture']}: z from {summary['z_min_mm']:.3f} to {summary['z_max_mm']:.3f} mm in the "
        f"{summary['frame']}'s frame, median u(z) {summary['u_z_median_mm']:.4f} mm, "
        f"{100 * summary['shares']['valid']:.1f} % of the picture valid",
        highlight=False,
        soft_wrap=True,
    )
    console.print(f"points: {summary['points']}; report: {summary['report']}", highlight=False, soft_wrap=True)


def _demand_further(forms: list[str]) -> None:
    """Refuse a format that is none as what it is: a slip in the command."""
    from fringecal.records import FURTHER

    for form in forms:
        if form not in FURTHER:
            raise typer.BadParameter(f"one of {', '.join(FURTHER)} was needed, found {form!r}", param_hint="--also")


def _demand_rows(rows: list[int], height: int) -> None:
    """Raise unless every row lies in the picture."""
    outside = [row for row in rows if not 0 <= row < height]
    if outside:
        raise typer.BadParameter(f"--profile {outside[0]} lies outside the picture, whose rows are 0 to {height - 1}")


def _range(lowest: float | None, highest: float | None) -> tuple[float, float] | None:
    if lowest is None and highest is None:
        return None
    if lowest is not None and highest is not None and lowest >= highest:
        raise typer.BadParameter(f"--lowest-mm {lowest:g} is not below --highest-mm {highest:g}")
    return (-np.inf if lowest is None else lowest, np.inf if highest is None else highest)
