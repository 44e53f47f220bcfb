"""`fringecal grid`: the lines of a grid picture, the scale they give, and the lens distortion."""

import sys
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import typer
from rich.table import Table

from fringecal.camera import (
    Centre,
    DistortionTest,
    ThesisScale,
    examine_distortion,
    family_rms_px,
    line_spacing_px,
    ruled_pitch,
    thesis_scale,
)
from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.pictures import channel_sentence, demand_channel, read_channels
from fringecal.cli.shared.saving import demand_folder
from fringecal.detect import FAMILIES, GridDetection, Polarity, find_dot_grid, find_grid, ruling_of
from fringecal.errors import DetectionError, TargetError
from fringecal.records import result_folder, software_versions, write_table
from fringecal.report import REPORT_FILE, Report, Verdict, write_report
from fringecal.targets import Dots, LineGrid, load_target
from fringecal.uncertainty import uncertainty_text, value_text
from fringecal.workflows.grid import (
    GridPicture,
    distortion_section,
    distortion_sentences,
    grid_sentence,
    lines_section,
    scale_section,
)
from fringecal.workflows.shared import command_line

# Channels of a colour picture whose grids are compared: noise and print may stand out more than lines in one.
_COMPARED = 3
HELP = """Find the lines of a grid picture; print the scale they give and the verdict on lens distortion.

IMAGE is one picture of a ruled grid. With --target (a shipped name or a file) distances come in mm.

Example: fringecal grid bench/2026-11-22/grid.png --target grid-10mm --out grid-check
"""


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="grid", help=HELP)(grid)


def grid(
    image: Path = typer.Argument(..., help="Picture of the grid.", show_default=False),
    target: str | None = typer.Option(None, "--target", help="Line grid or dots: a shipped name or a TOML file."),
    pattern: str = typer.Option("lines", "--pattern", help="What to look for without a target: lines or dots."),
    polarity: str = typer.Option("auto", "--polarity", help="auto, dark or light lines or dots."),
    centre: str = typer.Option("auto", "--centre", help="Centre of distortion: auto, image or free."),
    channel: str | None = typer.Option(
        None, "--channel", help="Colour picture: mean, red, green, blue or luma; else the one that shows most."
    ),
    out: Path | None = typer.Option(None, "--out", help="Folder for tables (CSV) and figures (PNG)."),
    as_json: bool = typer.Option(False, "--json", help="Print one JSON document (fringecal-grid/1)."),
) -> None:
    """Load, detect, save, print."""
    demand_channel(channel)
    paper = None if target is None else _target(target)
    dots = isinstance(paper, Dots) or (paper is None and _pattern(pattern) == "dots")
    detect = partial(find_dot_grid if dots else find_grid, polarity=_polarity(polarity))
    taken, picture, detection = _detected(image, channel, detect)
    test = examine_distortion(detection, centre=_centre(centre))
    ruling = None if dots else ruling_of(picture, detection)
    pitch = None if paper is None else paper.pitch_mm.estimate("pitch", "mm")
    if ruling is not None and pitch is not None and isinstance(paper, LineGrid):
        pitch = ruled_pitch(ruling, pitch, paper.heavy_every)
    scale = None if pitch is None else thesis_scale(detection, pitch).beside(test.scale_at_centre(pitch))
    found = GridPicture(image.name, picture, detection, test, scale, pitch)
    files = _save(found, out, command_line("grid", sys.argv[2:])) if out else []
    document = _document(image, found) | {"channel": taken, "files": files}
    if ruling is not None:
        document["ruling"] = {"parts": ruling.parts, "heavier_every": list(ruling.rhythms)}
    if as_json:
        print_json(document)
    else:
        if taken is not None:
            _say(channel_sentence(taken, channel))
        if ruling is not None and (ruling.parts > 1 or ruling.rhythms):
            _say(ruling.sentence())
        _show(document, found)


def _detected(
    image: Path, channel: str | None, detect: Callable[[np.ndarray], GridDetection]
) -> tuple[str | None, np.ndarray, GridDetection]:
    """Detect by the three channels that show most, and take the one with more crossings; if none has any, say why."""
    found: list[tuple[str | None, np.ndarray, GridDetection]] = []
    refused: list[DetectionError] = []
    for taken, (picture,) in read_channels([image], channel):
        try:
            found.append((taken, picture, detect(picture)))
        except DetectionError as error:
            refused.append(error)
        if len(found) == _COMPARED:
            break
    if not found:
        raise refused[0]
    return max(found, key=lambda each: len(each[2].row))


def _polarity(text: str) -> Polarity:
    if text in ("auto", "dark", "light"):
        return text  # type: ignore[return-value]
    raise typer.BadParameter(f"{text!r} is none of auto, dark, light", param_hint="--polarity")


def _centre(text: str) -> Centre:
    if text in ("auto", "image", "free"):
        return text  # type: ignore[return-value]
    raise typer.BadParameter(f"{text!r} is none of auto, image, free", param_hint="--centre")


def _pattern(text: str) -> str:
    if text in ("lines", "dots"):
        return text
    raise typer.BadParameter(f"{text!r} is neither lines nor dots", param_hint="--pattern")


def _target(name: str) -> LineGrid | Dots:
    """Load the target, which must be a square pattern of lines or dots."""
    target = load_target(name)
    if isinstance(target, LineGrid) or (isinstance(target, Dots) and not target.asymmetric):
        return target
    raise TargetError(f"{name}: a {target.kind} is no square grid; name a target of kind line-grid, or symmetric dots")


