"""The history as a database: SQLite in one file, or PostgreSQL by URL; rows are added, never changed."""

import contextlib
import math
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import pandas as pd
import sqlalchemy as sa
from sqlalchemy import Connection, Engine
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import SQLAlchemyError

from fringecal.errors import HistoryError
from fringecal.guarded import Refusal, bytes_of, quoted, text_of
from fringecal.history.entries import Entry
from fringecal.history.history_tables import ENTRIES, NONE_IN_IT, READINGS, STEPS, demand_known, migrate, schema_version
from fringecal.history.sqlite_files import WAIT_S, reader_engine, writer_engine

# Of a damaged file not even the message can always be read as text.
_DATABASE_ERRORS = (SQLAlchemyError, sqlite3.Error, UnicodeError)
_MOST_URL = 4096  # bytes of a file that holds one
_INSERT: Mapping[str, Any] = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}
ENTRY_COLUMNS = tuple(str(column.name) for column in ENTRIES.columns if column.name not in ("id", "document"))
READING_COLUMNS = tuple(str(column.name) for column in READINGS.columns if column.name not in ("id", "entry_id"))


class History:
    """An open history; use it in a `with` block, or close it.

    Every call of `append` is one transaction: after a crash each of its entries is there with all its readings, or
    none is.
    """

    def __init__(self, engine: Engine, name: str) -> None:
        self._engine = engine
        self.name = name

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the database."""
        self._engine.dispose()

    def append(self, entries: Sequence[Entry]) -> int:
        """Add entries and return how many were new; a record that is there already is left as it is.

        Raises
        ------
        HistoryError
            The database refuses; nothing was added.
        """
        with self._guarded(), writing(self._engine) as connection:
            return sum(_append(connection, entry) for entry in entries)

    def entries(self, rig: str | None = None, *, superseded: bool = False) -> pd.DataFrame:
        """Tabulate the entries in the order of capture, of one rig or of all; those that were corrected, if asked."""
        columns = [ENTRIES.c[name] for name in ENTRY_COLUMNS]
        return self._frame(sa.select(*columns), rig, superseded)

    def readings(
        self, rig: str | None = None, quantity: str | None = None, *, superseded: bool = False
    ) -> pd.DataFrame:
        """Tabulate the readings, each with the columns of its entry, in the order of capture."""
        ours = [ENTRIES.c[name] for name in ENTRY_COLUMNS if name != "decision"]
        theirs = [READINGS.c[name] for name in READING_COLUMNS]
        query = sa.select(*ours, ENTRIES.c.decision.label("verdict"), *theirs).join_from(READINGS, ENTRIES)
        query = query if quantity is None else query.where(READINGS.c.quantity == quantity)
        return self._frame(query, rig, superseded)

    def document(self, sha256: str) -> str | None:
        """Return the whole text of a record by its hash; None if only its numbers were imported."""
        query = sa.select(ENTRIES.c.document).where(ENTRIES.c.sha256 == sha256)
        with self._guarded(), self._engine.connect() as connection:
            return connection.execute(query).scalar()

    def rigs(self) -> tuple[str, ...]:
        """Name the rigs, in alphabetical order."""
        with self._guarded(), self._engine.connect() as connection:
            return tuple(connection.execute(sa.select(ENTRIES.c.rig).distinct().order_by(ENTRIES.c.rig)).scalars())

    def _frame(self, query: sa.Select[Any], rig: str | None, superseded: bool) -> pd.DataFrame:
        corrected = sa.select(ENTRIES.c.supersedes).where(ENTRIES.c.supersedes.is_not(None))
        query = query if superseded else query.where(ENTRIES.c.sha256.not_in(corrected))
        query = query if rig is None else query.where(ENTRIES.c.rig == rig)
        order = [ENTRIES.c.captured, ENTRIES.c.id]
        with self._guarded(), self._engine.connect() as connection:
            rows = connection.execute(query.order_by(*order)).fetchall()
        columns = list(query.selected_columns)
        for place, column in enumerate(columns):
            self._demand_kind(column, [row[place] for row in rows])
        return pd.DataFrame(rows, columns=[str(column.name) for column in columns])

    def _demand_kind(self, column: Any, cells: Sequence[Any]) -> None:
        """Refuse what cannot have been written here: SQLite lets any column hold any kind of value."""
        is_right = _is_number if isinstance(column.type, sa.Float) else _is_text
        wrong = next((cell for cell in cells if not is_right(cell)), None)
        if wrong is not None:
            raise HistoryError(f"{self.name}: a row holds {quoted(wrong)} as {column.name}; the history is damaged")

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except _DATABASE_ERRORS as error:
            raise HistoryError(f"{self.name}: {_reason(error)}") from error


def _is_number(cell: Any) -> bool:
    return cell is None or (isinstance(cell, int | float) and math.isfinite(cell))


def _is_text(cell: Any) -> bool:
    return cell is None or isinstance(cell, str)


def readings_of(entry: Entry) -> pd.DataFrame:
    """Tabulate one entry's readings as `History.readings` does, before it is appended or without."""
    row = asdict(entry) | {"appended": None}
    ours = {name: row[name] for name in ENTRY_COLUMNS if name != "decision"} | {"verdict": row["decision"]}
    columns = [*ours, *READING_COLUMNS]
    return pd.DataFrame(
        [ours | {name: one[name] for name in READING_COLUMNS} for one in row["readings"]], columns=columns
    )


