"""What the processes that are killed run; a module of its own, since they import it anew."""

import os
import sys
from collections.abc import Sequence
from multiprocessing.connection import Connection

from fringecal.cli.app import main

# What a command imports is loaded once, before the processes are forked.
PRELOAD = (
    "fringecal.procedures.report_commission",
    "fringecal.procedures.report_audit",
    "fringecal.procedures.recording_audit",
    "fringecal.history.store",
    "fringecal.report.html",
    "fringecal.report.pdf",
)


def run(arguments: Sequence[str], output: Connection) -> None:
    """Run a command that prints line by line into a pipe."""
    os.dup2(output.fileno(), 1)
    sys.stdout = os.fdopen(1, "w", buffering=1, closefd=False)
    main(list(arguments))
