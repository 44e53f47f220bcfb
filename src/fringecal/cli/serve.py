"""`fringecal serve`: a read-only page over the history, for the laboratory's browser."""

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import typer

from fringecal.cli.console import console, print_json
from fringecal.cli.history import DB
from fringecal.errors import FringecalError, RecordError

if TYPE_CHECKING:
    import flask

HELP = """Show the history in a browser: rigs, last audits, records, charts and reports.

Read only: nothing can be changed or uploaded. Bound to this machine unless --host says otherwise; stop it with Ctrl-C.
Needs the extra `serve`.

Example: fringecal serve --db history.db --port 8050
"""
LOOPBACK = ("127.0.0.1", "localhost", "::1")
_NO_SCRIPT = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'self'"


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="serve", help=HELP)(serve)


def serve(
    db: str = DB,
    host: str = typer.Option(
        "127.0.0.1", "--host", help="Address to listen on; another than this machine's is public."
    ),
    port: int = typer.Option(8050, "--port", min=0, max=65535, help="Port; 0 for any that is free."),
    as_json: bool = typer.Option(False, "--json", help="Print the address as one JSON document."),
) -> None:
    """Open the history, serve it until interrupted."""
    app = dashboard(db, host)
    from werkzeug.serving import make_server

    try:
        server = make_server(host, port, app, threaded=True)
    except (OSError, SystemExit) as error:
        raise FringecalError(f"{host}:{port} cannot be listened on ({error}); name another --port") from error
    address = f"http://{f'[{host}]' if ':' in host else host}:{server.server_port}/"
    if as_json:
        print_json({"format": "fringecal-serve/1", "address": address})
    else:
        console.print(f"{address}  (Ctrl-C stops it)", markup=False, highlight=False)
        if host not in LOOPBACK:
            console.print("Other machines can read this history.", style="bold yellow", markup=False)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        server.server_close()


def dashboard(db: str, host: str = "127.0.0.1") -> "flask.Flask":
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
    from fringecal.history.store import open_history

    try:
        import flask
    except ImportError as error:
        raise FringecalError("Flask is not installed; pip install 'fringecal[serve]'") from error
    open_history(db, create=False).close()
    app = flask.Flask("fringecal", static_folder=None)

    @app.before_request
    def demand_own_name() -> None:
        named = flask.request.host.rsplit(":", 1)[0].strip("[]")
        if host in LOOPBACK and named not in LOOPBACK:
            flask.abort(403)

    @app.after_request
    def harden(response: "flask.Response") -> "flask.Response":
        response.headers["Content-Security-Policy"] = _NO_SCRIPT
        response.headers["X-Content-Type-Options"] = "nosniff"
        return response

    _routes(app, db)
    return app


def _routes(app: "flask.Flask", db: str) -> None:
    import flask

    from fringecal.history.store import open_history
    from fringecal.report.dashboard import message_page, rig_page, rigs_page

    @app.get("/")
    def rigs() -> str:
        with open_history(db, create=False) as history:
            return rigs_page(history.entries(), history.name)

    # Names of rigs are free text: as a query they may hold slashes.
    @app.get("/rig")
    def one() -> str:
        rig = flask.request.args.get("name", "")
        return rig_page(rig, _entries(db, rig))

    @app.get("/report")
    def report() -> str:
        return _report(db, flask.request.args.get("name", ""))

    @app.get("/record/<sha256>")
    def record(sha256: str) -> "flask.Response":
        return flask.Response(_document(db, sha256), mimetype="application/json")

    @app.get("/compare")
    def compare() -> str:
        return _comparison(db, *(flask.request.args.get(key, "") for key in ("first", "second")))

    @app.errorhandler(Exception)
    def refuse(error: Exception) -> tuple[str, int]:
        code = int(getattr(error, "code", None) or (400 if isinstance(error, RecordError) else 500))
        words = {403: "Ask for this page under its own address.", 404: "There is no such rig or record."}
        told = str(error) if isinstance(error, FringecalError) else words.get(code, "This page cannot be shown.")
        return message_page("Not to be had", told), code


def _document(db: str, sha256: str) -> str:
    import flask

    from fringecal.history.store import open_history

    with open_history(db, create=False) as history:
        text = history.document(sha256)
    if text is None:
        flask.abort(404)
    return text


def _comparison(db: str, first: str, second: str) -> str:
    from fringecal.procedures.report_comparison import comparison_report
    from fringecal.records.calibration import parse_calibration
    from fringecal.report.html import render_html

    both = [parse_calibration(_document(db, one), name=f"record {one[:12]}") for one in (first, second)]
    return render_html(comparison_report(both[0], both[1], created=datetime.now(UTC)))


def _entries(db: str, rig: str) -> Any:
    import flask

    from fringecal.history.store import open_history

    with open_history(db, create=False) as history:
        entries = history.entries(rig)
    if entries.empty:
        flask.abort(404)
    return entries


def _report(db: str, rig: str) -> str:
    from fringecal.history.review import review_series, series_of
    from fringecal.history.store import open_history
    from fringecal.procedures.report_history import history_report
    from fringecal.report.html import render_html

    entries = _entries(db, rig)
    with open_history(db, create=False) as history:
        readings = history.readings(rig)
    reviews = [review_series(series_of(group)) for _, group in readings.groupby("quantity")]
    return render_html(history_report(rig, entries, reviews, created=datetime.now(UTC)))
