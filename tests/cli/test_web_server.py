"""The dashboard's server under attack: slow and many connections, large bodies of strangers, a kill without warning."""

import contextlib
import os
import socket
import threading
import time
import urllib.request

import pytest

from fringecal.errors import FringecalError
from fringecal.history.store import open_history

pytest.importorskip("flask", reason="the extra serve is not installed")
pytest.importorskip("waitress", reason="the extra serve is not installed")

from fringecal.serve.waitress_server import MOST_CONNECTIONS, bears_token, web_server  # noqa: E402

TOKEN = "secret-of-this-test"


def application(environment, start):
    """Answer with how long the body was; `/flood` answers with more than a socket holds."""
    body = environment["wsgi.input"].read()
    start("200 OK", [("Content-Type", "text/plain")])
    if environment["PATH_INFO"] == "/flood":
        return (b"x" * (1 << 20) for _ in range(200))
    return [str(len(body)).encode()]


@contextlib.contextmanager
def running(monkeypatch, **limits):
    for name, value in limits.items():
        monkeypatch.setattr(f"fringecal.serve.waitress_server.{name}", value)
    server = web_server(application, "127.0.0.1", 0, token=TOKEN, most_bytes=10_000_000)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        yield server.effective_port
    finally:
        server.end()
        thread.join(10)
        server.close()


@contextlib.contextmanager
def connected(port, sent=b""):
    with socket.create_connection(("127.0.0.1", port), timeout=10) as one:
        with contextlib.suppress(ConnectionError):  # what was refused early
            one.sendall(sent)
        yield one


def asked(port, path="/") -> bytes:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=10) as answer:
        return answer.read()


SLOW = {
    "nothing sent": b"",
    "half a header": b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Slow: ",
    "a header and half a body": b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 60000\r\n\r\nx",
}


@pytest.mark.parametrize("kind", SLOW)
def test_many_slow_connections_leave_room_for_others(monkeypatch, kind):
    upload = f"POST / HTTP/1.1\r\nHost: localhost\r\nX-Fringecal-Token: {TOKEN}\r\nContent-Length: 9\r\n\r\nx".encode()
    with running(monkeypatch) as port, connected(port, upload) as known, contextlib.ExitStack() as held:
        for _ in range(3 * MOST_CONNECTIONS):
            held.enter_context(connected(port, SLOW[kind]))
        began = time.monotonic()
        assert asked(port) == b"0"
        assert time.monotonic() - began < 5
        known.sendall(b"x" * 8)  # whom the server knows keeps the place
        assert known.recv(1 << 16).startswith(b"HTTP/1.1 200 ")


def test_a_header_that_trickles_in_has_its_time(monkeypatch):
    with running(monkeypatch, HEADER_S=0.5, _LOOK_EVERY_S=1) as port, connected(port, b"GET / HTTP/1.1\r\n") as slow:
        until = time.monotonic() + 8
        with contextlib.suppress(ConnectionError):
            while time.monotonic() < until:
                slow.sendall(b"X-More: 1\r\n")  # each is activity
                time.sleep(0.1)
        assert time.monotonic() < until


def test_who_does_not_take_the_answer_is_left(monkeypatch):
    asks = b"GET /flood HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with running(monkeypatch, IDLE_S=1, _LOOK_EVERY_S=1) as port, connected(port, asks) as deaf:
        time.sleep(4)
        count = 0
        with contextlib.suppress(ConnectionError):
            while data := deaf.recv(1 << 20):
                count += len(data)
        assert count < 200 << 20
        assert asked(port) == b"0"


@pytest.mark.parametrize(
    ("headers", "code"),
    [
        ("", 400),
        ("X-Fringecal-Token: wrong\r\n", 400),
        ("Cookie: fringecal-8050=wrong\r\n", 400),
        (f"X-Fringecal-Token: {TOKEN}\r\n", 200),
        (f"Cookie: a=b; fringecal-8050={TOKEN}\r\n", 200),
    ],
)
def test_a_large_body_is_taken_with_the_token_alone(monkeypatch, headers, code):
    head = f"POST / HTTP/1.1\r\nHost: localhost\r\n{headers}Content-Length: 100000\r\n\r\n"
    with running(monkeypatch) as port, connected(port, head.encode()) as one:
        if code == 200:
            one.sendall(bytes(100_000))
        assert one.recv(1 << 16).startswith(f"HTTP/1.1 {code} ".encode())  # 400 before any of the body was sent


def test_a_body_without_a_length_and_one_too_large_are_refused(monkeypatch):
    with running(monkeypatch) as port:
        for head, code in (
            ("Transfer-Encoding: chunked\r\n", b"400"),
            (f"X-Fringecal-Token: {TOKEN}\r\nContent-Length: 10000001\r\n", b"413"),
        ):
            with connected(port, f"POST / HTTP/1.1\r\nHost: localhost\r\n{head}\r\n".encode()) as one:
                assert one.recv(1 << 16).split(b" ")[1] == code


def test_a_header_without_end_is_refused(monkeypatch):
    with running(monkeypatch) as port, connected(port, b"GET / HTTP/1.1\r\nX: " + b"x" * 70_000) as one:
        assert b" 431 " in one.recv(1 << 16)


def test_an_address_that_is_taken_is_said(monkeypatch):
    with running(monkeypatch) as port, pytest.raises(FringecalError, match="another --port"):
        web_server(application, "127.0.0.1", port, token=TOKEN, most_bytes=1)


def test_the_log_holds_no_token(monkeypatch, capfd):
    with running(monkeypatch) as port:
        asked(port, f"/sessions?token={TOKEN}")
    said = capfd.readouterr().err
    assert "GET /sessions 200" in said
    assert TOKEN not in said


def test_tokens_in_odd_headers():
    assert not bears_token({"COOKIE": "\x00=; ;;=,\x7f"}.get, TOKEN)
    assert not bears_token({"COOKIE": "a=wröng"}.get, TOKEN)
    assert not bears_token({}.get, TOKEN)


# ---- a history's password ---------------------------------------------------------------------------
def test_a_history_is_named_by_the_environment_or_a_file(tmp_path, monkeypatch):
    open_history(tmp_path / "h.db").close()
    (tmp_path / "url").write_text(f"{tmp_path / 'h.db'}\n")
    monkeypatch.setenv("PLACE", str(tmp_path / "h.db"))
    for where in ("env:PLACE", f"file:{tmp_path / 'url'}"):
        with open_history(where, create=False) as history:
            assert history.name == str(tmp_path / "h.db")
    for where, what in (("env:NOWHERE", "no environment variable NOWHERE"), (f"file:{tmp_path}", "holds the URL")):
        with pytest.raises(FringecalError, match=what):
            open_history(where)


def test_a_run_does_not_show_the_password(tmp_path):
    from fringecal.serve.runs import Runs

    url = "postgresql://user:hidden@localhost/name"
    script = "import os, sys; print(os.environ['FRINGECAL_HISTORY'], sys.argv)"
    runs = Runs(tmp_path, ("python", "-S", "-c", script))
    run = runs.start("t", "s", lambda _: ["--history=env:FRINGECAL_HISTORY"], {"FRINGECAL_HISTORY": url})
    with run.changed:
        assert run.changed.wait_for(lambda: run.code is not None, 30)
    assert run.lines == [f"{url} ['-c', '--history=env:FRINGECAL_HISTORY']"]
    assert all("hidden" not in word for word in run.process.args)
    assert os.environ.get("FRINGECAL_HISTORY") != url
