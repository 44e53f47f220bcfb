"""The phase from an arctangent by its table of signs, as it was looked up before `atan2` was at hand."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def quadrant_phase(numerator: ArrayLike, denominator: ArrayLike) -> NDArray[np.float64]:
    """Turn an arctangent into a phase in [0, 2 pi) by the table of signs, as early systems did.

    Parameters
    ----------
    numerator, denominator
        N = k B sin(phi) and D = k B cos(phi), any common positive factor k.

    Returns
    -------
    numpy.ndarray
        Phase in [0, 2 pi), rad; NaN where N = D = 0, where there is no phase.

    Notes
    -----
    With `t = atan|N/D|`: t, pi - t, pi + t and 2 pi - t in the four quadrants and multiples of pi/2 on
    the axes; identical to `atan2(N, D) mod 2 pi`.
    """
    n, d = np.broadcast_arrays(np.asarray(numerator, np.float64), np.asarray(denominator, np.float64))
    slope = np.divide(np.abs(n), np.abs(d), out=np.zeros(n.shape), where=d != 0)
    t = np.where(d == 0, np.pi / 2, np.arctan(slope))
    quadrants = [(n >= 0) & (d > 0), (n > 0) & (d <= 0), (n <= 0) & (d < 0), (n < 0) & (d >= 0)]
    phase = np.select(quadrants, [t, np.pi - t, np.pi + t, 2 * np.pi - t], default=np.nan)
    return np.where(phase >= 2 * np.pi, 0.0, phase)
