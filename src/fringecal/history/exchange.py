"""The history as one flat table: CSV, which anything reads, and Parquet."""

import hashlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from fringecal.errors import HistoryError
from fringecal.guarded import Refusal, bytes_of, quoted, shortened
from fringecal.history.entries import Entry, Reading
from fringecal.history.parquet_files import MOST_ROWS, read_parquet, write_parquet
from fringecal.history.store import ENTRY_COLUMNS, READING_COLUMNS, History
from fringecal.history.superseding import settled
from fringecal.history.table_cells import NUMBERS, parsed_cell, plain_text, spreadsheet_text
from fringecal.records import replacing, write_table

NEEDED = ("rig", "captured", "quantity", "value")
_SHOWN = 8  # unknown columns that a message names
_MOST_BYTES = 1 << 28  # 256 bytes for each of the readings that are read
_LONGEST_HEADER = 1 << 14  # bytes: the columns' names take 180
_OF_ENTRY = tuple("verdict" if name == "decision" else name for name in ENTRY_COLUMNS)
COLUMNS = (*_OF_ENTRY, *READING_COLUMNS)


def flat_table(history: History, rig: str | None = None) -> pd.DataFrame:
    """Tabulate a history in one row per reading; an entry without readings has one row of its own.

    Parameters
    ----------
    history
        The open history.
    rig
        The rig whose rows are wanted; all by default.
    """
    entries = history.entries(rig).rename(columns={"decision": "verdict"})
    readings = history.readings(rig)[["sha256", *READING_COLUMNS]]
    table = entries.merge(readings, on="sha256", how="left")[list(COLUMNS)]
    return table.astype({name: (float if name in NUMBERS else object) for name in COLUMNS})


def export_table(history: History, path: str | Path, rig: str | None = None) -> int:
    """Write a history as ``.csv`` or ``.parquet``, whole or not at all, and return the number of rows.

    The texts of the records are left out: `History.document` gives them. In CSV, texts that a spreadsheet would take
    for formulas begin with an apostrophe, which `import_table` takes off again.

    Raises
    ------
    HistoryError
        The suffix is neither, or Parquet's library is not installed.
    """
    table, file = flat_table(history, rig), Path(path)
    if file.suffix == ".csv":
        write_table(file, table.map(spreadsheet_text))
    elif file.suffix == ".parquet":
        with replacing(file) as sibling:
            write_parquet(table, str(sibling))
    else:
        raise HistoryError(f"{file}: a file ending in .csv or .parquet was needed")
    return len(table)


def import_table(history: History, path: str | Path, *, correct: bool = False) -> int:
    """Add the entries of a table that `export_table` wrote, or of a laboratory's own; return how many were new.

    A table of one's own needs the columns rig, captured, quantity and value; rows that share rig, kind and captured
    make one entry. Times without a zone are UTC.

    Parameters
    ----------
    history
        Open to write.
    path
        The table.
    correct
        Whether an entry that says otherwise than the one of its time in the history supersedes it.

    Raises
    ------
    HistoryError
        A column is missing or unknown, a row makes no sense, or contradicts the history; nothing was added.
    """
    table = _complete(_read(Path(path)), Path(path))
    entries = [_entry(group) for _, group in table.groupby("sha256", sort=False)]
    return history.append(settled(history, entries, correct=correct))


def _read(file: Path) -> pd.DataFrame:
    if file.suffix not in (".csv", ".parquet"):
        raise HistoryError(f"{file}: a file ending in .csv or .parquet was needed")
    content = _content(file)
    try:
        return read_parquet(content) if file.suffix == ".parquet" else _read_csv(content)
    except HistoryError:
        raise
    except Exception as error:  # the libraries' own errors have no common parent
        raise HistoryError(f"{file}: not a table ({shortened(error)})") from error


def _content(file: Path) -> bytes:
    """Read a file that is one, and not larger than a table may be."""
    try:
        return bytes_of(file, _MOST_BYTES)
    except Refusal as error:
        raise HistoryError(f"{file}: {error}; give a table, a large one in parts") from error


