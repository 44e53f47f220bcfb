"""Sub-pixel centres of fringes, column by column, in one grey picture.

A fringe's centre is where the derivative across it passes zero: the ridge of a bright fringe and the valley of a dark
one. Both count: uneven light moves the two in opposite ways.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from fringecal.errors import DetectionError
from fringecal.numerics import UNIFORM_SD, robust_sd

Array = NDArray[np.float64]

_ACROSS = 1 / (2 * math.pi)  # of a period: standard deviation of the smoothing across the fringe
_ALONG_PX = 1.0  # standard deviation of the smoothing along the fringe
_LEAST_ACROSS_PX = 0.8  # of it: a narrower kernel is none on the raster of pixels
_LEAST_SIDE_PX = 16  # of a picture: three fringes of the finest
_LEAST_PERIOD_PX = 5.0  # the straight line between two pixels then errs by less than 0.03 px
_BORDER_KERNELS = 2.0  # standard deviations of the kernel from the picture's border that hold no centre
_LEAST_SLOPE = 0.2  # of the picture's usual slope at a centre, below which a crossing is noise


@dataclass(frozen=True)
class Centres:
    """Points on fringes.

    Parameters
    ----------
    u_px, v_px
        Where: the coordinate along the fringe is whole, that across it has a fraction.
    sigma_px
        Standard uncertainty of the place across the fringe.
    bright
        True on ridges, False in valleys.
    """

    u_px: Array
    v_px: Array
    sigma_px: Array
    bright: NDArray[np.bool_]

    def swapped(self) -> "Centres":
        """Return the same points of the transposed picture."""
        return Centres(self.v_px, self.u_px, self.sigma_px, self.bright)


def ridge_centres(image: ArrayLike, period_px: float, *, along: str = "rows") -> Centres:
    """Find the centres of bright and dark fringes along every line of pixels that crosses them.

    Parameters
    ----------
    image
        Grey values, (H, W).
    period_px
        Usual period of the fringes.
    along
        What the fringes run along: "rows" or "columns" of the picture.

    Notes
    -----
    Zero of the picture's derivative by a Gaussian of 1/2 pi periods, at which a fall of the light across the fringes
    moves ridges and valleys by equal amounts in opposite ways; by a straight line between the two pixels about it. For
    a cosine the line's error is below `w^2 / 62` px (w the phase per px, rad), 0.02 px at 6 px a period, and
    averages out. `sigma = noise |kernel| / slope`. Within two kernels of the border the light beyond is not known:
    no centres there.

    Raises
    ------
    DetectionError
        Fringes finer than 5 px, or no picture.

    Examples
    --------
    >>> v = np.arange(80)[:, None] * np.ones(40)
    >>> found = ridge_centres(100 + 50 * np.cos(2 * np.pi * (v - 3.3) / 16), 16.0)
    >>> sorted({round(float(x), 1) for x in found.v_px[found.bright]})
    [19.3, 35.3, 51.3, 67.3]
    """
    grey = _checked(image, period_px)
    if along == "columns":
        return ridge_centres(grey.T, period_px).swapped()
    across = max(_ACROSS * period_px, _LEAST_ACROSS_PX)
    slope = ndimage.gaussian_filter(grey, (across, _ALONG_PX), order=(1, 0), mode="nearest")
    rows, columns = np.nonzero((slope[:-1] > 0) != (slope[1:] > 0))
    above, below = slope[rows, columns], slope[rows + 1, columns]
    curvature = np.abs(above - below)
    strong = curvature > _LEAST_SLOPE * float(np.median(curvature)) if curvature.size else np.zeros(0, bool)
    margin = _BORDER_KERNELS * across
    strong &= (rows >= margin) & (rows < grey.shape[0] - 1 - margin)
    rows, columns, above, below, curvature = (a[strong] for a in (rows, columns, above, below, curvature))
    v = rows + above / (above - below)
    sigma = grey_noise(grey) * _kernel_norm(across) / curvature
    return Centres(columns.astype(float), v, sigma, above > below)


def _checked(image: ArrayLike, period_px: float) -> Array:
    grey = np.asarray(image, float)
    if grey.ndim != 2 or min(grey.shape) < _LEAST_SIDE_PX or not np.isfinite(grey).all():
        raise DetectionError(
            f"found a picture of shape {grey.shape}; needed: (height, width), finite, {_LEAST_SIDE_PX} px or more"
        )
    if not period_px >= _LEAST_PERIOD_PX:
        raise DetectionError(
            f"the centres of fringes of {period_px:.1f} px cannot be distinguished; at least "
            f"{_LEAST_PERIOD_PX:g} px are needed: use coarser fringes, or phase-shifted pictures"
        )
    return grey


def grey_noise(grey: Array) -> float:
    """Estimate the noise in grey levels from second differences along rows or columns, whichever are smaller.

    A step between two fringes lies in few pixels: the median does not see it.
    """
    spread = min(robust_sd(np.diff(grey, 2, axis=axis), about=0) for axis in (0, 1))
    # Rounding to whole levels leaves at least the noise of rounding.
    return max(spread / math.sqrt(6), UNIFORM_SD)  # 1 + 4 + 1 is the variance of a second difference


def _kernel_norm(across: float) -> float:
    """Root of the sum of squares of the kernel: noise of the slope for noise 1 of the picture."""
    reach = int(4 * max(across, _ALONG_PX)) + 2  # as far as gaussian_filter cuts its kernel, and a rim
    point = np.zeros((2 * reach + 1,) * 2)
    point[reach, reach] = 1.0
    return float(np.linalg.norm(ndimage.gaussian_filter(point, (across, _ALONG_PX), order=(1, 0))))
