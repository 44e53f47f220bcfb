"""A board of unknown size in a picture: ChArUco by its markers, a chessboard by squares dark and light in turn."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

_DICTIONARIES = ("DICT_4X4_50", "DICT_5X5_100", "DICT_6X6_250", "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL")
_LEAST_MARKERS = 4  # of one dictionary: single ones are read into texture
_LEAST_CORNERS = 4  # of a chessboard, along each side
_CONTRAST, _APART = 40, 1.2  # grey levels between black and white squares, and over their scatter


@dataclass(frozen=True)
class UnknownBoard:
    """What kind of board was found, and in words how much of it."""

    kind: Literal["charuco", "chessboard"]
    words: str


def board_in(grey: NDArray[np.generic]) -> UnknownBoard | None:
    """Look for a board of any size.

    Parameters
    ----------
    grey
        Grey levels, (H, W).
    """
    small = stretched(grey)
    return _markers(small) or _chessboard(small)


def stretched(grey: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Return a picture in 8 bit, from nearly its darkest to nearly its brightest pixel.

    Parameters
    ----------
    grey
        Grey levels, (H, W).
    """
    darkest, brightest = np.percentile(np.asarray(grey, np.float32), [0.5, 99.5])
    return np.clip((grey - darkest) / max(brightest - darkest, 1e-6) * 255, 0, 255).astype(np.uint8)


def _markers(small: NDArray[np.uint8]) -> UnknownBoard | None:
    counts = {}
    for name in _DICTIONARIES:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        _, numbers, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(small)
        counts[name] = 0 if numbers is None else len(numbers)
    best = max(counts, key=lambda name: counts[name])
    if counts[best] < _LEAST_MARKERS:
        return None
    return UnknownBoard("charuco", f"{counts[best]} markers of {best.rpartition('_')[0]}")


def _chessboard(small: NDArray[np.uint8]) -> UnknownBoard | None:
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    least = (_LEAST_CORNERS, _LEAST_CORNERS)
    found, corners, cells = cv2.findChessboardCornersSBWithMeta(small, least, flags)
    if not found or min(cells.shape[:2]) < _LEAST_CORNERS:
        return None
    rows, columns = cells.shape[:2]
    if not _alternates(small, corners.reshape(rows, columns, 2)):
        return None
    return UnknownBoard("chessboard", f"{max(rows, columns)} x {min(rows, columns)} inner corners")


def _alternates(small: NDArray[np.uint8], corners: NDArray[np.float32]) -> bool:
    """Whether the squares between corners are dark and light in turn."""
    centres = (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 4
    u, v = np.rint(centres).astype(int).transpose(2, 0, 1)
    smooth = cv2.GaussianBlur(small, (0, 0), 1.5).astype(float)
    seen = smooth[np.clip(v, 0, small.shape[0] - 1), np.clip(u, 0, small.shape[1] - 1)]
    sign = np.where(np.add.outer(np.arange(seen.shape[0]), np.arange(seen.shape[1])) % 2, 1.0, -1.0)
    one, other = seen[sign > 0], seen[sign < 0]
    apart = abs(float(np.median(one) - np.median(other)))
    return bool(apart > max(_CONTRAST, _APART * (np.std(one) + np.std(other))))
