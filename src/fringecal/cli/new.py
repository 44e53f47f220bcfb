"""`fringecal new`: a session document for pictures that exist."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich import box
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.saving import progress
from fringecal.errors import SessionError

if TYPE_CHECKING:
    from fringecal.workflows.new import Proposal, Series, Stated

HELP = """Write the session.toml of a folder of pictures that exist.

Looks at them: grids, boards, sets of fringes with their phase shifts and periods, the bare plate. What pictures cannot
tell is asked for in the terminal, or stated by options; NAME is a name in the table that is printed. Nothing is
written until fringecal check passes.

Example: fringecal new bench --height-mm 1500 --u-height-mm 5 --target grid=grid-10mm --target strips=glass-strips
"""


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="new", help=HELP)(new)


def new(
    folder: Path = typer.Argument(..., help="Folder of pictures; their names tell series apart.", show_default=False),
    rig: str | None = typer.Option(None, "--rig", help="Name of the rig; the folder's by default."),
    captured: str | None = typer.Option(
        None,
        "--captured",
        help="Date and time with zone, 2026-11-22T10:00:00Z; when the last file was written by default.",
    ),
    height_mm: float | None = typer.Option(None, "--height-mm", min=1.0, help="Camera above the plate, mm."),
    u_height_mm: float = typer.Option(5.0, "--u-height-mm", min=0.0, help="Its standard uncertainty, mm."),
    telecentric: bool = typer.Option(False, "--telecentric", help="The camera's rays are parallel."),
    model: str | None = typer.Option(None, "--camera-model", help="A .cameramodel of the camera, within the folder."),
    channel: str | None = typer.Option(None, "--channel", help="mean, red, green, blue or luma, of colour pictures."),
    projector: str | None = typer.Option(
        None, "--projector", help="Columns and rows of the projector: WIDTHxHEIGHT, px."
    ),
    kind: list[str] = typer.Option([], "--kind", help="NAME=KIND, again for more."),
    target: list[str] = typer.Option([], "--target", help="NAME=TARGET, a shipped one or a file, again for more."),
    periods: list[str] = typer.Option([], "--periods", help="NAME=P1,P2,... of fringes, or '*=P1,...' for all."),
    patterns: str | None = typer.Option(None, "--patterns", help="patterns.toml of the fringes shown, in the folder."),
    without: list[str] = typer.Option([], "--without", help="NAME of a series to leave out, again for more."),
    ask: bool = typer.Option(True, "--ask/--no-ask", help="Ask in the terminal for what is missing."),
    as_json: bool = typer.Option(False, "--json", help="Print what was found as one JSON document; asks nothing."),
) -> None:
    """Look, ask, write, check."""
    from fringecal.session import FILE_NAME
    from fringecal.workflows.new import Stated, captured_at, looked_at, series_of, session_table

    if (folder / FILE_NAME).exists():
        raise SessionError([f"{folder / FILE_NAME} is there already; edit it, or move it away"])
    when = _moment(captured) if captured else None
    stated = Stated(
        dict(_pair(text, "--kind") for text in kind),
        dict(_pair(text, "--target") for text in target),
        {name: _numbers(text) for name, text in (_pair(text, "--periods") for text in periods)},
        patterns,
        frozenset(without),
    )
    with progress(quiet=as_json) as show:
        series = series_of(folder, channel, show)
        looked = looked_at(series, show)
    camera = _camera(height_mm, u_height_mm, telecentric, model, channel)
    asking = ask and not as_json and sys.stdin.isatty()
    found, camera = _settled(looked, series, folder, stated, camera, asking=asking)
    open_ = [*_camera_asks(found, camera, series), *_capture_asks(found)]
    if as_json:
        print_json(_summary(found, open_, folder / FILE_NAME if not open_ else None))
    else:
        console.print(_table(found))
    if open_:
        raise SessionError([f"{why}; state it by {option}" for option, why in open_])
    shape = {"resolution_px": _size(projector)} if projector else {}
    path = _written(
        folder, session_table(rig or folder.resolve().name, when or captured_at(series), camera, shape, found)
    )
    if not as_json:
        console.print(f"written, and it passes fringecal check: {path}", highlight=False, soft_wrap=True)


def _written(folder: Path, table: dict[str, Any]) -> Path:
    """Write session.toml and check the folder; what does not pass, or is interrupted, is not left there."""
    from fringecal.records import lens_of_bytes, write_text
    from fringecal.session import FILE_NAME, check_session, to_toml

    path = write_text(folder / FILE_NAME, to_toml(table))
    try:
        outcome = check_session(folder, read_model=lens_of_bytes)
    except BaseException:
        path.unlink()
        raise
    if outcome.session is None:
        path.unlink()
        raise SessionError([str(fault) for fault in outcome.faults])
    return path


def _settled(
    looked: "list[Proposal]",
    series: "Sequence[Series]",
    folder: Path,
    stated: "Stated",
    camera: dict[str, Any],
    *,
    asking: bool,
) -> "tuple[list[Proposal], dict[str, Any]]":
    """Put together what was seen and stated; in a terminal, ask for the rest, one thing after the other."""
    from fringecal.workflows.new import decided

    found = decided(looked, folder, stated)
    while asking and (missing := next(((one, ask) for one in found for ask in one.asks), None)):
        one, (option, why) = missing
        answer = typer.prompt(f"{one.name}: {why}\n{option.split('=')[0].split()[0].removeprefix('--')}")
        stated = _with_answer(stated, one.name, option, answer)
        found = decided(looked, folder, stated)
    while asking and (wanted := _camera_asks(found, camera, series)):
        option, why = wanted[0]
        camera = camera | _camera_answer(option, typer.prompt(why))
    return found, camera


def _with_answer(stated: "Stated", name: str, option: str, answer: str) -> "Stated":
    """Add one answer to what is stated."""
    if option.startswith("--kind"):
        if answer.strip() in ("", "none", "without"):
            return replace(stated, without=stated.without | {name})
        return replace(stated, kinds={**stated.kinds, name: answer.strip()})
    if option.startswith("--target"):
        return replace(stated, targets={**stated.targets, name: answer.strip()})
    return replace(stated, periods={**stated.periods, name: _numbers(answer)})


def _camera(
    height_mm: float | None, u_height_mm: float, telecentric: bool, model: str | None, channel: str | None
) -> dict[str, Any]:
    """Return the camera's table."""
    found: dict[str, Any] = {"telecentric": True} if telecentric else {}
    found |= {"height_mm": {"value": height_mm, "u": u_height_mm}} if height_mm is not None else {}
    return found | ({"model": model} if model else {}) | ({"channel": channel} if channel else {})


