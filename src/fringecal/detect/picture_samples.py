"""Brightness between the pixels, at any number of points in a picture of any size."""

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]

# OpenCV counts rows and columns of pictures and of lists of points in 16 bits when it resamples: 32,767 at most.
# Points are looked up in rows of so many, and longer pictures in parts of so many px.
_ROW_POINTS, _ROWS, _PART_PX = 16_384, 16_384, 30_000
# Pixels around a point that its brightness may depend on: cubic interpolation takes two to each side.
_MARGIN_PX = 4


def brightness_at(image: Single, u: FloatArray, v: FloatArray, *, cubic: bool = False) -> FloatArray:
    """Sample a picture at points, bilinear or cubic; outside its border the nearest pixel counts.

    Parameters
    ----------
    image
        Grey picture, (H, W).
    u, v
        Columns and rows of the points, px, arrays of one shape.
    cubic
        Cubic in place of bilinear interpolation.

    Returns
    -------
    numpy.ndarray
        Brightness in the shape of `u`.

    Examples
    --------
    >>> ramp = np.tile(np.arange(40_000, dtype=np.float32), (3, 1))
    >>> brightness_at(ramp, np.array([0.5, 39_000.25]), np.array([1.0, 1.0])).tolist()
    [0.5, 39000.25]
    """
    way = cv2.INTER_CUBIC if cubic else cv2.INTER_LINEAR
    columns, rows = u.astype(np.float32).ravel(), v.astype(np.float32).ravel()
    if max(image.shape) <= _PART_PX:
        return _in_rows(image, columns, rows, way).reshape(u.shape)
    found = np.empty(u.size)
    part = [
        np.clip(at, 0, size - 1).astype(int) // _PART_PX for at, size in ((rows, len(image)), (columns, len(image.T)))
    ]
    for down, right in np.unique(np.stack(part, axis=1), axis=0):
        here = (part[0] == down) & (part[1] == right)
        top, left = (max(0, int(place) * _PART_PX - _MARGIN_PX) for place in (down, right))
        window = image[top : (down + 1) * _PART_PX + _MARGIN_PX, left : (right + 1) * _PART_PX + _MARGIN_PX]
        at_u, at_v = (np.asarray(at.ravel()[here] - first, np.float32) for at, first in ((u, left), (v, top)))
        found[here] = _in_rows(window, at_u, at_v, way)
    return found.reshape(u.shape)


def _in_rows(
    image: npt.NDArray[np.float32], u: npt.NDArray[np.float32], v: npt.NDArray[np.float32], way: int
) -> FloatArray:
    """Sample at a list of points (n,), which is folded into rows; the last row is filled up."""
    found = np.empty(u.size)
    for first in range(0, u.size, _ROW_POINTS * _ROWS):
        some = slice(first, first + _ROW_POINTS * _ROWS)
        length = min(_ROW_POINTS, len(u[some]))
        folded = [np.pad(at[some], (0, -len(at[some]) % length)).reshape(-1, length) for at in (u, v)]
        values = cv2.remap(image, folded[0], folded[1], way, borderMode=cv2.BORDER_REPLICATE)
        found[some] = values.ravel()[: len(u[some])]
    return found
