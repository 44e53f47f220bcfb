"""The thesis's way to a fringe's centre: filter, threshold, thin to one pixel, read whole rows at chosen columns."""

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.detect.ridge import Centres
from fringecal.errors import DetectionError

_LEAST_PERIOD_PX = 6.0  # three bright and three dark pixels, of which filtering leaves two each
_READING_PX = math.sqrt(1 / 12)  # whole rows


def thinned(image: ArrayLike, period_px: float, *, along: str = "rows", enlarged: int = 1) -> NDArray[np.bool_]:
    """Thin the bright fringes to lines of one pixel.

    Parameters
    ----------
    image
        Grey values, (H, W).
    period_px
        Usual period of the fringes.
    along
        What the fringes run along: "rows" or "columns" of the picture.
    enlarged
        How many times the filtered picture is enlarged before it is thinned; 1 is the thesis.

    Notes
    -----
    Median 3x3, mean 3x3, threshold at the mean over two periods across the fringes (the light of a diverging projector
    falls off: no one level suits the whole picture), thinning after Zhang and Suen, Commun. ACM 27 (1984) 236.

    Raises
    ------
    DetectionError
        Fringes finer than 6 px.
    """
    grey = np.ascontiguousarray(image, dtype=np.float32)
    if grey.ndim != 2 or not np.isfinite(grey).all():
        raise DetectionError(f"found a picture of shape {grey.shape}; needed: (height, width), finite")
    if not period_px >= _LEAST_PERIOD_PX:
        raise DetectionError(
            f"fringes of {period_px:.1f} px are too fine to be thresholded and thinned; at least "
            f"{_LEAST_PERIOD_PX:g} px are needed: use coarser fringes, or the ridge or phase estimator"
        )
    smooth = cv2.blur(cv2.medianBlur(grey, 3), (3, 3))
    if enlarged > 1:
        smooth = cv2.resize(smooth, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_CUBIC)
    reach = 2 * round(enlarged * period_px) + 1
    level = cv2.blur(smooth, (3, reach) if along == "rows" else (reach, 3))
    return cv2.ximgproc.thinning((smooth > level).astype(np.uint8) * 255) > 0


def skeleton_centres(image: ArrayLike, period_px: float, *, along: str = "rows", enlarged: int = 2) -> Centres:
    """Return the pixels of the thinned fringes, in px of the picture as it was.

    Whole rows, as the thesis read them (`enlarged=1`), err alike on all strips that a fringe crosses, so that more
    strips do not help; half rows err by half.

    Raises
    ------
    DetectionError
        Fringes finer than 6 px.
    """
    rows = np.nonzero(thinned(image, period_px, along=along, enlarged=enlarged))
    v, u = ((part + 0.5) / enlarged - 0.5 for part in rows)
    return Centres(u, v, np.full(u.size, _READING_PX / enlarged), np.ones(u.size, bool))
