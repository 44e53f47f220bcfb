"""Tables as Parquet, read by Arrow: what a file announces is judged before its columns are unpacked."""

import io
from typing import TYPE_CHECKING, Any

import pandas as pd

from fringecal.errors import HistoryError

if TYPE_CHECKING:
    import pyarrow as pa

_MAGIC = b"PAR1"  # first and last four bytes of every Parquet file
MOST_ROWS = 1_000_000  # readings: 26 quantities every week for 40 years of 18 rigs
_MOST_COLUMNS = 64  # a table of the history has 22
_MOST_UNPACKED = 1 << 30  # bytes: 1 kB for each reading
_MOST_FOOTER_STRING, _MOST_FOOTER_LIST = 1 << 20, 1 << 20  # bytes and entries: pandas' own note takes 10 kB


def write_parquet(table: pd.DataFrame, target: str) -> None:
    """Write a table of texts and numbers, one row after the other without an index.

    Parameters
    ----------
    table
        Columns of kind float are numbers, all others texts.
    target
        Name of the file.

    Raises
    ------
    HistoryError
        Arrow is not installed.
    """
    arrow, parquet = _arrow()
    kinds = [(str(name), arrow.float64() if table[name].dtype == float else arrow.string()) for name in table]
    rows = arrow.Table.from_pandas(table, arrow.schema(kinds), preserve_index=False)
    parquet.write_table(rows, target, store_schema=False)


def read_parquet(content: bytes) -> pd.DataFrame:
    """Read a table of plain columns; texts are unpacked once for each that differs.

    Parameters
    ----------
    content
        The file's.

    Raises
    ------
    HistoryError
        Arrow is not installed.
    ValueError
        It is no such table, is damaged, or larger than what is read. Arrow has further errors of its own.
    """
    arrow, parquet = _arrow()
    _demand_framed(content)
    limits = {
        "thrift_string_size_limit": _MOST_FOOTER_STRING,
        "thrift_container_size_limit": _MOST_FOOTER_LIST,
        "page_checksum_verification": True,
    }
    with parquet.ParquetFile(io.BytesIO(content), **limits) as file:
        texts = _demand_plain(file)
    with parquet.ParquetFile(io.BytesIO(content), read_dictionary=texts, **limits) as file:
        table = file.read(use_threads=False)
    table.validate(full=True)
    return _to_pandas(arrow, table)


def _demand_framed(content: bytes) -> None:
    """See that the file begins and ends as its format says: what is cut short is called so.

    A file is ``PAR1``, column chunks, footer, length of the footer (4 bytes, little-endian), ``PAR1`` (Apache Parquet
    file format).
    """
    least = 2 * len(_MAGIC) + 4
    footer = int.from_bytes(content[-8:-4], "little") if len(content) >= least else 0
    if content[:4] != _MAGIC or content[-4:] != _MAGIC or not 0 < footer <= len(content) - least:
        raise ValueError("a Parquet file begins and ends with PAR1; this one does not, or is cut short")


def _demand_plain(file: Any) -> list[str]:
    """Refuse columns of columns and what is too large; return the names of the columns of text."""
    facts, schema = file.metadata, file.schema_arrow
    unpacked = sum(facts.row_group(number).total_byte_size for number in range(facts.num_row_groups))
    for found, most, what in (
        (facts.num_rows, MOST_ROWS, "rows"),
        (facts.num_columns, _MOST_COLUMNS, "columns"),
        (unpacked, _MOST_UNPACKED, "bytes unpacked"),
    ):
        if not 0 <= found <= most:
            raise ValueError(f"{found} {what}, at most {most} are read")
    import pyarrow.types as kinds

    nested = [field.name for field in schema if kinds.is_nested(field.type)]
    if nested or len(set(schema.names)) < len(schema.names):
        raise ValueError(f"columns of columns, or two of one name: {', '.join(nested or schema.names)}")
    return [field.name for field in schema if kinds.is_string(field.type) or kinds.is_large_string(field.type)]


def _to_pandas(arrow: Any, table: "pa.Table") -> pd.DataFrame:
    """Turn columns into pandas', each text one object however often it stands there."""
    columns = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        is_text = arrow.types.is_dictionary(column.type)
        columns[name] = pd.Series(_texts(column), dtype=object) if is_text else column.to_pandas(ignore_metadata=True)
    return pd.DataFrame(columns, index=range(table.num_rows))


def _texts(column: Any) -> list[str | None]:
    found: list[str | None] = []
    for chunk in column.chunks:
        words = chunk.dictionary.to_pylist()
        found += [None if place is None else words[place] for place in chunk.indices.to_pylist()]
    return found


def _arrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise HistoryError("Parquet needs the package pyarrow: install the extra `parquet`, or use .csv") from error
    return pyarrow, pyarrow.parquet
