"""Control charts of single values: individuals, EWMA and CUSUM.

Audits are rare, so that a small drift must be found in few of them: a chart of individuals takes 44 audits on average
to see a change by one standard deviation, EWMA and CUSUM take ten (`fringecal.history.run_lengths`).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import HistoryError
from fringecal.history.constants import MOVING_RANGE

Floats = NDArray[np.float64]

LEAST_VALUES, USUAL_BASELINE = 6, 20
"""Values in control that sigma is estimated from, at least and usually: it is then known to 41 % and to 21 %
(`Baseline.u_sigma_relative`). From fewer no limit can be drawn; with more, years pass before the first chart."""

EWMA_WEIGHT, EWMA_WIDTH = 0.2, 2.962
"""Weight of the newest value, and half width of the limits in standard deviations of the average: 500 values between
false alarms (J. M. Lucas, M. S. Saccucci, Technometrics 32 (1990) 1; `ewma_run_length` computes it)."""

CUSUM_SLACK, CUSUM_LIMIT = 0.5, 4.77
"""In sigma: half the shift that is to be found, 1 sigma, and the sum that raises the alarm, with 370 values between
false ones (D. C. Montgomery, Introduction to Statistical Quality Control, 9.1; `cusum_run_length` computes it)."""

SHEWHART_WIDTH = 3.0
"""Half width of the limits of single values in sigma: 370 values between false alarms (W. A. Shewhart; ISO 7870-2)."""

_MOVING_RANGE_U = 0.909  # sqrt(0.8264): u of sigma from moving ranges of two, over sigma / sqrt(n - 1), see below
_NO_SCATTER = 1e-12  # of the largest value: rounding


@dataclass(frozen=True)
class Baseline:
    """Centre and standard deviation of a quantity in control, in its unit.

    `size` is the number of values that they were estimated from, 0 where they are stated. `sigma` has the relative
    standard uncertainty ``0.91 / sqrt(size - 1)`` (0 where stated), so that limits from few values are rough.
    """

    centre: float
    sigma: float
    size: int = 0

    @property
    def u_sigma_relative(self) -> float:
        """Relative standard uncertainty of `sigma` from overlapping moving ranges of two."""
        # Var(mean moving range) = sigma^2 (0.8264 / (m - 1)) d2^2 for long series: P. G. Hoel, 1946.
        return _MOVING_RANGE_U / np.sqrt(self.size - 1) if self.size > 1 else 0.0


@dataclass(frozen=True)
class Chart:
    """A control chart: the plotted statistic with its limits, all in the unit of the values.

    `lower` is None where only large values count. `second` is the lower sum of a CUSUM. `signals` are the indices of
    values beyond a limit.
    """

    kind: Literal["individuals", "EWMA", "CUSUM"]
    statistic: Floats
    centre: float
    upper: Floats
    lower: Floats | None
    signals: tuple[int, ...]
    second: Floats | None = None

    @property
    def first_signal(self) -> int | None:
        """Index of the first value that raises the alarm."""
        return self.signals[0] if self.signals else None

    @property
    def alarm(self) -> bool:
        """Whether the last value is beyond a limit: the state now, not the past."""
        return bool(self.signals) and self.signals[-1] == len(self.statistic) - 1


def baseline_of(values: ArrayLike, *, size: int | None = None) -> Baseline:
    """Estimate centre and standard deviation from the first values, which must have been in control.

    ``sigma = mean |x_i - x_(i-1)| / d2(2)``: moving ranges, since a slow drift inflates a plain standard deviation.

    Parameters
    ----------
    values
        (n,) in the order of capture.
    size
        How many of the first values to use; 20, or all where there are fewer.

    Raises
    ------
    HistoryError
        There are fewer than 6 values, or they are all equal: state centre and sigma instead.
    """
    x = checked(values)
    size = min(len(x), USUAL_BASELINE) if size is None else size
    if not LEAST_VALUES <= size <= len(x):
        raise HistoryError(
            f"a baseline takes {LEAST_VALUES} values at least, found {min(size, len(x))} of {len(x)}; "
            "wait for more records, or state centre and sigma"
        )
    sigma = float(np.abs(np.diff(x[:size])).mean()) / MOVING_RANGE.d2
    if sigma <= _NO_SCATTER * np.abs(x[:size]).max():
        raise HistoryError(f"the first {size} values are all equal: no scatter to judge others by; state sigma")
    return Baseline(float(x[:size].mean()), sigma, size)


def individuals_chart(values: ArrayLike, baseline: Baseline, *, width: float = SHEWHART_WIDTH) -> Chart:
    """Chart single values against ``centre +- width sigma`` (W. A. Shewhart; ISO 7870-2).

    Parameters
    ----------
    values
        (n,) in the order of capture.
    baseline
        Centre and sigma in control.
    width
        Half width of the limits in units of sigma.
    """
    x = checked(values)
    return _banded("individuals", x, baseline.centre, np.full(len(x), width * baseline.sigma))


def ewma_chart(
    values: ArrayLike,
    baseline: Baseline,
    *,
    weight: float = EWMA_WEIGHT,
    width: float = EWMA_WIDTH,
    settled: bool = False,
) -> Chart:
    """Chart the exponentially weighted moving average ``z_i = weight x_i + (1 - weight) z_(i-1)``, ``z_0 = centre``.

    Limits ``centre +- width sigma sqrt(weight / (2 - weight) (1 - (1 - weight)^(2 i)))`` (NIST/SEMATECH e-Handbook
    6.3.2.4; ISO 7870-6). Weight 0.2 with width 2.962 gives 500 values between false alarms.

    Parameters
    ----------
    values, baseline
        As for `individuals_chart`.
    weight
        Of the newest value, above 0 and up to 1.
    width
        Half width of the limits in standard deviations of z.
    settled
        Whether to use the limits of a long series from the first value on, as the handbook does.
    """
    x = checked(values)
    if not 0 < weight <= 1:
        raise HistoryError(f"the weight of an EWMA lies above 0 and not above 1, found {weight:g}")
    z, last = np.empty(len(x)), baseline.centre
    for i, value in enumerate(x):
        z[i] = last = weight * value + (1 - weight) * last
    growth = np.ones(len(x)) if settled else 1 - (1 - weight) ** (2 * np.arange(1, len(x) + 1))
    half = width * baseline.sigma * np.sqrt(weight / (2 - weight) * growth)
    return _banded("EWMA", z, baseline.centre, half)


def cusum_chart(
    values: ArrayLike, baseline: Baseline, *, slack: float = CUSUM_SLACK, limit: float = CUSUM_LIMIT
) -> Chart:
    """Chart the sums of deviations beyond a slack, upward and downward (tabular CUSUM).

    ``S_hi,i = max(0, S_hi,i-1 + x_i - centre - slack sigma)``, and likewise downward; both start at 0 (NIST/SEMATECH
    e-Handbook 6.3.2.3; ISO 7870-4). Slack 0.5 with limit 4.77 gives 370 values between false alarms.

    Parameters
    ----------
    values, baseline
        As for `individuals_chart`.
    slack, limit
        In units of sigma.
    """
    x = checked(values)
    high, low = np.empty(len(x)), np.empty(len(x))
    up = down = 0.0
    for i, deviation in enumerate(x - baseline.centre):
        high[i] = up = max(0.0, up + deviation - slack * baseline.sigma)
        low[i] = down = max(0.0, down - deviation - slack * baseline.sigma)
    upper = np.full(len(x), limit * baseline.sigma)
    return Chart("CUSUM", high, 0.0, upper, -upper, _indices((high > upper) | (low > upper)), -low)


def _banded(kind: Literal["individuals", "EWMA"], statistic: Floats, centre: float, half: Floats) -> Chart:
    """Chart a statistic within a band of half width `half`, (n,), about its centre."""
    beyond = np.abs(statistic - centre) > half
    return Chart(kind, statistic, centre, centre + half, centre - half, _indices(beyond))


def checked(values: ArrayLike) -> Floats:
    """Return a row of finite values as an array, or refuse."""
    x = np.asarray(values, dtype=float)
    if x.ndim != 1 or x.size == 0 or not np.isfinite(x).all():
        raise HistoryError(f"a chart takes a row of finite values, found an array of shape {x.shape}")
    return x


def _indices(beyond: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(int(i) for i in np.flatnonzero(beyond))
