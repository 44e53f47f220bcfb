"""Where the phases of several periods are zero: at one place, a constant apart as for sines, or each elsewhere."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import TURN, wrap
from fringecal.phase.orders.period_cycle import OrderRules, PeriodSample, cycle_of, nearest_orders

_AS_STATED = 1.5  # chi-squared per period up to which zeros at one place are believed: noise alone makes 1
_BETTER = 0.7  # of the chi-squared of one constant that zeros of their own must have: they have more freedom
_COARSE_DEG, _FINE_DEG = 3.0, 0.25  # steps in which a constant is looked for: 0.05 rad, and then a sixth of noise
_MOST_TRIED = 60_000  # orders of pixels for each constant: a fifth of a second
_LEAST_TRIED, _MOST_PIXELS = 60, 400  # pixels that decide a constant
_OUTLIER = 25.0  # chi-squared that a pixel counts at most: five standard uncertainties
_QUARTER_DEG = 2.0  # of a quarter of a fringe, within which an offset between two periods is named so
_WHOLE = 1e-3  # of a turn, within which a further period repeats with the cycle and has one zero


@dataclass(frozen=True)
class Zeros:
    """Phases of the longer fringes where the shortest one's is 0.

    Parameters
    ----------
    rad
        One for each longer period, rad, (K - 1,).
    chi_squared
        Median chi-squared per longer period that is left.
    offset_rad
        The constant that all periods' phases share, rad, such as a quarter of a fringe for sines; 0 where there is
        none, None where the zeros have no such explanation.
    """

    rad: NDArray[np.float64]
    chi_squared: float
    offset_rad: float | None = None


def find_zeros(sample: PeriodSample, cycle: int, whole: int, rules: OrderRules) -> Zeros:
    """Find where the phases of the longer fringes are zero.

    Parameters
    ----------
    sample
        Pixels that all periods know.
    cycle
        Orders that may occur.
    whole
        Orders after which the periods meet again; more than `cycle` where fewer are projected.
    rules
        When an offset is believed.

    Notes
    -----
    If all phases are those of one place plus a constant c, `zeta_k = (1 - rho_k) c`; c = -90 deg for sines taken
    for cosines. It is found by trial, so that all periods have it in common. Otherwise each zero is found against
    the order that the periods before it give, the shorter ones first.
    """
    starts = (0,) if cycle == whole else (-1, 1 - cycle)  # fewer: orders begin at the zero, or end there
    tried = [_at(sample, 0.0, start, cycle) for start in starts]
    best = min(tried, key=lambda one: one.chi_squared)
    if best.chi_squared < _AS_STATED:
        return best
    found = [best, *(_constant(sample, start, cycle) for start in starts)]
    best = min(found, key=lambda one: one.chi_squared)
    own = _stepwise(sample, cycle, rules) if cycle == whole else best
    pair = len(sample.ratios) == 1  # its zero is a constant's as well: the one nearest to 0 is taken
    if own.chi_squared < (1 / _BETTER if pair else _BETTER) * best.chi_squared:
        best = own
    return _named_quarter(best, sample) if pair else best


def _at(sample: PeriodSample, offset: float, start: int, cycle: int) -> Zeros:
    """Return the zeros of one constant, orders counted from `start`."""
    zeros = wrap((1 - sample.ratios) * offset + sample.ratios * TURN * start)
    return Zeros(zeros, sample.chi_squared(zeros, cycle), offset)


def _constant(sample: PeriodSample, start: int, cycle: int) -> Zeros:
    """Find the constant that all periods share, orders counted from `start`."""
    few = sample.thinned(int(np.clip(_MOST_TRIED // cycle, _LEAST_TRIED, _MOST_PIXELS)))
    coarse = np.deg2rad(np.arange(-180, 180, _COARSE_DEG))
    best = coarse[np.argmin([_cost(few, c, start, cycle) for c in coarse])]
    fine = best + np.deg2rad(np.arange(-_COARSE_DEG, _COARSE_DEG + _FINE_DEG, _FINE_DEG))
    return _at(sample, float(fine[np.argmin([_cost(few, c, start, cycle) for c in fine])]), start, cycle)


def _cost(few: PeriodSample, offset: float, start: int, cycle: int) -> float:
    """Return the mean chi-squared with one constant, outliers cut."""
    zeros = (1 - few.ratios) * offset + few.ratios * TURN * start
    orders = few.fine[:, None] + TURN * np.arange(cycle)
    total = np.zeros(orders.shape)
    for coarse, u, ratio, zero in zip(few.coarse, few.u, few.ratios, zeros, strict=True):
        off = (coarse[:, None] - ratio * orders - zero) / TURN
        total += ((off - np.rint(off)) * (TURN / u[:, None])) ** 2
    return float(np.minimum(total.min(axis=1), _OUTLIER).mean())


def _stepwise(sample: PeriodSample, cycle: int, rules: OrderRules) -> Zeros:
    """Find each zero against the order that the periods before it give, those nearest the shortest first."""
    zeros, known = np.zeros(len(sample.ratios)), np.zeros(len(sample.ratios), bool)
    absolute, turns = sample.fine, 1
    for k in np.argsort(-sample.ratios):
        zeros[k] = _zero(absolute, sample.coarse[k], sample.u[k], float(sample.ratios[k]), turns, rules)
        known[k] = True
        turns = cycle_of(sample.ratios[known])
        part = PeriodSample(sample.fine, sample.coarse[known], sample.u[known], sample.ratios[known])
        absolute = sample.fine + TURN * part.best(zeros[known], turns)[1]
    return Zeros(zeros, sample.chi_squared(zeros, cycle))


def _zero(absolute: NDArray, coarse: NDArray, u: NDArray, ratio: float, turns: int, rules: OrderRules) -> float:
    """Return the longer fringe's phase where the counted one's is 0, as near to 0 as whole orders allow, rad."""
    share = ratio * turns % 1
    near = nearest_orders([share], cycle_of([share])) if _WHOLE < share < 1 - _WHOLE else TURN
    if rules.seen * np.median(u) > near:
        return 0.0
    # Orders lie `near` apart, so that the remainder of it is the same for all of them.
    turned = np.mean(np.exp(1j * (coarse - ratio * absolute) * TURN / near))
    offset = float(np.angle(turned) * near / TURN)
    return offset if abs(turned) > rules.least_agreement and abs(offset) > rules.least_offset * near else 0.0


def _named_quarter(found: Zeros, sample: PeriodSample) -> Zeros:
    """Name the offset between two periods if a quarter of a fringe explains it; another could as well."""
    quarters = [one for one in _quarters() if _apart(one, found, sample) < np.deg2rad(_QUARTER_DEG)]
    return Zeros(found.rad, found.chi_squared, quarters[0] if quarters else None)


def _quarters() -> Iterator[float]:
    """Give sines, and sines that fall."""
    yield from (-TURN / 4, TURN / 4)


def _apart(offset: float, found: Zeros, sample: PeriodSample) -> float:
    """Return how far the longer phase is from that of a constant, with the order that fits best, rad."""
    turns = sample.ratios[0] * TURN * np.arange(cycle_of(sample.ratios))
    return float(np.abs(wrap(found.rad[0] - (1 - sample.ratios[0]) * offset - turns)).min())
