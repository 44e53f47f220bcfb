"""`fringecal procedure`: the written procedures, walked step by step beside the session folder."""

import difflib
import shlex
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import typer
from rich import box
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.exit_codes import EXIT_ERROR
from fringecal.errors import FringecalError, RecordError
from fringecal.session import SessionCheck, check_session
from fringecal.workflows.procedure import Page, StepState, Walk, parse_page, walk

HELP = """Walk a written procedure: what is done, what is still missing in the session folder, what is wrong with it.

Example: fringecal procedure run commissioning --session bench/2026-11-22 --out calibration
"""
_SIGNS = {"done": "done", "missing": "MISSING", "wrong": "WRONG", "optional": "if you have it", "by hand": "by hand"}
_RECORDS = ("calibration.json", "verification.json", "audit.json")
JSON = typer.Option(False, "--json", help="Print one JSON document.")


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    procedure = typer.Typer(help=HELP, no_args_is_help=True)
    procedure.command(name="list")(list_pages)
    procedure.command(name="run")(run)
    app.add_typer(procedure, name="procedure")


def pages() -> dict[str, Page]:
    """Read the shipped procedures by name.

    Raises
    ------
    FringecalError
        They are not there.
    """
    installed = Path(str(resources.files("fringecal"))) / "_shared" / "procedures"
    source_tree = Path(__file__).resolve().parents[3] / "procedures"
    folder = next((place for place in (installed, source_tree) if place.is_dir()), None)
    if folder is None:
        raise FringecalError(f"the shipped procedures are missing: {installed} does not exist; install fringecal again")
    files = sorted(file for file in folder.glob("*.md") if file.name != "README.md")
    return {file.stem: parse_page(file.stem, file.read_text(encoding="utf-8")) for file in files}


def list_pages(as_json: bool = JSON) -> None:
    """List the procedures, each with its verb.

    Example: fringecal procedure list
    """
    found = pages()
    if as_json:
        rows = [{"name": p.name, "title": p.title, "verb": p.verb, "function": p.function} for p in found.values()]
        print_json({"format": "fringecal-procedures/1", "procedures": rows})
        return
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("procedure", "verb", "needs"):
        table.add_column(heading, no_wrap=True)
    for page in found.values():
        table.add_row(page.name, page.verb, ", ".join(page.needs.values()) or "-")
    console.print(table)


def run(
    name: str = typer.Argument(..., help="Name of the procedure; `fringecal procedure list` shows them."),
    session: Path = typer.Option(..., "--session", help="Folder of the session, complete or not."),
    calibration: Path | None = typer.Option(None, "--calibration", help="calibration.json in force, where needed."),
    out: Path | None = typer.Option(None, "--out", help="Run the verb when all is there, results into this folder."),
    as_json: bool = JSON,
) -> None:
    """Walk the steps of a procedure; come back as often as you like, the folder says where you are.

    Exit code 1 while something is missing or wrong, else that of the verb.

    Example: fringecal procedure run commissioning --session bench/2026-11-22 --out calibration
    """
    from fringecal.records import lens_of_bytes

    page = _page(name)
    check = check_session(session, read_model=lens_of_bytes)
    found = walk(page, check)
    wanted = page.calibration and calibration is None
    arguments = _arguments(page, check, calibration, out)
    if as_json:
        print_json(_document(found, arguments, needs_calibration=wanted))
    else:
        _print(found, arguments, needs_calibration=wanted)
    if not found.ready or (wanted and out is not None):
        raise typer.Exit(EXIT_ERROR)
    if out is None or as_json:
        return
    before = _done_before(check, calibration, out)
    if before is not None:
        console.print(f"Done before, from these very files: {before}", markup=False, highlight=False, soft_wrap=True)
        return
    _run_verb(page, arguments)


def _page(name: str) -> Page:
    known = pages()
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
        raise FringecalError(f"no procedure {name!r}; {hint}")
    return known[name]


