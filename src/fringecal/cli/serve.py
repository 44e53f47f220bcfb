"""`fringecal serve`: the history in the laboratory's browser, and a desk to check sessions and run commands on them."""

import contextlib
import secrets
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fringecal.cli.history import DB
from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.saving import demand_folder
from fringecal.errors import FringecalError, RecordError
from fringecal.serve import LOOPBACK, SANDBOX, STRANGERS_BYTES, Bounds, guard, web_server

if TYPE_CHECKING:
    import flask
    import pandas as pd

    from fringecal.history import Standing
    from fringecal.serve import Desk

HELP = """Show the history in a browser, and check and run sessions there.

Rigs, last audits, records, charts and reports; a session folder is dropped in, checked, and commissioned, verified or
audited with its progress shown. The printed address holds a token, without which nothing is written. Bound to this
machine; with another --host, which others can reach, the history is shown and nothing more. Stop it with Ctrl-C.
Needs the extra `serve`.

Example: fringecal serve --db history.db --port 8050
"""
_FORM_BYTES = 1 << 20  # names and fields beside the files of an upload
_FORM_PARTS = 1000  # more than the files that are taken, so that a few too many are told how many are
_WORDS = {
    404: "There is no such rig, record or file.",
    413: "More was sent than is taken; --most-files and --most-megabytes of fringecal serve allow more.",
}


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="serve", help=HELP)(serve)


def serve(
    db: str = DB,
    host: str = typer.Option(
        "127.0.0.1", "--host", help="Address to listen on; another than this machine's is public."
    ),
    port: int = typer.Option(8050, "--port", min=0, max=65535, help="Port; 0 for any that is free."),
    sessions: Path | None = typer.Option(None, "--sessions", help="Folder of session folders to choose from."),
    work: Path | None = typer.Option(None, "--work", help="Folder to keep uploads and results in; else a passing one."),
    most_files: int = typer.Option(Bounds.files, "--most-files", min=1, help="Most files of an upload."),
    most_megabytes: int = typer.Option(Bounds.megabytes, "--most-megabytes", min=1, help="Most megabytes of one."),
    as_json: bool = typer.Option(False, "--json", help="Print the address as one JSON document."),
) -> None:
    """Open the history, serve it until interrupted."""
    with _work_folder(work) as folder:
        desk = _desk(db, folder, sessions, Bounds(most_files, most_megabytes)) if host in LOOPBACK else None
        token = desk.token if desk else secrets.token_urlsafe(32)
        app = dashboard(db, host, desk)
        most_bytes = app.config["MAX_CONTENT_LENGTH"] + _FORM_BYTES if desk else STRANGERS_BYTES
        server = web_server(app, host, port, token=token, most_bytes=most_bytes)
        _print(host, server.effective_port, desk.token if desk else "", as_json)
        try:
            with _ended_by_signal(), contextlib.suppress(KeyboardInterrupt):
                server.run()
        finally:
            if desk:
                desk.runs.close()
            server.close()


@contextlib.contextmanager
def _work_folder(work: Path | None) -> Iterator[Path]:
    """Lend the folder named, or one that is removed with everything in it."""
    if work is None:
        with tempfile.TemporaryDirectory(prefix="fringecal-", ignore_cleanup_errors=True) as folder:
            yield Path(folder)
    else:
        demand_folder(work)
        work.mkdir(parents=True, exist_ok=True)
        yield work.absolute()


