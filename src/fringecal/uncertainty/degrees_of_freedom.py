"""Effective degrees of freedom of a combined standard uncertainty: the formula of Welch and Satterthwaite."""

import math

import numpy as np
from numpy.typing import ArrayLike

DOF_RULES = ("interpolated", "truncated")

_ROUNDING = 1e-12  # relative, below a whole number that is still that number


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
