"""The store: what goes in comes out, nothing is changed or lost, older databases are brought up to date."""

import json
import sqlite3

import pytest
import sqlalchemy as sa

from fringecal.errors import HistoryError, RecordError
from fringecal.history.entries import Reading, read_entry
from fringecal.history.history_tables import METADATA, STEPS, migrate, schema_version
from fringecal.history.store import open_history

from .conftest import make_entry


def rows_of(path, table):
    with sqlite3.connect(path) as connection:
        count = connection.execute(f"SELECT COUNT(*) FROM {table}").fetchone()[0]
    connection.close()
    return count


def test_what_is_added_comes_back(history):
    reading = Reading("scale", 0.734, "mm/px", 1e-4, 12.5, 0.733, 2e-4, 0.4, 1.0, "pass")
    entry = make_entry(1, readings=[reading], operator="ab", temperature_degC=20.5, document='{"format": "x"}')
    assert history.append([entry]) == 1
    row = history.readings("bench-1", "scale").iloc[0]
    assert Reading(**{name: row[name] for name in vars(reading)}) == reading
    assert (row["operator"], row["temperature_degC"], row["verdict"]) == ("ab", 20.5, "pass")
    assert history.document(entry.sha256) == '{"format": "x"}'
    assert history.rigs() == ("bench-1",)


def test_a_record_is_added_once(history):
    assert history.append([make_entry(1), make_entry(1), make_entry(2)]) == 2
    assert history.append([make_entry(2)]) == 0
    assert len(history.entries()) == 2
    assert len(history.readings()) == 24


def test_rows_stand_in_the_order_of_capture(history):
    days = ("2026-03-01T00:00:00+00:00", "2026-01-01T00:00:00+00:00", "2026-02-01T00:00:00+00:00")
    history.append([make_entry(number, captured=day) for number, day in enumerate(days)])
    assert list(history.entries()["captured"]) == sorted(days)


@pytest.mark.parametrize("statement", ["UPDATE readings SET value = 0", "DELETE FROM readings", "DELETE FROM entries"])
def test_the_database_itself_refuses_changes(history, statement):
    history.append([make_entry(1)])
    with sqlite3.connect(history.name) as connection, pytest.raises(sqlite3.IntegrityError, match="append-only"):
        connection.execute(statement)
    connection.close()
    assert len(history.readings()) == 12


def test_a_failure_adds_nothing(history):
    bad = make_entry(2, readings=[Reading("scale", None)])
    with pytest.raises(HistoryError, match="NOT NULL"):
        history.append([make_entry(1), bad])
    assert history.entries().empty


def test_the_steps_make_the_tables_that_the_code_uses(history):
    engine = sa.create_engine(f"sqlite:///{history.name}")
    found = sa.inspect(engine)
    for table in METADATA.sorted_tables:
        columns = {column["name"]: column["nullable"] for column in found.get_columns(table.name)}
        assert columns == {column.name: column.nullable for column in table.columns} | {"id": columns["id"]}
    engine.dispose()


def test_a_database_of_the_first_version_is_brought_up_to_date(tmp_path):
    engine = sa.create_engine(f"sqlite:///{tmp_path / 'old.db'}")
    with engine.begin() as connection:
        assert migrate(connection, STEPS[:1]) == 0
        connection.exec_driver_sql(
            "INSERT INTO entries (appended, rig, kind, captured, created, decision, source, software, sha256) "
            "VALUES ('t', 'old rig', 'audit', 't', 't', 'pass', '', '', 'f')"
        )
        assert schema_version(connection) == 1
    engine.dispose()
    with open_history(tmp_path / "old.db") as history:
        assert list(history.entries()["rig"]) == ["old rig"]
        with sqlite3.connect(history.name) as connection, pytest.raises(sqlite3.IntegrityError, match="append-only"):
            connection.execute("DELETE FROM entries")
        connection.close()


def test_a_step_that_fails_leaves_the_version_before_it(history):
    def broken(connection):
        connection.exec_driver_sql("CREATE TABLE half (id INTEGER)")
        connection.exec_driver_sql("SELECT nonsense FROM half")

    from fringecal.history.store import writing

    with pytest.raises(sa.exc.OperationalError, match="nonsense"), writing(history._engine) as connection:
        migrate(connection, (*STEPS, broken))
    with history._engine.connect() as connection:
        assert schema_version(connection) == len(STEPS)
        assert not sa.inspect(connection).has_table("half")


def test_a_newer_database_is_refused(tmp_path):
    open_history(tmp_path / "h.db").close()
    with sqlite3.connect(tmp_path / "h.db") as connection:
        connection.execute("INSERT INTO schema_version VALUES (99, 'later')")
    connection.close()
    with pytest.raises(HistoryError, match=r"h\.db: the history has version 99, newer than"):
        open_history(tmp_path / "h.db")


def test_what_is_no_history_is_refused(tmp_path):
    (tmp_path / "text.db").write_text("this is a text that is longer than a header of SQLite, " * 20)
    with sqlite3.connect(tmp_path / "other.db") as connection:
        connection.execute("CREATE TABLE entries (id INTEGER)")
    connection.close()
    for place, what in (
        (tmp_path / "text.db", "no SQLite file"),
        (tmp_path / "other.db", "another program"),
        (tmp_path, "a file in an existing folder"),
        (tmp_path / "absent" / "h.db", "a file in an existing folder"),
        ("mysql://host/name", "SQLite"),
        ("postgresql://user:secret@127.0.0.1:1/none", "127.0.0.1"),
    ):
        with pytest.raises(HistoryError, match=what) as caught:
            open_history(place)
        assert "secret" not in str(caught.value)


def test_reading_makes_no_file(tmp_path):
    with pytest.raises(HistoryError, match="history add"):
        open_history(tmp_path / "h.db", create=False)
    assert list(tmp_path.iterdir()) == []


def test_files_that_are_no_records_are_named(tmp_path):
    for name, text in (("a.json", "{"), ("b.json", "[]"), ("c.json", '{"format": "other/1"}'), ("d.json", "")):
        (tmp_path / name).write_text(text)
        with pytest.raises(RecordError, match=name):
            read_entry(tmp_path / name)
    (tmp_path / "e.json").write_text(json.dumps({"format": "fringecal-calibration/1"}))
    with pytest.raises(RecordError, match=r"e\.json"):
        read_entry(tmp_path / "e.json")
    with pytest.raises(RecordError, match="found none"):
        read_entry(tmp_path)
