"""Out to a table and in again: the same rows, and hand-made tables with their faults."""

import pandas as pd
import pytest

from fringecal.errors import HistoryError
from fringecal.history.entries import Reading
from fringecal.history.exchange import export_table, flat_table, import_table
from fringecal.history.store import open_history

from .conftest import make_entry


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_every_digit_comes_back(history, tmp_path, suffix):
    odd = [Reading('a, "quoted"\nquantity', 1 / 3, "µm", 0.1 + 0.2, 7.25, None, None, -1e-300, 1e300, "fail")]
    history.append([make_entry(1, operator="NA", rig="007"), make_entry(2, readings=odd), make_entry(3, readings=[])])
    file = tmp_path / f"table.{suffix}"
    assert export_table(history, file) == 12 + 1 + 1
    with open_history(tmp_path / "second.db") as second:
        assert import_table(second, file) == 3
        assert import_table(second, file) == 0
        drop = ["appended"]
        pd.testing.assert_frame_equal(flat_table(second).drop(columns=drop), flat_table(history).drop(columns=drop))


def test_one_rig_alone(history, tmp_path):
    history.append([make_entry(1), make_entry(1, rig="bench-2")])
    assert export_table(history, tmp_path / "t.csv", "bench-2") == 12
    assert set(pd.read_csv(tmp_path / "t.csv")["rig"]) == {"bench-2"}


def test_a_table_made_by_hand(history, tmp_path):
    file = tmp_path / "old.csv"
    file.write_text(
        "rig,captured,quantity,value,u\n"
        "bench-1,2019-05-01,scale,0.7341,0.0002\n"
        "bench-1,2019-05-01,angle,50.7,\n"
        "bench-1,2020-05-01T12:00:00+02:00,scale,0.7344,0.0002\n"
    )
    assert import_table(history, file) == 2
    assert import_table(history, file) == 0
    rows = history.readings(quantity="scale")
    assert list(rows["captured"]) == ["2019-05-01T00:00:00+00:00", "2020-05-01T10:00:00+00:00"]
    assert list(rows["value"]) == [0.7341, 0.7344]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "not a table"),
        ("rig,captured,quantity,value\n", "without rows"),
        ("rig,captured,value\na,2019-01-01,1\n", "without quantity"),
        ("rig,captured,quantity,value,colour\na,2019-01-01,q,1,red\n", "unknown colour"),
        ("rig,captured,quantity,value\na,2019-01-01,q,nan\n", "row 2: value is 'nan'"),
        ("rig,captured,quantity,value\na,2019-01-01,q,1\na,last May,q,1\n", "row 3: captured is 'last May'"),
        ("rig,captured,quantity,value\n,2019-01-01,q,1\n", "rig is empty"),
        ("rig,captured,quantity,value\na,2019-01-01,q,\n", "has no value"),
        (
            "rig,captured,quantity,value,operator\na,2019-01-01,q,1,x\na,2019-01-01,r,1,y\n",
            "several operator: x, y",
        ),
    ],
)
def test_faults_of_tables_are_named_and_nothing_is_added(history, tmp_path, text, what):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(HistoryError, match=what):
        import_table(history, tmp_path / "bad.csv")
    assert history.entries().empty


def test_other_suffixes_and_broken_files_are_refused(history, tmp_path):
    for name, what in (("t.xlsx", r"\.csv or \.parquet"), ("absent.csv", "cannot be read")):
        with pytest.raises(HistoryError, match=what):
            import_table(history, tmp_path / name) if name == "absent.csv" else export_table(history, tmp_path / name)
    for content in (b"", b"PAR1 and then nothing", b"PAR1PAR1", b"PAR1" + b"\xff" * 4 + b"PAR1", b"PAR1 \0\0\0\0PAR1"):
        (tmp_path / "broken.parquet").write_bytes(content)
        with pytest.raises(HistoryError, match="not a table"):
            import_table(history, tmp_path / "broken.parquet")
