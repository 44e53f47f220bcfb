"""Pages of the dashboard on which a session folder comes in, is checked, and is run with its progress shown."""

import json
import os
import secrets
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from fringecal.report import REPORT_FILE
from fringecal.serve.access import SANDBOX, Refused, demand_reader, page_policy
from fringecal.serve.desk import Desk, calibrations, ending, start
from fringecal.serve.runs import Run
from fringecal.serve.uploads import SUFFIXES, receive

if TYPE_CHECKING:
    import flask

    from fringecal.report import RunParts, Seal


def desk_pages(desk: Desk) -> "flask.Blueprint":
    """Make the pages of the desk; all of them are for readers who hold the token.

    Parameters
    ----------
    desk
        What they work with.
    """
    import flask

    pages = flask.Blueprint("desk", __name__)

    @pages.before_request
    def admit() -> None:
        if flask.request.method == "GET":
            demand_reader(desk.token)

    @pages.after_request
    def keep_private(response: "flask.Response") -> "flask.Response":
        response.headers["Cache-Control"] = "no-store"
        return response

    _session_routes(pages, desk)
    _run_routes(pages, desk)
    return pages


def _session_routes(pages: "flask.Blueprint", desk: Desk) -> None:
    import flask

    from fringecal.report import session_page, sessions_page

    @pages.get("/sessions")
    def sessions() -> "flask.Response":
        lists = ([(o.key, o.label) for o in list(desk.opened.values())[::-1]], _titles(desk.runs.newest_first()))
        limits = (desk.bounds.files, desk.bounds.megabytes, SUFFIXES)
        return _shown(desk, lambda seal: sessions_page(seal, limits, sorted(desk.offered()), *lists))

    @pages.post("/sessions")
    def upload() -> Any:
        files = [(part.filename or "", part.stream) for part in flask.request.files.getlist("files")]
        folder = desk.work / f"session-{secrets.token_hex(8)}"
        receive(files, folder, desk.bounds)  # type: ignore[arg-type]  # werkzeug's streams are binary files
        return _go(f"/sessions/{desk.open(folder, _label([name for name, _ in files])).key}")

    @pages.post("/sessions/open")
    def open_named() -> Any:
        name = flask.request.form.get("folder", "")
        folder = desk.offered().get(name)
        if folder is None:
            raise Refused(f"there is no session folder {name[:120]!r} below the one given by --sessions", 404)
        return _go(f"/sessions/{desk.open(folder, name).key}")

    @pages.get("/sessions/<key>")
    def session(key: str) -> "flask.Response":
        opened = desk.session(key)
        outcome = desk.check(opened)
        choices = calibrations(desk, outcome.rig) if outcome.rig is not None else []
        return _shown(desk, lambda seal: session_page(seal, opened.key, opened.label, outcome, choices))

    @pages.post("/sessions/<key>/run")
    def begin(key: str) -> Any:
        return _go(f"/runs/{start(desk, desk.session(key), flask.request.form.to_dict()).key}")


def _run_routes(pages: "flask.Blueprint", desk: Desk) -> None:
    import flask

    from fringecal.report import run_page

    @pages.get("/runs/<key>")
    def run(key: str) -> "flask.Response":
        one = desk.runs.named(key)
        return _shown(desk, lambda seal: run_page(seal, _parts(one), one.lines[:], ending(one)))

    @pages.get("/runs/<key>/progress")
    def progress(key: str) -> "flask.Response":
        first = max(0, flask.request.args.get("from", 0, type=int))
        last = flask.request.headers.get("Last-Event-ID", type=int)
        events = _events(desk.runs.named(key), first if last is None else max(0, last + 1))
        if not desk.watchers.acquire(blocking=False):
            raise Refused("As many pages as can be follow a run already; close one.", 503)
        response = flask.Response(events, mimetype="text/event-stream")
        response.call_on_close(desk.watchers.release)
        return response

    @pages.post("/runs/<key>/stop")
    def stop(key: str) -> Any:
        desk.runs.cancel(desk.runs.named(key))
        return _go(f"/runs/{key}")

    @pages.get("/runs/<key>/files/<path:name>")
    def result(key: str, name: str) -> "flask.Response":
        # Joined safely by Flask: what does not lie below the folder of the results is not found.
        folder = desk.runs.named(key).out.absolute()
        response = flask.send_from_directory(folder, name, as_attachment=name != REPORT_FILE)
        response.headers["Content-Security-Policy"] = SANDBOX
        return response


def _shown(desk: Desk, page: Callable[["Seal"], str]) -> "flask.Response":
    """Render a page that runs its own script, and may write."""
    import flask

    from fringecal.report import Seal

    nonce = secrets.token_urlsafe(16)
    headers = {"Content-Security-Policy": page_policy(nonce)}
    return flask.Response(page(Seal(nonce, desk.token)), mimetype="text/html", headers=headers)


def _go(place: str) -> Any:
    """Send the reader on; a script is told where."""
    import flask

    if flask.request.accept_mimetypes.best == "application/json":
        return {"location": place}, 201
    return flask.redirect(place, 303)


def _label(names: list[str]) -> str:
    """Call a session by the folder that all its files came in, if they came in one."""
    folder, slash, _ = os.path.commonprefix(names).partition("/")
    return folder if slash else "session"


def _titles(runs: tuple[Run, ...]) -> list[tuple[str, str]]:
    return [(run.key, f"{run.title}: {'under way' if run.code is None else 'ended'}") for run in runs]


def _parts(run: Run) -> "RunParts":
    from fringecal.report import RunParts

    return RunParts(run.key, run.title, run.session, run.started)


def _events(run: Run, start: int) -> Iterator[str]:
    """Lines of a run as server-sent events, and its end."""
    yield ": here they come\n\n"  # the browser knows at once that it is connected
    for numbered in run.follow(start):
        if numbered is None:
            yield ": still at it\n\n"
        else:
            number, line = numbered
            yield f"id: {number}\nevent: line\ndata: {json.dumps(line)}\n\n"
    yield f"event: end\ndata: {run.code}\n\n"
