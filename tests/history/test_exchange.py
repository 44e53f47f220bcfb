"""Out to a table and in again: the same rows, and hand-made tables with their faults."""

import contextlib
import random

import pandas as pd
import pytest

from fringecal.errors import HistoryError
from fringecal.history.entries import Reading
from fringecal.history.exchange import export_table, flat_table, import_table
from fringecal.history.parquet_files import read_parquet
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


# ---- damaged and oversized Parquet: its earlier reader ended the process on one damaged file in a hundred ------------
def parquet_bytes(tmp_path, columns) -> bytes:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    parquet.write_table(arrow.table(columns), tmp_path / "made.parquet")
    return (tmp_path / "made.parquet").read_bytes()


def test_damaged_parquet_is_read_or_refused(history, tmp_path):
    history.append([make_entry(k) for k in range(1, 9)])
    file = tmp_path / "table.parquet"
    export_table(history, file)
    content, draw = file.read_bytes(), random.Random(20)
    footer = int.from_bytes(content[-8:-4], "little")
    for _ in range(150):
        damaged = bytearray(content)
        first = draw.choice([4, len(content) - 8 - footer])  # anywhere, or in the footer
        for _ in range(draw.choice([1, 2, 16])):
            damaged[draw.randrange(first, len(content) - 8)] = draw.randrange(256)
        file.write_bytes(damaged)
        with open_history(tmp_path / "second.db") as second, contextlib.suppress(HistoryError):
            import_table(second, file)


def test_a_long_text_is_unpacked_once_however_often_it_stands_there(tmp_path):
    arrow = pytest.importorskip("pyarrow")
    text, rows = "x" * 100_000, 100_000  # 10 GB, if each were an object of its own
    column = arrow.DictionaryArray.from_arrays(arrow.array([0] * rows, arrow.int32()), arrow.array([text]))
    read = read_parquet(parquet_bytes(tmp_path, {"rig": column}))["rig"]
    assert len(read) == rows
    assert read[0] is read[rows - 1]
    assert read[0] == text


def test_parquet_that_is_no_plain_table_or_too_large_is_refused(tmp_path):
    for columns, what in (
        ({"value": [0.0] * 1_000_001}, "1000001 rows, at most 1000000"),
        ({f"c{k}": [1.0] for k in range(65)}, "65 columns"),
        ({"value": [[1.0, 2.0]]}, "columns of columns"),
    ):
        with pytest.raises(ValueError, match=what):
            read_parquet(parquet_bytes(tmp_path, columns))


def test_tables_by_other_programs_have_times_and_whole_numbers(history, tmp_path):
    columns = {
        "rig": ["a", "a"],
        "captured": pd.to_datetime(["2019-05-01", "2020-05-01"]),
        "quantity": pd.Categorical(["q", "q"]),
        "value": [1, 2],
    }
    pytest.importorskip("pyarrow")
    pd.DataFrame(columns).to_parquet(tmp_path / "own.parquet", index=False)
    assert import_table(history, tmp_path / "own.parquet") == 2
    rows = history.readings()
    assert list(rows["captured"]) == ["2019-05-01T00:00:00+00:00", "2020-05-01T00:00:00+00:00"]
    assert list(rows["value"]) == [1.0, 2.0]


def test_csv_of_excessive_size_is_refused(history, tmp_path, monkeypatch):
    file = tmp_path / "t.csv"
    for text, what in (
        ("rig," * 5000 + "\n", "first line"),
        ("rig,captured,quantity,value\na,2019,q,1,9\n", "not a table"),
    ):
        file.write_text(text)
        with pytest.raises(HistoryError, match=what):
            import_table(history, file)
    monkeypatch.setattr("fringecal.history.exchange._MOST_BYTES", 10)
    with pytest.raises(HistoryError, match="larger than the 10 bytes"):
        import_table(history, file)
    with pytest.raises(HistoryError, match="is a folder"):
        import_table(history, make_folder(tmp_path / "folder.csv"))


def make_folder(path):
    path.mkdir()
    return path
