"""Tables that contradict the history, rows that make no sense, formulas, and days since when."""

from datetime import UTC, datetime

import pandas as pd
import pytest

from fringecal.errors import HistoryError
from fringecal.history.entries import Reading
from fringecal.history.exchange import export_table, import_table
from fringecal.history.store import open_history
from fringecal.history.table_cells import captured_since, parsed_time

from .conftest import make_entry

HEAD = "rig,captured,quantity,value,u\n"


def table(folder, text, name="t.csv"):
    (folder / name).write_text(text)
    return folder / name


def test_a_corrected_uncertainty_is_not_dropped(history, tmp_path):
    import_table(history, table(tmp_path, HEAD + "a,2019-05-01,scale,0.7341,0.0002\n"))
    corrected = table(tmp_path, HEAD + "a,2019-05-01,scale,0.7341,0.0004\n")
    with pytest.raises(HistoryError, match=r"scale: u is 0\.0002, the table says 0\.0004\); --correct"):
        import_table(history, corrected)
    assert list(history.readings()["u"]) == [0.0002]
    assert import_table(history, corrected, correct=True) == 1
    assert list(history.readings()["u"]) == [0.0004]
    assert import_table(history, corrected, correct=True) == 0
    assert import_table(history, corrected) == 0
    assert sorted(history.readings(superseded=True)["u"]) == [0.0002, 0.0004]  # nothing was removed
    assert len(history.entries()) == 1
    # What was corrected does not come back with an old table, unless it is meant to.
    old = table(tmp_path, HEAD + "a,2019-05-01,scale,0.7341,0.0002\n")
    assert import_table(history, old) == 0
    assert list(history.readings()["u"]) == [0.0004]
    assert import_table(history, old, correct=True) == 1
    assert list(history.readings()["u"]) == [0.0002]
    assert import_table(history, old, correct=True) == 0


def test_an_export_that_was_edited_is_a_contradiction_too(history, tmp_path):
    history.append([make_entry(1), make_entry(2)])
    file = tmp_path / "t.csv"
    export_table(history, file)
    assert import_table(history, file) == 0
    rows = pd.read_csv(file, dtype=str, keep_default_na=False)
    rows.loc[3, "u"] = "0.05"
    rows.to_csv(file, index=False)
    with pytest.raises(HistoryError, match=r"q3: u is 0\.01, the table says 0\.05"):
        import_table(history, file)
    assert import_table(history, file, correct=True) == 1
    assert list(history.readings(quantity="q3")["u"]) == [0.05, 0.01]
    assert len(history.readings()) == 24
    with open_history(tmp_path / "second.db") as second:  # and it goes through a table like any other
        export_table(history, file)
        assert import_table(second, file) == 2
        assert len(second.readings()) == 24


def test_a_correction_states_the_whole_entry(history, tmp_path):
    import_table(history, table(tmp_path, HEAD + "a,2019-05-01,x,1,\na,2019-05-01,y,2,\n"))
    with pytest.raises(HistoryError, match="the correction lacks y"):
        import_table(history, table(tmp_path, HEAD + "a,2019-05-01,x,3,\n"), correct=True)
    assert import_table(history, table(tmp_path, HEAD + "a,2019-05-01,z,3,\n")) == 1  # another quantity is no rival
    assert sorted(history.readings()["quantity"]) == ["x", "y", "z"]


@pytest.mark.parametrize(
    ("column", "cell", "what"),
    [
        ("u", "-1", "zero or more"),
        ("u", "inf", "zero or more"),
        ("u_reference", "-0.1", "zero or more"),
        ("dof", "0", "above zero"),
        ("verdict", "banana", "one of info, pass"),
        ("decision", "PASS", "one of info, pass"),
        ("minutes_since_power_on", "-5", "zero or more"),
        ("temperature_degC", "-300", "above -273.15"),
        ("sha256", "abc", "64 digits"),
        ("created", "1.2.2026", "2026-02-01"),
        ("quantity", "   ", "a text of 1 to 1000"),
        ("operator", "x" * 1001, "a text of 1 to 1000"),
    ],
)
def test_rows_that_make_no_sense_are_refused(history, tmp_path, column, cell, what):
    row = {"rig": "a", "captured": "2019-05-01", "quantity": "q", "value": "1"} | {column: cell}
    pd.DataFrame([row]).to_csv(tmp_path / "t.csv", index=False)
    with pytest.raises(HistoryError, match=f"row 2: {column} is .*{what}"):
        import_table(history, tmp_path / "t.csv")
    assert history.entries().empty


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\tx", "\rx", "'=1", "''", "plain", "a=b"])
def test_formulas_are_texts_in_an_export_and_come_back(history, tmp_path, text):
    readings = [Reading(text, -1.5, "mm")]
    history.append([make_entry(1, rig=text, operator=text, readings=readings)])
    export_table(history, tmp_path / "t.csv")
    raw = pd.read_csv(tmp_path / "t.csv", dtype=str)
    for column in ("rig", "operator", "quantity"):
        assert raw[column][0][0] not in "=+-@\t\r"
    assert raw["value"][0] == "-1.5"
    with open_history(tmp_path / "second.db") as second:
        import_table(second, tmp_path / "t.csv")
        row = second.readings().iloc[0]
    assert (row["rig"], row["operator"], row["quantity"]) == (text, text, text)


def test_a_day_with_a_zone_is_a_moment(history):
    moments = ("2026-01-31T22:30:00+00:00", "2026-01-31T23:30:00+00:00", "2026-02-01T00:30:00+00:00")
    history.append([make_entry(k, captured=moment) for k, moment in enumerate(moments)])
    entries = history.entries()
    for since, count in (
        ("2026-02-01", 1),
        ("2026-02-01T00:00:00+01:00", 2),  # 23:00 in UTC
        ("2026-01-31T23:00:00-01:00", 1),  # midnight in UTC
        ("2026-01-31", 3),
        ("2026-02-02T00:00Z", 0),
    ):
        assert len(captured_since(entries, parsed_time(since))) == count, since
    assert parsed_time("2026-02-01T00:00:00+01:00") == datetime(2026, 1, 31, 23, tzinfo=UTC)


@pytest.mark.parametrize(
    "text", ["1.2.2026", "02/01/2026", "last May", "2026", "2026-13-01", "", "nan", "0001-01-01T00:00+14"]
)
def test_other_ways_to_write_a_day_are_refused_with_the_right_one(text):
    with pytest.raises(ValueError, match="2026-02-01T08:00:00"):
        parsed_time(text)
