"""`fringecal check`: is this folder a session, and if not, everything that is wrong with it."""

from pathlib import Path

import typer
from rich import box
from rich.console import JustifyMethod
from rich.markup import escape
from rich.table import Table

from fringecal.cli.shared.console import complain, console, print_json
from fringecal.cli.shared.exit_codes import EXIT_ERROR
from fringecal.errors import SessionError
from fringecal.session import Session, SessionCheck, check_report, check_session


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="check", help=HELP)(check)


HELP = """Check a session folder and list every fault in it, each with what to do.

Exit code 0 if the session may be used, 1 if not.

Example: fringecal check bench/2026-11-22 --json
"""


_NEXT = (
    "A session: every file is there and can be read. The content of the pictures was not judged; "
    "fringecal phase SESSION --diagnose tests the fringes, fringecal procedure run follows the whole procedure."
)


def check(
    session: Path = typer.Argument(..., help="Folder that holds session.toml.", show_default=False),
    as_json: bool = typer.Option(False, "--json", help="Print one JSON document (fringecal-check/1)."),
) -> None:
    """Load, check, print."""
    from fringecal.records import lens_of_bytes

    outcome = check_session(session, read_model=lens_of_bytes)
    if as_json:
        print_json(check_report(outcome).model_dump(mode="json"))
    else:
        show(outcome)
    if outcome.session is None:
        raise typer.Exit(EXIT_ERROR)


def show(outcome: SessionCheck) -> None:
    """Print what was found, for people."""
    if outcome.session is not None:
        console.print(_table(outcome.session))
    for note in outcome.notes:
        console.print(f"note: {note}", markup=False, soft_wrap=True, highlight=False)
    if outcome.session is None:
        complain(SessionError([str(fault) for fault in outcome.faults]))
    else:
        console.print(_NEXT, markup=False, soft_wrap=True, highlight=False)


def _table(session: Session) -> Table:
    title = escape(f"{session.folder}: rig {session.rig}, {session.captured.isoformat()}")
    # Narrow enough for 80 columns, because a hash or a size that wraps cannot be compared.
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), title_justify="left")
    for heading in ("capture", "kind", "target", "images", "size px", "bits", "white", "sha256"):
        justify: JustifyMethod = "right" if heading in ("images", "bits", "white") else "left"
        table.add_column(heading, justify=justify, no_wrap=heading != "target")
    for capture in session.captures.values():
        height, width = capture.shape
        table.add_row(
            escape(capture.name),
            capture.kind,
            escape(capture.target.name) if capture.target else "-",
            str(len(capture.files)),
            f"{width} x {height}",
            str(capture.bits),
            str(capture.white_level),
            capture.files[0][1][:8],
        )
    return table
