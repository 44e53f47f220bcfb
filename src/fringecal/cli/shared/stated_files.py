"""`fringecal lens` on a calibration that another program made: read, judged, written in every format, printed."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.exit_codes import EXIT_OUT_OF_TOLERANCE
from fringecal.cli.shared.saving import demand_folder
from fringecal.report import write_report
from fringecal.uncertainty import uncertainty_text, value_text
from fringecal.workflows.shared import command_line

if TYPE_CHECKING:
    from fringecal.camera import Lens
    from fringecal.workflows.lens import Judged

CALIBRATIONS = (".cameramodel", ".yml", ".yaml", ".xml", ".slcalib", ".mat")
POINTS = (".csv", ".npz")
UNITS_MM = {"mm": 1.0, "m": 1000.0, "in": 25.4}
_VERDICTS = {"pass": "TRUSTED", "conditionalPass": "OPEN", "fail": "REFUSED"}
_STYLES = {"pass": "bold green", "conditionalPass": "bold yellow", "fail": "bold red"}


@dataclass(frozen=True)
class StatedOptions:
    """Options of the verb that only a stated calibration has."""

    camera_size: str | None
    projector_size: str | None
    unit: str | None
    pixel_aspect: float | None
    pairs: Path | None

    def demand_none(self) -> None:
        """Refuse them where pictures are given."""
        for name, value in vars(self).items():
            if value is not None:
                raise typer.BadParameter(
                    "only a stated calibration has it, not pictures", param_hint=f"--{name.replace('_', '-')}"
                )

    @property
    def unit_mm(self) -> float | None:
        """Millimetres of the stated unit."""
        if self.unit is None:
            return None
        if self.unit not in UNITS_MM:
            raise typer.BadParameter(f"{self.unit!r} is none of {', '.join(UNITS_MM)}", param_hint="--unit")
        return UNITS_MM[self.unit]


def are_stated(source: Sequence[Path]) -> bool:
    """Whether the sources are calibrations or lists of places, by their names."""
    return all(path.suffix.lower() in (*CALIBRATIONS, *POINTS) for path in source)


def judge_stated(source: Sequence[Path], options: StatedOptions, out: Path | None, *, as_json: bool) -> None:
    """Judge the files, write and print what was found.

    Raises
    ------
    typer.Exit
        With code 3 where the calibration is not to be trusted.
    """
    from fringecal.records import written_document
    from fringecal.workflows.lens import judged_document, judged_report

    judged = _judged(source, options)
    command = command_line("lens", [*source, *_given(options)])
    document = judged_document(judged, command=command)
    if out is not None:
        demand_folder(out)
        report = judged_report(judged, command=" ".join(command), created=datetime.now(UTC))
        _save(judged, document, report, out)
    if as_json:
        print_json(written_document(document))
    else:
        _print(judged, out)
    if judged.verdict == "fail":
        raise typer.Exit(EXIT_OUT_OF_TOLERANCE)


def _judged(source: Sequence[Path], options: StatedOptions) -> "Judged":
    from fringecal.workflows.lens import judge_files, judge_points

    sizes = {
        "camera_size": _size(options.camera_size, "--camera-size"),
        "projector_size": _size(options.projector_size, "--projector-size"),
    }
    if source[0].suffix.lower() not in POINTS:
        return judge_files(
            source, **sizes, unit_mm=options.unit_mm, pixel_aspect=options.pixel_aspect, pairs=options.pairs
        )
    if len(source) > 1 or options.pairs is not None or options.unit is not None:
        raise typer.BadParameter("one list of places is solved by itself, in mm", param_hint="SOURCE")
    return judge_points(source[0], **sizes, pixel_aspect=options.pixel_aspect)


def _given(options: StatedOptions) -> list[str]:
    return [
        word
        for name, value in vars(options).items()
        if value is not None
        for word in (f"--{name.replace('_', '-')}", str(value))
    ]


def _size(text: str | None, option: str) -> tuple[int, int] | None:
    if text is None:
        return None
    width, by, height = text.lower().partition("x")
    if not (by and width.isascii() and width.isdigit() and height.isascii() and height.isdigit()):
        raise typer.BadParameter(f"{text!r} is no size; write it as 1920x1080", param_hint=option)
    if not all(0 < int(side[:6]) <= 65_535 and len(side) < 6 for side in (width, height)):
        raise typer.BadParameter(f"{text!r}: each side must be 1 to 65535 px", param_hint=option)
    return int(width), int(height)


def _save(judged: "Judged", document, report, out: Path) -> None:  # type: ignore[no-untyped-def]
    """Write record, report and the calibration in every format, all together or not at all."""
    from fringecal.camera import Lens
    from fringecal.records import PAIR_FILE, result_folder, write_document, write_lens, write_pair

    with result_folder(out, last=PAIR_FILE) as staging:
        if isinstance(judged.stated, Lens):
            for name in ("lens.cameramodel", "lens.yml"):
                write_lens(staging / name, judged.stated)
        else:
            write_pair(staging, judged.stated)
        write_report(report, staging)
        write_document(document, staging / PAIR_FILE)


def _print(judged: "Judged", out: Path | None) -> None:
    from fringecal.camera import Lens

    stated = judged.stated
    lenses = [("camera", stated)] if isinstance(stated, Lens) else _devices(stated)
    console.print(_table(lenses))
    if not isinstance(stated, Lens):
        _say(f"{judged.kind}: the centres stand {stated.baseline_mm:.2f} mm apart.")
    for note in judged.notes:
        _say(note)
    if judged.pairs is not None:
        found = judged.pairs
        _say(
            f"{judged.pairs_file}: at {found.points} places of {found.poses} pose(s) the rays miss each other by "
            f"{found.camera_rms_px:.3g} px rms in the camera, {found.projector_rms_px:.3g} px in the projector."
        )
    for doubt in judged.doubts:
        _say(f"{'refused' if doubt.refused else 'open'}: {doubt.subject}, {doubt.name}: {doubt.sentence}.")
    _say(f"{_VERDICTS[judged.verdict]}: {judged.sentence}", style=_STYLES[judged.verdict])
    if out is not None:
        _say(f"report: {out / 'report.html'}")


def _devices(stated) -> list[tuple[str, "Lens"]]:  # type: ignore[no-untyped-def]
    return [("camera", stated.camera), ("projector", stated.projector)]


def _say(text: str, style: str | None = None) -> None:
    console.print(text, markup=False, highlight=False, soft_wrap=True, style=style)


def _table(lenses: "list[tuple[str, Lens]]") -> Table:
    from fringecal.camera import LENS_NAMES

    table = Table(title="Stated lenses; u is a standard uncertainty")
    table.add_column("parameter")
    for name, lens in lenses:
        table.add_column(f"{name}, {lens.width_px} x {lens.height_px} px", justify="right")
        table.add_column("u", justify="right")
    for name in LENS_NAMES:
        row = [name.removesuffix("_px")]
        for _, lens in lenses:
            one = lens.estimate(name)
            known = lens.covariance_known
            row += [value_text(one.value, one.u) if known else f"{one.value:.6g}"]
            row += [uncertainty_text(one.u) if known else "not stated"]
        table.add_row(*row)
    return table
