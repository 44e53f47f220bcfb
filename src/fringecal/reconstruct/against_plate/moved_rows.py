"""Single rows of one frame that lie aside of their neighbours: a sensor's or a digitizer's lost line synchronism."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

LEAST_PX = 0.3
"""Displacement of a row from which it is believed, px: as a picture's against the calibration's."""

LEAST_ROWS = 3
"""Rows of one frame from which lines are called unsteady: one may be an edge that lies along it."""

_SIGMAS = 6.0  # of a row's own residual and of all rows' scatter
_STEEP_LEVELS = 25.0  # per pixel: at steeper edges a displacement is no slope times its size
_OPPOSITE = (0.2, 0.9)  # times the row's own displacement, that both neighbours show the other way: half of it
_BLURS_PX = (0.0, 2.0)  # along the rows: fine texture shows small displacements, blurred rows large ones
_MOST_COLUMNS = 320  # side by side, of which rows are judged: of 12 megapixels 0.2 s
_FIRST_ROW = 4  # a row is judged beside its neighbours, and each by three rows on both sides
_TINY = 1e-9


def moved_rows(frames: NDArray[np.generic]) -> Iterator[tuple[int, float, NDArray[np.intp]]]:
    """Yield frame, median displacement in px, and which rows, for every frame of which single rows lie aside.

    Parameters
    ----------
    frames
        Grey levels, (N, H, W).

    Notes
    -----
    A row displaced by d differs from what three rows on both sides let expect (a cubic, which follows fringes along the
    rows) by `-d I'`, and both neighbours by 9/16 of that the other way. Texture and edges do so in all frames alike:
    the mean of the others is taken off, and of each row the frame that is displaced most is looked at. Rows along
    which nothing varies show nothing.
    """
    few = _columns(frames)
    found = [_aside(few if blur == 0 else _blurred(few, blur)) for blur in _BLURS_PX]
    for frame in range(len(frames)):
        marks = [np.flatnonzero(marked[frame]) for marked, _ in found]
        best = int(np.argmax([len(rows) for rows in marks]))
        if len(marks[best]) >= LEAST_ROWS:
            sizes = np.abs(found[best][1][frame, marks[best]])
            yield frame, float(np.median(sizes)), marks[best] + _FIRST_ROW


def _columns(frames: NDArray[np.generic]) -> Array:
    """Return the middle columns of the frames as floats."""
    width = frames.shape[2]
    first = max(0, (width - _MOST_COLUMNS) // 2)
    return frames[:, :, first : first + _MOST_COLUMNS].astype(np.float32)


def _blurred(frames: Array, blur_px: float) -> Array:
    """Blur along the rows."""
    across, down = cv2.getGaussianKernel(8 * int(blur_px) + 1, blur_px), np.ones(1)
    return np.stack([cv2.sepFilter2D(frame, cv2.CV_32F, across, down) for frame in frames])


def _aside(frames: Array) -> tuple[NDArray[np.bool_], Array]:
    """Return which rows lie aside of both neighbours, and by how much, px, from row `_FIRST_ROW` on."""
    near, far = frames[:, 2:-4] + frames[:, 4:-2], frames[:, :-6] + frames[:, 6:]
    change = frames[:, 3:-3] - (9 * near - far) / 16
    slope = np.zeros_like(change)
    slope[:, :, 1:-1] = (frames[:, 3:-3, 2:] - frames[:, 3:-3, :-2]) / 2
    change = (change - change.mean(axis=0)) * len(change) / (len(change) - 1)
    use = (np.abs(slope) < _STEEP_LEVELS) & (np.abs(change) < _STEEP_LEVELS)
    slope, change = np.where(use, slope, 0), np.where(use, change, 0)
    power = np.maximum((slope * slope).sum(axis=2), _TINY)
    away = -(change * slope).sum(axis=2) / power
    left = change + away[:, :, None] * slope
    u = np.sqrt(np.square(left, out=left).sum(axis=2) / np.maximum(use.sum(axis=2), 1) / power)
    away = away - np.median(away, axis=0)
    usual = 1.4826 * np.median(np.abs(away), axis=1, keepdims=True)
    middle = away[:, 1:-1]
    sure = np.abs(middle) == np.abs(middle).max(axis=0)
    sure &= (np.abs(middle) > _SIGMAS * np.hypot(usual, u[:, 1:-1])) & (np.abs(middle) > LEAST_PX)
    own = np.where(sure, middle, 1.0)
    low, high = _OPPOSITE
    for neighbour in (away[:, :-2], away[:, 2:]):
        against = -neighbour / own
        sure &= (against > low) & (against < high)
    return np.asarray(sure, np.bool_), np.asarray(middle, np.float32)
