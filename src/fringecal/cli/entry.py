"""Where the command begins and ends: whatever comes by signal, from the first import to the last, ends it in one line.

This module loads next to nothing, so that its handlers stand before the libraries are loaded.
"""

import contextlib
import os
import signal
import sys
import threading
import time
from typing import Any, NoReturn

NUMBERS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
TIDYING_S = 2.0
"""For so long after a signal further ones are not heard, s: what was begun is cleared away meanwhile."""

_AT_START = b"nothing was written; run the command again\n"
_RAISED_AGAIN_S = 0.05  # after which an interruption that nobody could pass on is given once more, s

told_to_end: list[int] = []
"""Signals by which the system asked the command to end, other than Ctrl-C."""

_last: list[float] = []


def main() -> NoReturn:
    """Run the command on what it was given; it ends with the codes that `fringecal.cli.app.main` states."""
    _listen(_at_start)
    code: Any = 0
    try:
        try:
            from fringecal.cli.app import main as command

            sys.unraisablehook = _not_lost
            _listen(_at_work)
            command()
        finally:
            _listen(signal.SIG_IGN)  # what is done is done: the interpreter ends, and nothing is left to stop
    except SystemExit as stop:
        code = stop.code
    except KeyboardInterrupt:
        code = _interrupted()
    _flushed()
    sys.exit(code)


def _listen(handler: Any) -> None:
    """Have signals handled so that were not ignored when the command began."""
    if threading.current_thread() is threading.main_thread():
        for number in NUMBERS:
            if handler is signal.SIG_IGN or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, handler)


def _at_start(number: int, _: object) -> NoReturn:
    """End at once: nothing has been begun."""
    word, code = _said(number)
    os.write(2, f"{word}: ".encode() + _AT_START)
    os._exit(code)


def _at_work(number: int, _: object) -> None:
    """Break the work off, once; it clears away what it had begun."""
    now = time.monotonic()
    if _last and now - _last[-1] < TIDYING_S:
        return
    _last.append(now)
    if number != signal.SIGINT:
        told_to_end.append(number)
    raise KeyboardInterrupt


def _said(number: int) -> tuple[str, int]:
    """Return the word and the exit code for a signal."""
    return ("interrupted" if number == signal.SIGINT else "terminated"), 128 + (2 if number == signal.SIGINT else 15)


def _interrupted() -> Any:
    """Say what stands, for an interruption that came between the command's own handlers."""
    from fringecal.cli.app import stop_interrupted

    try:
        stop_interrupted()
    except SystemExit as stop:
        return stop.code


def _not_lost(unraisable: Any) -> None:
    """Give an interruption again that came where Python can pass none on: in a destructor, or called back from C."""
    if not issubclass(unraisable.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(unraisable)
        return
    _last.clear()
    again = threading.Timer(_RAISED_AGAIN_S, os.kill, (os.getpid(), signal.SIGINT))
    again.daemon = True
    again.start()


def _flushed() -> None:
    """Write out what was printed; whoever read it may have gone."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(BrokenPipeError, ValueError, AttributeError):
            stream.flush()
            continue
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
