"""Find the files of a capture and learn of each what the checks need, without keeping its pixels."""

import hashlib
import itertools
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fringecal.session.document import is_inside
from fringecal.session.faults import Fault, nearest
from fringecal.session.pictures.containers import Container
from fringecal.session.pictures.picture import decode
from fringecal.session.pictures.size_limits import kind_of_place, regular_bytes

_GLOB_CHARACTERS = re.compile(r"[*?\[]")
_MOST_ENTRIES = 100_000  # of a capture: 20 steps of 10 periods, 500 times over
_MOST_NAMED = 20  # of the files of a capture that are not there: more say no more
_MOST_COMPARED = 5000  # names of a folder that are compared with a missing one, which takes 10 us each
_BRIGHT = 0.995  # quantile of the pixels that stands for a picture's brightness: above hot pixels and glints


@dataclass(frozen=True)
class FrameFacts:
    """What is known of one picture file after it has been decoded once.

    Parameters
    ----------
    path, sha256
        The file and the hash of its bytes.
    height_px, width_px, bits
        Size, and bits of the container (8 or 16).
    is_colour
        Whether red, green and blue differ.
    pixel_digest
        Hash of the decoded pixels: equal for one picture saved twice in different ways.
    peak, peak_share
        Largest value, and the share of pixels that have it.
    bright
        Value that 99.5 % of the pixels do not exceed.
    used_bits
        Bitwise or of all values: which bits the camera uses.
    container
        What the file says of itself.
    """

    path: Path
    sha256: str
    height_px: int
    width_px: int
    bits: int
    is_colour: bool
    pixel_digest: str
    peak: int
    peak_share: float
    bright: int
    used_bits: int
    container: Container

    def saturated_share(self, white_level: int) -> float:
        """Share of pixels at the white level, 0..1."""
        return self.peak_share if self.peak >= white_level else 0.0


def natural_key(name: str) -> list[tuple[int, str]]:
    """Sort key by which ``f-2`` comes before ``f-10``.

    Examples
    --------
    >>> sorted(["f-10.png", "f-2.png"], key=natural_key)
    ['f-2.png', 'f-10.png']
    """
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", name)]


def expand(folder: Path, entries: Sequence[str], where: str) -> tuple[list[Path], list[Fault]]:
    """Turn the names and globs of a capture into files, each glob naturally sorted."""
    if len(entries) > _MOST_ENTRIES:
        found = f"{len(entries)} entries, at most {_MOST_ENTRIES} are read"
        return [], [Fault(where, found, "list fewer, or name them by a pattern")]
    paths: list[Path] = []
    faults: list[Fault] = []
    missing: list[str] = []
    for entry in entries:
        found_paths, fault = _expand_one(folder, entry, where)
        paths += found_paths
        if fault is not None:
            faults.append(fault)
        elif not found_paths:
            missing.append(entry)
    return paths, [*faults, *_missing_faults(folder, missing, where)]


def _expand_one(folder: Path, entry: str, where: str) -> tuple[list[Path], Fault | None]:
    """Find the files of one entry; none, and no fault, where it names a file that is not there."""
    if not is_inside(entry) or "\0" in entry:
        return [], Fault(
            where, f'"{entry}" is outside the session folder', "copy it in and name it relative to the folder"
        )
    path = folder / entry
    if os.path.isfile(path):
        return [path], None
    kind = kind_of_place(path)
    if kind == "a folder":
        return [], Fault(where, f'"{entry}" is a folder', f'list its files, for example "{entry}/*.png"')
    if kind:
        return [], Fault(where, f'"{entry}" is {kind}, a file was needed', "name a picture file")
    if not _GLOB_CHARACTERS.search(entry):
        return [], None
    found = sorted((p for p in _glob(folder, entry) if os.path.isfile(p)), key=lambda p: natural_key(str(p)))
    if found:
        return found, None
    return [], Fault(where, f'no file matches "{entry}"', "correct the pattern or add the files")


def _glob(folder: Path, pattern: str) -> list[Path]:
    try:
        return list(folder.glob(pattern))
    except (ValueError, NotImplementedError, OSError):  # such as "a**": a pattern that matches nothing by its form
        return []


def _missing_faults(folder: Path, missing: Sequence[str], where: str) -> Iterator[Fault]:
    """Name what is not there: the first entries one by one, each with the nearest name that is, the rest together."""
    one_by_one = missing[:_MOST_NAMED] if len(missing) > _MOST_NAMED + 1 else missing
    names: dict[Path, list[str]] = {}
    for entry in one_by_one:
        yield Fault(where, f'"{entry}" is not there', _missing_remedy(folder / entry, names))
    rest = missing[len(one_by_one) :]
    if rest:
        yield Fault(where, f'"{rest[0]}" is not there, and {len(rest) - 1} more are not', "add the files")


def _missing_remedy(path: Path, names: dict[Path, list[str]]) -> str:
    """Ask for the nearest name that there is; `names` keeps what lies in the folders that were read."""
    if path.parent not in names:
        names[path.parent] = _names_in(path.parent)
    close = nearest(path.name, names[path.parent])
    return f'did you mean "{close}"?' if close else "add the file or correct the name"


def _names_in(folder: Path) -> list[str]:
    try:
        with os.scandir(folder) as entries:
            return [entry.name for entry in itertools.islice(entries, _MOST_COMPARED)]
    except OSError:
        return []


def examine(path: Path) -> FrameFacts:
    """Read and decode one file.

    Raises
    ------
    PictureError
        If it cannot be read or trusted.
    """
    data = regular_bytes(path)
    picture = decode(data)
    pixels = np.ascontiguousarray(picture.pixels)
    peak = int(pixels.max())
    n_bright = int(_BRIGHT * (pixels.size - 1))
    return FrameFacts(
        path=path,
        sha256=hashlib.sha256(data).hexdigest(),
        height_px=pixels.shape[0],
        width_px=pixels.shape[1],
        bits=picture.bits,
        is_colour=picture.is_colour,
        pixel_digest=f"{pixels.dtype}{pixels.shape}{hashlib.sha256(pixels.data).hexdigest()}",
        peak=peak,
        peak_share=float(np.count_nonzero(pixels == peak) / pixels.size),
        bright=int(np.partition(pixels, n_bright, axis=None)[n_bright]),
        used_bits=int(np.bitwise_or.reduce(pixels, axis=None)),
        container=picture.container,
    )
