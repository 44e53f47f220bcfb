"""Effective degrees of freedom of a combined standard uncertainty: the formula of Welch and Satterthwaite."""

import math
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

DOF_RULES = ("interpolated", "truncated")

_ROUNDING = 1e-12  # relative, below a whole number that is still that number


class DofWarning(UserWarning):
    """Degrees of freedom that no rule covers; a cautious number was taken, and this says so."""


def effective_dof(contributions: ArrayLike, dof: ArrayLike, *, rule: str = "interpolated") -> float:
    """Return the effective degrees of freedom of the root sum of squares of independent contributions.

    ``nu_eff = u^4 / sum (u_i^4 / nu_i)`` with ``u^2 = sum u_i^2`` (JCGM 100:2008, eq. G.2b). Independent contributions
    only; what is correlated counts as one contribution.

    Parameters
    ----------
    contributions
        (n,) contributions ``u_i = c_i u(x_i)`` in the unit of the result; their signs do not matter.
    dof
        (n,) or scalar, degrees of freedom of each contribution; infinite where it is taken as exactly known.
    rule
        "interpolated": k is taken at the number as it is; "truncated": at the integer below (JCGM 100:2008, G.4.1).

    Returns
    -------
    float
        Infinite where no contribution has finite degrees of freedom.

    Raises
    ------
    ValueError
        An unknown rule.

    Examples
    --------
    >>> round(effective_dof([3.0, 4.0], [5, 10]), 2)
    14.95
    """
    if rule not in DOF_RULES:
        raise ValueError(f"rule {rule!r} is not one of {DOF_RULES}")
    u = np.asarray(contributions, float)
    spread = float(np.sum(u**4 / np.asarray(dof, float)))
    if spread == 0.0:
        return math.inf
    nu = float(np.sum(u**2)) ** 2 / spread
    return float(math.floor(nu * (1 + _ROUNDING))) if rule == "truncated" else nu


def correlated_dof(
    contributions: ArrayLike, correlation: ArrayLike, dof: Sequence[float], *, rule: str = "interpolated"
) -> float:
    """Return `effective_dof` of contributions that may be correlated.

    Contributions correlated among themselves and of one and the same dof, as means of repeated simultaneous readings
    are, count as one. Correlated contributions of different dof are covered by no rule: the smallest is taken for the
    group, with a `DofWarning`.

    Parameters
    ----------
    contributions
        (n,) signed contributions ``c_i u(x_i)`` in the unit of the result.
    correlation
        (n, n) correlation coefficients.
    dof
        (n,) degrees of freedom of each.
    rule
        "interpolated" or "truncated".
    """
    effects, matrix = np.asarray(contributions, float), np.asarray(correlation, float)
    groups = _correlated_groups(matrix)
    variances = [float(effects[group] @ matrix[np.ix_(group, group)] @ effects[group]) for group in groups]
    together = np.sqrt(np.maximum(variances, 0.0))
    return effective_dof(together, [_group_dof([dof[i] for i in group]) for group in groups], rule=rule)


def _correlated_groups(matrix: Floats) -> list[list[int]]:
    groups: list[list[int]] = []
    for i in range(len(matrix)):
        touching = [g for g in groups if any(matrix[i, j] != 0 for j in g)]
        groups = [g for g in groups if g not in touching] + [[*(j for g in touching for j in g), i]]
    return groups


def _group_dof(dof: Sequence[float]) -> float:
    if len(set(dof)) > 1:
        warnings.warn(
            f"correlated inputs with different degrees of freedom {sorted(dof)}: Welch-Satterthwaite "
            "does not cover them, the smallest is taken",
            DofWarning,
            stacklevel=4,
        )
    return min(dof)