def _read_csv(content: bytes) -> pd.DataFrame:
    if content.find(b"\n", 0, _LONGEST_HEADER) < 0 and len(content) > _LONGEST_HEADER:
        raise ValueError(f"its first line is longer than {_LONGEST_HEADER} bytes")
    # Without an index of its own a row that is longer than the first is refused, not shifted.
    rows = pd.read_csv(
        io.BytesIO(content), dtype=str, keep_default_na=False, na_values=[""], index_col=False, nrows=MOST_ROWS + 1
    )
    if len(rows) > MOST_ROWS:
        raise ValueError(f"more than {MOST_ROWS} rows; import it in parts")
    return rows.map(plain_text, na_action="ignore")


def _complete(table: pd.DataFrame, file: Path) -> pd.DataFrame:
    """Check a table and fill in what one made by hand may leave out."""
    missing = [name for name in NEEDED if name not in table]
    unknown = [shortened(str(name)) for name in table if name not in COLUMNS]
    faults = [f"without {', '.join(missing)}"] if missing else []
    faults += [f"with unknown {', '.join(unknown[:_SHOWN])}"] if unknown else []
    faults += ["without rows"] if table.empty else []
    if faults:
        raise HistoryError(f"{file}: a table {'; '.join(faults)}; columns may be {', '.join(COLUMNS)}")
    table = table.reindex(columns=list(COLUMNS)).astype(object)
    table = table.where(table.notna(), None)
    for name in COLUMNS:
        cells = [_cell(value, name, f"{file}, row {row}") for row, value in enumerate(table[name], start=2)]
        table[name] = pd.Series(cells, index=table.index, dtype=object)  # else None turns into NaN
    table["kind"] = table["kind"].map(lambda kind: kind or "imported")
    made_by_hand = table["sha256"].isna()
    for _, group in table[made_by_hand].groupby(["rig", "kind", "captured"], sort=False):
        table.loc[group.index, "sha256"] = _hash(group)
    return table


def _hash(group: pd.DataFrame) -> str:
    """Give an entry of a table made by hand a hash, so that importing it twice adds nothing."""
    content = group.drop(columns=["sha256", "appended", "source", "software"]).to_csv(index=False)
    return hashlib.sha256(content.encode()).hexdigest()


def _cell(value: Any, name: str, place: str) -> Any:
    """Turn one cell into what its column holds; None where it is empty."""
    if value is None or value == "":
        if name in ("rig", "captured"):
            raise HistoryError(f"{place}: {name} is empty")
        return None
    try:
        return parsed_cell(value, name)
    except ValueError as error:
        raise HistoryError(f"{place}: {name} is {quoted(value)}; {error}") from None


def _entry(group: pd.DataFrame) -> Entry:
    first = group.iloc[0]
    for name in _OF_ENTRY:
        if group[name].nunique(dropna=False) > 1:
            found = ", ".join(map(str, group[name].unique()))
            raise HistoryError(f"the entry of {first['rig']} at {first['captured']} has several {name}: {found}")
    return Entry(
        rig=first["rig"],
        kind=first["kind"],
        captured=first["captured"],
        created=first["created"] or first["captured"],
        sha256=first["sha256"],
        decision=first["verdict"] or "info",
        readings=tuple(_readings(group)),
        operator=first["operator"],
        temperature_degC=first["temperature_degC"],
        minutes_since_power_on=first["minutes_since_power_on"],
        source=first["source"] or "",
        software=first["software"] or "",
        supersedes=first["supersedes"],
    )


def _readings(group: pd.DataFrame) -> Iterator[Reading]:
    for row in group[list(READING_COLUMNS)].to_dict("records"):
        if row["quantity"] is None:
            continue
        if row["value"] is None:
            raise HistoryError(
                f"{row['quantity']} of {group.iloc[0]['captured']} has no value; give one or drop the row"
            )
        yield Reading(**{str(name): value for name, value in row.items()} | {"unit": row["unit"] or ""})
