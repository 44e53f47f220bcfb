"""From the bytes of a picture file to grey values, with nothing repaired, rotated or scaled on the way."""

import os
import re
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from fringecal.session.faults import PictureError
from fringecal.session.pictures.containers import Container, inspect_bmp
from fringecal.session.pictures.jpeg_segments import inspect_jpeg
from fringecal.session.pictures.png_chunks import PNG_SIGNATURE, inspect_png
from fringecal.session.pictures.tiff import read_tiff

# ITU-R BT.601, the luma that cameras and JPEG mean by it.
_LUMA = np.array([0.299, 0.587, 0.114])
_CHANNEL_WEIGHTS = {
    "mean": np.full(3, 1 / 3),
    "luma": _LUMA,
    "red": np.array([1.0, 0.0, 0.0]),
    "green": np.array([0.0, 1.0, 0.0]),
    "blue": np.array([0.0, 0.0, 1.0]),
}
# OpenCV's level of telling: at a lower one, which the environment may ask for, libtiff's errors are not told.
_LOG_WARNINGS = 3
_TIFF_ERROR = "TIFF_Error"
_SAID_WHERE = re.compile(r"\[\s*\w+:\S+\] global \S+ (TIFF_\w+ )?")
_LONGEST_COMPLAINT = 160  # letters: two lines
_stderr_lock = threading.Lock()


@dataclass(frozen=True)
class Picture:
    """A decoded picture file.

    Parameters
    ----------
    pixels
        (H, W) grey or (H, W, 3) red, green, blue; uint8 or uint16.
    container
        What the file says of itself.
    """

    pixels: np.ndarray
    container: Container

    @property
    def bits(self) -> int:
        """Bits of the container, 8 or 16."""
        return 8 * self.pixels.dtype.itemsize

    @property
    def is_colour(self) -> bool:
        """Whether the channels differ anywhere."""
        return self.pixels.ndim == 3


def decode(data: bytes) -> Picture:
    """Decode a PNG, TIFF, BMP or JPEG file; its kind is told by its content, not by its name.

    RGB whose channels are equal everywhere is grey. Alpha is dropped. An EXIF orientation is not
    applied: pixels stay where the sensor has them. What the header announces is judged before anything is unpacked
    (`size_limits`).

    Raises
    ------
    PictureError
        If the file is empty, truncated, damaged, of another kind, not 8 or 16 bit, or larger than what is read.
    """
    if not data:
        raise PictureError("an empty file (0 bytes)")
    pixels: np.ndarray | None = None
    if data.startswith(PNG_SIGNATURE):
        data, container = inspect_png(data)
    elif data.startswith(b"\xff\xd8\xff"):
        container = inspect_jpeg(data)
    elif data.startswith(b"BM"):
        container = inspect_bmp(data)
    elif data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        pixels, container = read_tiff(data)
    else:
        raise PictureError(
            f"not a picture: begins with {data[:8]!r}", "give a PNG, TIFF, BMP or JPEG file, 8 to 16 bit"
        )
    if pixels is None:
        pixels = _decode_by_opencv(data, container.format)
    return Picture(_without_idle_channels(pixels), container)


def _decode_by_opencv(data: bytes, kind: str) -> np.ndarray:
    with _written_to_stderr() as written:
        try:
            pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            if error.code == cv2.Error.StsNoMem:
                raise MemoryError("no memory to decode a picture in") from error
            pixels = None
    complaints = "".join(written)
    # libjpeg and libtiff fill up what is not there, and return it. Of TIFF, warnings are mostly of unknown tags.
    if pixels is None or (complaints.strip() if kind == "JPEG" else _TIFF_ERROR in complaints):
        raise PictureError(f"damaged {kind}: {_first(complaints) or 'it cannot be decoded'}")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise PictureError(f"samples of type {pixels.dtype}, needed 8 or 16 bit", "save as 8- or 16-bit grey")
    if pixels.ndim == 3 and pixels.shape[2] >= 3:
        pixels = pixels[:, :, 2::-1]  # OpenCV gives blue, green, red[, alpha]
    return pixels


def _first(complaints: str) -> str:
    """Return the first of what decoders said, errors before warnings, without where in OpenCV it was said."""
    lines = sorted(complaints.splitlines(), key=lambda line: "ERROR" not in line)
    return _SAID_WHERE.sub("", next(iter(lines), "")).strip()[:_LONGEST_COMPLAINT]


def _without_idle_channels(pixels: np.ndarray) -> np.ndarray:
    if pixels.ndim == 2:
        return pixels
    if pixels.shape[2] < 3:
        return np.ascontiguousarray(pixels[:, :, 0])
    red, green, blue = (pixels[:, :, k] for k in range(3))
    if np.array_equal(red, green) and np.array_equal(red, blue):
        return np.ascontiguousarray(red)
    return np.ascontiguousarray(pixels[:, :, :3])


def to_grey(pixels: np.ndarray, channel: str | None, white_level: int) -> np.ndarray:
    """Reduce red, green, blue to one value by a stated rule; grey passes unchanged.

    A pixel is saturated as soon as one channel that counts is: it gets `white_level`, lest the mean of
    a clipped and an unclipped channel pass for a measurement. Other values are rounded to the nearest.

    Parameters
    ----------
    pixels
        (H, W) or (H, W, 3), uint8 or uint16.
    channel
        ``"mean"``, ``"red"``, ``"green"``, ``"blue"`` or ``"luma"`` (BT.601).
    white_level
        Value of a saturated pixel.

    Examples
    --------
    >>> pixels = np.array([[[30, 60, 90], [255, 10, 20]]], dtype=np.uint8)
    >>> to_grey(pixels, "mean", 255)
    array([[ 60, 255]], dtype=uint8)
    """
    if pixels.ndim == 2:
        return pixels
    if channel is None:
        raise PictureError(
            "colour without a rule for its channels",
            'state channel = "green" (or "mean", "red", "blue", "luma") under [camera] or in the capture',
        )
    weights = _CHANNEL_WEIGHTS[channel]
    counted = pixels[:, :, weights > 0]
    grey = np.rint(counted @ weights[weights > 0]).astype(pixels.dtype)
    grey[(counted >= white_level).any(axis=2)] = white_level
    return grey


@contextmanager
def _written_to_stderr() -> Iterator[list[str]]:
    """Catch what native decoders write to file descriptor 2: libjpeg reports damage nowhere else."""
    written: list[str] = []
    with _stderr_lock, tempfile.TemporaryFile() as catch:
        try:
            saved = os.dup(2)
        except OSError:  # a process without standard error has nothing to catch
            yield written
            return
        os.dup2(catch.fileno(), 2)
        level = cv2.utils.logging.setLogLevel(_LOG_WARNINGS)
        try:
            yield written
        finally:
            cv2.utils.logging.setLogLevel(level)
            os.dup2(saved, 2)
            os.close(saved)
            catch.seek(0)
            written.append(catch.read().decode(errors="replace"))
