"""SQLite files: a history is told from what belongs to other programs before it is opened, and read without a trace."""

import os
import shutil
import sqlite3
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import sqlalchemy as sa
from sqlalchemy import Connection, Engine
from sqlalchemy.pool import StaticPool

from fringecal.errors import HistoryError
from fringecal.history.history_tables import (
    APPLICATION_ID,
    NONE_IN_IT,
    STEPS,
    demand_known,
    demand_ours,
    migrate,
    schema_version,
)

WAIT_S = 60.0  # how long a writer waits for the others
_MAGIC, _HEADER = b"SQLite format 3\0", 100  # of a database file (its format, 1.3): first bytes, and length
_AT_APPLICATION_ID = slice(68, 72)  # of the header, big-endian


def writer_engine(path: Path) -> Engine:
    """Open a file for writing, so that writers queue up and a killed process leaves whole transactions only.

    Raises
    ------
    HistoryError
        The file belongs to another program; it was not touched.
    """
    demand_history_file(path)
    engine = sa.create_engine(sa.URL.create("sqlite", database=str(path)), connect_args={"timeout": WAIT_S})
    _prepared(engine, "journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON")
    return engine


def reader_engine(path: Path) -> Engine:
    """Open a history for reading: nothing is written, and one on a medium that cannot be written is read as well.

    A history of an older version is brought up to date in memory.

    Raises
    ------
    HistoryError
        It is no history.
    """
    demand_history_file(path)
    engine = _engine_over(_opened(path))
    try:
        with engine.connect() as connection:
            found = schema_version(connection)
            demand_known(found)
            if found == 0:
                raise HistoryError(NONE_IN_IT)
            if found == len(STEPS):
                return engine
            copy = _in_memory(_driver_of(connection))
    except BaseException:
        engine.dispose()
        raise
    engine.dispose()
    engine = _engine_over(copy)
    with engine.connect().execution_options(fringecal_writes=True) as connection, connection.begin():
        migrate(connection)
    return engine


def _driver_of(connection: Connection) -> sqlite3.Connection:
    driver = connection.connection.driver_connection
    assert isinstance(driver, sqlite3.Connection)
    return driver


def demand_history_file(path: Path) -> None:
    """Refuse a file that is there and belongs to another program, without opening it as a database if that tells.

    Raises
    ------
    HistoryError
        As described.
    """
    try:
        there = os.stat(path)
    except OSError:
        return  # a new one, or what SQLite will say
    if not stat.S_ISREG(there.st_mode):
        raise HistoryError("a file was needed; this is something else")
    with open(path, "rb") as file:
        header = file.read(_HEADER)
    if not header:
        return
    if not header.startswith(_MAGIC):
        raise HistoryError("this is no SQLite file; name another")
    number = int.from_bytes(header[_AT_APPLICATION_ID])
    if number not in (0, APPLICATION_ID):
        raise HistoryError(f"the database belongs to another program (application_id {number}); name another")
    if number == 0:  # of an older version, or still in the log beside the file, or of somebody else
        _demand_tables(path)


def _demand_tables(path: Path) -> None:
    engine = _engine_over(_looked_at(path))
    try:
        with engine.connect() as connection:
            demand_ours(connection)
    finally:
        engine.dispose()


def _looked_at(path: Path) -> sqlite3.Connection:
    """Open a file to look at its tables, leaving nothing beside it; with its log, where there is one."""
    if _has_log(path) and _may_be_written(path.absolute().parent):
        return _connected(path, "mode=ro")
    return _as_it_is(path)


def _opened(path: Path) -> sqlite3.Connection:
    """Open a history so that other programs may write meanwhile; else as it is."""
    if not (_may_be_written(path) and _may_be_written(path.absolute().parent)):
        return _as_it_is(path)
    # Who may write clears the log away again; the last reader who may not would leave it beside the file.
    source = _connected(path, "mode=rw")
    source.execute("PRAGMA query_only=ON").close()
    return source


def _as_it_is(path: Path) -> sqlite3.Connection:
    """Open a file that nobody writes; with a log beside it in a copy, since the log is merged into the file first."""
    if not _has_log(path):
        return _connected(path, "immutable=1")
    with tempfile.TemporaryDirectory(prefix="fringecal-") as folder:
        place = Path(folder) / "history.db"
        for ending in ("", "-wal"):
            shutil.copyfile(f"{path}{ending}", f"{place}{ending}")
        source = _connected(place, "mode=rw")
        try:
            return _in_memory(source)
        finally:
            source.close()


def _may_be_written(path: Path) -> bool:
    return os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids)


def _has_log(path: Path) -> bool:
    try:
        return os.stat(f"{path}-wal").st_size > 0
    except OSError:
        return False


def _connected(path: Path, how: str) -> sqlite3.Connection:
    place = f"file:{quote(str(path.absolute()))}?{how}"
    # Another thread may close it: the dashboard's pages are made in several.
    return sqlite3.connect(place, uri=True, timeout=WAIT_S, isolation_level=None, check_same_thread=False)


def _in_memory(source: sqlite3.Connection) -> sqlite3.Connection:
    copy = sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False)
    source.backup(copy)
    return copy


def _engine_over(source: sqlite3.Connection) -> Engine:
    """Lead all access through one open connection, which ends with the engine."""
    engine = sa.create_engine("sqlite://", creator=lambda: source, poolclass=StaticPool)
    _prepared(engine)
    return engine


def _prepared(engine: Engine, *pragmas: str) -> None:
    @sa.event.listens_for(engine, "connect")
    def prepare(driver: Any, _: object) -> None:
        driver.isolation_level = None  # transactions are begun below, not by the driver's guess
        try:
            for pragma in pragmas:
                driver.execute(f"PRAGMA {pragma}").close()
        except Exception:
            driver.close()  # nobody else will: the pool never gets it
            raise

    @sa.event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        options: Mapping[str, Any] = connection.get_execution_options()
        # A reader that turns into a writer cannot wait for another writer; so writers say so at once.
        connection.exec_driver_sql("BEGIN IMMEDIATE" if options.get("fringecal_writes") else "BEGIN")
