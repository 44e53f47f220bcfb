"""Conformity with a tolerance (JCGM 106, ISO 14253-1): probability, guard band, decision, risks."""

import math
from dataclasses import dataclass
from typing import Literal

from scipy import integrate, optimize
from scipy.special import ndtr, ndtri

from fringecal.errors import FitError
from fringecal.uncertainty.estimates import COVERAGE

Outcome = Literal["pass", "conditionalPass", "conditionalFail", "fail"]

_REACH_SDS = 9.0  # standard deviations of a production: 1e-18 of the items lie beyond
_GUARD_TOLERANCE = 1e-12  # of u, to which a guard band is solved: beyond any digit that is printed
# Of the integral of a risk: absolute, so that one of 1e-6 keeps six digits; relative; and the most pieces of its range.
_RISK_TOLERANCE, _RISK_RELATIVE, _RISK_PIECES = 1e-12, 1e-10, 200


@dataclass(frozen=True)
class Decision:
    """One of four outcomes, with the probability of conformity that led to it and the rule's level."""

    outcome: Outcome
    probability: float
    level: float


@dataclass(frozen=True)
class GlobalRisks:
    """Risks over all items of a production, before any is measured.

    `consumer`: an item is accepted and does not conform; `producer`: it is rejected and conforms, both of all
    items (unconditional). `consumer_of_accepted`: share of the accepted ones that does not conform.
    """

    consumer: float
    producer: float
    consumer_of_accepted: float


def conformance_probability(y: float, u: float, *, lower: float = -math.inf, upper: float = math.inf) -> float:
    """Probability that a quantity measured as y lies within limits (JCGM 106:2012, eq. 13).

    ``p = Phi((TU - y) / u) - Phi((TL - y) / u)``; normal distribution, nothing known before.

    Examples
    --------
    >>> round(conformance_probability(13.6, 1.8, lower=12.5, upper=16.3), 4)
    0.6626
    """
    _check(u, lower, upper)
    if u == 0:
        return float(lower <= y <= upper)
    return float(ndtr((upper - y) / u) - ndtr((lower - y) / u))


def decide(
    y: float, u: float, *, lower: float = -math.inf, upper: float = math.inf, level: float = COVERAGE
) -> Decision:
    """Decide on conformity with four outcomes.

    "pass": conformity is proved, ``p >= level``; "fail": non-conformity is proved, ``p <= 1 - level``;
    between them the side of the limit on which y lies, with a condition. For a tolerance wider than 6 u
    this is the rule of ISO 14253-1:2017: y inside limits drawn in, or outside limits drawn out, by 1.645 u.

    Examples
    --------
    >>> [decide(y, 0.1, upper=1.0).outcome for y in (0.8, 0.9, 1.1, 1.2)]
    ['pass', 'conditionalPass', 'conditionalFail', 'fail']
    """
    p = conformance_probability(y, u, lower=lower, upper=upper)
    inside = lower <= y <= upper
    if p >= level and inside:
        outcome: Outcome = "pass"
    elif p <= 1 - level and not inside:
        outcome = "fail"
    else:
        outcome = "conditionalPass" if inside else "conditionalFail"
    return Decision(outcome, p, level)


def guard_band(u: float, *, tolerance: float = math.inf, level: float = COVERAGE) -> float:
    """Guard band that proves conformity exactly at the given level, in the unit of u.

    Solves ``Phi(g / u) - Phi((g - T) / u) = level``; for T beyond 6 u it is the one-sided ``1.645 u``.

    Parameters
    ----------
    tolerance
        Width T of the tolerance; infinite when there is one limit only.

    Raises
    ------
    FitError
        The tolerance is so narrow, below 3.92 u at 95 %, that no result can prove conformity.

    Examples
    --------
    >>> round(guard_band(1.0), 4), round(guard_band(1.0, tolerance=4.0), 4)
    (1.6449, 1.7962)
    """
    if u <= 0:
        return 0.0
    simple = float(ndtri(level))
    width = tolerance / u
    if math.isinf(width):
        return simple * u
    if 2 * ndtr(width / 2) - 1 < level:
        raise FitError(
            f"a tolerance of {tolerance:g} leaves no acceptance zone with u = {u:g} at {level:.0%}; "
            f"u must be below {tolerance / (2 * float(ndtri(0.5 + level / 2))):.3g}"
        )

    def excess(g: float) -> float:
        return float(ndtr(g) - ndtr(g - width)) - level

    low = min(simple, width / 2)
    return u * (low if excess(low) >= 0 else float(optimize.brentq(excess, low, width / 2, xtol=_GUARD_TOLERANCE)))


def global_risks(
    prior_mean: float, prior_sd: float, u: float, *, lower: float, upper: float, guard: float = 0.0
) -> GlobalRisks:
    """Risks of accepting and rejecting wrongly, over a normal production (JCGM 106:2012, 9.5).

    Parameters
    ----------
    prior_mean, prior_sd
        Distribution of the true values.
    u
        Standard uncertainty of the measurement.
    lower, upper
        Tolerance limits.
    guard
        Both limits are drawn in by this before the measured value meets them; negative draws them out.
    """
    _check(u, lower, upper)

    def accepted(value: float) -> float:
        inside = ndtr((upper - guard - value) / u) - ndtr((lower + guard - value) / u)
        density = math.exp(-(((value - prior_mean) / prior_sd) ** 2) / 2) / (math.sqrt(math.tau) * prior_sd)
        return float(inside * density)

    def share(start: float, end: float) -> float:
        found = integrate.quad(accepted, start, end, epsabs=_RISK_TOLERANCE, epsrel=_RISK_RELATIVE, limit=_RISK_PIECES)
        return float(found[0])

    reach = _REACH_SDS * prior_sd
    first, last = min(lower, prior_mean - reach), max(upper, prior_mean + reach)
    consumer = share(first, lower) + share(upper, last)
    conforming_accepted = share(lower, upper)
    conforming = float(ndtr((upper - prior_mean) / prior_sd) - ndtr((lower - prior_mean) / prior_sd))
    accepted_share = consumer + conforming_accepted
    return GlobalRisks(consumer, conforming - conforming_accepted, consumer / accepted_share)


def _check(u: float, lower: float, upper: float) -> None:
    if not u >= 0 or not lower < upper:
        raise ValueError(f"u >= 0 and lower < upper are needed, found u {u:g}, limits {lower:g} .. {upper:g}")
