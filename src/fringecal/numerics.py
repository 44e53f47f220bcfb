"""Small computations that many rooms need: phase wrapped, a spread that outliers do not move."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAD_TO_SD = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution: 1 / 0.67449, its upper quartile
(P. J. Rousseeuw and C. Croux, J. Am. Stat. Assoc. 88 (1993) 1273)."""

TURN = 2 * math.pi
"""One fringe, rad."""


def wrap(phase_rad: ArrayLike) -> NDArray[np.float64]:
    """Return the phase less the nearest whole number of turns, in [-pi, pi].

    Parameters
    ----------
    phase_rad
        Any shape, rad.

    Examples
    --------
    >>> wrap([0.5, 3.5, -9.0]).round(4).tolist()
    [0.5, -2.7832, -2.7168]
    """
    phase = np.asarray(phase_rad, np.float64)
    return np.asarray(phase - TURN * np.round(phase / TURN))
