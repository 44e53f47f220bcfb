"""Small computations that many rooms need: wrapped phase, robust standard deviations, polynomial terms, threads."""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAD_TO_SD = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution: 1 / 0.67449, its upper quartile
(P. J. Rousseeuw and C. Croux, J. Am. Stat. Assoc. 88 (1993) 1273)."""

MEDIAN_TO_MEAN = math.sqrt(math.pi / 2)
"""Standard deviation of a median over that of a mean, of many values from a normal distribution: a median's variance is
`1 / (4 n f^2)`, with the density `f = 1 / (sqrt(2 pi) s)` there."""

UNIFORM_SD = 1 / math.sqrt(12)
"""Standard deviation over full width of a uniform distribution, as rounding has (JCGM 100:2008, 4.3.7)."""

TURN = 2 * math.pi
"""One fringe, rad."""

_LEAST_ROWS = 64  # of a picture: those of a small one take less time than starting a thread

DRAW_SEED = 2008
"""Seed of draws of pixels for a fit, where none is given: any number serves, and a fixed one repeats the result."""


def wrap(phase_rad: ArrayLike, turn_rad: float = TURN) -> NDArray[np.float64]:
    """Return the phase less the nearest whole number of turns, at most half a turn up or down.

    Parameters
    ----------
    phase_rad
        Any shape, rad.
    turn_rad
        Where the phase starts again: one fringe, or the fringes of one cycle, rad.

    Examples
    --------
    >>> wrap([0.5, 3.5, -9.0]).round(4).tolist()
    [0.5, -2.7832, -2.7168]
    """
    phase = np.asarray(phase_rad, np.float64)
    return np.asarray(phase - turn_rad * np.round(phase / turn_rad))


def robust_sd(values: ArrayLike, *, about: float | None = None) -> float:
    """Return the standard deviation as the median absolute deviation tells it, which outliers do not move.

    `s = 1.4826 median |x - c|`, with `c` the median of the values. For a normal distribution it estimates the standard
    deviation; up to half of the values may be wrong before it follows them.

    Parameters
    ----------
    values
        Any shape and unit; what is not finite is left out.
    about
        The centre `c`, if it is known: 0 for residuals of a fit.

    Returns
    -------
        In the unit of the values; 0 if there are none.

    References
    ----------
    P. J. Rousseeuw, C. Croux, Alternatives to the median absolute deviation, J. Am. Stat. Assoc. 88 (1993) 1273.

    Examples
    --------
    >>> round(robust_sd([-1.0, 0.0, 1.0, 2.0, 1000.0]), 4)
    1.4826
    >>> round(robust_sd([3.0, -4.0, 5.0], about=0), 4)
    5.9304
    """
    known = np.asarray(values)
    known = known[np.isfinite(known)]
    if not known.size:
        return 0.0
    centre = np.median(known) if about is None else about
    return MAD_TO_SD * float(np.median(np.abs(known - centre)))


def median_and_u(values: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the median of every column and its standard uncertainty, which outliers do not move.

    `u = sqrt(pi / 2) s / sqrt(n)` with the robust standard deviation `s` of the column's n values.

    Parameters
    ----------
    values
        Shape (n, columns), all finite.

    Examples
    --------
    >>> median, u = median_and_u(np.array([[1.0], [2.0], [3.0], [90.0]]))
    >>> median.tolist(), u.round(4).tolist()
    ([2.5], [0.9291])
    """
    centre = np.median(values, axis=0)
    spread = MAD_TO_SD * np.median(np.abs(values - centre), axis=0)
    return centre, MEDIAN_TO_MEAN * spread / math.sqrt(len(values))


def powers_up_to(degree: int) -> list[tuple[int, int]]:
    """Return the pairs of powers of a polynomial of two variables, by total degree.

    Within a degree the first variable's power rises.

    Examples
    --------
    >>> powers_up_to(2)
    [(0, 0), (0, 1), (1, 0), (0, 2), (1, 1), (2, 0)]
    """
    return [(i, n - i) for n in range(degree + 1) for i in range(n + 1)]


def products_up_to(along: ArrayLike, across: ArrayLike) -> NDArray[np.float64]:
    """Return the terms of a polynomial of two variables up to a total degree, in the order of `powers_up_to`.

    Parameters
    ----------
    along, across
        Terms of one variable each, of degrees 0, 1, .. along the last axis, as `numpy.polynomial` builds them
        (`legvander`, `chebvander`, `polyvander`): shape (..., degree + 1).

    Returns
    -------
        Shape (..., (degree + 1)(degree + 2) / 2).

    Examples
    --------
    >>> from numpy.polynomial import polynomial
    >>> products_up_to(polynomial.polyvander([2.0], 2), polynomial.polyvander([3.0], 2)).tolist()
    [[1.0, 3.0, 2.0, 9.0, 6.0, 4.0]]
    """
    first, second = np.asarray(along), np.asarray(across)
    pairs = powers_up_to(first.shape[-1] - 1)
    return np.stack([first[..., i] * second[..., j] for i, j in pairs], axis=-1)


def over_bands(kernel: Callable[..., None], rows: int, *arguments: Any, least: int = _LEAST_ROWS) -> None:
    """Call `kernel(first, last, *arguments)` for equal bands of rows, one band in each of numba's threads.

    The kernel is compiled with `nogil=True` and writes what belongs to rows `first` to `last - 1`, by no other row's
    result: so the number of threads changes nothing. It does what numba's parallel loops do (`prange`), which take
    longer to compile, and everybody waits for that when the program runs first.

    Parameters
    ----------
    kernel
        A compiled function.
    rows
        How many there are: rows of a picture, or whatever the kernel counts.
    arguments
        Handed on to every call.
    least
        Rows that are worth a thread: starting one takes 0.1 ms.

    Examples
    --------
    >>> squares = np.zeros(5)
    >>> def square(first, last, out):
    ...     out[first:last] = np.arange(first, last) ** 2
    >>> over_bands(square, 5, squares, least=1)
    >>> squares.tolist()
    [0.0, 1.0, 4.0, 9.0, 16.0]
    """
    import numba

    number = max(1, min(numba.get_num_threads(), rows // least))
    ends = [rows * band // number for band in range(number + 1)]
    if number == 1:
        kernel(0, rows, *arguments)
        return
    with ThreadPoolExecutor(number - 1) as pool:
        others = [pool.submit(kernel, first, last, *arguments) for first, last in pairwise(ends[1:])]
        kernel(0, ends[1], *arguments)
        for other in others:
            other.result()


def by_powers(coefficients: ArrayLike, degree: int) -> NDArray[np.float64]:
    """Return coefficients of `products_up_to` as a square by the powers of both variables, 0 where there is no term.

    Examples
    --------
    >>> by_powers([1, 2, 3], 1).tolist()
    [[1.0, 2.0], [3.0, 0.0]]
    """
    grid = np.zeros((degree + 1, degree + 1))
    for value, powers in zip(np.ravel(coefficients), powers_up_to(degree), strict=False):
        grid[powers] = value
    return grid
