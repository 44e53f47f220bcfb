"""Scores of a result against a reference: En by expanded uncertainties, zeta by standard ones (ISO 13528)."""

import math

from fringecal.uncertainty.estimates import Estimate

EXPANDED_BY = "U: 95 % coverage, k from the effective degrees of freedom"
"""How every expanded uncertainty is formed, as headings and rules say it."""

EN_DEFINITION = f"En = difference / root sum of squares of both U; {EXPANDED_BY}"
"""How every En is formed, as records say it: the one thing that a reader must know to compare it with another."""


def en_score(found: Estimate, reference: Estimate | None = None) -> float:
    """Return the En score of a result, or of a difference; ``|En| <= 1``: it agrees within the expanded uncertainties.

    ``En = (x - X) / sqrt(U(x)^2 + U(X)^2)`` (ISO 13528:2022; ISO/IEC 17043:2023). Every ``U = k u`` is
    `Estimate.expanded`: coverage probability 95 %, k of Student's t for the effective degrees of freedom of its own u.
    Holds for independent results; what two results share belongs into u of their difference, given alone.

    Parameters
    ----------
    found
        The result x; without a reference a difference whose u already holds the uncertainties of both sides.
    reference
        The reference value X, in the same unit.

    Raises
    ------
    ValueError
        Neither side has an uncertainty greater than 0.

    Examples
    --------
    >>> step, certified = Estimate(20.03, 0.010, "mm", dof=5), Estimate(20.00, 0.005, "mm")
    >>> round(en_score(step, certified), 3)  # 0.03 / sqrt((2.571 x 0.010)^2 + (1.960 x 0.005)^2)
    1.09
    >>> round(en_score(Estimate(0.03, 0.010, "mm", dof=5)), 3)
    1.167
    """
    if reference is None:
        return _score(found.value, found.expanded().U, 0.0)
    return _score(found.value - reference.value, found.expanded().U, reference.expanded().U)


def zeta_score(found: Estimate, reference: Estimate) -> float:
    """Return the zeta score: as En, but by STANDARD uncertainties; beyond 2 doubtful, beyond 3 wrong (ISO 13528).

    Examples
    --------
    >>> round(zeta_score(Estimate(100.10, 0.025), Estimate(100.02, 0.015)), 3)
    2.744
    """
    return _score(found.value - reference.value, found.u, reference.u)


def _score(difference: float, first: float, second: float) -> float:
    spread = math.hypot(first, second)
    if not spread > 0:
        raise ValueError("a score needs an uncertainty greater than 0 on one side at least")
    return difference / spread
