"""How much a fine pattern stands out in a picture, to choose among its colour channels."""

import cv2
import numpy as np
import numpy.typing as npt

# Gaussians between which lines and dots lie that are 2 to 20 px wide: noise is finer, shading coarser. px
_FINE_PX, _COARSE_PX = 1.5, 8.0
# Deviations beyond this percentile are the picture's borders, writing and reflections, not the pattern.
_MOST = 98.0


def pattern_contrast(image: npt.NDArray[np.generic]) -> float:
    """Return the rms of what lies between 1.5 and 8 px in a picture, its strongest 2 % cut off, grey levels.

    Parameters
    ----------
    image
        Grey picture, (H, W).

    Examples
    --------
    >>> wave = np.tile(100 + 50 * np.sin(np.arange(400) / 3), (60, 1))
    >>> round(pattern_contrast(wave) / pattern_contrast(0.5 * wave), 6)
    2.0
    """
    grey = np.asarray(image).astype(np.float32)
    band = np.abs(cv2.GaussianBlur(grey, (0, 0), _FINE_PX) - cv2.GaussianBlur(grey, (0, 0), _COARSE_PX))
    return float(np.sqrt(np.mean(np.minimum(band, np.percentile(band, _MOST)) ** 2)))
