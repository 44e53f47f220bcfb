"""How the bare plate looked, packed so that a record stays small."""

import base64
import zlib

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fringecal.errors import RecordError
from fringecal.records.parts import Part

_NOTHING = -(2**15)  # what stands for NaN
_MOST = 2**15 - 1


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
        numbers = np.frombuffer(zlib.decompress(base64.b64decode(written.data)), "<i2").reshape(written.shape)
    except (ValueError, zlib.error) as error:
        raise RecordError(
            f"look: an array of shape {written.shape} cannot be read ({error}); calibrate again"
        ) from error
    return np.where(numbers == _NOTHING, np.nan, numbers * written.step)
