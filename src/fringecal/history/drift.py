"""Drift of a quantity over the years, and when to calibrate next (ILAC-G24:2022 / OIML D 10)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, stats

from fringecal.errors import HistoryError
from fringecal.uncertainty import COVERAGE, Estimate, Line, fit_line

YEAR_DAYS = 365.25
LEAST_POINTS = 4  # records: two degrees of freedom at least for the scatter about the line
LONGEST_DAYS = 5 * YEAR_DAYS  # of an interval: no history says what a rig does in longer
EXTENDED_BELOW = 0.8  # of the limit: ILAC-G24's example for a longer interval
GROWTH = 0.1  # by how much an interval is lengthened: small steps, since one good audit says little
TARGET_RELIABILITY = 0.9  # share of audits that are to find the rig within its limits
SIGNIFICANCE = 0.05  # probability without drift below which a rate is called significant: the usual 5 %
_SUSPICIOUS = 0.01  # probability of residuals so alike below which the line is not carried on: 1 %, since it stops work
_LEAST_RESIDUALS = 8  # below it the normal approximation of von Neumann's ratio does not hold


@dataclass(frozen=True)
class Drift:
    """A straight line through a quantity over time.

    `rate` is per year; `level` holds at the last record; `p_value` is the probability of such a rate without drift;
    `p_structure` that of residuals as alike as these from one record to the next: a small one means that steps or
    curves, not a steady drift, are there, and that the line must not be carried on.
    """

    rate: Estimate
    level: Estimate
    p_value: float
    p_structure: float
    line: Line
    last_years: float
    span_years: float

    @property
    def significant(self) -> bool:
        """Whether the rate differs from 0 at 95 %."""
        return self.p_value < SIGNIFICANCE

    @property
    def steady(self) -> bool:
        """Whether the residuals are consistent with a straight line."""
        return self.p_structure >= _SUSPICIOUS

    def at(self, years: float) -> Estimate:
        """Forecast of one record, so many years after the last: its scatter is part of the uncertainty."""
        t = self.last_years + years
        variance = np.array([1.0, t]) @ self.line.covariance @ np.array([1.0, t]) + self.line.residual_sd**2
        value = self.line.intercept + self.line.slope * t
        return Estimate(float(value), float(np.sqrt(variance)), self.level.unit, "forecast", self.line.dof)


def drift_of(days: ArrayLike, values: ArrayLike, *, unit: str = "") -> Drift:
    """Fit a straight line; its uncertainty comes from the scatter about it, not from the stated u.

    What the records share (artefact, model) cancels in a drift, and their u contains it.

    Parameters
    ----------
    days
        (n,) days since any origin.
    values
        (n,) in `unit`.

    Raises
    ------
    HistoryError
        Fewer than 4 records, or all at one time.
    """
    t, x = np.asarray(days, float) / YEAR_DAYS, np.asarray(values, float)
    if t.size < LEAST_POINTS or t.shape != x.shape or np.ptp(t) == 0:
        raise HistoryError(f"a drift takes {LEAST_POINTS} records at different times, found {t.size}")
    order = np.argsort(t, kind="stable")
    t, x = t[order], x[order]
    line = fit_line(t, x)
    u_rate = float(np.sqrt(line.covariance[1, 1]))
    last = np.array([1.0, t[-1]])
    u_level = float(np.sqrt(last @ line.covariance @ last))
    p = 2 * float(stats.t.sf(abs(line.slope) / u_rate, line.dof)) if u_rate > 0 else float(line.slope == 0)
    return Drift(
        Estimate(line.slope, u_rate, f"{unit}/year", "drift", line.dof),
        Estimate(line.intercept + line.slope * t[-1], u_level, unit, "level", line.dof),
        p,
        _structure(x - line.intercept - line.slope * t),
        line,
        float(t[-1]),
        float(np.ptp(t)),
    )


def _structure(residuals: np.ndarray) -> float:
    """Probability of successive residuals so alike by chance (von Neumann's ratio, normal approximation)."""
    total = float(residuals @ residuals)
    if len(residuals) < _LEAST_RESIDUALS or total == 0:
        return 1.0  # too few for a test
    ratio = float(np.sum(np.diff(residuals) ** 2)) / total
    n = len(residuals)
    # J. von Neumann 1941: mean 2, variance 4 (n - 2) / (n^2 - 1) about the mean; two more degrees go with the line.
    return float(stats.norm.cdf((ratio - 2) / np.sqrt(4 * (n - 2) / (n**2 - 1))))


@dataclass(frozen=True)
class Interval:
    """A recalibration interval in days, by which method, and why."""

    days: float
    method: Literal["staircase", "control chart"]
    reason: str


def staircase(
    current_days: float, ratios: Sequence[float], *, growth: float = GROWTH, reliability: float = TARGET_RELIABILITY
) -> Interval:
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
    if not current_days > 0 or not len(ratios) or not np.isfinite(ratios).all():
        raise HistoryError("a staircase takes an interval above 0 and at least one finite ratio")
    shrink = (1 + growth) ** (-reliability / (1 - reliability))
    days = current_days
    for ratio in ratios:
        days *= shrink if abs(ratio) > 1 else (1 + growth if abs(ratio) < EXTENDED_BELOW else 1.0)
        days = min(days, LONGEST_DAYS)
    beyond, below = sum(abs(r) > 1 for r in ratios), sum(abs(r) < EXTENDED_BELOW for r in ratios)
    reason = (
        f"of {len(ratios)} audits {below} stayed below {EXTENDED_BELOW:.0%} of the limit (+{growth:.0%} each) and "
        f"{beyond} went beyond it (-{1 - shrink:.0%} each), from {current_days:.0f} days; "
        f"settles at {reliability:.0%} within"
    )
    return Interval(days, "staircase", reason)


def chart_interval(drift: Drift, limit: float, *, reference: float = 0.0, coverage: float = COVERAGE) -> Interval:
    """Find how long the forecast of the next audit stays within the limit (ILAC-G24, method 2).

    The first time at which ``|forecast - reference| + U = limit``, U the expanded uncertainty of a single forecast,
    but no further ahead than the history reaches back, nor than 5 years.

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
        return limit - abs(forecast.value - reference) - forecast.expanded(coverage).U

    if spare(0.0) <= 0:
        return Interval(0.0, "control chart", f"the next audit may lie beyond the limit {limit:.3g} already: audit now")
    longest = min(drift.span_years, LONGEST_DAYS / YEAR_DAYS)
    if spare(longest) > 0:
        reason = f"the forecast stays within {limit:.3g} for as long as the history reaches back; no longer is claimed"
        return Interval(longest * YEAR_DAYS, "control chart", reason)
    years = float(optimize.brentq(spare, 0.0, longest))
    rate, unit = drift.rate, drift.rate.unit
    reason = f"a drift of {rate.value:+.3g} {unit} (u {rate.u:.2g}) and its forecast's U reach the limit {limit:.3g}"
    return Interval(years * YEAR_DAYS, "control chart", reason)
