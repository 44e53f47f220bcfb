"""Session folders that come in through the browser: every name is judged before anything is written."""

import shutil
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from fringecal.serve.access import Refused
from fringecal.session import FILE_NAME, joined

SUFFIXES = (".toml", ".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg", ".cameramodel", ".yml", ".yaml", ".xml", ".mat")
_LONGEST_NAME = 120  # letters: half of what file systems take, so that a folder and a suffix of ours fit beside it
_CHUNK = 1 << 20  # bytes that are copied at a time
# Endings of names that Windows takes for devices, whatever their suffix.
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10))}


@dataclass(frozen=True)
class Bounds:
    """How much one upload may hold: several sessions of frames as large as cameras take."""

    files: int = 200
    megabytes: int = 1000


def receive(parts: Sequence[tuple[str, BinaryIO]], folder: Path, bounds: Bounds) -> Path:
    """Write an upload into a fresh folder, whole or not at all, and return that folder.

    Parameters
    ----------
    parts
        Name relative to the session's parent or to the session itself, and content, of every file.
    folder
        Where to; it must not exist yet.
    bounds
        Limits of the upload.

    Raises
    ------
    Refused
        A name is not one of a session's files, or there are too many files, or too large ones.
    """
    places = places_of([name for name, _ in parts], bounds)
    folder.mkdir(mode=0o700, parents=True)
    try:
        left = bounds.megabytes * 10**6
        for place, (_, content) in zip(places, parts, strict=True):
            left -= _copy(content, folder / place, left)
    except BaseException:
        shutil.rmtree(folder)
        raise
    return folder


def places_of(names: Sequence[str], bounds: Bounds | None = None) -> list[PurePosixPath]:
    """Return where each file of an upload belongs in the session folder, at most one folder deep.

    Browsers put the name of the chosen folder before every file; it is left out where all share it.

    Raises
    ------
    Refused
        A name leads elsewhere, is none that sessions use or stands twice; there are too many; or no session.toml.

    Examples
    --------
    >>> [str(place) for place in places_of(["bench/session.toml", "bench/grid/a.png"])]
    ['session.toml', 'grid/a.png']
    """
    bounds = bounds or Bounds()
    if len(names) > bounds.files:
        raise Refused(f"{len(names)} files were sent, at most {bounds.files} are taken; --most-files allows more", 413)
    parts = [_parts(name) for name in names]
    if all(len(one) > 1 for one in parts) and len({one[0] for one in parts}) == 1:
        parts = [one[1:] for one in parts]
    deep = ["/".join(one) for one in parts if len(one) > 2]
    if deep:
        raise Refused(f"folders in folders of a session are not taken: {joined(deep)}; put its files one folder up")
    _demand_distinct(parts)
    if (FILE_NAME,) not in parts:
        raise Refused(f"no {FILE_NAME} was sent: choose the folder that holds it, not one above or below")
    return [PurePosixPath(*one) for one in parts]


def _parts(name: str) -> tuple[str, ...]:
    """Split a name at its slashes, and refuse what is no plain relative name of a session's file."""
    shown = repr(name[:_LONGEST_NAME])
    parts = tuple(name.split("/"))
    if not all(map(_is_plain, parts)):
        raise Refused(f"the name {shown} is not taken: plain names below the session's folder were needed")
    suffix = PurePosixPath(name).suffix.lower()
    if suffix not in SUFFIXES:
        raise Refused(f"{shown} is no file that sessions use; leave it out, and send only {', '.join(SUFFIXES)}", 415)
    return parts


def _is_plain(part: str) -> bool:
    """Whether a file of this name lies in its folder on every system, and is shown as it is called.

    Examples
    --------
    >>> [_is_plain(part) for part in ("grid 1.png", "..", "C:", "nul.png", ".hidden", "")]
    [True, False, False, False, False, False]
    """
    return (
        0 < len(part) <= _LONGEST_NAME
        and part.isprintable()
        and not set(part) & set('\\:*?"<>|')
        and not part.startswith((".", " "))
        and not part.endswith((".", " "))
        and part.split(".")[0].casefold() not in _DEVICES
    )


def _demand_distinct(parts: Iterable[tuple[str, ...]]) -> None:
    """Refuse names that are one on some systems, and a file that is called as a folder is."""
    names = [tuple(part.casefold() for part in one) for one in parts]
    twice = [name for name, count in Counter(names).items() if count > 1]
    mixed = {name[:1] for name in names if len(name) > 1} & set(names)
    if twice or mixed:
        found = joined("/".join(name) for name in (*twice, *sorted(mixed)))
        raise Refused(f"names that stand twice, upper or lower case: {found}; rename one of each")


def _copy(content: BinaryIO, target: Path, left: int) -> int:
    """Copy into a new file; return its size in bytes."""
    target.parent.mkdir(exist_ok=True)
    size = 0
    with target.open("xb") as file:
        while chunk := content.read(_CHUNK):
            size += len(chunk)
            if size > left:
                raise Refused("the upload is too large; --most-megabytes allows more", 413)
            file.write(chunk)
    return size
