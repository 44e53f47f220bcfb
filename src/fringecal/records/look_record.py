"""How the bare plate looked, packed so that a record stays small."""

import base64
import math
import zlib

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fringecal.errors import RecordError
from fringecal.records.parts import Part

_NOTHING = -(2**15)  # what stands for NaN
_MOST = 2**15 - 1
_MOST_NUMBERS = 2**24  # of one array: what is kept of a plate is some 10,000


class PackedArray(Part):
    """An array as 16-bit whole numbers of `step`: little-endian, compressed by zlib, in base64; -32768 is no value."""

    shape: tuple[int, ...]
    step: float = Field(gt=0)
    data: str


class LookRecord(Part):
    """The bare plate's light by cells of the picture, and pieces of its texture at full resolution, grey levels.

    `corners_px` holds column and row of each piece's first pixel, `noise_levels` the noise in `texture`.
    """

    shape: tuple[int, int]
    corners_px: tuple[tuple[int, int], ...]
    noise_levels: float = Field(ge=0)
    background: PackedArray
    modulation: PackedArray
    texture: PackedArray
    phase_shifts_rad: tuple[float, ...] = Field(default=(), description="as found in the plate's frames, or as stated")
    neighbour_scatter: float | None = Field(default=None, ge=0, description="of neighbours' phases over their noise")


def packed(values: NDArray[np.floating], step: float) -> PackedArray:
    """Pack an array, rounded to multiples of `step`.

    Examples
    --------
    >>> unpacked(packed(np.array([[0.5, np.nan], [-1.25, 2.0]]), 0.25)).tolist()
    [[0.5, nan], [-1.25, 2.0]]
    """
    known = np.isfinite(values)
    whole = np.clip(np.rint(np.where(known, values, 0) / step), -_MOST, _MOST)
    numbers = np.where(known, whole, _NOTHING).astype("<i2")
    return PackedArray(
        shape=values.shape, step=step, data=base64.b64encode(zlib.compress(numbers.tobytes(), 9)).decode()
    )


def unpacked(written: PackedArray) -> NDArray[np.float64]:
    """Return the array that was packed.

    Raises
    ------
    RecordError
        What is written is no array of this shape.
    """
    try:
        numbers = np.frombuffer(_unpacked(written), "<i2").reshape(written.shape)
    except (ValueError, zlib.error) as error:
        raise RecordError(
            f"look: an array of shape {written.shape} cannot be read ({error}); calibrate again"
        ) from error
    return np.where(numbers == _NOTHING, np.nan, numbers * written.step)


def _unpacked(written: PackedArray) -> bytes:
    """Decompress as many bytes as the array has, and none of what is there beyond them.

    Raises
    ------
    ValueError
        The shape is no shape, or larger than a picture, or the bytes are not as many.
    """
    if min(written.shape, default=0) < 0 or not 0 < (size := math.prod(written.shape)) <= _MOST_NUMBERS:
        raise ValueError(f"1 to {_MOST_NUMBERS} numbers are read")
    content = zlib.decompressobj().decompress(base64.b64decode(written.data), 2 * size + 1)
    if len(content) != 2 * size:
        raise ValueError(f"{2 * size} bytes were needed")
    return content
