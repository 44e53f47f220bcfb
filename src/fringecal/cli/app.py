"""The `fringecal` command: collects the verbs and turns errors into one message and an exit code."""

import importlib
import os
import sys

import typer

from fringecal import __version__
from fringecal.cli.shared.console import complain, prepare_streams
from fringecal.cli.shared.exit_codes import EXIT_ERROR, EXIT_INTERRUPTED, EXIT_PASS
from fringecal.errors import FringecalError

VERBS = (
    "demo",
    "simulate",
    "check",
    "targets",
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
    return app


def main(arguments: list[str] | None = None) -> None:
    """Run the command; exit codes are 0 pass, 1 error, 2 usage, 3 out of tolerance, 130 interrupted."""
    prepare_streams()
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
        _print_interrupted()
        sys.exit(EXIT_INTERRUPTED)
    except SystemExit as stop:  # Typer's way to pass on an interruption of a verb
        if stop.code == EXIT_INTERRUPTED:
            _print_interrupted()
        raise


def _of_the_system(error: BaseException) -> str:
    """Say what the operating system or the machine refused, and where."""
    if isinstance(error, OSError):
        where = error.filename if error.filename is not None else "a file or folder"
        return f"{where}: {error.strerror or error}; see that it is there and may be read or written"
    short = "memory" if isinstance(error, MemoryError) else "levels for what is nested so deeply"
    return f"not enough {short}; give smaller files"


def _print_interrupted() -> None:
    print("interrupted: nothing was written of what was not complete; run the command again", file=sys.stderr)
