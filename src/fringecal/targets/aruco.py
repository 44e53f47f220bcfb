"""ArUco dictionaries by name, and the bits of their markers."""

import difflib
import re

import numpy as np


def dictionary_names() -> list[str]:
    """Names of the predefined dictionaries, as in ``cv2.aruco``."""
    import cv2  # loaded late: listing and reading targets must not wait for OpenCV

    return sorted(name for name in dir(cv2.aruco) if re.fullmatch(r"DICT_\w+", name))


ALIKE = 0.4  # similarity of names by difflib, for a hint: long names that share half of their letters


def _dictionary(name: str):  # type: ignore[no-untyped-def]  # cv2 has no type for it
    import cv2

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def check_dictionary(name: str, markers: int) -> None:
    """Refuse an unknown dictionary, or one with fewer than `markers` markers, by `ValueError`."""
    known = dictionary_names()
    if name not in known:
        nearest = difflib.get_close_matches(name.upper(), known, n=1, cutoff=ALIKE)
        hint = f'; did you mean "{nearest[0]}"?' if nearest else f"; known are {', '.join(known)}"
        raise ValueError(f'unknown dictionary "{name}"{hint}')
    has = len(_dictionary(name).bytesList)
    if has < markers:
        raise ValueError(f"{name} has {has} markers and the board needs {markers}; take a larger dictionary")


def marker_bits(dictionary: str, marker: int) -> np.ndarray:
    """Draw one marker as bits, True where black, with its one-bit black border, shape (n, n).

    Examples
    --------
    >>> marker_bits("DICT_4X4_50", 0).astype(int)
    array([[1, 1, 1, 1, 1, 1],
           [1, 0, 1, 0, 0, 1],
           [1, 1, 0, 1, 0, 1],
           [1, 1, 1, 0, 0, 1],
           [1, 1, 1, 0, 1, 1],
           [1, 1, 1, 1, 1, 1]])
    """
    import cv2

    markers = _dictionary(dictionary)
    side = markers.markerSize + 2
    return cv2.aruco.generateImageMarker(markers, marker, side) == 0


def board_bits(dictionary: str, columns: int, rows: int) -> np.ndarray:
    """Draw the markers of a ChArUco board as bits, True where black, each with its one-bit black border.

    Parameters
    ----------
    dictionary
        Name of an ArUco dictionary.
    columns, rows
        Squares in a row and rows of squares.

    Returns
    -------
    Shape (rows, columns, n, n), row 0 at the top. Markers are numbered row by row from the top left through
    the light squares, as OpenCV numbers them; dark squares, the top left among them, have no black bit.

    Examples
    --------
    >>> board_bits("DICT_4X4_50", 3, 2).any(axis=(2, 3)).astype(int)
    array([[0, 1, 0],
           [1, 0, 1]])
    """
    light = np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 1
    markers = np.stack([marker_bits(dictionary, marker) for marker in range(np.count_nonzero(light))])
    bits = np.zeros((rows, columns, *markers.shape[1:]), bool)
    bits[light] = markers
    return bits
