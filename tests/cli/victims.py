"""What the processes that are killed run; a module of its own, since they import it anew."""

import base64
import os
from collections.abc import Sequence

from fringecal.cli.app import main
from fringecal.report import views
from fringecal.report.structure import FigureItem

# What a command imports is loaded once, before the processes are forked.
PRELOAD = (
    "fringecal.workflows.commission.report",
    "fringecal.workflows.audit.report",
    "fringecal.workflows.audit.record",
    "fringecal.history.store",
    "fringecal.report.html",
    "fringecal.report.pdf",
)


SQUARE = (
    b"iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNoAAAAggCBd81ytgAAAABJRU5ErkJggg=="  # one grey pixel
)


def run(arguments: Sequence[str], drawn: bool) -> None:
    """Run a command whose words nobody reads; unless `drawn`, blank figures stand in for those that take long."""
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    if not drawn:
        views._encoded = blank
    main(list(arguments))


def blank(item: FigureItem) -> bytes:
    """Give a picture of the figure's kind and about its length, with nothing to see."""
    if item.encoding == "png":
        return base64.b64decode(SQUARE)
    return b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9">' + b" " * 50_000 + b"</svg>"