def _arguments(page: Page, check: SessionCheck, calibration: Path | None, out: Path | None) -> list[str]:
    """Put this session's paths where the page's command has its own."""
    words = shlex.split(page.command)[1:]
    for option, path in {"--calibration": calibration, "--out": out}.items():
        if path is not None and option in words:
            words[words.index(option) + 1] = str(path)
    if "--capture" in words and check.session is not None:
        named = [capture.name for kind in page.needs.values() for capture in check.session.find(kind)]
        words[words.index("--capture") + 1] = named[0] if named else words[words.index("--capture") + 1]
    return [_placed(word, check) for word in words]


def _placed(word: str, check: SessionCheck) -> str:
    """Give the session for SESSION, and the first picture of a capture of that kind for SESSION/kind.png."""
    if word == "SESSION":
        return str(check.folder)
    place, _, file = word.partition("/")
    if place != "SESSION":
        return word
    captures = () if check.session is None else check.session.find(file.partition(".")[0])
    return str(captures[0].paths[0] if captures else check.folder / file)


def _done_before(check: SessionCheck, calibration: Path | None, out: Path) -> Path | None:
    """Return the record in `out` if it was made from these very files and this very calibration."""
    from fringecal.records import CalibrationRecord, read_record, sha256_of

    for file in (out / name for name in _RECORDS):
        if check.session is None or not file.is_file():
            continue
        try:
            record, _ = read_record(file)
        except RecordError:
            continue  # what cannot be read was not made from these files
        inputs = {row.file: row.sha256 for row in record.inputs}
        same = inputs.items() <= check.session.inputs.items()
        used = None if isinstance(record, CalibrationRecord) else record.calibration.sha256
        if calibration is not None and calibration.is_dir():
            calibration = calibration / "calibration.json"
        if inputs and same and (used is None or (calibration is not None and used == sha256_of(calibration))):
            return file
    return None


def _document(found: Walk, arguments: Sequence[str], *, needs_calibration: bool) -> dict[str, Any]:
    steps = [
        {"number": s.number, "state": s.state, "kind": s.kind, "text": _ended(s.text, arguments), "faults": s.faults}
        for s in found.steps
    ]
    return {
        "format": "fringecal-procedure/1",
        "procedure": found.page.name,
        "ready": found.ready and not needs_calibration,
        "missing": found.missing,
        "steps": steps,
        "faults": found.faults,
        "command": ["fringecal", *arguments],
    }


def _print(found: Walk, arguments: Sequence[str], *, needs_calibration: bool) -> None:
    def say(text: str, style: str = "") -> None:
        console.print(text, markup=False, highlight=False, soft_wrap=True, style=style)

    say(f"{found.page.title}: {found.page.purpose}")
    for step in found.steps:
        style = "bold red" if step.state in ("missing", "wrong") else ""
        say(f"{step.number}. [{_sign(step)}] {_ended(step.text, arguments)}", style)
        for fault in step.faults:
            say(f"     - {fault}", "red")
    for fault in found.faults:
        say(f"session: {fault}", "red")
    if found.next_step is not None:
        what = "put right" if found.next_step.state == "wrong" else f"take the pictures of kind {found.next_step.kind}"
        say(f"Next: {what} (step {found.next_step.number}), then run this again.", "bold")
    elif found.faults:
        say("Next: put the session right, then run this again.", "bold")
    elif needs_calibration:
        say(
            "All pictures are there. Name the calibration in force with --calibration, and --out for the results.",
            "bold",
        )
    else:
        say(f"All is there: {_command(arguments)}", "bold")


def _sign(step: StepState) -> str:
    """Say how a step stands, and which captures say so."""
    sign = ": ".join(filter(None, (_SIGNS[step.state], ", ".join(step.captures))))
    return f"{sign}; {', '.join(step.beside)}: measured, not in the fit" if step.beside else sign


def _ended(text: str, arguments: Sequence[str]) -> str:
    """Put the command behind a step that announces it."""
    return f"{text} {_command(arguments)}" if text.endswith(":") else text


def _command(arguments: Sequence[str]) -> str:
    return shlex.join(("fringecal", *arguments))


def _run_verb(page: Page, arguments: Sequence[str]) -> None:
    from fringecal.cli.app import build_app

    build_app(page.verb)(args=list(arguments))
