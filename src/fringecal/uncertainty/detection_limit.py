"""The smallest change that a test finds with 95 %, however little of the stated variance is really at work."""

import functools

import numpy as np
from scipy import special

from fringecal.uncertainty.estimates import COVERAGE

_SHARES = (0.01, 1.0, 100)  # of the stated variance that may be at work: from, to, and how many are tried


@functools.cache
def least_seen(number: int, chance: float) -> float:
    """Least ``c V^-1 c`` of a change that a chi-squared test of `number` quantities sees with 95 %.

    V is the stated covariance; the real variance may be a share s of it. The test then sees s times a
    noncentral chi-squared with lambda / s, and the lambda that passes the threshold with 95 % is largest where s is
    about a third for twenty quantities: chance no longer lifts a change over the threshold, but still hides some.

    Parameters
    ----------
    number
        Quantities that are compared as one: the degrees of freedom.
    chance
        Of a false alarm, by which the test's threshold is set.

    Examples
    --------
    >>> round(least_seen(1, 0.01) ** 0.5, 2), round(least_seen(19, 0.01) ** 0.5, 2)
    (4.22, 6.48)
    """
    share = np.linspace(*_SHARES)
    needed = special.chndtrinc(special.chdtri(number, chance) / share, number, 1 - COVERAGE)
    return float((share * needed).max())


def shift_seen(threshold: float, u: float) -> float:
    """Shift of a quantity that lies beyond a threshold of its size with 95 %, in its unit: ``threshold + 1.645 u``.

    With less scatter than the standard uncertainty u a smaller shift is seen as well: u may be a bound.

    Examples
    --------
    >>> round(shift_seen(1.96, 1.0), 3)  # of an En whose limit is 1
    3.605
    """
    return threshold + float(special.ndtri(COVERAGE)) * u
