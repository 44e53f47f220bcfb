"""What every verb writes: record, tables, figures and report, all together or not at all."""

import os
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fringecal.cli.shared.console import console
from fringecal.cli.shared.exit_codes import EXIT_OUT_OF_TOLERANCE
from fringecal.errors import RecordError
from fringecal.replacement import hidden_beside, settle
from fringecal.report import REPORT_FILE
from fringecal.uncertainty import EXPANDED_BY, uncertainty_text, value_text

if TYPE_CHECKING:
    from rich.table import Table

    from fringecal.records import Check

LIMITS_HELP = "Limits of acceptance; by default limits.toml beside the session's pictures, else fringecal's own."

_TRIED = "fringecal"  # of a folder that is made and removed to see whether one may be

_VERDICTS = {
    "pass": "PASS",
    "conditionalPass": "CONDITIONAL PASS: nothing beyond its limit, but conformity not proved for all",
    "conditionalFail": "CONDITIONAL FAIL: beyond a limit, but nonconformity not proved",
    "fail": "FAIL",
    "info": "NO VERDICT: nothing was judged",
}
_STYLES = {
    "pass": "bold green",
    "conditionalPass": "bold yellow",
    "conditionalFail": "bold yellow",
    "fail": "bold red",
    "info": "bold",
}


def demand_folder(out: Path) -> None:
    """Refuse a place for results before the work is done, not after it; clear away what killed commands left there.

    Raises
    ------
    RecordError
        `out` is a file, or lies in one, or in a folder where nothing may be written.
    """
    place = next(place for place in (out, *out.absolute().parents) if os.path.exists(place))
    if not place.is_dir():
        raise RecordError(f"{out}: a folder for results was needed, but {place} is a file; name another")
    try:
        settle(place / _TRIED)
        if out.name:
            settle(out.absolute())
        tried = hidden_beside(place / _TRIED)
        tried.mkdir()  # rights alone do not tell
        tried.rmdir()
    except OSError as error:
        raise RecordError(
            f"{out}: nothing may be written in {place} ({error.strerror}); name another folder for the results"
        ) from error


def print_outcome(
    checks: Sequence["Check"], sentences: Sequence[str], out: Path, *, why: str = "", table: "Table | None" = None
) -> None:
    """Print the verdict over all checks, then what was found, the checks that stand in the way, and the report's place.

    Parameters
    ----------
    checks
        All that was judged.
    sentences
        What was found.
    out
        The results' folder.
    why
        What the verdict's line says first; by default what such a verdict means.
    table
        Headline numbers, shown after the verdict.

    Raises
    ------
    typer.Exit
        With code 3 where a check failed.
    """
    from fringecal.workflows.shared import severest

    say = partial(console.print, markup=False, highlight=False, soft_wrap=True)
    failed = [check for check in checks if check.decision == "fail"]
    unproved = [check for check in checks if check.decision.startswith("conditional")]
    judged = sum(check.decision != "info" for check in checks)
    verdict = severest(checks)
    meaning = f"{_VERDICTS[verdict].partition(':')[0]}: {why}" if why else _VERDICTS[verdict]
    say(f"{meaning} ({judged} checks; {EXPANDED_BY})", style=_STYLES[verdict])
    if table is not None:
        console.print(table)
    for sentence in sentences:
        say(sentence)
    for check in (*failed, *unproved):
        value = "" if check.value is None else f": {value_text(check.value, check.u)} {check.unit}".rstrip()
        value += f", u {uncertainty_text(check.u)}" if check.u else ""
        limit = "" if check.limit is None else f", limit {check.limit:.4g}"
        say(
            f"check {'failed' if check.decision == 'fail' else 'not proved'}: {check.name}{value}{limit} ({check.rule})"
        )
    say(f"report: {out / REPORT_FILE}")
    if failed:
        raise typer.Exit(EXIT_OUT_OF_TOLERANCE)


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


type Show = Callable[[str], None]
