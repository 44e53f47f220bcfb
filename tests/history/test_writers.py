"""Many writers at once, and writers that are killed: all rows, whole rows, on SQLite and on a real PostgreSQL."""

import multiprocessing
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from fringecal.history.store import open_history

from .writers import READINGS_EACH, append_for_ever, append_many

WRITERS, ROWS = 8, 500
BATCH = int(os.environ.get("FRINGECAL_BATCH", "20"))  # entries in a transaction; 1 takes a minute
KILLS = int(os.environ.get("FRINGECAL_KILLS", "25"))  # 200 take a minute
PATIENCE_S = 300


@pytest.fixture(scope="module")
def context():
    """Processes forked from a clean one that has everything loaded, so that each starts in milliseconds."""
    if sys.platform == "win32":
        pytest.skip("no fork server")
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(["fringecal.history.store", "tests.history.writers"])
    return server


def run_writers(context, where, rows):
    """Let all writers start on the same database at once, none of which may exist yet, and check its content."""
    writers = [context.Process(target=append_many, args=(where, number, rows, BATCH)) for number in range(WRITERS)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join(PATIENCE_S)
    assert [writer.exitcode for writer in writers] == [0] * WRITERS
    with open_history(where, create=False) as history:
        assert len(history.entries()) == WRITERS * rows
        per_rig = history.entries().groupby("rig").size()
        assert per_rig.to_dict() == {f"rig {number}": rows for number in range(WRITERS)}
        assert len(history.readings()) == WRITERS * rows * READINGS_EACH


def test_eight_writers_on_sqlite(context, tmp_path):
    run_writers(context, str(tmp_path / "h.db"), ROWS)


def test_killed_writers_leave_whole_entries_only(context, tmp_path):
    where, chance = str(tmp_path / "h.db"), random.Random(7)
    before = 0
    for kill in range(KILLS):
        opened = context.Event()
        writer = context.Process(target=append_for_ever, args=(where, kill, opened))
        writer.start()
        if kill % 5:  # the others die while they start, or while they make the database
            assert opened.wait(PATIENCE_S)
        time.sleep(chance.uniform(0.0, 0.04))
        os.kill(writer.pid, signal.SIGKILL)
        writer.join(PATIENCE_S)
        assert writer.exitcode == -signal.SIGKILL
        with open_history(where) as history:
            entries, readings = history.entries(), history.readings()
        assert len(entries) >= before
        assert len(readings) == READINGS_EACH * len(entries)
        before = len(entries)
    assert before > 0


def postgresql_binaries() -> Path | None:
    """Find a PostgreSQL server: on the path, or where Debian puts it."""
    found = shutil.which("initdb")
    places = [Path(found).resolve().parent] if found else sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    return next((place for place in reversed(places) if (place / "postgres").exists()), None)


def unprivileged() -> dict[str, int]:
    """Whom the server runs as, in the words of `subprocess`: it refuses to run as a superuser."""
    if os.geteuid() != 0:
        return {}
    import pwd  # Unix alone has it

    users = {user.pw_name: user for user in pwd.getpwall()}
    chosen = next(users[name] for name in ("postgres", "nobody") if name in users)
    return {"user": chosen.pw_uid, "group": chosen.pw_gid}


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@pytest.fixture(scope="module")
def postgresql():
    """A server of our own on a free loopback port, as a user that PostgreSQL accepts.

    Its folder is not pytest's: that one only its owner may enter, and a socket's path must stay below 108 characters.
    """
    pytest.importorskip("pg8000", reason="no driver for PostgreSQL: install the extra `postgresql`")
    binaries = postgresql_binaries()
    if binaries is None:
        pytest.skip("no PostgreSQL server here: install one (Debian: apt-get install postgresql)")
    user, port = unprivileged(), free_port()
    with tempfile.TemporaryDirectory(prefix="fringecal-", dir="/tmp") as place:
        folder = Path(place)
        if user:
            shutil.chown(folder, **user)
        start = [binaries / "pg_ctl", "-D", folder / "data", "-w", "-l", folder / "log"]
        options = f"-p {port} -c listen_addresses=127.0.0.1 -k {folder} -c fsync=off"
        make = [binaries / "initdb", "-D", folder / "data", "-A", "trust", "-U", "lab", "-E", "UTF8", "--no-locale"]
        for command in (make, [*start, "-o", options, "start"]):
            subprocess.run(command, stdout=subprocess.DEVNULL, timeout=PATIENCE_S, cwd=folder, check=True, **user)
        yield f"postgresql://lab@127.0.0.1:{port}/postgres"
        stop = [*start, "-m", "immediate", "stop"]
        subprocess.run(stop, stdout=subprocess.DEVNULL, timeout=PATIENCE_S, cwd=folder, check=True, **user)


def test_eight_writers_on_postgresql(context, postgresql):
    run_writers(context, postgresql, ROWS)


def test_postgresql_refuses_changes_and_repeats(postgresql):
    import sqlalchemy as sa

    from .conftest import make_entry

    with open_history(postgresql) as history:
        assert [history.append([make_entry(1, rig="pg")]) for _ in range(2)] == [1, 0]
        assert list(history.readings("pg", "q3")["value"]) == [1.375]
        with pytest.raises(sa.exc.DBAPIError, match="append-only"), history._engine.begin() as connection:
            connection.exec_driver_sql("UPDATE readings SET value = 0")
