"""Gauge repeatability and reproducibility: how much of a scatter is the rig's, the operator's, and the parts' own."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from fringecal.errors import HistoryError
from fringecal.history.constants import range_moments

Floats = NDArray[np.float64]
# Limits of the AIAG's manual, Measurement Systems Analysis, 4th edition (2010).
POOLING_LEVEL = 0.25  # an interaction less significant than this is taken for repeatability
GOOD_PERCENT, BAD_PERCENT = 10.0, 30.0  # %GRR below which a gauge is good, and above which it is unfit
LEAST_CATEGORIES = 5  # distinct categories that a good gauge distinguishes
_CATEGORIES = 1.41  # sqrt 2 with the manual's digits: 97 % intervals of the gauge that span the parts' variation
_WHOLE_SCATTER = 6.0  # standard deviations that stand for the whole scatter of a gauge: 99.7 %


@dataclass(frozen=True)
class GaugeStudy:
    """Standard deviations of a crossed study, in the unit of the readings.

    Parameters
    ----------
    repeatability, reproducibility
        EV and AV: of one operator repeating, and between operators (interaction included where it is kept).
    gauge, parts, total
        GRR, PV and TV: root sums of squares.
    u_repeatability, u_gauge
        Standard uncertainties from the finite number of readings; None for the range method.
    interaction_f, interaction_p
        Of operator by part, with the probability of as much by chance; None where there is none to test.
    pooled
        Whether the interaction was taken for repeatability.
    """

    method: Literal["range", "ANOVA"]
    repeatability: float
    reproducibility: float
    gauge: float
    parts: float
    total: float
    u_repeatability: float | None = None
    u_gauge: float | None = None
    interaction_f: float | None = None
    interaction_p: float | None = None
    pooled: bool = False

    @property
    def percent(self) -> float:
        """%GRR: share of the total standard deviation; below 10 good, above 30 not fit for use."""
        return 100 * self.gauge / self.total

    @property
    def categories(self) -> float:
        """Number of distinct categories ``1.41 PV / GRR`` (the manual's digits) before it is cut; 5 are needed."""
        return _CATEGORIES * self.parts / self.gauge if self.gauge > 0 else np.inf

    def percent_of_tolerance(self, tolerance: float) -> float:
        """Six standard deviations of the gauge as a share of a tolerance's width."""
        return 100 * _WHOLE_SCATTER * self.gauge / tolerance

    @property
    def verdict(self) -> str:
        """What AIAG's limits say: good, conditional or unfit."""
        if self.percent > BAD_PERCENT:
            return "unfit"
        return "good" if self.percent < GOOD_PERCENT and self.categories >= LEAST_CATEGORIES else "conditional"


def range_study(readings: ArrayLike) -> GaugeStudy:
    """Average and range method (AIAG MSA, 4th edition, III-B).

    ``EV = R / d2(trials)``, ``AV^2 = (X_diff / d2*(operators))^2 - EV^2 / (parts trials)``, ``PV = R_p / d2*(parts)``.

    Parameters
    ----------
    readings
        (parts, operators, trials); one operator has no reproducibility.

    Raises
    ------
    HistoryError
        Fewer than 2 parts or 2 trials, missing values, or no scatter at all.
    """
    x = _crossed(readings)
    parts, operators, trials = x.shape
    repeatability = float(np.ptp(x, axis=2).mean()) / range_moments(trials).d2
    between = 0.0
    if operators > 1:
        spread = float(np.ptp(x.mean(axis=(0, 2)))) / range_moments(operators).d2_star
        between = max(spread**2 - repeatability**2 / (parts * trials), 0.0) ** 0.5
    gauge = float(np.hypot(repeatability, between))
    part = float(np.ptp(x.mean(axis=(1, 2)))) / range_moments(parts).d2_star
    return GaugeStudy("range", repeatability, between, gauge, part, float(np.hypot(gauge, part)))


def anova_study(readings: ArrayLike, *, pooling: float = POOLING_LEVEL) -> GaugeStudy:
    """Two-way analysis of variance with random parts and operators (AIAG MSA, 4th edition, III-B and appendix A).

    An interaction with p above `pooling` is pooled with repeatability. Standard uncertainties from
    ``Var(MS) = 2 MS^2 / dof``; components that come out negative are 0.

    Parameters
    ----------
    readings
        (parts, operators, trials); one operator has no reproducibility.
    pooling
        Level of the interaction's test.

    Raises
    ------
    HistoryError
        Fewer than 2 parts or 2 trials, missing values, or no scatter at all.
    """
    x = _crossed(readings)
    parts, operators, trials = x.shape
    squares, dof = _mean_squares(x)
    f = p = None
    pooled = False
    if operators > 1:
        f = float(squares[2] / squares[3]) if squares[3] > 0 else float("inf")
        p = float(stats.f.sf(f, dof[2], dof[3]))
        pooled = p > pooling
    if pooled:
        together = (squares[2] * dof[2] + squares[3] * dof[3]) / (dof[2] + dof[3])
        squares[2:], dof[2:] = together, dof[2] + dof[3]
    # Rows: parts, operators, interaction, repeatability; columns: mean squares of the same.
    error = 3 if pooled or operators == 1 else 2
    solve = np.zeros((4, 4))
    solve[0, [0, error]] = np.array([1, -1]) / (operators * trials)
    if operators > 1:
        solve[1, [1, error]] = np.array([1, -1]) / (parts * trials)
        if not pooled:
            solve[2, [2, 3]] = np.array([1, -1]) / trials
    solve[3, 3] = 1
    variances = np.maximum(solve @ squares, 0.0)
    # A pooled mean square stands in two places and is one number.
    gauge_row = solve[1:][variances[1:] > 0].sum(axis=0)
    spread = 2 * squares**2 / np.maximum(dof, 1)
    gauge = float(variances[1:].sum() ** 0.5)
    repeatability = float(variances[3] ** 0.5)
    return GaugeStudy(
        "ANOVA",
        repeatability,
        float((variances[1] + variances[2]) ** 0.5),
        gauge,
        float(variances[0] ** 0.5),
        float(variances.sum() ** 0.5),
        _half(spread[3], repeatability),
        _half(float(gauge_row**2 @ spread), gauge),
        f,
        p,
        pooled,
    )


def _half(variance: float, sd: float) -> float:
    """Turn the variance of a variance into the standard uncertainty of its root."""
    return float(variance**0.5 / (2 * sd)) if sd > 0 else 0.0


def _mean_squares(x: Floats) -> tuple[Floats, Floats]:
    """Mean squares and degrees of freedom of parts, operators, interaction and repeatability."""
    parts, operators, trials = x.shape
    grand, part = x.mean(), x.mean(axis=(1, 2))
    operator, cell = x.mean(axis=(0, 2)), x.mean(axis=2)
    sums = np.array(
        [
            operators * trials * np.sum((part - grand) ** 2),
            parts * trials * np.sum((operator - grand) ** 2),
            trials * np.sum((cell - part[:, None] - operator + grand) ** 2),
            np.sum((x - cell[..., None]) ** 2),
        ]
    )
    dof = np.array(
        [parts - 1, operators - 1, (parts - 1) * (operators - 1), parts * operators * (trials - 1)], dtype=float
    )
    return np.divide(sums, dof, out=np.zeros(4), where=dof > 0), dof


def _crossed(readings: ArrayLike) -> Floats:
    x = np.asarray(readings, dtype=float)
    if x.ndim != 3 or x.shape[0] < 2 or x.shape[1] < 1 or x.shape[2] < 2:
        raise HistoryError(
            f"a gauge study takes parts x operators x trials, 2 parts and 2 trials at least; found shape {x.shape}"
        )
    if not np.isfinite(x).all():
        raise HistoryError(f"a gauge study takes every reading, {int((~np.isfinite(x)).sum())} of {x.size} are missing")
    if np.ptp(x) == 0 or np.ptp(x, axis=2).max() == 0:
        raise HistoryError(
            "repeats do not differ at all: the readings are rounded or copied, and do not show the scatter"
        )
    return x
