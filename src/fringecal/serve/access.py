"""Who may do what over the dashboard's address: its own name, the token, and pages that run nothing of others."""

import hmac
from typing import TYPE_CHECKING, Any

from fringecal.errors import FringecalError

if TYPE_CHECKING:
    import flask

LOOPBACK = ("127.0.0.1", "localhost", "::1")
TOKEN_HEADER = "X-Fringecal-Token"
_READING = ("GET", "HEAD", "OPTIONS")
_NO_SCRIPT = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)
# A report has scripts of its own, for maps and surfaces: it runs them as a page of no site, which can ask for nothing.
SANDBOX = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'"
)


class Refused(FringecalError):
    """A request that is not carried out; `code` is its HTTP status."""

    def __init__(self, words: str, code: int = 400) -> None:
        self.code = code
        super().__init__(words)


def guard(app: "flask.Flask", host: str, token: str) -> None:
    """Let nothing in that does not come from the dashboard's own pages.

    Every request must name this machine where `host` is on loopback, so that no page of another site reads along under
    a name of its own (DNS rebinding). What writes must come from the same origin and bring the token, in a header or as
    a form's field.

    Parameters
    ----------
    app
        The application.
    host
        Address that it listens on.
    token
        Secret of this server; a reader who opens an address with ``?token=`` keeps it in a cookie.
    """
    import flask

    @app.before_request
    def admit() -> Any:
        request = flask.request
        if host in LOOPBACK and _name(request.host) not in LOOPBACK:
            raise Refused("Ask for this page under its own address.", 403)
        if request.method not in _READING:
            demand_token(token)
        elif "token" in request.args:
            return _keep_token(token)
        return None

    @app.after_request
    def harden(response: "flask.Response") -> "flask.Response":
        response.headers.setdefault("Content-Security-Policy", _NO_SCRIPT)
        response.headers["X-Content-Type-Options"] = "nosniff"
        # An Origin of "null" would say nothing: browsers send it where pages forbid every referrer.
        response.headers["Referrer-Policy"] = "same-origin"
        return response


def page_policy(nonce: str) -> str:
    """Content policy of a page that runs the one script that bears `nonce`, which may talk to this server alone."""
    return f"{_NO_SCRIPT}; script-src 'nonce-{nonce}'; connect-src 'self'"


def demand_reader(token: str) -> None:
    """Refuse readers of private pages who did not open the address with the token, nor send it as a header.

    Raises
    ------
    Refused
        With code 403.
    """
    import flask

    request = flask.request
    given = request.headers.get(TOKEN_HEADER) or request.cookies.get(_cookie(request.host), "")
    if not _same(given, token):
        raise Refused("Open the address that `fringecal serve` printed when it started: it holds a token.", 403)


def demand_token(token: str) -> None:
    """Refuse to write without the token, or on behalf of another site.

    A form's field is looked at only where the cookie is right: else anyone could have a large body read.

    Raises
    ------
    Refused
        With code 403.
    """
    import flask

    request = flask.request
    origin, site = request.headers.get("Origin"), request.headers.get("Sec-Fetch-Site", "same-origin")
    if (origin is not None and origin != f"http://{request.host}") or site != "same-origin":
        raise Refused("Another site asked for this; nothing was done.", 403)
    given = request.headers.get(TOKEN_HEADER)
    if given is None:
        demand_reader(token)
        given = request.form.get("token", "")
    if not _same(given, token):
        raise Refused("The token is wrong; open the address that `fringecal serve` printed when it started.", 403)


def _keep_token(token: str) -> "flask.Response":
    import flask

    request = flask.request
    if not _same(request.args["token"], token):
        raise Refused("This token is of another start; open the address that `fringecal serve` printed last.", 403)
    response = flask.redirect(request.path)
    response.set_cookie(_cookie(request.host), token, httponly=True, samesite="Strict")
    return response  # type: ignore[return-value]  # Flask states werkzeug's response, and makes its own


def _cookie(host: str) -> str:
    # Cookies of one machine are shared by all its ports: two dashboards must not take each other's.
    return f"fringecal-{host.rpartition(':')[2]}" if not host.endswith("]") else "fringecal-80"


def _name(host: str) -> str:
    return host.rsplit(":", 1)[0].strip("[]")


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())
