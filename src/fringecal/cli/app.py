"""The `fringecal` command: collects the verbs and turns errors into one message and an exit code."""

import contextlib
import importlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from typing import NoReturn

import typer

from fringecal import __version__
from fringecal.cli.entry import told_to_end
from fringecal.cli.shared.console import complain, prepare_streams
from fringecal.cli.shared.exit_codes import EXIT_ERROR, EXIT_INTERRUPTED, EXIT_PASS, EXIT_TERMINATED
from fringecal.cli.shared.judged_options import judge_options
from fringecal.errors import FringecalError
from fringecal.replacement import put_in_place_so_far

VERBS = (
    "demo",
    "simulate",
    "new",
    "check",
    "targets",
    "patterns",
    "grid",
    "lens",
    "phase",
    "angle",
    "commission",
    "verify",
    "reconstruct",
    "history",
    "study",
    "audit",
    "rerun",
    "certificate",
    "procedure",
    "serve",
)


def build_app(only: str | None = None) -> typer.Typer:
    """Assemble the command from one module per verb, each of which has `register(app)`.

    With `only`, the name of a verb, the other verbs' libraries are not loaded: the command starts at once.
    """
    app = typer.Typer(
        name="fringecal",
        help="Calibration and metrology of fringe-projection rigs.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )

    @app.callback(invoke_without_command=True)
    def root(version: bool = typer.Option(False, "--version", help="Print the version and stop.")) -> None:
        if version:
            print(f"fringecal {__version__}")
            raise typer.Exit(EXIT_PASS)

    for verb in (only,) if only in VERBS else VERBS:
        importlib.import_module(f"fringecal.cli.{verb}").register(app)
    judge_options(app)
    return app


def main(arguments: list[str] | None = None) -> None:
    """Run the command; exit codes are 0 pass, 1 error, 2 usage, 3 out of tolerance, 130 interrupted, 143 terminated."""
    prepare_streams()
    with _ended_tidily():
        _run(arguments)


def _run(arguments: list[str] | None) -> None:
    try:
        given = sys.argv[1:] if arguments is None else arguments
        build_app(given[0] if given else None)(args=given)
    except FringecalError as error:
        complain(error)
        sys.exit(EXIT_ERROR)
    except BrokenPipeError:  # whoever read the output has enough of it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(EXIT_ERROR)
    except (OSError, MemoryError, RecursionError) as error:
        complain(FringecalError(_of_the_system(error)))
        sys.exit(EXIT_ERROR)
    except KeyboardInterrupt:
        stop_interrupted()
    except SystemExit as stop:  # Typer's way to pass on an interruption of a verb
        if stop.code == EXIT_INTERRUPTED:
            stop_interrupted()
        raise


def _of_the_system(error: BaseException) -> str:
    """Say what the operating system or the machine refused, and where."""
    if isinstance(error, OSError):
        where = error.filename if error.filename is not None else "a file or folder"
        return f"{where}: {error.strerror or error}; see that it is there and may be read or written"
    short = "memory" if isinstance(error, MemoryError) else "levels for what is nested so deeply"
    return f"not enough {short}; give smaller files"


def stop_interrupted() -> NoReturn:
    """Say what stands, and end with the code of what came: Ctrl-C, or a request to end."""
    word, code = ("terminated", EXIT_TERMINATED) if told_to_end else ("interrupted", EXIT_INTERRUPTED)
    there = " and ".join(str(path) for path in put_in_place_so_far())
    stands = f"{there} was complete and stands, nothing else was written" if there else "nothing was written"
    print(f"{word}: {stands}; run the command again", file=sys.stderr)
    sys.exit(code)


@contextlib.contextmanager
def _ended_tidily() -> Iterator[None]:
    """Let a request to end (SIGTERM, a closed terminal) clear away as Ctrl-C does."""
    told_to_end.clear()
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    if threading.current_thread() is not threading.main_thread():
        numbers = []
    before = {number: signal.getsignal(number) for number in numbers}
    ours = [number for number, handler in before.items() if handler is signal.SIG_DFL]
    try:
        for number in ours:
            signal.signal(number, _told_to_end)
        yield
    finally:
        for number in ours:
            signal.signal(number, before[number])


def _told_to_end(number: int, _: object) -> NoReturn:
    told_to_end.append(number)
    raise KeyboardInterrupt
