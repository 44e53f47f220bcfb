"""`fringecal lens`: focal length, principal point and distortion from pictures of a board."""

import hashlib
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, cast

import typer
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.pictures import channel_sentence, demand_channel, picture_bytes, read_channels
from fringecal.cli.shared.saving import demand_folder, progress
from fringecal.report import write_report
from fringecal.uncertainty import uncertainty_text, value_text
from fringecal.workflows.shared import command_line

if TYPE_CHECKING:
    from fringecal.calibration import LensFindings
    from fringecal.camera import Model, Solver
    from fringecal.records import LensDocument
    from fringecal.report import InputFile, Report

HELP = """Fit the full lens to several pictures of a board, with its uncertainty over the field.

SOURCE is a session folder with a capture of kind board, or the pictures with --target (a shipped name or a file).
Writes lens.json, lens.cameramodel, lens.yml, tables, figures and report.html into DIR.

SOURCE may also be a calibration that another program made, of a camera or of a camera and a projector (one file, or the
camera's and the projector's), or a list of places on a board in both (CSV, npz): it is judged, exit code 3 where it is
not to be trusted, and DIR gets pair.json and the calibration in every format (docs/camera.md).

Example: fringecal lens bench/2026-11-22/board-*.png --target chessboard-9x6-25mm --out lens
"""
SOLVERS = ("auto", "mrcal", "opencv")
MODELS = ("brown", "opencv8", "splined")


@dataclass(frozen=True)
class _Wanted:
    """How the lens is to be solved."""

    solver: "Solver"
    model: "Model"
    flat_board: bool


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="lens", help=HELP)(lens)


def lens(
    source: list[Path] = typer.Argument(..., help="Session folder, or pictures.", show_default=False),
    target: str | None = typer.Option(None, "--target", help="Board: a shipped name or a TOML file."),
    solver: str = typer.Option("auto", "--solver", help="auto, mrcal or opencv."),
    model: str = typer.Option("brown", "--model", help="brown; opencv8 or splined (mrcal)."),
    flat_board: bool = typer.Option(False, "--flat-board", help="Take the board as flat."),
    distance_mm: float | None = typer.Option(None, help="Distance for the map of uncertainty; else the boards'."),
    channel: str | None = typer.Option(
        None, "--channel", help="Colour pictures: mean, red, green, blue or luma; else the one that shows most."
    ),
    camera_size: str | None = typer.Option(None, "--camera-size", help="Picture of a stated camera: WIDTHxHEIGHT, px."),
    projector_size: str | None = typer.Option(
        None, "--projector-size", help="Frame of a stated projector: WIDTHxHEIGHT, px."
    ),
    unit: str | None = typer.Option(None, "--unit", help="Unit of a stated pose: mm, m or in; mm, of ROS m."),
    pixel_aspect: float | None = typer.Option(
        None, "--pixel-aspect", help="Projector: distance of rows over that of columns; else 1, 0.5 or 2 pass."
    ),
    pairs: Path | None = typer.Option(None, "--pairs", help="Places that belong together, to judge the pair by."),
    out: Path | None = typer.Option(None, "--out", help="Folder for the results."),
    as_json: bool = typer.Option(
        False, "--json", help="Print one JSON document (fringecal-lens/1; of a stated calibration fringecal-pair/1)."
    ),
) -> None:
    """Load, fit or judge, save, print."""
    from fringecal.calibration import KnownLens
    from fringecal.cli.shared.stated_files import StatedOptions, are_stated, judge_stated
    from fringecal.records import LensDocument, software_versions, written_document
    from fringecal.workflows.lens import lens_record, lens_report

    _demand(solver, model, distance_mm, out)
    options = StatedOptions(camera_size, projector_size, unit, pixel_aspect, pairs)
    if are_stated(source):
        judge_stated(source, options, out, as_json=as_json)
        return
    options.demand_none()
    demand_channel(channel)
    given = [*(["--target", target] if target else []), *(["--channel", channel] if channel else [])]
    command = command_line("lens", [*source, *given])
    with progress(quiet=as_json) as show:
        show("finding the board and fitting the lens")
        wanted = _Wanted(cast("Solver", solver), cast("Model", model), flat_board)
        found, inputs, taken = _found(source, target, channel, wanted)
        record = lens_record(KnownLens(found.fit.lens, findings=found), distance_mm=distance_mm)
        hashes = {entry.file: entry.sha256 for entry in inputs}
        document = LensDocument(software=software_versions(), command=command, inputs=hashes, lens=record)
        if out is not None:
            show("writing the report")
            report = lens_report(
                found,
                distance_mm=distance_mm,
                inputs=inputs,
                command=" ".join(command),
                created=datetime.now(UTC),
            )
            _save(document, report, found, out)
    if as_json:
        print_json(written_document(document))
        return
    if taken is not None:
        console.print(channel_sentence(taken, channel), markup=False, highlight=False, soft_wrap=True)
    console.print(_table(found))
    for sentence in record.notes:
        console.print(sentence, markup=False, highlight=False, soft_wrap=True)
    if out is not None:
        console.print(f"report: {out / 'report.html'}", markup=False, highlight=False, soft_wrap=True)


