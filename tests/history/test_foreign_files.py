"""Databases of other programs stay as they are; a history is read where nothing can be written."""

import contextlib
import hashlib
import os
import random
import re
import shutil
import sqlite3
import tempfile
from pathlib import Path

import pytest
import sqlalchemy as sa

from fringecal.errors import HistoryError
from fringecal.history.history_tables import APPLICATION_ID, STEPS, migrate
from fringecal.history.store import open_history

from .conftest import make_entry


def made(path: Path, *statements: str) -> Path:
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        for statement in statements:
            connection.execute(statement)
    return path


def state(folder: Path) -> dict[str, str]:
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(folder.iterdir())}


FOREIGN = {
    "tables of its own": ["CREATE TABLE photos (id INTEGER, place TEXT)", "INSERT INTO photos VALUES (1, 'x')"],
    "a number of its own": ["PRAGMA application_id = 252006673", "CREATE TABLE schema_version (version, applied)"],
    "a number and no table": ["PRAGMA application_id = 1"],
    "a table that is named as ours is": ["CREATE TABLE entries (id INTEGER, title TEXT)"],
    "a version in words": [
        "CREATE TABLE schema_version (version TEXT, applied TEXT)",
        "INSERT INTO schema_version VALUES ('three', 'x')",
    ],
    "all three names": [
        "CREATE TABLE schema_version (version INTEGER, applied TEXT)",
        "CREATE TABLE entries (id INTEGER, rig TEXT)",
        "CREATE TABLE readings (id INTEGER)",
    ],
    "ours and more": [
        "CREATE TABLE schema_version (version INTEGER, applied TEXT)",
        "CREATE TABLE entries (rig TEXT, captured TEXT, sha256 TEXT)",
        "CREATE TABLE readings (entry_id INTEGER, quantity TEXT, value REAL)",
        "CREATE TABLE more (id INTEGER)",
    ],
}


@pytest.mark.parametrize("create", [True, False])
@pytest.mark.parametrize("kind", FOREIGN)
def test_a_database_of_another_program_is_not_touched(tmp_path, kind, create):
    file = made(tmp_path / "other.db", *FOREIGN[kind])
    before = state(tmp_path)
    with pytest.raises(HistoryError, match=r"other\.db: the database (belongs to|holds tables of) another program"):
        open_history(file, create=create)
    assert state(tmp_path) == before


@pytest.mark.parametrize("create", [True, False])
def test_one_that_is_being_written_is_told_by_its_log(tmp_path, create):
    with contextlib.closing(sqlite3.connect(tmp_path / "other.db")) as writer:
        writer.execute("PRAGMA journal_mode=WAL")
        writer.execute("CREATE TABLE photos (id INTEGER)")
        writer.commit()
        before = state(tmp_path)
        assert before.keys() == {"other.db", "other.db-shm", "other.db-wal"}
        with pytest.raises(HistoryError, match="photos"):
            open_history(tmp_path / "other.db", create=create)
        assert {name: before[name] for name in ("other.db", "other.db-wal")} == {
            name: digest for name, digest in state(tmp_path).items() if name != "other.db-shm"
        }


def test_a_history_is_marked_and_reading_it_changes_nothing(tmp_path):
    with open_history(tmp_path / "h.db") as history:
        history.append([make_entry(1)])
    assert (tmp_path / "h.db").read_bytes()[68:72] == APPLICATION_ID.to_bytes(4) == b"FRNG"
    before = state(tmp_path)
    with open_history(tmp_path / "h.db", create=False) as history:
        assert len(history.readings()) == 12
        with pytest.raises(HistoryError, match="readonly"):
            history.append([make_entry(2)])
    assert state(tmp_path) == before


def test_an_older_history_is_read_as_it_is_and_marked_when_written(tmp_path):
    engine = sa.create_engine(f"sqlite:///{tmp_path / 'old.db'}")
    with engine.begin() as connection:
        migrate(connection, STEPS[:2])
        connection.exec_driver_sql(
            "INSERT INTO entries (appended, rig, kind, captured, created, decision, source, software, sha256) "
            "VALUES ('t', 'old rig', 'audit', 't', 't', 'pass', '', '', 'f')"
        )
    engine.dispose()
    before = state(tmp_path)
    with open_history(tmp_path / "old.db", create=False) as history:
        assert list(history.entries()["rig"]) == ["old rig"]
    assert state(tmp_path) == before
    open_history(tmp_path / "old.db").close()
    assert (tmp_path / "old.db").read_bytes()[68:72] == b"FRNG"