def _append(connection: Connection, entry: Entry) -> int:
    insert = _INSERT[connection.dialect.name]
    row = asdict(entry)
    readings = row.pop("readings")
    row["appended"] = datetime.now(UTC).isoformat(timespec="milliseconds")
    statement = insert(ENTRIES).values(row).on_conflict_do_nothing(index_elements=["sha256"]).returning(ENTRIES.c.id)
    key = connection.execute(statement).scalar()
    if key is None:
        return 0
    if readings:
        connection.execute(sa.insert(READINGS), [{"entry_id": key, **reading} for reading in readings])
    return 1


def open_history(where: str | Path, *, create: bool = True) -> History:
    """Open a history: to write, bringing an older one up to date, or to read.

    Parameters
    ----------
    where
        Path of an SQLite file, or a URL such as ``postgresql://user@host/name``; ``env:NAME`` and ``file:PATH`` name
        the environment variable, or the file, that holds one.
    create
        Whether it is opened to write, and made where there is none; a URL always names a database that exists. A file
        opened to read is not changed, nor is the folder that it is in.

    Raises
    ------
    HistoryError
        There is no such history, it cannot be reached, it is newer than this version, or no history at all.
    """
    url, name = _locate(where, create)
    try:
        return History(_engine(url, create), name)
    except (*_DATABASE_ERRORS, ImportError, OSError) as error:
        raise HistoryError(f"{name}: {_reason(error)}") from error
    except HistoryError as error:
        raise HistoryError(f"{name}: {error}") from None


def _engine(url: URL, create: bool) -> Engine:
    is_file = url.get_backend_name() == "sqlite"
    if is_file and not create:
        return reader_engine(Path(str(url.database)))
    engine = writer_engine(Path(str(url.database))) if is_file else sa.create_engine(url, pool_pre_ping=True)
    _bring_up_to_date(engine, create)
    return engine


def _bring_up_to_date(engine: Engine, create: bool) -> None:
    try:
        with engine.connect() as connection:
            found = schema_version(connection)
            demand_known(found)
        if found == 0 and not create:
            raise HistoryError(NONE_IN_IT)
        if found < len(STEPS):
            with writing(engine) as connection:
                migrate(connection)
    except BaseException:
        engine.dispose()
        raise


@contextlib.contextmanager
def writing(engine: Engine) -> Iterator[Connection]:
    """Lend a connection whose transaction holds the right to write from its first statement."""
    with engine.connect().execution_options(fringecal_writes=True) as connection, connection.begin():
        yield connection


def _locate(where: str | Path, create: bool) -> tuple[URL, str]:
    """Turn a path or a URL, or where one stands, into a URL, and a name that may be printed."""
    where = _stated_elsewhere(str(where))
    if "://" in str(where):
        try:
            url = make_url(str(where))
        except SQLAlchemyError as error:
            raise HistoryError("this is no database URL; write postgresql://user@host/name") from error
        if url.get_backend_name() == "postgresql":
            url = url.set(drivername="postgresql+pg8000") if url.drivername == "postgresql" else url
            return url, url.render_as_string(hide_password=True)
        if url.get_backend_name() != "sqlite" or not url.database:
            raise HistoryError(f"{url.drivername}: a history is a file (SQLite) or postgresql://user@host/name")
        where = url.database
    path = Path(where)
    if os.path.isdir(path) or not os.path.isdir(path.absolute().parent):
        raise HistoryError(f"{path}: a file in an existing folder was needed; name one, for example history.db")
    if not create and not os.path.lexists(path):
        raise HistoryError(f"{path}: there is no history; `fringecal history add` makes one")
    return URL.create("sqlite", database=str(path)), str(path)


def _stated_elsewhere(where: str) -> str:
    """Resolve ``env:NAME`` and ``file:PATH``: a URL with a password belongs on no command line, which all can read."""
    kind, colon, name = where.partition(":")
    if kind == "env" and colon:
        if not os.environ.get(name):
            raise HistoryError(f"{where}: there is no environment variable {name}; set it to the file or URL")
        return os.environ[name]
    if kind == "file" and colon:
        try:
            return text_of(bytes_of(name, _MOST_URL)).strip()
        except Refusal as error:
            raise HistoryError(f"{where}: {error}; a file that holds the URL was needed") from None
    return where


def _reason(error: Exception) -> str:
    if isinstance(error, ImportError):
        return f"no driver for this database ({error}); install the extra `postgresql`"
    if isinstance(error, UnicodeError):
        return "the file is damaged"
    cause = getattr(error, "orig", None) or error
    text = " ".join(str(cause).split())
    hints = {
        "file is not a database": "this is no SQLite file; name another",
        "locked": f"another program holds it for more than {WAIT_S:g} s; try again",
        "unable to open": "see that it may be read, and written",
        "readonly": "nothing may be written there; name another place",
        "append-only": "rows of a history are never changed or removed",
    }
    hint = next((advice for part, advice in hints.items() if part in text), "")
    return f"{text}; {hint}" if hint else text
