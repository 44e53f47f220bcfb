"""How the scatter of a grid's crossings hangs together, and residuals of which that is taken out."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from fringecal.detect import LineScatter

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Crossings along a line over which autocorrelations are summed at most: a sheet's waves, and whatever else moves lines
#: together that their own uncertainty does not know, were seen to reach eleven.
MOST_LAGS = 20
#: The sum ends at the first autocorrelation below so many of its own standard uncertainties, 1 over the root of the
#: pairs: every further lag would add noise alone.
SIGNIFICANT = 2.0
#: What all crossings have in common is left out where it moves none by this part of its own uncertainty.
NOTICED_PART = 0.02
#: Added to variances, relative: crossings of drawn pictures share all of their points' rounding.
RIDGE = 1e-9


@dataclass(frozen=True)
class CrossingNoise:
    """How crossings err: by themselves, with their neighbours, and all together.

    Parameters
    ----------
    row, column
        Index of the crossings, (n,).
    sigma_px
        Standard uncertainty of each per axis, px, (n,).
    scatter
        What is known of their covariance; None where they count as independent.
    """

    row: IntArray
    column: IntArray
    sigma_px: Array
    scatter: LineScatter | None = None

    def picked(self, keep: NDArray[np.bool_]) -> "CrossingNoise":
        """Of some of the crossings alone."""
        scatter = None if self.scatter is None else self.scatter.picked(keep)
        return CrossingNoise(self.row[keep], self.column[keep], self.sigma_px[keep], scatter)

    @property
    def common_px(self) -> Array:
        """Shifts (modes, n, 2), px, by one standard uncertainty of what all have in common, where it is noticed."""
        if self.scatter is None:
            return np.zeros((0, len(self.row), 2))
        shifts = np.nan_to_num(self.scatter.common_px)
        noticed = np.abs(shifts / self.sigma_px[:, None]).max(axis=(1, 2), initial=0.0) > NOTICED_PART
        return np.asarray(shifts[noticed])

    def whitening(self) -> Callable[[Array], Array]:
        """Return a function that turns shifts (n, 2, ...), px, into (n, 2, ...) independent ones of variance 1.

        The second index of the result tells horizontal lines from vertical ones where the covariance is known.

        Examples
        --------
        >>> noise = CrossingNoise(np.array([0, 0]), np.array([0, 1]), np.array([0.5, 2.0]))
        >>> noise.whitening()(np.ones((2, 2))).tolist()
        [[2.0, 2.0], [0.5, 0.5]]
        """
        if self.scatter is None:
            return lambda shift: shift / self.sigma_px.reshape(-1, *[1] * (shift.ndim - 1))
        normals, bands = self.scatter.normals, self.scatter.bands
        lines = ((self.row, self.column), (self.column, self.row))
        parts = [_line_whitening(*line, bands[:, family]) for family, line in enumerate(lines)]

        def whitened(shift: Array) -> Array:
            across = np.einsum("nfc,nc...->nf...", normals, shift)
            return np.stack([part(across[:, family]) for family, part in enumerate(parts)], axis=1)

        return whitened


def _line_whitening(line: IntArray, place: IntArray, bands: Array) -> Callable[[Array], Array]:
    """Whiten errors (n, ...) across the lines of a family whose covariance along them is banded.

    The covariance is L L^T by Cholesky's method; L^-1 times the errors is white.
    """
    order = np.lexsort((place, line))
    line, place, bands = line[order], place[order], bands[order]
    lags = bands.shape[1] - 1
    lower = np.zeros((lags + 1, len(line)))
    lower[0] = bands[:, 0] * (1 + RIDGE)
    for m in range(1, min(lags, len(line) - 1) + 1):
        gap = place[m:] - place[:-m]
        near = (line[m:] == line[:-m]) & (gap <= lags)
        lower[m, :-m] = np.where(near, bands[np.arange(len(gap)), np.clip(gap, 0, lags)], 0.0)
    factor = linalg.cholesky_banded(lower, lower=True)

    def whitened(errors: Array) -> Array:
        solved = np.empty_like(errors)
        solved[order] = linalg.solve_banded((lags, 0), factor, errors[order])
        return solved

    return whitened


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
        `1 + 2 sum(rho_k)` as in `shared_factor`; rho is the autocorrelation along each line of the residuals across
        it, the mean of both families.

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
    across = [
        residual_px @ np.array([-direction[1], direction[0]]) / np.hypot(*direction)
        for direction in (along_row, along_column)
    ]
    return shared_factor(row, column, np.stack(across, axis=1))


def shared_factor(row: IntArray, column: IntArray, across: Array) -> float:
    """Return `1 + 2 sum(rho_k)`, at least 1, of errors (n, 2) across the horizontal and across the vertical lines.

    The sum ends where an autocorrelation is not told from none, and after twenty lags.
    """
    total = sum(_lagged_sum(*line, across[:, k]) for k, line in enumerate(((row, column), (column, row))))
    return max(1.0, 1.0 + total)


def _lagged_sum(line: IntArray, place: IntArray, values: Array) -> float:
    """Sum of the autocorrelations at the first lags along the lines, up to one that is not told from none."""
    lags = min(MOST_LAGS, int(place.max()))
    table = np.full((line.max() + 1, place.max() + 1), np.nan)
    table[line, place] = values
    variance = float(np.nanmean(table**2))
    if not variance > 0:
        return 0.0
    total = 0.0
    for lag in range(1, lags + 1):
        products = (table[:, lag:] * table[:, :-lag]) / variance
        pairs = int(np.isfinite(products).sum())
        rho = float(np.nanmean(products)) if pairs else 0.0
        if rho < SIGNIFICANT / np.sqrt(max(pairs, 1)):
            break
        total += rho
    return total
