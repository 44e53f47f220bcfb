"""The pictures of a folder, small and grey, gathered into series by folder and name."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import SessionError
from fringecal.session import PictureError, decode, natural_key, regular_bytes, to_grey

Image = NDArray[np.float32]

SUFFIXES = (".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg")
_LONGER_SIDE_PX = 1100  # of a picture that is looked at: fringes of 8 px in 20 megapixels are still there
_MOST_PICTURES = 10_000  # of a folder
_LAST_NUMBER = re.compile(r"[-_ ]*\d+$")
_PART_OF_SET = re.compile(
    r"[-_ ]+(?:[uvxyhpfs]\d*|(?:white|black|gr[ae]y|bit|step|shift|phase|period|column|row|horizontal|vertical)s?\d*)$",
    re.IGNORECASE,
)
"""What names say of a frame within a set: its axis or period, or that it is white, black or Gray code."""


@dataclass(frozen=True)
class Still:
    """One picture, reduced.

    Parameters
    ----------
    file
        Its path within the folder, with forward slashes.
    grey
        Grey levels, reduced by `factor`, (H, W).
    factor
        By how much.
    shape
        Of the whole picture, px.
    colour
        Whether it has colours.
    white_level
        The largest value that a pixel may have.
    modified
        When its file was written, s.
    """

    file: str
    grey: Image
    factor: int
    shape: tuple[int, int]
    colour: bool
    white_level: int
    modified: float


@dataclass(frozen=True)
class Series:
    """Pictures of one folder whose names differ by their last number and by what tells frames of a set apart alone.

    They are in natural order.
    """

    name: str
    stills: tuple[Still, ...]

    @property
    def files(self) -> tuple[str, ...]:
        """Paths within the folder."""
        return tuple(still.file for still in self.stills)


def series_of(folder: Path, channel: str | None = None, tell: Callable[[str], None] = lambda _: None) -> list[Series]:
    """Read the pictures of a folder and its folders.

    Parameters
    ----------
    folder
        Where they are.
    channel
        How colours become grey; the mean of them to look at, where not stated.
    tell
        Called with what is being read.

    Raises
    ------
    SessionError
        There are none, too many, or one that cannot be read.
    """
    pictures = (path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    files = sorted(pictures, key=lambda path: natural_key(path.relative_to(folder).as_posix()))
    if not files:
        raise SessionError([f"{folder}: no pictures ({', '.join(SUFFIXES)}); give the folder that holds them"])
    if len(files) > _MOST_PICTURES:
        raise SessionError(
            [f"{folder}: {len(files)} pictures; give the folder of one session ({_MOST_PICTURES} at most)"]
        )
    groups: dict[tuple[str, str], list[Path]] = {}
    for path in files:
        groups.setdefault((path.parent.as_posix(), _common(path.stem)), []).append(path)
    found = []
    for paths in groups.values():
        tell(f"looking at {paths[0].relative_to(folder).as_posix()}")
        found.append(Series(_name(folder, paths), tuple(_still(folder, path, channel) for path in paths)))
    return found


def _common(stem: str) -> str:
    """Return what a name has in common with those of the same series.

    A number at its end goes; where something else tells frames apart, numbers before it stay, of a pose for example.
    """
    rest = _LAST_NUMBER.sub("", stem) if not _PART_OF_SET.search(stem) else stem
    while (shorter := _PART_OF_SET.sub("", rest)) != rest:
        rest = shorter
    return rest


def _name(folder: Path, paths: list[Path]) -> str:
    """Name a series: its folder where that has one series alone, else the names' common part, within the folder."""
    inner = paths[0].parent.relative_to(folder)
    stem = paths[0].stem if len(paths) == 1 else _common(paths[0].stem)
    parts = [*inner.parts, *([stem] if stem else [])]
    return "-".join(parts) or "pictures"


def _still(folder: Path, path: Path, channel: str | None) -> Still:
    try:
        picture = decode(regular_bytes(path))
    except PictureError as error:
        raise SessionError([f"{path.relative_to(folder).as_posix()}: {error}"]) from error
    white = 2**picture.bits - 1
    grey = to_grey(picture.pixels, (channel or "mean") if picture.is_colour else None, white)
    factor = max(1, round(max(grey.shape) / _LONGER_SIDE_PX))
    size = grey.shape[1] // factor, grey.shape[0] // factor
    squares = grey[: size[1] * factor, : size[0] * factor].reshape(size[1], factor, size[0], factor)
    small = squares.mean(axis=(1, 3), dtype=np.float32)
    file = path.relative_to(folder).as_posix()
    shape = grey.shape[0], grey.shape[1]
    return Still(file, small, factor, shape, picture.is_colour, white, path.stat().st_mtime)
