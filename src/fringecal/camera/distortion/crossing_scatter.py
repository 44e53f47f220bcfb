"""How far the scatter of a grid's crossings is their own: neighbours on a line share the points between them."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Crossings along a line over which the autocorrelation is summed: a crossing rests on the two pieces of line beside
#: it, or four where they are short, so that beyond three it shares nothing; every further lag would add noise alone.
LAGS = 3


def shared_scatter(row: IntArray, column: IntArray, points_px: Array, residual_px: Array) -> float:
    """Factor by which smooth terms fitted to the crossings vary more than independent scatter says.

    Parameters
    ----------
    row, column
        Index of the crossings, (n,).
    points_px, residual_px
        Their positions and residuals, (n, 2); NaN residuals count as gaps.

    Returns
    -------
    float
        `1 + 2 sum(rho_k)` over the first three lags, at least 1; rho is the autocorrelation along each line
        of the residuals across it, the mean of both families.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> row, column = (a.ravel() for a in np.mgrid[:40, :40])
    >>> points = np.stack([column, row], axis=1) * 20.0
    >>> float(round(shared_scatter(row, column, points, rng.normal(0, 0.1, points.shape)), 1))
    1.0
    """
    design = np.stack([np.ones(len(row)), column, row], axis=1)
    (_, along_row, along_column), *_ = np.linalg.lstsq(design, points_px, rcond=None)
    total = 0.0
    for line, place, direction in ((column, row, along_column), (row, column, along_row)):
        across = residual_px @ np.array([-direction[1], direction[0]]) / np.hypot(*direction)
        total += _lagged_sum(line, place, across)
    return max(1.0, 1.0 + total)


def _lagged_sum(line: IntArray, place: IntArray, values: Array) -> float:
    """Sum of the autocorrelations at the first lags along the lines."""
    table = np.full((line.max() + 1, place.max() + 1 + LAGS), np.nan)
    table[line, place] = values
    variance = float(np.nanmean(table**2))
    if not variance > 0:
        return 0.0
    products = [table[:, lag:] * table[:, :-lag] for lag in range(1, LAGS + 1)]
    return sum(float(np.nanmean(p)) for p in products if np.isfinite(p).any()) / variance
