"""When to look at a rig again, by all its records (ILAC-G24:2022 / OIML D 10), and what decides it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

from fringecal.errors import HistoryError
from fringecal.history.drift import YEAR_DAYS, Drift, Floats
from fringecal.uncertainty import uncertainty_text, value_text

LONGEST_DAYS = 5 * YEAR_DAYS  # of an interval: no history says what a rig does in longer
EXTENDED_BELOW = 0.8  # of the limit: ILAC-G24's example for a longer interval
GROWTH = 0.1  # by how much an interval is lengthened: small steps, since one good audit says little
TARGET_RELIABILITY = 0.9  # share of audits that are to find the rig within its limits

type Method = Literal["beyond the limit", "drift", "usual interval", "staircase", "not enough to say"]


@dataclass(frozen=True)
class Due:
    """In how many days after the last record to look again, by which method, and why.

    `days` is None where the records do not say; 0 means now.
    """

    days: float | None
    method: Method
    reason: str


def due_of(
    days: ArrayLike,
    deviations: ArrayLike,
    limit: float,
    drift: Drift,
    *,
    reference: float = 0.0,
    jumps: int = 0,
) -> Due:
    """Say when the limit may be reached, from the drift through all records, or why it cannot be said.

    A last record beyond the limit is due now. Along a line (ILAC-G24, method 2) it is due when forecast and its U
    reach the limit. A line whose rate is not significant shortens no interval: the scatter that hides it is no drift.
    Where the quantity jumps, or the line is curved, the staircase (method 1) steps the usual interval by each audit.

    Parameters
    ----------
    days, deviations
        (n,) the records in the order of time, as distances from the reference.
    limit
        Largest permissible deviation, in the unit of `drift.level`.
    drift
        The line through them, about `reference`.
    jumps
        How many jumps were found.
    """
    off, unit = np.asarray(deviations, float), drift.level.unit
    usual = float(np.median(np.diff(np.asarray(days, float))))
    if abs(off[-1]) > limit:
        return beyond_the_limit(float(off[-1]), limit, unit)
    if jumps or not drift.steady:
        return _stepwise(usual, np.abs(off) / limit, jumps)
    found = chart_interval(drift, limit, reference=reference)
    if found.days is not None and (found.days >= usual or drift.significant):
        return found
    scatter = f"{uncertainty_text(drift.at(0.0).expanded().U)} {unit}".rstrip()
    reason = (
        f"no drift is shown ({rate_text(drift)}), but the next audit is foreseen to {scatter} only, "
        f"limit {_with_unit(limit, unit)}: more audits say more"
    )
    return Due(usual, "usual interval", reason)


def beyond_the_limit(last: float, limit: float, unit: str) -> Due:
    """Due now: the last record is beyond the limit."""
    found = f"{value_text(last, limit / 10, sign=True)} {unit}".rstrip()
    return Due(0.0, "beyond the limit", f"{found} at the last record, limit {_with_unit(limit, unit)}")


def _with_unit(number: float, unit: str) -> str:
    return f"{number:.3g} {unit}".rstrip()


def rate_text(drift: Drift) -> str:
    """Print a rate with its expanded uncertainty and the number of records.

    Examples
    --------
    >>> from fringecal.history.drift import drift_of
    >>> rate_text(drift_of([0, 365.25, 730.5, 1095.75], [0.0, 1.1, 1.9, 3.0], unit="mm"))
    '+0.98 mm/year, U 0.18, by 4 records'
    """
    rate, expanded = drift.rate, drift.rate.expanded().U
    value = value_text(rate.value, expanded, sign=True)
    return f"{value} {rate.unit}, U {uncertainty_text(expanded)}, by {drift.records} records"


def _stepwise(usual: float, ratios: Floats, jumps: int) -> Due:
    """Step the usual interval, since no line foresees the next jump."""
    found = staircase(usual, ratios)
    why = f"{jumps} jump{'s' if jumps > 1 else ''}" if jumps else "no straight line"
    return Due(min(usual, found.days or usual), "staircase", f"{why}, which no rate foresees; {found.reason}")


def staircase(
    current_days: float, ratios: ArrayLike, *, growth: float = GROWTH, reliability: float = TARGET_RELIABILITY
) -> Due:
    """Step an interval up or down after each audit (ILAC-G24, method 1).

    Each ratio beyond 1 shortens the interval to ``(1 + growth)^(-R / (1 - R))`` of itself, so that it settles where
    the share R of audits is within the limit; a ratio below 0.8 lengthens it by `growth`; between them it stays.

    Parameters
    ----------
    current_days
        Interval that the first audit ended.
    ratios
        Largest ``|deviation| / limit`` of each audit, oldest first.
    growth
        By how much an interval is lengthened.
    reliability
        Share of audits R that is to be within the limit.

    Examples
    --------
    >>> round(staircase(100.0, [0.5, 0.5, 0.9]).days, 1)
    121.0
    """
    shares = np.abs(np.asarray(ratios, float))
    if not current_days > 0 or not shares.size or not np.isfinite(shares).all():
        raise HistoryError("a staircase takes an interval above 0 and at least one finite ratio")
    shrink = (1 + growth) ** (-reliability / (1 - reliability))
    days = current_days
    for share in shares:
        days *= shrink if share > 1 else (1 + growth if share < EXTENDED_BELOW else 1.0)
        days = min(days, LONGEST_DAYS)
    beyond, below = int((shares > 1).sum()), int((shares < EXTENDED_BELOW).sum())
    reason = (
        f"of {shares.size} records {below} stayed below {EXTENDED_BELOW:.0%} of the limit (+{growth:.0%} each) and "
        f"{beyond} went beyond it (-{1 - shrink:.0%} each), from {current_days:.0f} days; "
        f"settles at {reliability:.0%} within"
    )
    return Due(days, "staircase", reason)


def chart_interval(drift: Drift, limit: float, *, reference: float = 0.0) -> Due:
    """Find how long the forecast of the next audit stays within the limit (ILAC-G24, method 2).

    The first time at which ``|forecast - reference| + U = limit``, U the expanded uncertainty of a single forecast,
    but no further ahead than the longest time without calibration or jump, nor than 5 years.

    Parameters
    ----------
    drift
        The fitted line.
    limit
        Largest permissible deviation from `reference`, in the unit of the values.

    Raises
    ------
    HistoryError
        The residuals are structured, so that no line may be carried on, or the limit is not positive.
    """
    if not limit > 0:
        raise HistoryError(f"a limit above 0 was needed, found {limit:g}")
    if not drift.steady:
        raise HistoryError(
            f"the values do not follow a line (p = {drift.p_structure:.2g}): look for steps, and start after the last"
        )

    def spare(years: float) -> float:
        forecast = drift.at(years)
        return limit - abs(forecast.value - reference) - forecast.expanded().U

    rate, limited = rate_text(drift), _with_unit(limit, drift.level.unit)
    if spare(0.0) <= 0:
        return Due(0.0, "drift", f"{rate}: the next audit may lie beyond the limit {limited} already")
    longest = min(drift.span_years, LONGEST_DAYS / YEAR_DAYS)
    if spare(longest) > 0:
        reason = f"{rate}: stays within the limit {limited} for as long as the records reach back; no longer is claimed"
        return Due(longest * YEAR_DAYS, "drift", reason)
    years = float(optimize.brentq(spare, 0.0, longest))
    return Due(years * YEAR_DAYS, "drift", f"{rate}: the forecast and its U reach the limit {limited}")
