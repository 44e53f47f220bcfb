"""`fringecal targets`: list the shipped artefacts, show what one says, draw the printable ones."""

import os
from pathlib import Path
from typing import Any

import typer
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.errors import TargetError
from fringecal.targets import (
    PRINTABLE,
    Target,
    Zigzag,
    footprint_mm,
    list_targets,
    load_target,
    pdf,
    sheet,
    svg,
    zigzag_base_mm,
    zigzag_height,
)

NAME = typer.Argument(help="Name of a shipped target, or path of a .toml file.", metavar="NAME")
AS_JSON = typer.Option(False, "--json", help="Print one JSON document.")


def register(app: typer.Typer) -> None:
    """Add the verb `targets` with its three commands."""
    verb = typer.Typer(
        help="Artefacts as data: list them, show one, draw a printable one true to scale.",
        no_args_is_help=True,
    )
    verb.command("list", epilog="Example: fringecal targets list")(list_command)
    verb.command("show", epilog="Example: fringecal targets show angle-bars")(show_command)
    verb.command("draw", epilog="Example: fringecal targets draw grid-10mm --out grid.pdf --page A4")(draw_command)
    app.add_typer(verb, name="targets")


def list_command(as_json: bool = AS_JSON) -> None:
    """List the shipped targets."""
    rows = [_row(name, load_target(name)) for name in list_targets()]
    if as_json:
        print_json({"targets": rows})
        return
    table = Table("name", "kind", "what it is", "sheet")
    for row in rows:
        table.add_row(row["target"], row["kind"], row["name"], "yes" if row["printable"] else "")
    console.print(table)


def show_command(name: str = NAME, as_json: bool = AS_JSON) -> None:
    """Show one target: its dimensions with standard uncertainties, and what follows from them."""
    target = load_target(name)
    stated, derived = target.model_dump(mode="json", exclude_none=True), _derived(target)
    if as_json:
        print_json({"target": stated, "derived": derived})
        return
    table = Table("key", "value", "u", title=target.name, caption=f"certificate: {target.certificate}")
    for key, value in stated.items():
        if key not in ("name", "certificate"):
            table.add_row(*_cells(key, value))
    for key, value in derived.items():
        table.add_row(*_cells(key, value), style="dim")
    console.print(table)


def draw_command(
    name: str = NAME,
    out: Path = typer.Option(..., "--out", help="File to write; its ending, .pdf or .svg, decides the format."),
    page: str = typer.Option("A4", help="A5..A0, letter, legal, tabloid, or WIDTHxHEIGHT in mm."),
    margin_mm: float = typer.Option(8.0, min=0.0, help="What the printer leaves white at each edge."),
    as_json: bool = AS_JSON,
) -> None:
    """Draw a printable target true to scale, with a 100 mm check ruler on each axis."""
    writers = {".pdf": pdf, ".svg": lambda drawing: svg(drawing).encode()}
    writer = writers.get(out.suffix.lower())
    if writer is None:
        raise TargetError(f'"{out}" ends in {out.suffix or "nothing"}; a sheet is written as .pdf or .svg')
    drawing = sheet(load_target(name), page=page, margin_mm=margin_mm)
    _write(out, writer(drawing))
    if as_json:
        print_json({"file": str(out), "width_mm": drawing.width_mm, "height_mm": drawing.height_mm})
        return
    console.print(f"{out}: {drawing.width_mm:g} x {drawing.height_mm:g} mm")
    console.print("Print at actual size, then measure both rulers.")


def _row(name: str, target: Target) -> dict[str, Any]:
    printable = isinstance(target, PRINTABLE)
    return {"target": name, "kind": target.kind, "name": target.name, "printable": printable}


def _derived(target: Target) -> dict[str, Any]:
    """Compute what follows from the stated numbers: footprint, and the shape of a zig-zag."""
    width, length = footprint_mm(target)
    derived: dict[str, Any] = {}
    if width < float("inf") and length < float("inf"):
        derived["footprint_mm"] = [round(width, 4), round(length, 4)]
    if isinstance(target, Zigzag):
        height = zigzag_height(target)
        derived["full_height_mm"] = {"value": height.value, "u": height.u}
        derived["ridge_spacing_mm"] = zigzag_base_mm(target.leg_mm.value, target.apex_deg.value)
    return derived


def _cells(key: str, value: Any) -> tuple[str, str, str]:
    if isinstance(value, dict):
        return key, _short(value["value"]), _short(value["u"])
    return key, _short(value), ""


def _short(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(_short(item) for item in value)
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _write(file: Path, content: bytes) -> None:
    """Write a file whole or not at all: beside it first, then in its place."""
    part = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        part.write_bytes(content)
        os.replace(part, file)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise TargetError(f"{file}: cannot be written ({error.strerror}); check the path given to --out") from None
