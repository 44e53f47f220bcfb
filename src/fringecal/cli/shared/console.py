"""What every verb prints with: one console for people, plain JSON for programs, errors on stderr."""

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


def complain(error: FringecalError) -> None:
    """Print an error the user can act on; a session's faults one per line."""
    stderr = Console(stderr=True, highlight=False, soft_wrap=True)
    if isinstance(error, SessionError):
        stderr.print(f"[bold red]error:[/] {len(error.faults)} fault(s) in the session", markup=True)
        for fault in error.faults:
            stderr.print(f"  - {fault}", markup=False)
    else:
        stderr.print("error: ", style="bold red", end="")
        stderr.print(str(error), markup=False)