def _demand(solver: str, model: str, distance_mm: float | None, out: Path | None) -> None:
    """Refuse options that cannot be meant, before the work is done."""
    if solver not in SOLVERS:
        raise typer.BadParameter(f"{solver!r} is none of {', '.join(SOLVERS)}", param_hint="--solver")
    if model not in MODELS:
        raise typer.BadParameter(f"{model!r} is none of {', '.join(MODELS)}", param_hint="--model")
    if distance_mm is not None and not distance_mm > 0:
        raise typer.BadParameter(f"{distance_mm} mm is not in front of the camera", param_hint="--distance-mm")
    if out is not None:
        demand_folder(out)


def _found(
    source: list[Path], target: str | None, channel: str | None, wanted: _Wanted
) -> tuple["LensFindings", tuple["InputFile", ...], str | None]:
    """Fit the lens to a session's boards or to pictures; with the files used, and the channel of colour pictures."""
    from fringecal.calibration import lens_from_pictures
    from fringecal.session import load_session
    from fringecal.targets import load_target
    from fringecal.workflows.lens import measure_lens
    from fringecal.workflows.shared import inputs_of_capture

    if len(source) == 1 and source[0].is_dir():
        if target is not None:
            raise typer.BadParameter("a session names its own targets; leave it out", param_hint="--target")
        if channel is not None:
            raise typer.BadParameter("a session states its own channel; leave it out", param_hint="--channel")
        session = load_session(source[0])
        found = measure_lens(session, **asdict(wanted))
        return found, tuple(one for capture in session.find("board") for one in inputs_of_capture(capture)), None
    if target is None:
        raise typer.BadParameter("pictures need the board that they show", param_hint="--target")
    board = load_target(target)
    contents = [picture_bytes(path) for path in source]
    taken, read = read_channels(source, channel, contents)[0]
    pictures = [(path.name, picture) for path, picture in zip(source, read, strict=True)]
    found = lens_from_pictures(pictures, board, **asdict(wanted))
    return found, _hashed(source, contents), taken


def _hashed(source: list[Path], contents: list[bytes]) -> tuple["InputFile", ...]:
    """Name the pictures by the bytes that were used."""
    from fringecal.report import InputFile

    files = zip(source, contents, strict=True)
    return tuple(InputFile("board", path.name, hashlib.sha256(content).hexdigest()) for path, content in files)


def _save(document: "LensDocument", report: "Report", found: "LensFindings", out: Path) -> None:
    """Write record, lens files and report, all together or not at all."""
    from fringecal.records import LENS_FILE, result_folder, rich_lens_text, write_document, write_lens, write_text

    with result_folder(out, last=LENS_FILE) as staging:
        for name in ("lens.cameramodel", "lens.yml"):
            write_lens(staging / name, found.fit.lens)
        if found.fit.rich is not None:
            write_text(staging / "lens-rich.cameramodel", rich_lens_text(found.fit.rich))
        write_report(report, staging)
        write_document(document, staging / LENS_FILE)


def _table(found: "LensFindings") -> Table:
    from fringecal.camera import LENS_NAMES

    table = Table(title="Lens; u is a standard uncertainty")
    for heading in ("parameter", "value", "u", "unit"):
        table.add_column(heading, justify="left" if heading in ("parameter", "unit") else "right")
    for name in LENS_NAMES:
        one = found.fit.lens.estimate(name)
        table.add_row(name.removesuffix("_px"), value_text(one.value, one.u), uncertainty_text(one.u), one.unit)
    return table
