"""A quantity against its limit, by the probability that it conforms."""

import math
from typing import TYPE_CHECKING

from fringecal.records import DEFAULT_LIMITS, Check
from fringecal.uncertainty import EXPANDED_BY, Estimate, decide

if TYPE_CHECKING:
    pass


def rms_estimate(rms: float, number: int, unit: str) -> Estimate:
    """Return an rms of independent residuals with its uncertainty, ``rms / sqrt(2 n)`` (JCGM 100:2008, E.4.3).

    Examples
    --------
    >>> rms_estimate(0.1, 50, "px").u
    0.01
    """
    return Estimate(rms, rms / math.sqrt(2 * max(number, 1)), unit)


def judged(name: str, found: Estimate, limit: float, *, level: float = DEFAULT_LIMITS.level) -> Check:
    """Judge the size of a signed quantity against a limit, by probability of conformity (JCGM 106:2012, 8.2).

    Parameters
    ----------
    name
        What is judged.
    found
        Its value and standard uncertainty.
    limit
        Largest size allowed, in the unit of the value.
    level
        Probability at which conformity counts as proved.

    Examples
    --------
    >>> judged("drift", Estimate(-0.3, 0.01, "mm"), 0.2).decision
    'fail'
    """
    return Check(
        name=name,
        value=found.value,
        limit=limit,
        u=found.u,
        expanded=found.expanded().U,
        unit=found.unit,
        decision=decide(found.value, found.u, lower=-limit, upper=limit, level=level).outcome,
        rule=f"within the limit with a probability of {level:.0%} at least (guard band)",
    )


def judged_below(name: str, found: Estimate, limit: float, level: float) -> Check:
    """Judge a quantity that cannot be negative, such as an rms, against its upper limit."""
    return Check(
        name=name,
        value=found.value,
        limit=limit,
        u=found.u,
        expanded=found.expanded().U if found.u > 0 else None,
        unit=found.unit,
        decision=decide(found.value, found.u, upper=limit, level=level).outcome,
        rule=f"below the limit with a probability of {level:.0%} at least (guard band)",
    )


def judged_en(name: str, en: float, limit: float, *, of: str, note: str = "") -> Check:
    """Judge an En score, which holds the uncertainties already, against its limit without a guard band.

    Parameters
    ----------
    name
        What is judged.
    en
        The score, from `en_score`.
    limit
        Largest size allowed, 1 by definition.
    of
        The quotient in words, for the rule.
    note
        What else the rule must say.

    Examples
    --------
    >>> print(judged_en("step", 0.4, 1.0, of="error / U").rule)
    |En| <= 1, En = error / U; U: 95 % coverage, k from the effective degrees of freedom
    """
    return Check(
        name=name,
        value=en,
        limit=limit,
        decision="pass" if abs(en) <= limit else "fail",
        rule=f"|En| <= {limit:g}, En = {of}; {EXPANDED_BY}{note}",
        score="En",
    )
