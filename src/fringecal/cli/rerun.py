"""`fringecal rerun`: a calibration, verification or audit once more from its record, number by number."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.exit_codes import EXIT_OUT_OF_TOLERANCE
from fringecal.cli.shared.saving import progress

if TYPE_CHECKING:
    from fringecal.workflows.rerun import Rerun

HELP = """Run a calibration, a verification or an audit again from its record: same files by hash, same numbers.

Nothing is written. A file that is missing or has another content is named, and nothing is run.
Every number is compared: with its u where it states one, else to rounding, each u and each covariance as well.
Exit code 0 if every result is the same; 3 if one differs by more than 1 % of its u, or by more than rounding where it
states none, or if the record was edited after it was written; 1 if it cannot be run.

Example: fringecal rerun calibration/calibration.json --session bench/2026-11-22
"""
_SHOWN = 10  # differences on a terminal, the largest; --json lists all


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="rerun", help=HELP)(rerun)


def rerun(
    record: Path = typer.Argument(
        ..., help="calibration.json, verification.json or audit.json, or its folder.", show_default=False
    ),
    session: Path | None = typer.Option(
        None, "--session", help="Folder of the session; by default the one that the record names.", show_default=False
    ),
    calibration: Path | None = typer.Option(
        None, "--calibration", help="The calibration.json that was judged; by default as above.", show_default=False
    ),
    as_json: bool = typer.Option(False, "--json", help="Print the comparison as one JSON document."),
) -> None:
    """Load, run again, print."""
    from fringecal.records import read_record, record_file
    from fringecal.workflows.rerun import calibration_file, session_folder
    from fringecal.workflows.rerun import rerun as run

    written, _ = read_record(record)
    folder = session or session_folder(written)
    judged = record_file(calibration) if calibration else calibration_file(written)
    with progress(quiet=as_json) as show:
        found = run(written, folder, judged, progress=show)
    if as_json:
        print_json(_document(found))
    else:
        _print(found)
    if not found.repeats:
        raise typer.Exit(EXIT_OUT_OF_TOLERANCE)


def _document(found: "Rerun") -> dict[str, Any]:
    differences = [
        {"place": d.place, "then": d.then, "now": d.now, "part_of_u": d.part_of_u, "rule": d.rule, "matters": d.matters}
        | ({"by_definition_of_en": True} if d.defined else {})
        for d in found.differences
    ]
    return {
        "format": "fringecal-rerun/1",
        "identical": found.identical,
        "agrees": found.agrees,
        "digest": found.digest,
        "unstated": list(found.unstated),
        "sentence": found.sentence,
        "versions": {name: {"then": then, "now": now} for name, (then, now) in found.versions.items()},
        "differences": differences,
    }


def _print(found: "Rerun") -> None:
    worst = sorted(found.differences, key=lambda d: (not d.matters, -(d.part_of_u or 0.0)))
    for d in worst[:_SHOWN]:
        part = "" if d.part_of_u is None else f" ({d.part_of_u:.2g} of u)"
        part = " (by another definition of En)" if d.defined else part
        console.print(f"  {d.place}: {d.then} then, {d.now} now{part}", markup=False, highlight=False, soft_wrap=True)
    if len(worst) > _SHOWN:
        console.print(f"  and {len(worst) - _SHOWN} more; --json lists all", markup=False, highlight=False)
    console.print(found.sentence, markup=False, highlight=False, soft_wrap=True)