def _tables(scale: ThesisScale | None, test: DistortionTest) -> dict[str, pd.DataFrame]:
    """Name every table as its file."""
    tables = {"straightness-before": test.straightness_before, "straightness-after": test.straightness_after}
    if scale is not None:
        tables |= {
            "distances-vertical-lines": scale.vertical_lines,
            "distances-horizontal-lines": scale.horizontal_lines,
            "errors-horizontal": scale.horizontal_errors,
            "errors-vertical": scale.vertical_errors,
        }
    return tables


def _save(grid: GridPicture, folder: Path, command: tuple[str, ...]) -> list[str]:
    """Write every table whole, and the report with its figures."""
    demand_folder(folder)
    with result_folder(folder, last=REPORT_FILE) as staging:
        write_report(_report(grid, command), staging)
        for name, table in _tables(grid.scale, grid.test).items():
            write_table(staging / f"{name}.csv", table)
        names = sorted(str(path.relative_to(staging)) for path in staging.rglob("*") if path.is_file())
    return [str(folder / name) for name in names]


def _report(grid: GridPicture, command: tuple[str, ...]) -> Report:
    """Print the results of the picture."""
    return Report(
        title=f"Grid in {grid.name}",
        verdict=Verdict("info", grid_sentence(grid)),
        sections=(lines_section(grid), scale_section(grid), distortion_section(grid)),
        versions=software_versions(),
        command=" ".join(command),
        created=datetime.now(UTC),
    )


def _document(image: Path, found: GridPicture) -> dict[str, Any]:
    """Put everything into plain numbers."""
    detection, scale, test = found.detection, found.scale, found.test
    document: dict[str, Any] = {
        "format": "fringecal-grid/1",
        "image": str(image),
        "polarity": detection.polarity,
        "lines": {family: len(detection.family(family)) for family in FAMILIES},
        "crossings": len(detection.row),
        "u_crossing_px": float(np.median(detection.sigma_px)),
        "line_width_px": detection.profile.width_px,
        "blur_px": detection.profile.blur_px,
        "distortion": {
            "verdict": test.verdict,
            "max_px": {"value": test.max_px.value, "u": test.max_px.u},
            "detection_limit_px": test.detection_limit_px,
            "p_value": test.p_value,
            "sheet_irregular_px": test.irregular_px,
            "centre_px": list(test.lens.centre_px),
            "u_centre_px": None if test.centre is None else [one.u for one in test.centre],
            "coefficients": {name: {"value": e.value, "u": e.u} for name, e in test.coefficients.items()},
            "half_diagonal_px": test.lens.half_diagonal_px,
        },
        "spacing_px": {
            when: {family: {"value": e.value, "u": e.u} for family, e in line_spacing_px(detection, lens).items()}
            for when, lens in (("before", None), ("after", test.lens))
        },
        "straightness_rms_px": {
            when: {family: family_rms_px(table, family) for family in FAMILIES}
            for when, table in (("before", test.straightness_before), ("after", test.straightness_after))
        },
    }
    if scale is not None and found.pitch_mm is not None:
        document["scale"] = {
            name: {"value": e.value, "u": e.u, "dof": e.dof if np.isfinite(e.dof) else None, "unit": e.unit}
            for name, e in (
                ("horizontal", scale.horizontal),
                ("vertical", scale.vertical),
                ("mean", scale.mean),
                ("at_centre", test.scale_at_centre(found.pitch_mm)),
            )
        }
        document["largest_error_percent"] = scale.largest_error_percent
    return document


def _show(document: dict[str, Any], found: GridPicture) -> None:
    """Print tables for people."""
    scale = found.scale
    lines = document["lines"]
    _say(
        f"{lines['horizontal']} horizontal and {lines['vertical']} vertical lines, {document['polarity']}, "
        f"{document['line_width_px']:.1f} px wide; {document['crossings']} crossings, "
        f"u = {document['u_crossing_px']:#.2g} px each"
    )
    if scale is not None:
        console.print(_scale_table(document))
        _say(f"largest error of a distance by the mean scale: {scale.largest_error_percent:+z.2f} %")
    else:
        _say("no scale: name the grid with --target")
    for sentence in distortion_sentences(found.test, found.mm_per_px):
        _say(sentence)
    rms = document["straightness_rms_px"]
    for family in FAMILIES:
        before, after = rms["before"][family], rms["after"][family]
        _say(f"straightness of the {family} lines: rms {before:.3f} px, {after:.3f} px with the lens taken out")
    if document["files"]:
        page, *_ = (file for file in document["files"] if file.endswith(REPORT_FILE))
        _say(f"report: {page}; {len(document['files']) - 1} tables and figures beside it")


def _scale_table(document: dict[str, Any]) -> Table:
    table = Table(title="Scale from distances between lines; u is a standard uncertainty")
    for heading in ("direction", "scale / mm/px", "u", "relative"):
        table.add_column(heading, justify="left" if heading == "direction" else "right")
    for name, one in document["scale"].items():
        table.add_row(
            name.replace("_", " "),
            value_text(one["value"], one["u"]),
            uncertainty_text(one["u"]),
            f"{100 * one['u'] / one['value']:.3f} %",
        )
    return table


def _say(sentence: str) -> None:
    console.print(sentence, markup=False, highlight=False, soft_wrap=True)
