"""`fringecal patterns`: the frames that a projector is to show, and the document that describes them."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import typer
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.saving import demand_folder, progress
from fringecal.errors import PhaseError, RecordError

if TYPE_CHECKING:
    from fringecal.patterns import Axis, Code, PatternSet, PeriodChoice, Raster, Response, Ripple

HELP = """Draw the patterns that a projector is to show: fringes, Gray codes, white, black, charts.

Writes PNGs, pixel for pixel, and patterns.toml into DIR; its [capture] can be copied into a session. Periods are given
(--period, again for more) or chosen so that noise numbers next to no fringe wrongly; the choices are printed.

Example: fringecal patterns --projector 1920x1080 --steps 4 --noise-rad 0.05 --charts --out patterns
"""
PATTERNS_FILE = "patterns.toml"
CODES = ("none", "plain", "complementary")
_MOST_LADDER = 1 << 20  # bytes of a ladder of grey values: 65,536 steps


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="patterns", help=HELP)(patterns)


def patterns(
    projector: str = typer.Option(..., "--projector", help="Columns and rows of the projector: WIDTHxHEIGHT, px."),
    out: Path = typer.Option(..., "--out", help="Folder for the patterns."),
    bits: int = typer.Option(8, "--bits", min=8, max=16, help="Bits of a grey value that the projector shows."),
    axis: list[str] = typer.Option(["u", "v"], "--axis", help="u: fringes count columns; v: rows; again for both."),
    period: list[float] = typer.Option([], "--period", help="Fringe period, px, again for more; chosen by default."),
    steps: int = typer.Option(4, "--steps", min=3, max=64, help="Evenly spaced phase shifts."),
    shortest_px: int = typer.Option(20, "--shortest-px", min=3, help="Period that measures, where periods are chosen."),
    range_px: float | None = typer.Option(None, "--range-px", help="Length to number; else the projector's own."),
    noise_rad: float = typer.Option(0.05, "--noise-rad", help="Standard uncertainty of a phase, rad."),
    most_wrong: float = typer.Option(1e-6, "--most-wrong", help="Share of fringes that may be numbered wrongly."),
    gray: str = typer.Option("none", "--gray", help="Gray code of the shortest period: none, plain, complementary."),
    response: str | None = typer.Option(
        None, "--response", help="Response to undo: gamma:EXPONENT, or a CSV of grey values and lights."
    ),
    contrast: float = typer.Option(1.0, "--contrast", max=1.0, help="Modulation over background."),
    dither: bool = typer.Option(False, "--dither", help="Spread rounding along the fringes."),
    charts: bool = typer.Option(False, "--charts", help="Focus and alignment charts too."),
    as_json: bool = typer.Option(False, "--json", help="Print a summary as one JSON document."),
) -> None:
    """Choose, draw, save, print."""
    from fringecal.patterns import Raster, drawn_ripple, pattern_set

    width, height = _size(projector)
    if gray not in CODES:
        raise typer.BadParameter(f"{gray!r} is none of {', '.join(CODES)}", param_hint="--gray")
    axes = _axes(axis)
    curve = _response(response)
    raster = Raster(width, height, bits, curve)
    demand_folder(out)
    choices = {} if period or gray != "none" else _choices(raster, axes, range_px, shortest_px, noise_rad, steps)
    periods = {name: _periods(name, tuple(period), choices, shortest_px, most_wrong) for name in axes}
    found = pattern_set(
        raster,
        axes,
        periods,
        steps=steps,
        code=cast("Code", gray),
        contrast=contrast,
        dithered=dither,
        charts=charts,
    )
    shifts = [math.radians(step) for step in found.steps_deg]
    shortest = min(min(each) for each in periods.values())
    ripples = [drawn_ripple(raster, shortest, shifts, contrast=contrast, dithered=dither)]
    if curve is not None:
        plain = Raster(width, height, bits)
        ripples.append(drawn_ripple(plain, shortest, shifts, true_response=curve, contrast=contrast, dithered=dither))
    with progress(quiet=as_json) as show:
        show(f"drawing {len(found.patterns)} frames")
        _save(found, out)
    summary = _summary(found, out, ripples, choices)
    if as_json:
        print_json(summary)
        return
    _print(found, choices, ripples, summary)


def _save(found: "PatternSet", out: Path) -> None:
    """Write frames and document, all together or not at all."""
    from fringecal.patterns import patterns_document, png_of
    from fringecal.records import result_folder, write_bytes, write_text
    from fringecal.session import to_toml

    with result_folder(out, last=PATTERNS_FILE) as staging:
        for one in found.patterns:
            write_bytes(staging / one.file, png_of(one.draw()))
        write_text(staging / PATTERNS_FILE, to_toml(patterns_document(found)))


def _choices(
    raster: "Raster",
    axes: "list[Axis]",
    range_px: float | None,
    shortest_px: int,
    noise_rad: float,
    steps: int,
) -> "dict[str, tuple[PeriodChoice, ...]]":
    from fringecal.patterns import choose_periods

    return {
        name: choose_periods(range_px or raster.extent_px(name), shortest_px, noise_rad, steps=steps) for name in axes
    }


def _periods(
    axis: str,
    given: tuple[float, ...],
    choices: "dict[str, tuple[PeriodChoice, ...]]",
    shortest_px: int,
    most_wrong: float,
) -> tuple[float, ...]:
    """Periods of one axis: as given; the shortest alone where a code numbers it; or the first choice that is safe."""
    if given:
        return given
    if axis not in choices:
        return (float(shortest_px),)
    safe = next((one for one in choices[axis] if one.error_rate <= most_wrong), None)
    if safe is None:
        best = min(choices[axis], key=lambda one: one.error_rate)
        raise PhaseError(
            f"axis {axis}: no choice numbers fringes of {shortest_px} px with less than {most_wrong:g} wrong; the best "
            f"is {_listed(best.periods_px)} px with {best.error_rate:.1g}. Take more steps (--steps), a longer period "
            "(--shortest-px) or a Gray code (--gray)"
        )
    return safe.periods_px


def _response(text: str | None) -> "Response | None":
    from fringecal.guarded import Refusal, bytes_of, text_of
    from fringecal.patterns import gamma_response, measured_response

    if text is None:
        return None
    if text.startswith("gamma:"):
        try:
            return gamma_response(float(text.removeprefix("gamma:")))
        except ValueError as error:
            raise typer.BadParameter(f"{text!r} names no exponent", param_hint="--response") from error
    try:
        rows = _rows(text_of(bytes_of(text, _MOST_LADDER)))
    except (Refusal, ValueError) as error:
        raise RecordError(f"{text}: {error}; a CSV of two columns was needed, grey value and light") from error
    return measured_response([row[0] for row in rows], [row[1] for row in rows])


def _rows(text: str) -> list[tuple[float, float]]:
    """Two numbers of each line; a first line of words is passed over."""
    lines = [line.split(",") for line in text.splitlines() if line.strip()]
    found = []
    for number, cells in enumerate(lines):
        try:
            grey, light = (float(cell) for cell in cells)
        except ValueError as error:
            if number == 0:
                continue
            raise ValueError(f"line {number + 1} is not two numbers") from error
        found.append((grey, light))
    return found


def _axes(given: list[str]) -> "list[Axis]":
    if not given or any(name not in ("u", "v") for name in given) or len(set(given)) < len(given):
        raise typer.BadParameter("u, v, or both, each once", param_hint="--axis")
    return cast("list[Axis]", given)


def _size(text: str) -> tuple[int, int]:
    width, by, height = text.lower().partition("x")
    if not (by and all(side.isascii() and side.isdigit() and len(side) < 6 for side in (width, height))):
        raise typer.BadParameter(f"{text!r} is no size; write it as 1920x1080", param_hint="--projector")
    return int(width), int(height)


def _summary(
    found: "PatternSet", out: Path, ripples: "list[Ripple]", choices: "dict[str, tuple[PeriodChoice, ...]]"
) -> dict[str, Any]:
    return {
        "format": "fringecal-patterns/1",
        "document": str(out / PATTERNS_FILE),
        "frames": len(found.patterns),
        "periods_px": {name: list(each) for name, each in found.periods_px.items()},
        "ripple_rad": {"rms": ripples[0].rms_rad, "most": ripples[0].most_rad},
        "ripple_without_response_rad": None if len(ripples) < 2 else {"rms": ripples[1].rms_rad},
        "choices": {
            name: [
                {"how": one.how, "periods_px": list(one.periods_px), "error_rate": one.error_rate, "frames": one.frames}
                for one in each
            ]
            for name, each in choices.items()
        },
    }


def _print(
    found: "PatternSet",
    choices: "dict[str, tuple[PeriodChoice, ...]]",
    ripples: "list[Ripple]",
    summary: dict[str, Any],
) -> None:
    for axis, each in choices.items():
        table = Table("periods / px", "how", "frames", "wrong", title=f"Periods, axis {axis}")
        for one in each:
            chosen = one.periods_px == found.periods_px[cast("Axis", axis)]
            style = "bold" if chosen else None
            table.add_row(_listed(one.periods_px), one.how, str(one.frames), f"{one.error_rate:.1g}", style=style)
        console.print(table)
    for axis, periods in found.periods_px.items():
        console.print(f"axis {axis}: periods of {_listed(periods)} px", highlight=False)
    before = "" if len(ripples) < 2 else f", {ripples[1].rms_rad:.2g} rad if the response were not undone"
    console.print(f"ripple of the drawing: {ripples[0].rms_rad:.2g} rad rms{before}", highlight=False)
    console.print(f"{summary['frames']} frames: {summary['document']}", highlight=False, soft_wrap=True)


def _listed(periods: tuple[float, ...]) -> str:
    return ", ".join(f"{period:g}" for period in periods)
