"""Average run lengths: how many values a control chart takes to raise the alarm, false or true.

All for normal, independent values with known centre and sigma, and a chart that starts at its centre when the mean
has already shifted. Solved as integral equations (S. V. Crowder, Technometrics 29, 401, 1987; P. L. Goel and
S. M. Wu, Technometrics 13, 221, 1971) by Gauss-Legendre quadrature.
"""

import numpy as np
from scipy import stats

from fringecal.history.charts import CUSUM_LIMIT, CUSUM_SLACK, EWMA_WEIGHT, EWMA_WIDTH, SHEWHART_WIDTH

_NODES = 96  # of Gauss and Legendre: more change no digit that is printed


def shewhart_run_length(shift: float = 0.0, *, width: float = SHEWHART_WIDTH) -> float:
    """Average run length of single values against `width` sigma, after a shift in units of sigma.

    Examples
    --------
    >>> round(shewhart_run_length(), 1), round(shewhart_run_length(1.0), 1)
    (370.4, 43.9)
    """
    return 1 / float(stats.norm.sf(width - shift) + stats.norm.cdf(-width - shift))


def ewma_run_length(shift: float = 0.0, *, weight: float = EWMA_WEIGHT, width: float = EWMA_WIDTH) -> float:
    """Average run length of an EWMA with settled limits, after a shift in units of sigma.

    ``L(z) = 1 + (1 / w) int_-h^h L(y) phi((y - (1 - w) z) / w - shift) dy``, from z = 0.

    Examples
    --------
    >>> round(ewma_run_length(), 0), round(ewma_run_length(1.0), 1)
    (500.0, 10.5)
    """
    half = width * np.sqrt(weight / (2 - weight))
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    y, dy = half * nodes, half * weights

    def kernel(z: np.ndarray) -> np.ndarray:
        return dy / weight * stats.norm.pdf((y - (1 - weight) * z[:, None]) / weight - shift)

    inside = np.linalg.solve(np.eye(_NODES) - kernel(y), np.ones(_NODES))
    return float(1 + (kernel(np.zeros(1)) @ inside)[0])


def cusum_run_length(shift: float = 0.0, *, slack: float = CUSUM_SLACK, limit: float = CUSUM_LIMIT) -> float:
    """Average run length of a two-sided CUSUM, after a shift in units of sigma.

    Both sides together: ``1 / L = 1 / L(shift) + 1 / L(-shift)`` (K. W. Kemp, Appl. Statist. 10, 149, 1961).

    Examples
    --------
    >>> round(cusum_run_length(limit=4.0), 1), round(cusum_run_length(1.0, limit=4.0), 2)
    (167.7, 8.38)
    """
    sides = (_one_sided(shift, slack, limit), _one_sided(-shift, slack, limit))
    return 1 / sum(1 / side for side in sides)


def _one_sided(shift: float, slack: float, limit: float) -> float:
    """Solve ``L(s) = 1 + L(0) Phi(k - s - shift) + int_0^h L(y) phi(y + k - s - shift) dy`` for s = 0."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    y, dy = limit / 2 * (nodes + 1), limit / 2 * weights
    start = np.concatenate([[0.0], y])
    reach = slack - start - shift
    step = np.column_stack([stats.norm.cdf(reach), dy * stats.norm.pdf(y + reach[:, None])])
    return float(np.linalg.solve(np.eye(_NODES + 1) - step, np.ones(_NODES + 1))[0])
