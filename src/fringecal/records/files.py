"""Writing so that a reader never meets half a file: to a sibling first, then renamed into place."""

import contextlib
import glob
import hashlib
import os
import secrets
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from fringecal.errors import RecordError

if TYPE_CHECKING:
    import pandas as pd

ABANDONED_S = 24 * 3600.0
"""Age in s after which what a killed command had gathered is cleared away by the next one; none works so long at it."""

EARLIER = "earlier"
"""Folder beside a record that keeps those that stood in its place."""


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Lend a temporary sibling to write to; it takes the place of `path` if the block succeeds.

    The file is flushed to the disk before the rename and its folder after it, so that after a
    crash the old or the new content is there, whole. On any error the sibling is removed and
    `path` stays as it was. The sibling keeps the suffix, since libraries choose formats by it.

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
    sibling = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.partial{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield sibling
        _flush(sibling)
        os.replace(sibling, path)  # noqa: PTH105 -- the one call that is atomic on every system
        _flush_folder(path.parent)
    except OSError as error:
        raise RecordError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with contextlib.suppress(OSError):  # where nothing can be made, nothing is left
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
    return write_text(path, frame.to_csv(index=False, lineterminator="\n"))


@contextlib.contextmanager
def result_folder(folder: str | Path, *, last: str = "calibration.json") -> Iterator[Path]:
    """Lend a hidden sibling folder to write results into; they move to `folder` all together.

    If the block fails or is interrupted, the sibling is removed and `folder` stays as it was.
    A new `folder` appears in one rename. Into an existing one the files are renamed one by one,
    the file named `last` after all others, so that a record never stands before its results;
    files of other names are left alone. A record that is replaced is kept in `earlier/`, named
    by its hash: audits, verifications and certificates may rest on it. What a command that was
    killed had gathered for the same folder is removed once it is a day old.

    Raises
    ------
    RecordError
        `folder` is a file, or the operating system refuses to write there.
    """
    folder = Path(folder).absolute()
    staging = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}.partial")
    if folder.exists() and not folder.is_dir():
        raise RecordError(f"{folder}: a folder for results was needed, found a file; name another")
    try:
        staging.mkdir(parents=True)
        _clear_abandoned(folder)
        yield staging
        _move_all(staging, folder, last)
    except OSError as error:
        raise RecordError(f"{folder}: cannot be written ({error.strerror or error})") from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _clear_abandoned(folder: Path) -> None:
    for left in folder.parent.glob(f".{glob.escape(folder.name)}.*.partial"):
        if time.time() - left.stat().st_mtime > ABANDONED_S:
            shutil.rmtree(left, ignore_errors=True)


def _move_all(staging: Path, folder: Path, last: str) -> None:
    files = sorted(file for file in staging.rglob("*") if file.is_file())
    for file in files:
        _flush(file)
    if not folder.exists():
        staging.rename(folder)
        _flush_folder(folder.parent)
        return
    for file in sorted(files, key=lambda file: file.name == last):
        target = folder / file.relative_to(staging)
        target.parent.mkdir(parents=True, exist_ok=True)
        if target == folder / last:
            _keep_earlier(target, file)
        file.replace(target)
        _flush_folder(target.parent)


def earlier_record(record: Path, sha256: str) -> Path:
    """Return where a record of this content is kept once another one has taken its place."""
    return record.parent / EARLIER / f"{record.stem}-{sha256[:12]}.json"


def _keep_earlier(record: Path, successor: Path) -> None:
    """Copy a record that is about to be replaced by another to where it will still be found by its hash."""
    if record.suffix != ".json" or not record.exists():
        return
    content = record.read_bytes()
    if content != successor.read_bytes():
        kept = earlier_record(record, hashlib.sha256(content).hexdigest())
        kept.parent.mkdir(exist_ok=True)
        write_bytes(kept, content)


def _flush(file: Path) -> None:
    with file.open("rb+") as stream:
        os.fsync(stream.fileno())


def _flush_folder(folder: Path) -> None:
    # Windows cannot open a folder for this; its renames are journalled.
    with contextlib.suppress(PermissionError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