def _camera_asks(
    found: "Sequence[Proposal]", camera: dict[str, Any], series: "Sequence[Series]"
) -> list[tuple[str, str]]:
    """Return what has to be known of the camera and is not: how colour becomes grey, and how far away it is."""
    asks = []
    if any(still.colour for one in series for still in one.stills) and "channel" not in camera:
        asks.append(("--channel CHANNEL", "the pictures have colours: mean, red, green, blue or luma"))
    kinds = {one.kind for one in found}
    if "grid" in kinds and "board" not in kinds and not {"height_mm", "telecentric", "model"} & camera.keys():
        why = "camera above the plate, mm, by a tape: one picture of a grid holds no focal length"
        asks.append(("--height-mm MM (or --telecentric, or --camera-model FILE)", why))
    return asks


def _capture_asks(found: "Sequence[Proposal]") -> list[tuple[str, str]]:
    """Return what has to be known of captures and is not; what one option states of several is asked once."""
    names: dict[tuple[str, str], list[str]] = {}
    for one in found:
        for ask in one.asks:
            names.setdefault(ask, []).append(one.name)
    return [(option, f"{', '.join(of)}: {why}") for (option, why), of in names.items()]


def _camera_answer(option: str, answer: str) -> dict[str, Any]:
    if option.startswith("--channel"):
        return {"channel": answer.strip()}
    return {"height_mm": {"value": _numbers(answer)[0], "u": 5.0}}


def _pair(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (equals and name and value):
        raise typer.BadParameter(f"{text!r} is not NAME=VALUE", param_hint=option)
    return name, value


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise SessionError([f"{text!r}: numbers with commas between them were needed, as 20,21.5,24"]) from error


def _size(text: str) -> list[int]:
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(side.isascii() and side.isdigit() and len(side) < 6 for side in sides):
        raise typer.BadParameter(f"{text!r} is no size; write it as 1920x1080", param_hint="--projector")
    return [int(side) for side in sides]


def _moment(text: str) -> datetime:
    try:
        found = datetime.fromisoformat(text)
    except ValueError as error:
        raise typer.BadParameter(
            f"{text!r} is no date; write it as 2026-11-22T10:00:00Z", param_hint="--captured"
        ) from error
    if found.tzinfo is None:
        raise typer.BadParameter(f"{text!r} has no time zone; add Z or +01:00", param_hint="--captured")
    return found


def _summary(found: "Sequence[Proposal]", asks: Sequence[tuple[str, str]], path: Path | None) -> dict[str, Any]:
    return {
        "format": "fringecal-new/1",
        "session": str(path) if path else None,
        "captures": [
            {"name": one.name, "kind": one.kind, "seen": one.seen, "target": one.target} | dict(one.table)
            for one in found
        ],
        "asked": [{"option": option, "why": why} for option, why in asks],
    }


def _table(found: "Sequence[Proposal]") -> Table:
    table = Table("capture", "kind", "pictures", "what was seen", "target", box=box.SIMPLE)
    for one in found:
        number = sum(len(one.table.get(key, ())) for key in ("images", "gray", "white", "black"))
        table.add_row(one.name, one.kind or "?", str(number), one.seen, one.target or "")
    return table