@pytest.mark.parametrize("content", [b"", b"SQLite format 3\0"])
def test_reading_what_is_empty_makes_no_history_of_it(tmp_path, content):
    (tmp_path / "h.db").write_bytes(content)
    with pytest.raises(HistoryError, match="no history in it|not a database|malformed"):
        open_history(tmp_path / "h.db", create=False)
    assert (tmp_path / "h.db").read_bytes() == content


def test_an_empty_database_becomes_a_history_only_for_a_writer(tmp_path):
    made(tmp_path / "h.db", "CREATE TABLE t (x)", "DROP TABLE t")
    before = state(tmp_path)
    with pytest.raises(HistoryError, match="no history in it"):
        open_history(tmp_path / "h.db", create=False)
    assert state(tmp_path) == before
    open_history(tmp_path / "h.db").close()
    open_history(tmp_path / "h.db", create=False).close()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for create in (True, False):
        with pytest.raises(HistoryError, match="a file was needed"):
            open_history(tmp_path / "pipe", create=create)


@contextlib.contextmanager
def nothing_may_be_written(folder: Path):
    """Take the right to write from a folder, and from the superuser who runs this; the folder is given back."""
    for file in folder.iterdir():
        file.chmod(0o444)
    folder.chmod(0o555)
    superuser = hasattr(os, "geteuid") and os.geteuid() == 0
    if superuser:
        os.seteuid(65534)
    try:
        yield
    finally:
        if superuser:
            os.seteuid(0)
        folder.chmod(0o755)


@pytest.fixture
def folder():
    """A folder that others than its owner may enter too, which pytest's own are not."""
    with tempfile.TemporaryDirectory() as place:
        Path(place).chmod(0o755)
        yield Path(place)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="rights work otherwise here")
@pytest.mark.parametrize("with_log", [False, True])
def test_a_history_on_a_medium_that_cannot_be_written_is_read(folder, tmp_path, with_log):
    with open_history(tmp_path / "h.db") as history:
        history.append([make_entry(1)])
        with history._engine.connect() as connection:  # kept open, so that the log is not cleared away
            connection.exec_driver_sql("SELECT 1")
            for ending in ("", "-wal") if with_log else ():
                shutil.copyfile(tmp_path / f"h.db{ending}", folder / f"h.db{ending}")
    if not with_log:
        shutil.copyfile(tmp_path / "h.db", folder / "h.db")
    assert (folder / "h.db-wal").exists() == with_log
    before = state(folder)
    with nothing_may_be_written(folder):
        with open_history(folder / "h.db", create=False) as history:
            assert len(history.readings()) == 12
        with pytest.raises(HistoryError, match="h.db"), open_history(folder / "h.db") as history:
            history.append([make_entry(2)])
    assert state(folder) == before


@pytest.mark.parametrize(
    ("column", "value", "what"),
    [
        ("u", "=cmd()", "'=cmd()' as u"),
        ("value", b"\x00\xff", "as value"),
        ("value", float("inf"), "inf as value"),
        ("unit", b"mm", "as unit"),
    ],
)
def test_values_that_no_history_holds_are_refused(tmp_path, column, value, what):
    with open_history(tmp_path / "h.db") as history:
        history.append([make_entry(1)])
    with contextlib.closing(sqlite3.connect(tmp_path / "h.db")) as connection, connection:
        connection.execute("DROP TRIGGER no_update_of_readings")
        connection.execute(f"UPDATE readings SET {column} = ? WHERE id = 3", (value,))
    with open_history(tmp_path / "h.db", create=False) as history, pytest.raises(HistoryError, match=re.escape(what)):
        history.readings()


def test_a_damaged_file_is_refused_or_read(tmp_path):
    with open_history(tmp_path / "h.db") as history:
        history.append([make_entry(k) for k in range(1, 9)])
    content, draw = (tmp_path / "h.db").read_bytes(), random.Random(7)
    for number in range(60):
        damaged = bytearray(content)
        for _ in range(draw.choice([1, 8, 40])):
            damaged[draw.choice([draw.randrange(16, 9000), draw.randrange(16, len(content))])] = draw.randrange(256)
        file = tmp_path / f"damaged-{number}.db"
        file.write_bytes(damaged)
        with contextlib.suppress(HistoryError), open_history(file, create=False) as history:
            history.readings()
