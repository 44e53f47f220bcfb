"""Writing so that a reader never meets half a file: to a sibling first, then renamed into place."""

import contextlib
import csv
import hashlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from fringecal.errors import RecordError
from fringecal.replacement import flush_folder, hidden_beside, put_in_place, settle, signals_deferred

if TYPE_CHECKING:
    import pandas as pd

EARLIER = "earlier"
"""Folder beside a record that keeps those that stood in its place."""


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Lend a temporary sibling to write to; it takes the place of `path` if the block succeeds.

    The file is flushed to the disk before the rename and its folder after it, so that after a
    crash the old or the new content is there, whole. On any error the sibling is removed and
    `path` stays as it was. The sibling keeps the suffix, since libraries choose formats by it; what a
    command that was killed left of the same path is removed.

    Raises
    ------
    RecordError
        The operating system refuses to write there.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with replacing(Path(folder) / "scale.csv") as sibling:
    ...         _ = sibling.write_text("mm/px")
    ...     sorted(file.name for file in Path(folder).iterdir())
    ['scale.csv']
    """
    path = Path(path)
    sibling = hidden_beside(path, suffix=path.suffix)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        settle(path)
        yield sibling
        with signals_deferred():
            _flush(sibling)
            os.replace(sibling, path)  # noqa: PTH105 -- the one call that is atomic on every system
            flush_folder(path.parent)
    except OSError as error:
        raise RecordError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with contextlib.suppress(OSError), signals_deferred():  # where nothing can be made, nothing is left
            sibling.unlink()


def write_text(path: str | Path, text: str) -> Path:
    """Write a UTF-8 text file, whole or not at all, with the same line ends on every system."""
    with replacing(path) as sibling:
        sibling.write_text(text, encoding="utf-8", newline="\n")
    return Path(path)


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a binary file, whole or not at all."""
    with replacing(path) as sibling:
        sibling.write_bytes(content)
    return Path(path)


def write_table(path: str | Path, frame: "pd.DataFrame") -> Path:
    """Write a flat table as CSV with every digit; missing values are empty fields."""
    # Python 3.12 leaves a lone carriage return without quotation marks, and readers end the row there.
    texts = frame.select_dtypes(exclude="number")
    returns = any("\r" in cell for column in texts for cell in texts[column] if isinstance(cell, str))
    if returns:
        return write_text(path, frame.to_csv(index=False, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC))
    return write_text(path, frame.to_csv(index=False, lineterminator="\n"))


@contextlib.contextmanager
def result_folder(folder: str | Path, *, last: str = "calibration.json") -> Iterator[Path]:
    """Lend a hidden sibling folder to write results into; they take the place of `folder` in one step.

    If the block fails or is interrupted, the sibling is removed and `folder` stays as it was. What `folder`
    held beside the results stays in it. A record that is replaced, the file named `last`, is kept in
    `earlier/`, named by its hash: audits, verifications and certificates may rest on it. What commands that
    were killed had gathered for the same folder is removed (`fringecal.replacement`).

    Raises
    ------
    RecordError
        `folder` is a file, or the operating system refuses to write there.
    """
    folder = _real(Path(folder).absolute())
    if not folder.name or "\0" in folder.name:
        raise RecordError(f"{str(folder)!r}: a folder of its own is needed for results; name one")
    staging = hidden_beside(folder)
    if os.path.lexists(folder) and not folder.is_dir():
        raise RecordError(f"{folder}: a folder for results was needed, found a file; name another")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        settle(folder)
        staging.mkdir()
        yield staging
        for file in sorted(file for file in staging.rglob("*") if file.is_file()):
            _flush(file)
        put_in_place(staging, folder, keep_others=True, merge=lambda: _keep_earlier(folder / last, staging / last))
    except OSError as error:
        where = error.filename if isinstance(error, FileExistsError) else folder
        raise RecordError(f"{where}: cannot be written ({error.strerror or error})") from error
    finally:
        with signals_deferred():
            shutil.rmtree(staging, ignore_errors=True)


def _real(folder: Path) -> Path:
    """Return the folder that a link or ``..`` leads to, since what is beside it is meant."""
    return Path(os.path.realpath(folder)) if folder.name == ".." or os.path.islink(folder) else folder


def earlier_record(record: Path, sha256: str) -> Path:
    """Return where a record of this content is kept once another one has taken its place."""
    return record.parent / EARLIER / f"{record.stem}-{sha256[:12]}.json"


def _keep_earlier(record: Path, successor: Path) -> None:
    """Put a record that is about to be replaced by another beside its successor, where its hash still finds it."""
    if record.suffix != ".json" or not record.is_file() or not successor.is_file():
        return
    content = record.read_bytes()
    if content != successor.read_bytes():
        kept = earlier_record(successor, hashlib.sha256(content).hexdigest())
        kept.parent.mkdir(exist_ok=True)
        kept.write_bytes(content)
        _flush(kept)


def _flush(file: Path) -> None:
    with file.open("rb+") as stream:
        os.fsync(stream.fileno())
