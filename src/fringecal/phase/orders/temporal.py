"""Fringe order from a second, longer fringe: pixel by pixel, so that steps and gaps do not matter."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from fringecal.errors import PhaseError
from fringecal.numerics import TURN

_NO_NOISE_RAD = 1e-12  # instead of a division by 0


def unwrap_temporal(coarse: ArrayLike, fine: ArrayLike, ratio: float) -> NDArray[np.float64]:
    """Give a fine phase the fringe order that an absolute coarse phase implies.

    Parameters
    ----------
    coarse
        Absolute phase of the longer fringe, rad, (H, W), zero where the fine phase is zero.
    fine
        Wrapped phase of the shorter fringe, rad, (H, W).
    ratio
        Period of the coarse fringe over period of the fine fringe, greater than 1.

    Returns
    -------
    numpy.ndarray
        Absolute fine phase, rad, float64; NaN where either is.

    Notes
    -----
    `fine + 2 pi round((ratio coarse - fine) / 2 pi)` (Huntley and Saldner, Appl. Opt. 32 (1993) 3047).
    How often noise makes the order wrong is `order_error_rate`.

    Raises
    ------
    PhaseError
        Maps of different shape or a ratio that is not above 1.

    Examples
    --------
    >>> true = np.array([0.5, 9.0, 40.0])
    >>> unwrap_temporal(true / 8, np.angle(np.exp(1j * true)), 8.0).round(6)
    array([ 0.5,  9. , 40. ])
    """
    long, short = np.asarray(coarse, np.float64), np.asarray(fine, np.float64)
    if long.shape != short.shape:
        raise PhaseError(f"coarse phase has shape {long.shape}, fine phase {short.shape}; they must be equal")
    if not ratio > 1:
        raise PhaseError(f"ratio of periods is {ratio}; needed: coarse period / fine period, above 1")
    return short + TURN * np.rint((ratio * long - short) / TURN)


def beat_phase(fine: ArrayLike, coarse: ArrayLike) -> NDArray[np.float64]:
    """Return the wrapped phase of the beat of two fringes, in [0, 2 pi).

    Parameters
    ----------
    fine, coarse
        Phases of the shorter and the longer fringe, rad, both zero at the same place.

    Notes
    -----
    `fine - coarse mod 2 pi`; its period is `beat_period` and its variance the sum of both variances.

    Examples
    --------
    >>> u = np.array([0.0, 5.0, 27.5])  # fringes of 10 and 11 px: a beat of 110 px
    >>> (beat_phase(2 * np.pi * u / 10, 2 * np.pi * u / 11) / (2 * np.pi) * 110).round(6).tolist()
    [0.0, 5.0, 27.5]
    """
    return np.mod(np.asarray(fine, np.float64) - np.asarray(coarse, np.float64), TURN)


def beat_period(fine_period: float, coarse_period: float) -> float:
    """Return the period of the beat of two fringes, in the unit of the periods.

    Raises
    ------
    PhaseError
        Periods that are not 0 < fine < coarse.

    Examples
    --------
    >>> round(beat_period(200 / 3, 100.0), 9)
    200.0
    """
    if not 0 < fine_period < coarse_period:
        raise PhaseError(f"periods {fine_period} and {coarse_period} give no beat; needed: 0 < fine < coarse")
    return fine_period * coarse_period / (coarse_period - fine_period)


def order_error_rate(u_coarse_rad: ArrayLike, u_fine_rad: ArrayLike, ratio: float) -> NDArray[np.float64]:
    """Predict the share of wrong fringe orders of `unwrap_temporal`.

    Parameters
    ----------
    u_coarse_rad, u_fine_rad
        Standard uncertainties of both phases, rad; independent and normal. (A beat contains the fine phase:
        pass `hypot(u_1 (ratio - 1), u_2 ratio) / ratio` and 0 then.)
    ratio
        Period of the coarse fringe over that of the fine one.

    Notes
    -----
    The order is wrong when `|ratio e_coarse - e_fine| > pi`, which happens with probability
    `erfc(pi / sqrt(2 (ratio^2 u_coarse^2 + u_fine^2)))`.

    Examples
    --------
    >>> f"{order_error_rate(0.3, 0.3, 8.0):.3f}"
    '0.194'
    """
    spread = np.hypot(ratio * np.asarray(u_coarse_rad, np.float64), u_fine_rad)
    return special.erfc(np.pi / (np.sqrt(2) * np.maximum(spread, _NO_NOISE_RAD)))
