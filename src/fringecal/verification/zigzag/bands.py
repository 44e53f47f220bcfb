"""Means over bands of the flanks: where along the bars, and on which flank, an error sits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.verification.zigzag.zigzag_shape import Floats, ZigzagShape, bar_number, ridge_offset

_ALONG_BANDS = 10  # tenths of the bars' length: long enough for a mean, short enough to show a slope
_MIN_SHARE = 0.1  # of the typical band's pixels: a sliver at an end is no band
_MIN_PIXELS = 20.0  # of a band: fewer have a mean that their own noise makes


@dataclass(frozen=True)
class Band:
    """Mean height error over one band: "along" at a place along the ridges, or "flank" at one across."""

    kind: str
    centre_mm: float
    n: int
    mean_mm: float


def band_errors(across: Floats, along: Floats, error: Floats, shape: ZigzagShape) -> tuple[Band, ...]:
    """Mean error in tenths of the bars' length, and on each flank.

    Parameters
    ----------
    across, along, error
        (n,) places and height errors of flank pixels, mm.
    """
    tenth = shape.length_mm / _ALONG_BANDS
    along_band = np.floor((along + shape.length_mm / 2) / tenth).astype(np.int64)
    along_centres = -shape.length_mm / 2 + (np.arange(_ALONG_BANDS) + 0.5) * tenth
    flank = 2 * bar_number(across, shape) + (ridge_offset(across, shape) > 0)
    flank_centres = (np.arange(2 * shape.count) + 0.5 - shape.count) * shape.base_mm / 2
    return (*_means("along", along_band, along_centres, error), *_means("flank", flank, flank_centres, error))


def _means(kind: str, number: NDArray[np.int64], centres: NDArray[np.floating], error: Floats) -> tuple[Band, ...]:
    number = np.clip(number, 0, len(centres) - 1)
    count = np.bincount(number, minlength=len(centres))
    total = np.bincount(number, weights=error, minlength=len(centres))
    enough = count >= max(_MIN_PIXELS, _MIN_SHARE * float(np.median(count[count > 0])))
    return tuple(
        Band(kind, float(centres[i]), int(count[i]), float(total[i] / count[i])) for i in np.flatnonzero(enough)
    )
