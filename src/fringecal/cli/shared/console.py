"""What every verb prints with: one console for people, plain JSON for programs, errors on stderr."""

import io
import json
import sys
from collections.abc import Mapping
from typing import Any

from rich.console import Console

from fringecal.errors import FringecalError, SessionError

console = Console()


def print_json(document: Mapping[str, Any]) -> None:
    """Print one JSON document and nothing else on standard output."""
    json.dump(document, sys.stdout, indent=2, ensure_ascii=False, allow_nan=False)
    sys.stdout.write("\n")


def prepare_streams() -> None:
    """Let every name be printed: what the terminal's encoding lacks, such as bytes that are no text, is escaped."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def printable(text: str) -> str:
    r"""Escape what would steer a terminal instead of being shown; line ends stay.

    Examples
    --------
    >>> printable("a\x1b[2Jb")
    'a\\x1b[2Jb'
    """
    return "".join(
        letter if letter.isprintable() or letter == "\n" else letter.encode("unicode_escape", "replace").decode()
        for letter in text
    )


def complain(error: FringecalError) -> None:
    """Print an error the user can act on; a session's faults one per line."""
    stderr = Console(stderr=True, highlight=False, soft_wrap=True)
    if isinstance(error, SessionError):
        stderr.print(f"[bold red]error:[/] {len(error.faults)} fault(s) in the session", markup=True)
        for fault in error.faults:
            stderr.print(f"  - {printable(fault)}", markup=False)
    else:
        stderr.print("error: ", style="bold red", end="")
        stderr.print(printable(str(error)), markup=False)
