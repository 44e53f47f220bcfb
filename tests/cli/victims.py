"""What the processes that are killed run; a module of its own, since they import it anew."""

import os
from collections.abc import Sequence

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


def run(arguments: Sequence[str]) -> None:
    """Run a command whose words nobody reads."""
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    main(list(arguments))
