"""Random and systematic parts kept apart: averaging shrinks the one and never the other."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def linear_uncertainty(
    weights: ArrayLike,
    u_random: ArrayLike,
    *,
    sensitivities: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
) -> float:
    """Propagate to a weighted sum of map values.

    ``u^2 = sum (w_i u_i)^2 + s^T C s`` with ``s_k = sum_i w_i c_ki``: the first term falls with
    the number of values, the second does not.

    Parameters
    ----------
    weights
        (n,) weight of each value; ``1/n`` for a mean, a regression's row for a slope.
    u_random
        (n,) or scalar random standard uncertainty of each value, independent between values.
    sensitivities
        (K, n) change of each value per unit of K common influences.
    covariance
        (K, K) covariance of the influences, or (K,) their standard uncertainties; unit when omitted.

    Examples
    --------
    >>> round(linear_uncertainty([0.25] * 4, 0.2, sensitivities=[[1, 1, 1, 1]], covariance=[0.05]), 4)
    0.1118
    """
    w = np.asarray(weights, float)
    variance = float(np.sum((w * np.asarray(u_random, float)) ** 2))
    if sensitivities is not None:
        common = np.atleast_2d(np.asarray(sensitivities, float)) @ w
        variance += float(common @ _matrix(covariance, common.size) @ common)
    return float(np.sqrt(variance))


def mean_uncertainty(
    u_random: ArrayLike, *, sensitivities: ArrayLike | None = None, covariance: ArrayLike | None = None
) -> float:
    """Propagate to the plain mean of map values, as a standard uncertainty; see `linear_uncertainty`.

    Examples
    --------
    >>> round(mean_uncertainty([0.3] * 9), 12)
    0.1
    """
    u = np.atleast_1d(np.asarray(u_random, float))
    weights = np.full(u.size, 1.0 / u.size)
    return linear_uncertainty(weights, u, sensitivities=sensitivities, covariance=covariance)


def combined_map(u_random: ArrayLike, sensitivities: ArrayLike, covariance: ArrayLike | None = None) -> Floats:
    """Total standard uncertainty of each value, ``sqrt(u_r^2 + c^T C c)``.

    Parameters
    ----------
    u_random
        (...) random standard uncertainty of each value.
    sensitivities
        (K, ...) change of each value per unit of K common influences.
    covariance
        (K, K) covariance of the influences, or (K,) their standard uncertainties; unit when omitted.

    Examples
    --------
    >>> float(combined_map(3.0, [4.0]))
    5.0
    """
    c = np.asarray(sensitivities, float)
    systematic = np.einsum("k...,kl,l...->...", c, _matrix(covariance, c.shape[0]), c)
    return np.sqrt(np.asarray(u_random, float) ** 2 + systematic)


def _matrix(covariance: ArrayLike | None, size: int) -> Floats:
    if covariance is None:
        return np.eye(size)
    given = np.asarray(covariance, float)
    matrix = np.diag(given**2) if given.ndim == 1 else given
    if matrix.shape != (size, size):
        raise ValueError(
            f"covariance of shape {given.shape} does not match {size} sensitivity maps; "
            f"give ({size},) or ({size}, {size})"
        )
    return matrix
