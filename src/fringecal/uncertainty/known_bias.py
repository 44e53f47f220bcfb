"""A result with a bias that is known and not corrected: the standard uncertainty whose interval still holds."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from fringecal.uncertainty.estimates import COVERAGE

_FAR = 3.0  # bias over u beyond which the truth lies on one side alone: the rest is below 1e-6 of U
_NODES = 301
_HALVINGS = 50  # of the bracket of a root: to rounding


def uncertainty_with_bias(u: ArrayLike, bias: ArrayLike, *, coverage: float = COVERAGE) -> NDArray[np.float64]:
    """Return the standard uncertainty of results that keep a known bias.

    `U = k u'` is the half-width of the interval around the biased result that holds the truth with the stated
    probability: ``F((U - b)/u) - F(-(U + b)/u) = p`` with F the normal distribution and b the size of the bias. Without
    a bias u' is u; with a large one U is ``b + 1.64 u`` at 95 %. Adding u and b in quadrature would hold too much or
    too little, depending on their ratio: S. D. Phillips, K. R. Eberhardt, B. Parry, J. Res. NIST 102 (1997) 577.

    Parameters
    ----------
    u
        Standard uncertainty without the bias, any shape; above 0, NaN where unknown.
    bias
        The bias, of either sign, in the same unit.
    coverage
        Coverage probability p.

    Examples
    --------
    >>> uncertainty_with_bias([1.0, 1.0], [0.0, 10.0]).round(3).tolist()
    [1.0, 5.941]
    """
    size, spread = np.abs(np.asarray(bias, float)), np.asarray(u, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(spread > 0, size / spread, np.inf)
    nodes = np.linspace(0.0, _FAR, _NODES)
    near = np.interp(ratio, nodes, _half_widths(nodes, coverage)) * spread
    far = size + float(ndtri(coverage)) * spread
    return np.asarray(np.where(ratio < _FAR, near, far) / float(ndtri(0.5 + coverage / 2)))


def _half_widths(ratio: NDArray[np.float64], coverage: float) -> NDArray[np.float64]:
    """Return U/u for ratios of bias to u, by halving a bracket."""
    low = np.zeros_like(ratio)
    high = ratio + float(ndtri(0.5 + coverage / 2))
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        enough = ndtr(middle - ratio) - ndtr(-middle - ratio) > coverage
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return high
