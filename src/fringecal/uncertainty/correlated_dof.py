"""Effective degrees of freedom where contributions may be correlated."""

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.uncertainty.degrees_of_freedom import effective_dof

Floats = NDArray[np.float64]


class DofWarning(UserWarning):
    """Degrees of freedom that no rule covers; a cautious number was taken, and this says so."""


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
