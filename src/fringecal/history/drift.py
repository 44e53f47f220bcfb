"""Drift of a quantity over the years: one rate, and a level of its own after each calibration or jump."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats

from fringecal.errors import HistoryError
from fringecal.uncertainty import Estimate

Floats = NDArray[np.float64]

YEAR_DAYS = 365.25
LEAST_DOF = 2  # of the scatter about the line: of one degree of freedom U is 13 u, which says nothing
LEAST_POINTS = 2 + LEAST_DOF  # records on one line
SIGNIFICANCE = 0.05  # probability without drift below which a rate is called significant: the usual 5 %
_SUSPICIOUS = 0.01  # probability of residuals so alike below which the line is not carried on: 1 %, since it stops work
_LEAST_RESIDUALS = 8  # below it the normal approximation of von Neumann's ratio does not hold
_JUMP = 0.01  # probability without any jump, all places tried, below which one is taken for real
_HELD = 1e-9  # squared length of a step beside the design: rounding
_MOST_JUMPS = 3  # in one history: with more of them it has no line


@dataclass(frozen=True)
class Drift:
    """A straight line through a quantity over time, in parts that share its rate.

    `rate` is per year; `level` holds at the last record; `p_value` is the probability of such a rate without drift;
    `p_structure` that of residuals as alike as these from one record to the next: a small one means that steps or
    curves, not a steady drift, are there, and that the line must not be carried on. `covariance` is that of level and
    rate, `span_years` the longest part, as far ahead as the line may be carried on.
    """

    rate: Estimate
    level: Estimate
    p_value: float
    p_structure: float
    covariance: Floats
    residual_sd: float
    span_years: float
    records: int

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
        weights = np.array([1.0, years])
        variance = weights @ self.covariance @ weights + self.residual_sd**2
        value = self.level.value + self.rate.value * years
        return Estimate(float(value), float(np.sqrt(variance)), self.level.unit, "forecast", self.level.dof)


def drift_of(days: ArrayLike, values: ArrayLike, *, parts: ArrayLike | None = None, unit: str = "") -> Drift:
    """Fit a straight line; its uncertainty comes from the scatter about it, not from the stated u.

    What the records share (artefact, model) cancels in a drift, and their u contains it.

    Parameters
    ----------
    days
        (n,) days since any origin.
    values
        (n,) in `unit`.
    parts
        (n,) whole numbers: records with the same one share a level. By default all do.

    Raises
    ------
    HistoryError
        Fewer records than levels and 3 more, or all records of each part at one time.
    """
    t, x = np.asarray(days, float) / YEAR_DAYS, np.asarray(values, float)
    part = np.zeros(t.shape, int) if parts is None else np.asarray(parts, int)
    if t.ndim != 1 or not t.shape == x.shape == part.shape or not t.size:
        raise HistoryError(f"a drift takes {LEAST_POINTS} records at different times, found {t.size}")
    order = np.argsort(t, kind="stable")
    t, x, part = t[order], x[order], part[order]
    design = _design(t - t[-1], part)
    dof = t.size - design.shape[1]
    if dof < LEAST_DOF or np.linalg.matrix_rank(design) < design.shape[1]:
        needed = design.shape[1] + LEAST_DOF
        raise HistoryError(f"a drift takes {needed} records at different times, found {t.size}")
    found, residuals, normal = _solved(design, x)
    variance = float(residuals @ residuals) / dof
    # The last part's level comes first in the design, the rate last.
    covariance = variance * normal[np.ix_([0, -1], [0, -1])]
    u_level, u_rate = np.sqrt(np.diag(covariance))
    p = 2 * float(stats.t.sf(abs(found[-1]) / u_rate, dof)) if u_rate > 0 else float(found[-1] == 0)
    return Drift(
        Estimate(float(found[-1]), float(u_rate), f"{unit or '1'}/year", "drift", dof),
        Estimate(float(found[0]), float(u_level), unit, "level", dof),
        p,
        _structure(residuals),
        covariance,
        variance**0.5,
        max(float(np.ptp(t[part == one])) for one in set(part)),
        t.size,
    )


def _design(years: Floats, part: NDArray[np.int_]) -> Floats:
    """Columns: the level of each part, the last record's first, then the time."""
    others = sorted(set(part) - {part[-1]})
    return np.column_stack([*(part == one for one in (part[-1], *others)), years]).astype(float)


