"""The server in front of the dashboard: waitress, with limits on who may hold how many connections for how long."""

import hmac
import os
import select
import socket
import sys
import time
from collections.abc import Callable, Sequence
from http.cookies import CookieError, SimpleCookie
from typing import Any

from fringecal.errors import FringecalError
from fringecal.serve.access import TOKEN_HEADER

# A browser opens six connections to one address; the desk is for one person, the history for a laboratory.
MOST_CONNECTIONS = 64
THREADS = 16  # pages made at one time; a run's progress holds one as long as it is watched
HEADER_S = 15.0  # within which a request's header must be there, sent at once by every browser
REQUEST_S = 900.0  # within which the whole request must be there: 1 GB at 10 Mbit/s
IDLE_S = 30.0  # without a byte, after which a connection is closed
_TURN_S = 1.0  # of waiting for something to happen
_LOOK_EVERY_S = 2  # for connections that have had their time
STRANGERS_BYTES = 1 << 16  # of a request's body without the token: a form's fields
_HEADER_BYTES = 1 << 16
_MEMORY_BYTES = 1 << 19  # of a request's body; what is larger waits in a file without a name


def web_server(app: Any, host: str, port: int, *, token: str, most_bytes: int) -> Any:
    """Make a server that listens; `run` serves until interrupted or told to `end`, `close` lets go of the address.

    Beyond `MOST_CONNECTIONS` a new connection takes the place of the oldest that has not sent a whole request. A large
    body is taken only from who sends the token along with its header, before any of it is read.

    Parameters
    ----------
    app
        The application (WSGI).
    host, port
        Where to listen; port 0 for any that is free, then found as `effective_port`.
    token
        Secret of the server.
    most_bytes
        Of a request's body.

    Raises
    ------
    FringecalError
        Waitress is not installed, or that address cannot be listened on.
    """
    try:
        from waitress.adjustments import Adjustments
    except ImportError as error:
        raise FringecalError("waitress is not installed; pip install 'fringecal[serve]'") from error
    limits = Adjustments(
        threads=THREADS,
        connection_limit=4 * MOST_CONNECTIONS,
        channel_timeout=int(IDLE_S),
        cleanup_interval=_LOOK_EVERY_S,
        max_request_header_size=_HEADER_BYTES,
        max_request_body_size=most_bytes,
        inbuf_overflow=_MEMORY_BYTES,
        ident="fringecal",
        asyncore_use_poll=hasattr(select, "poll"),
        sockets=[],
    )
    # Made here, since waitress leaves one open that it could not bind.
    listening = _listening(host, port)
    address = (listening.family, listening.type, listening.proto, listening.getsockname())
    server = _server_class(token)(logged(app), adj=limits, _sock=listening, sockinfo=address, bind_socket=False)
    server.effective_port = address[3][1]  # a number: waitress has it as a text
    return server


def _listening(host: str, port: int) -> socket.socket:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        found = socket.socket(family, socket.SOCK_STREAM)
        try:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, os.name == "posix")
            found.bind((host, port))
            found.listen()
        except BaseException:
            found.close()
            raise
    except (OSError, ValueError, OverflowError) as error:
        raise FringecalError(f"{host}:{port} cannot be listened on ({error}); name another --port") from error
    return found


def _server_class(token: str) -> Any:
    """Make a server that closes connections which have had their time, and can be told to end."""
    from waitress.server import TcpWSGIServer

    class Server(TcpWSGIServer):  # type: ignore[misc]  # not typed
        channel_class = _channel_class(token)
        running = True

        def handle_accept(self) -> None:
            super().handle_accept()
            _make_room([*self.active_channels.values()])

        def maintenance(self, now: float) -> None:
            super().maintenance(now)
            _close_late([*self.active_channels.values()], now)

        def run(self) -> None:
            while self.running:
                self.asyncore.loop(timeout=_TURN_S, map=self._map, use_poll=self.adj.asyncore_use_poll, count=1)

        def end(self) -> None:
            self.running = False
            self.pull_trigger()

        def close(self) -> None:
            self.task_dispatcher.shutdown(timeout=_TURN_S)
            for channel in list(self.active_channels.values()):
                channel.handle_close()
            super().close()

    return Server


def _make_room(channels: Sequence[Any]) -> None:
    """Close the oldest connection that waits for its request where there are too many; not the one that just came."""
    waiting = sorted((one for one in channels if not one.requests), key=lambda one: one.began)[:-1]
    if len(channels) > MOST_CONNECTIONS and waiting:
        min(waiting, key=_worth).will_close = True


def _close_late(channels: Sequence[Any], now: float) -> None:
    for channel in channels:
        if channel.is_late(now):
            channel.will_close = True


def _worth(channel: Any) -> tuple[bool, float]:
    """Order connections: whose request bears the token is worth more, else the older is worth less."""
    return channel.request is not None and channel.request.is_known, channel.began


def logged(app: Callable[..., Any]) -> Callable[..., Any]:
    """Have requests written to standard error: method, path and status, not the query, which may hold the token."""

    def answer(environment: dict[str, Any], start: Callable[..., Any]) -> Any:
        def told(status: str, *rest: Any) -> Any:
            path = ascii(environment.get("PATH_INFO", ""))[1:-1]
            sys.stderr.write(f"{environment['REMOTE_ADDR']} {environment['REQUEST_METHOD']} {path} {status}\n")
            return start(status, *rest)

        return app(environment, told)

    return answer


def _channel_class(token: str) -> type:
    """Make a connection that knows since when its request comes in, and who sends it."""
    from waitress.channel import HTTPChannel
    from waitress.parser import HTTPRequestParser, ParsingError

    class Request(HTTPRequestParser):  # type: ignore[misc]  # not typed
        is_known = False

        def parse_header(self, header_plus: bytes) -> None:
            super().parse_header(header_plus)
            self.is_known = bears_token(self.headers.get, token)
            is_large = self.chunked or self.content_length > STRANGERS_BYTES
            if is_large and not self.is_known:
                raise ParsingError("so much is taken only with the token that fringecal serve printed")

    class Channel(HTTPChannel):  # type: ignore[misc]  # not typed
        parser_class = Request

        def __init__(self, *arguments: Any, **options: Any) -> None:
            self.began = time.time()
            super().__init__(*arguments, **options)

        def received(self, data: bytes) -> Any:
            if self.request is None:
                self.began = time.time()
            return super().received(data)

        def is_late(self, now: float) -> bool:
            request = self.request
            if request is not None:
                return now - self.began > (REQUEST_S if request.headers_finished else HEADER_S)
            # Who does not take its answer holds the thread that makes it.
            return bool(self.total_outbufs_len) and now - self.last_activity > IDLE_S

    return Channel


def bears_token(header: Callable[[str, str], str], token: str) -> bool:
    """Whether the headers of a request, asked for by WSGI's names, hold the token, as a header or a cookie."""
    given = [header(TOKEN_HEADER.upper().replace("-", "_"), "")]
    try:
        given += [morsel.value for morsel in SimpleCookie(header("COOKIE", "")).values()]
    except CookieError:
        return False
    return any(hmac.compare_digest(one.encode(), token.encode()) for one in given)
