"""Values as deviates from all those before them, so that charts promise the same from the first records on.

Limits from a baseline of twenty values raise several times as many false alarms as a chart promises, since centre and
sigma are known to a fifth only. Each value against mean and standard deviation of those before it is Student's t;
turned into a normal deviate it is independent of all others, and exactly normal while the quantity is in control
(D. M. Hawkins, J. Quality Technology 19 (1987) 131; D. C. Montgomery, Introduction to Statistical Quality Control,
9.1.8).
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from fringecal.errors import HistoryError
from fringecal.history.charts import LEAST_VALUES, SHEWHART_WIDTH, Chart, Floats, checked

FIRST = 2  # values that have no deviate: mean and standard deviation take two
_FARTHEST = 8.0  # standard deviations that a deviate is held to: beyond it the normal distribution cannot be inverted
_NO_SCATTER = 1e-12  # of the largest value: rounding


def self_starting_deviates(values: ArrayLike, *, size: int | None = None) -> Floats:
    """Return each value's normal deviate against all before it; 0 for the first two.

    ``z_n = Phi^-1(F_(n-2)(sqrt((n-1)/n) (x_n - mean_(n-1)) / s_(n-1)))``, F Student's t with n - 2 degrees of freedom.

    Parameters
    ----------
    values
        (n,) in the order of capture.
    size
        How many of the first values judge those after them; by default all that came before.

    Raises
    ------
    HistoryError
        There are fewer than 6 values, or the first ones are all equal.
    """
    x = checked(values)
    if min(x.size, size or x.size) < LEAST_VALUES:
        raise HistoryError(f"a chart takes {LEAST_VALUES} records at least, found {min(x.size, size or x.size)}")
    mean, sd, number = _before(x, size)
    if sd[LEAST_VALUES - 1] <= _NO_SCATTER * np.abs(x).max():
        raise HistoryError(f"the first {LEAST_VALUES - 1} values are all equal: no scatter to judge others by")
    least = np.maximum(sd, _NO_SCATTER * np.abs(x).max())[FIRST:]
    score = (x - mean)[FIRST:] / least / np.sqrt(1 + 1 / number[FIRST:])
    below = special.ndtri(special.stdtr(number[FIRST:] - 1, -np.abs(score)))
    deviates = np.zeros(x.size)
    deviates[FIRST:] = -np.sign(score) * np.clip(below, -_FARTHEST, 0)
    return deviates


def _before(x: Floats, size: int | None) -> tuple[Floats, Floats, Floats]:
    """Return mean, standard deviation and number of the values before each; 0 where there are none or one."""
    number = np.minimum(np.arange(x.size), size or x.size)
    mean, sd = np.zeros(x.size), np.zeros(x.size)
    for k in range(FIRST, x.size):
        mean[k], sd[k] = x[: number[k]].mean(), x[: number[k]].std(ddof=1)
    return mean, sd, number.astype(float)


def self_starting_individuals(values: ArrayLike, *, size: int | None = None) -> Chart:
    """Chart single values in their own unit, within what those before them leave: 3 sigma of the deviates.

    Limits ``mean_(n-1) +- t s_(n-1) sqrt(n / (n - 1))``, t of n - 2 degrees of freedom with the chance that a normal
    value has beyond 3 sigma, 0.27 %; not finite for the first two values.

    Parameters
    ----------
    values, size
        As for `self_starting_deviates`.

    Examples
    --------
    >>> chart = self_starting_individuals([10.0, 12.0, 11.0, 13.0, 12.0, 11.0, 40.0])
    >>> chart.signals, round(float(chart.upper[-1]), 2)  # t(0.99865, 5) = 5.507, s = 1.0488, sqrt(7 / 6)
    ((6,), 17.74)
    """
    x = checked(values)
    deviates = self_starting_deviates(x, size=size)
    mean, sd, number = _before(x, size)
    half = np.full(x.size, np.nan)
    t = special.stdtrit(number[FIRST:] - 1, special.ndtr(SHEWHART_WIDTH))
    half[FIRST:] = t * sd[FIRST:] * np.sqrt(1 + 1 / number[FIRST:])
    signals = tuple(int(i) for i in np.flatnonzero(np.abs(deviates) > SHEWHART_WIDTH))
    return Chart("individuals", x, float(mean[-1]), mean + half, mean - half, signals)
