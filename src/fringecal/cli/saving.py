"""What every verb writes: record, tables, figures and report, all together or not at all."""

from collections.abc import Callable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from fringecal.cli.console import console
from fringecal.errors import RecordError

if TYPE_CHECKING:
    from fringecal.report.structure import Report

REPORT_FILE = "report.html"
SHEETS_FILE = "report.pdf"


def write_report(report: "Report", folder: Path) -> None:
    """Write a report as a page and as sheets, with its tables as CSV and its figures beside them."""
    from fringecal.procedures.report_parts import figures_of, tables_of
    from fringecal.records.files import write_bytes, write_table
    from fringecal.report.html import write_html
    from fringecal.report.pdf import write_pdf

    for name, frame in tables_of(report).items():
        write_table(_made(folder / "tables") / name, frame)
    for name, content in figures_of(report).items():
        write_bytes(_made(folder / "figures") / name, content)
    write_html(report, folder / REPORT_FILE)
    write_pdf(report, folder / SHEETS_FILE)


def demand_folder(out: Path) -> None:
    """Refuse a place for results before the work is done, not after it.

    Raises
    ------
    RecordError
        `out` is a file, or lies in one.
    """
    for place in (out, *out.absolute().parents):
        if place.is_file():
            raise RecordError(f"{out}: a folder for results was needed, but {place} is a file; name another")


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder


@contextmanager
def progress(*, quiet: bool):  # type: ignore[no-untyped-def]
    """Lend a function that shows what is being done; silent when the output is for a program."""
    if quiet:
        yield lambda _: None
        return
    with console.status("starting") as status:

        def show(step: str) -> None:
            if not console.is_terminal:
                console.print(f"  {step}", markup=False, highlight=False)
            status.update(step)

        yield show


def command_line(verb: str, arguments: Sequence[object]) -> tuple[str, ...]:
    """Return the command as typed, for the record."""
    return ("fringecal", verb, *(str(a) for a in arguments))


type Show = Callable[[str], None]
