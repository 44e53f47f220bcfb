"""Constants of normal samples that charts and gauge studies rest on, computed and not copied from tables."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special, stats

_REACH = 9.0  # standard deviations: 1e-18 of the values lie beyond
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(160)  # of Gauss and Legendre over that reach: twelve digits


class RangeMoments(NamedTuple):
    """Mean d2 and standard deviation d3 of the range of n normal values of unit standard deviation."""

    d2: float
    d3: float

    @property
    def d2_star(self) -> float:
        """``sqrt(d2^2 + d3^2)``: the root mean square, which turns one single range into a standard deviation."""
        return math.hypot(self.d2, self.d3)


@lru_cache(maxsize=64)
def range_moments(size: int) -> RangeMoments:
    """Moments of the range of `size` independent normal values.

    ``P(W <= w) = n int phi(x) (Phi(x + w) - Phi(x))^(n-1) dx``, and ``E W = int (1 - P)``, ``E W^2 = 2 int w (1 - P)``
    (H. L. Harter, Ann. Math. Statist. 31, 1122, 1960).

    Examples
    --------
    >>> [round(value, 4) for value in range_moments(2)]
    [1.1284, 0.8525]
    """
    x, w = _REACH * _NODES, _REACH * (_NODES + 1)
    above = stats.norm.cdf(x[:, None] + w) - stats.norm.cdf(x)[:, None]
    beyond = 1 - size * _REACH * ((_WEIGHTS * stats.norm.pdf(x)) @ above ** (size - 1))
    mean, square = _REACH * float(_WEIGHTS @ beyond), 2 * _REACH * float(_WEIGHTS @ (w * beyond))
    return RangeMoments(mean, math.sqrt(square - mean**2))


def c4(size: int) -> float:
    """Mean of the standard deviation of `size` normal values of unit standard deviation.

    ``sqrt(2 / (n - 1)) Gamma(n / 2) / Gamma((n - 1) / 2)``.

    Examples
    --------
    >>> round(c4(5), 6)
    0.939986
    """
    return math.sqrt(2 / (size - 1)) * math.exp(special.gammaln(size / 2) - special.gammaln((size - 1) / 2))


MOVING_RANGE = range_moments(2)
"""Of the range of two successive values: sigma is estimated by the mean moving range over its d2."""