@contextlib.contextmanager
def _ended_by_signal() -> Iterator[None]:
    """Take a request to end as Ctrl-C, so that what runs is stopped and passing folders are removed."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield  # Python lets the main thread alone choose
        return
    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _desk(db: str, work: Path, sessions: Path | None, bounds: Bounds) -> "Desk":
    from fringecal.serve import Desk, Runs

    if sessions is not None and not sessions.is_dir():
        raise FringecalError(
            f"--sessions {sessions}: a folder was needed, there is none; name the one above your sessions"
        )
    return Desk(db, work, secrets.token_urlsafe(32), Runs(work), root=sessions, bounds=bounds)


def _print(host: str, port: int, token: str, as_json: bool) -> None:
    """Print where the pages are."""
    address = f"http://{f'[{host}]' if ':' in host else host}:{port}/"
    if token:
        address += f"?token={token}"
    if as_json:
        print_json({"format": "fringecal-serve/1", "address": address})
        sys.stdout.flush()  # a program waits for it
        return
    console.print(f"{address}  (Ctrl-C stops it)", markup=False, highlight=False, soft_wrap=True)
    if host not in LOOPBACK:
        console.print("Other machines can read this history; nothing is run here.", style="bold yellow", markup=False)


def dashboard(db: str, host: str = "127.0.0.1", desk: "Desk | None" = None) -> "flask.Flask":
    """Make the application over a history.

    Parameters
    ----------
    db
        SQLite file or URL; it is opened for every page, so that a page shows what is there now.
    host
        Address that it listens on. On loopback, requests under other names are refused: a page of another site could
        otherwise let a browser read the history under a name of its own.

    Raises
    ------
    FringecalError
        Flask is not installed.
    HistoryError
        There is no such history.
    """
    from fringecal.history import open_history

    try:
        import flask
    except ImportError as error:
        raise FringecalError("Flask is not installed; pip install 'fringecal[serve]'") from error
    open_history(db, create=False).close()
    app = flask.Flask("fringecal", static_folder=None)
    app.url_map.merge_slashes = False  # a name that begins with a slash is wrong, not to be mended

    guard(app, host, desk.token if desk else secrets.token_urlsafe(32))
    if desk:
        from fringecal.serve import desk_pages

        app.config.update(
            MAX_CONTENT_LENGTH=desk.bounds.megabytes * 10**6 + _FORM_BYTES,
            MAX_FORM_PARTS=_FORM_PARTS + desk.bounds.files,
        )
        app.register_blueprint(desk_pages(desk))
    _routes(app, db, "/sessions" if desk else "")
    return app


def _routes(app: "flask.Flask", db: str, desk: str) -> None:
    import flask

    from fringecal.history import open_history
    from fringecal.report import message_page, rig_page, rigs_page

    @app.get("/")
    def rigs() -> str:
        with open_history(db, create=False) as history:
            entries, readings, name = history.entries(), history.readings(), history.name
        standings = {str(rig): _standing(readings[readings["rig"] == rig]) for rig in set(entries["rig"])}
        return rigs_page(entries, name, standings, now=datetime.now(UTC), desk=desk)

    # Names of rigs are free text: as a query they may hold slashes.
    @app.get("/rig")
    def one() -> str:
        rig = flask.request.args.get("name", "")
        entries = _entries(db, rig)
        with open_history(db, create=False) as history:
            standing = _standing(history.readings(rig))
        return rig_page(rig, entries, standing, now=datetime.now(UTC))

    @app.get("/report")
    def report() -> "flask.Response":
        return _scripted(_report(db, flask.request.args.get("name", "")))

    @app.get("/record/<sha256>")
    def record(sha256: str) -> str:
        return _record(db, sha256)

    @app.get("/record/<sha256>.json")
    def record_text(sha256: str) -> "flask.Response":
        return flask.Response(_document(db, sha256), mimetype="application/json")

    @app.get("/compare")
    def compare() -> str:
        return _comparison(db, *(flask.request.args.get(key, "") for key in ("first", "second")))

    @app.errorhandler(Exception)
    def refuse(error: Exception) -> tuple[str, int]:
        code = int(getattr(error, "code", None) or (400 if isinstance(error, RecordError) else 500))
        if code == 500 and not isinstance(error, FringecalError):
            app.logger.error("a page failed", exc_info=error)
        told = str(error) if isinstance(error, FringecalError) else _WORDS.get(code, "This page cannot be shown.")
        return message_page("Not available", told), code


def _scripted(report: str) -> "flask.Response":
    """Answer with a report, whose own scripts run as those of a page of no site."""
    import flask

    return flask.Response(report, mimetype="text/html", headers={"Content-Security-Policy": SANDBOX})


def _document(db: str, sha256: str) -> str:
    import flask

    from fringecal.history import open_history

    with open_history(db, create=False) as history:
        text = history.document(sha256)
    if text is None:
        flask.abort(404)
    return text


def _standing(readings: "pd.DataFrame") -> "Standing":
    from fringecal.history import reviews_of, standing_of

    return standing_of(reviews_of(readings) if len(readings) else ())


def _record(db: str, sha256: str) -> str:
    """Show one record, also one that was corrected since: a link to it may be old."""
    import flask

    from fringecal.history import open_history
    from fringecal.report import record_page

    with open_history(db, create=False) as history:
        entries, text = history.entries(superseded=True), history.document(sha256)
        found = entries[entries["sha256"] == sha256].to_dict("records")
        if not found:
            flask.abort(404)
        readings = history.readings(str(found[0]["rig"]), superseded=True)
    return record_page(found[0], readings[readings["sha256"] == sha256], text)


def _comparison(db: str, first: str, second: str) -> str:
    from fringecal.records import parse_calibration
    from fringecal.report import render_html
    from fringecal.workflows.compare import comparison_report

    both = [parse_calibration(_document(db, one), name=f"record {one[:12]}") for one in (first, second)]
    return render_html(comparison_report(both[0], both[1], created=datetime.now(UTC)))


def _entries(db: str, rig: str) -> Any:
    import flask

    from fringecal.history import open_history

    with open_history(db, create=False) as history:
        entries = history.entries(rig)
    if entries.empty:
        flask.abort(404)
    return entries


def _report(db: str, rig: str) -> str:
    from fringecal.history import open_history, reviews_of
    from fringecal.report import render_html
    from fringecal.workflows.history import history_report

    entries = _entries(db, rig)
    with open_history(db, create=False) as history:
        readings = history.readings(rig)
    return render_html(history_report(rig, entries, reviews_of(readings), created=datetime.now(UTC)))