def _solved(design: Floats, x: Floats) -> tuple[Floats, Floats, Floats]:
    """Return coefficients, residuals, and the covariance of the coefficients for unit variance."""
    inverse = np.linalg.pinv(design)
    found = inverse @ x
    return found, x - design @ found, inverse @ inverse.T


def _structure(residuals: Floats) -> float:
    """Probability of successive residuals so alike by chance (von Neumann's ratio, normal approximation)."""
    total = float(residuals @ residuals)
    if len(residuals) < _LEAST_RESIDUALS or total == 0:
        return 1.0  # too few for a test
    ratio = float(np.sum(np.diff(residuals) ** 2)) / total
    n = len(residuals)
    # J. von Neumann 1941: mean 2, variance 4 (n - 2) / (n^2 - 1) about the mean; two more degrees go with the line.
    return float(stats.norm.cdf((ratio - 2) / np.sqrt(4 * (n - 2) / (n**2 - 1))))


def jumps_of(days: ArrayLike, values: ArrayLike, *, parts: ArrayLike | None = None) -> tuple[int, ...]:
    """Find the records from which on a quantity has another level, in the order of time.

    At each place in turn a further level is fitted beside the line's; the one that explains most is kept if its F test,
    times the number of places tried (Bonferroni), is below 1 %, and the search begins again with it.

    Parameters
    ----------
    days, values, parts
        As for `drift_of`, in the order of time.

    Examples
    --------
    >>> jumps_of(range(10), [0.1, 0, 0.1, 0, 0.1, 1.0, 1.1, 1.0, 1.1, 1.0])
    (5,)
    """
    t, x = np.asarray(days, float), np.asarray(values, float)
    part = np.zeros(t.shape, int) if parts is None else np.asarray(parts, int)
    found: list[int] = []
    while len(found) < _MOST_JUMPS:
        place = _largest_jump(t, x, part)
        if place is None:
            break
        found.append(place)
        part = part + (np.arange(t.size) >= place) * (part.max() + 1) * (part == part[place])
    return tuple(sorted(found))


def _largest_jump(t: Floats, x: Floats, part: NDArray[np.int_]) -> int | None:
    """Return where a further level explains most, if it is significant."""
    places = np.flatnonzero(np.diff(part) == 0) + 1
    design = _design(t - t[-1], part)
    dof = t.size - design.shape[1] - 1
    if not places.size or dof < LEAST_DOF:
        return None
    residuals = _solved(design, x)[1]
    before = float(residuals @ residuals)
    gains = _gains(design, residuals, (np.arange(t.size)[:, None] >= places) & (part[:, None] == part[places]))
    best = int(np.argmax(gains))
    left = before - gains[best]
    ratio = gains[best] * dof / left if left > 0 else np.inf
    p = float(special.fdtrc(1, dof, ratio)) * places.size if before > 0 else 1.0
    return int(places[best]) if p < _JUMP else None


def _gains(design: Floats, residuals: Floats, steps: NDArray[np.bool_]) -> Floats:
    """By how much the sum of squares falls with each column of `steps` (n, k) added to the design."""
    basis = np.linalg.qr(design)[0]
    across = steps - basis @ (basis.T @ steps)
    length = np.einsum("ij,ij->j", across, across)
    # A step that the design holds already, as one beside a calibration may be, explains nothing more.
    return np.where(length > _HELD, (residuals @ across) ** 2 / np.maximum(length, _HELD), 0.0)


def split_at(parts: ArrayLike, jumps: Sequence[int]) -> NDArray[np.int_]:
    """Number the parts anew, a further one from each jump to the end of the part that it is in.

    Examples
    --------
    >>> split_at([0, 0, 0, 1, 1], [1]).tolist()
    [0, 1, 1, 2, 2]
    """
    part = np.asarray(parts, int)
    begins = np.zeros(part.size, bool)
    begins[1:] = np.diff(part) != 0
    begins[list(jumps)] = True
    return np.asarray(np.cumsum(begins))
