"""Repeated readings: a straight line with its covariance, and the variance between and within groups."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from fringecal.errors import FitError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """``y = intercept + slope x`` with the (2, 2) covariance of both, residual sd and degrees of freedom."""

    intercept: float
    slope: float
    covariance: Floats
    residual_sd: float
    dof: int


@dataclass(frozen=True)
class OneWay:
    """Variance within and between groups of repeated readings (JCGM 100:2008, H.5).

    `sd_within` comes from the scatter inside groups and `sd_from_means` from that of their means, both for
    one reading; `sd_between` is what the groups differ by beyond that, 0 when less than nothing is left.
    `u_mean` (dof groups - 1) holds whether or not groups differ; `u_mean_pooled` only when they do not.
    """

    mean: float
    sd_of_means: float
    sd_from_means: float
    sd_within: float
    sd_between: float
    f: float
    p_value: float
    u_mean: float
    dof: int
    u_mean_pooled: float
    dof_pooled: int


def fit_line(x: ArrayLike, y: ArrayLike) -> Line:
    """Fit a straight line by least squares, weights equal, scatter taken from the residuals (GUM H.3).

    Parameters
    ----------
    x, y
        (n,), n >= 3.

    Examples
    --------
    >>> line = fit_line([0.0, 1.0, 2.0, 3.0], [1.0, 3.0, 5.0, 7.0])
    >>> round(float(line.intercept), 9), round(float(line.slope), 9)
    (1.0, 2.0)
    """
    xs, ys = np.asarray(x, float), np.asarray(y, float)
    if xs.shape != ys.shape or xs.size < 3 or np.ptp(xs) == 0:
        raise FitError(f"a line needs three points at two places at least, found {xs.size} and {ys.size} values")
    middle = xs.mean()
    spread = float(np.sum((xs - middle) ** 2))
    slope = float(np.sum((xs - middle) * ys)) / spread
    level = float(ys.mean())
    residual = ys - level - slope * (xs - middle)
    dof = xs.size - 2
    variance = float(residual @ residual) / dof
    corner = -middle / spread
    covariance = variance * np.array([[1 / xs.size + middle**2 / spread, corner], [corner, 1 / spread]])
    return Line(level - slope * middle, slope, covariance, variance**0.5, dof)


def one_way(means: ArrayLike, sds: ArrayLike, repeats: int) -> OneWay:
    """Analyse groups given by their means and standard deviations, equally many readings in each.

    Parameters
    ----------
    means, sds
        (J,) mean and standard deviation of each group.
    repeats
        Readings in each group, K >= 2.

    Examples
    --------
    >>> readings = np.array([[1.0, 3.0], [5.0, 7.0]])
    >>> round(one_way(readings.mean(axis=1), readings.std(axis=1, ddof=1), 2).f, 9)
    8.0
    """
    m, s = np.asarray(means, float), np.asarray(sds, float)
    if m.size < 2 or repeats < 2 or m.shape != s.shape:
        raise FitError(f"groups of repeats are needed, at least 2 of 2; found {m.size} of {repeats}")
    groups, inner = m.size, m.size * (repeats - 1)
    var_means, within = float(m.var(ddof=1)), float(np.mean(s**2))
    from_means = repeats * var_means
    f = from_means / within if within > 0 else np.inf
    pooled = ((groups - 1) * from_means + inner * within) / (groups - 1 + inner)
    return OneWay(
        mean=float(m.mean()),
        sd_of_means=var_means**0.5,
        sd_from_means=from_means**0.5,
        sd_within=within**0.5,
        sd_between=max((from_means - within) / repeats, 0.0) ** 0.5,
        f=float(f),
        p_value=float(stats.f.sf(f, groups - 1, inner)),
        u_mean=(var_means / groups) ** 0.5,
        dof=groups - 1,
        u_mean_pooled=(pooled / (groups * repeats)) ** 0.5,
        dof_pooled=groups - 1 + inner,
    )
