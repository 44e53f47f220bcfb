"""How large a picture file may be, packed and unpacked: judged by its header, before any pixel is read."""

import os
import stat
from pathlib import Path

from fringecal.session.faults import PictureError

# Of a file, and of the pixels in it: 1 GiB holds 151 megapixels (the largest machine-vision sensor) of three channels
# with 16 bit (0.9 GiB), or 12,000 x 9,000 of four (0.8 GiB).
MOST_BYTES = 1 << 30
MOST_PIXELS = 1 << 28  # 16,384 x 16,384: eight bit of grey in a quarter of MOST_BYTES
# Unpacked over packed bytes. Deflate reaches 1032 for a picture of zeros, the DCT of JPEG 512 with its channels sampled
# two by two: whoever announces more has no data for it.
MOST_RATIO = 1100
_MIB = 1 << 20
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def check_size(width: int, height: int, bytes_per_pixel: int, packed: int) -> None:
    """Refuse sizes that no camera has, and those for which the file is too small.

    Parameters
    ----------
    width, height
        As the header announces them, px.
    bytes_per_pixel
        All channels of a pixel, alpha among them, unpacked.
    packed
        Size of the whole file, bytes.

    Raises
    ------
    PictureError
        Before anything has been unpacked.

    Examples
    --------
    >>> check_size(12_000, 9_000, 2, 190_000_000)
    >>> check_size(32_000, 32_000, 1, 335)
    Traceback (most recent call last):
    fringecal.session.faults.PictureError: a header that announces 32000 x 32000 px, at most 268435456 are read; ...
    """
    announced = f"a header that announces {width} x {height} px"
    if width <= 0 or height <= 0:
        raise PictureError(announced)
    smaller = "save the part that is needed"
    if width * height > MOST_PIXELS:
        raise PictureError(f"{announced}, at most {MOST_PIXELS} are read", smaller)
    unpacked = width * height * bytes_per_pixel
    if unpacked > MOST_BYTES:
        found = f"{announced} of {bytes_per_pixel} bytes, at most {MOST_BYTES // _MIB} MiB are read"
        raise PictureError(found, smaller)
    if unpacked > MOST_RATIO * packed:
        raise PictureError(f"{announced} ({unpacked} bytes) in a file of {packed} bytes: its pixels are not there")


def regular_bytes(path: Path) -> bytes:
    """Read a picture file; what is no file, such as a pipe, is never opened, and what is too large is not read.

    Raises
    ------
    PictureError
        With what is there instead.

    Examples
    --------
    >>> len(regular_bytes(Path("tests/data/oblique/grid.png"))) > 1000
    True
    """
    try:
        _demand_regular(os.stat(path).st_mode)
        # Not blocking: between the look and the opening a pipe may have taken the file's place.
        with open(path, "rb", opener=_without_waiting) as file:
            there = os.fstat(file.fileno())
            _demand_regular(there.st_mode)
            _demand_bounded(there.st_size)
            content = file.read(there.st_size + 1)
    except OSError as error:
        raise PictureError(f"cannot be read ({error.strerror})", "see that it is there and may be read") from error
    except ValueError as error:  # a name that no file can have
        raise PictureError(f"cannot be read ({error})", "see that it is there and may be read") from error
    if len(content) != there.st_size:
        raise PictureError(f"announced as {there.st_size} bytes, and others were read", "wait until it is written")
    return content


def kind_of_place(path: Path) -> str:
    """Say what lies at a path, such as ``"a pipe"``; empty for a file, and where nothing is or can be seen.

    Examples
    --------
    >>> kind_of_place(Path("/")), kind_of_place(Path("/nowhere"))
    ('a folder', '')
    """
    try:
        return _kind(os.stat(path).st_mode)
    except (OSError, ValueError):
        return ""


def _kind(mode: int) -> str:
    return next((words for is_kind, words in _KINDS if is_kind(mode)), "")


def _demand_regular(mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise PictureError(f"{_kind(mode) or 'something else'}, a file was needed", "name a picture file")


def _demand_bounded(size: int) -> None:
    if size > MOST_BYTES:
        raise PictureError(f"a file of {size} bytes, at most {MOST_BYTES} are read", "save the part that is needed")


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
