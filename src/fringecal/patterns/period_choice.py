"""Which fringe periods to show: the range that they number, and how often noise makes them number a fringe wrongly."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from fringecal.errors import PhaseError

Array = NDArray[np.float64]

_MOST_FRINGES = 4096  # of a picture that a choice is looked for: no raster shows more
_WIDEST = 2.0  # of the shortest period, up to which the periods of a beat are looked for
_TRIED = 48  # further periods beside the shortest that are tried for a beat
_WHOLE_FRINGE = 1 - 1e-9


@dataclass(frozen=True)
class PeriodChoice:
    """One choice of periods.

    Parameters
    ----------
    how
        What its periods do: one, widening step by step, or beating with one another.
    periods_px
        Shortest first.
    error_rate
        Probability that a pixel's fringe is numbered wrongly, at most (the sum over all other numbers).
    frames
        Frames along one axis.
    """

    how: str
    periods_px: tuple[float, ...]
    error_rate: float
    frames: int


def phase_noise_rad(noise_levels: float, modulation_levels: float, steps: int) -> float:
    """Standard uncertainty of the phase of one set: `sqrt(2 / N) s / B`.

    Parameters
    ----------
    noise_levels, modulation_levels
        Standard deviation of a frame's noise and modulation, in grey levels of the camera.
    steps
        Frames of the set.

    Raises
    ------
    PhaseError
        Fewer than three frames, or a number that is not above zero.

    Examples
    --------
    >>> round(phase_noise_rad(1.0, 50.0, 4), 5)
    0.01414
    """
    if steps < 3 or not (noise_levels > 0 and modulation_levels > 0):
        raise PhaseError(f"noise {noise_levels:g}, modulation {modulation_levels:g}, {steps} frames: three at least")
    return math.sqrt(2 / steps) * noise_levels / modulation_levels


def order_error_rate(periods_px: Sequence[float], range_px: float, noise_rad: float) -> float:
    """Probability, at most, that noise numbers a fringe of the shortest period wrongly within a range.

    Parameters
    ----------
    periods_px
        Of the set, in any order.
    range_px
        Length that is to be numbered.
    noise_rad
        Standard uncertainty of each phase.

    Notes
    -----
    A pixel's number n is the one whose longer phases, `2 pi n p_0 / p_k`, fit best. The phase of period k differs from
    what the shortest says of it by noise of `u_k = s sqrt(1 + (p_0 / p_k)^2)`. A number that is off by m lies
    `d_m = sqrt(sum_k (wrap(2 pi m p_0 / p_k) / u_k)^2)` away, and is taken with probability `erfc(d_m / sqrt 8) / 2`;
    the sum over all m that the range holds, to both sides, is the union bound.

    Raises
    ------
    PhaseError
        A period or noise that is not above zero, or more fringes than are counted.
    """
    periods = np.sort(np.asarray(periods_px, float))
    if not (periods.size and (periods > 0).all() and noise_rad > 0 and range_px > 0):
        raise PhaseError(f"periods {list(periods_px)}, range {range_px:g}, noise {noise_rad:g}: all must be above zero")
    count = math.ceil(range_px / periods[0] * _WHOLE_FRINGE)
    if count > _MOST_FRINGES:
        raise PhaseError(
            f"{count} fringes of {periods[0]:g} px in {range_px:g} px; {_MOST_FRINGES} at most are counted"
        )
    if count <= 1:
        return 0.0
    if periods.size == 1:
        return 1.0
    ratios = periods[0] / periods[1:]
    u = noise_rad * np.sqrt(1 + ratios**2)
    turns = np.outer(np.arange(1, count), ratios)
    apart = 2 * np.pi * np.abs(turns - np.rint(turns))
    distance = np.sqrt(((apart / u) ** 2).sum(axis=1))
    # Of numbers 0 to count - 1 a number off by m to one side exists for all but m of them.
    share = 1 - np.arange(1, count) / count
    return float(min(1.0, (2 * share * erfc(distance / math.sqrt(8)) / 2).sum()))


def choose_periods(
    range_px: float, shortest_px: int, noise_rad: float, *, steps: int = 4, most_periods: int = 4
) -> tuple[PeriodChoice, ...]:
    """Return choices of whole-pixel periods that number a range, fewest frames first, then the lowest error rate.

    Parameters
    ----------
    range_px
        Length to number: the projector's extent along the axis, or what a capture sees of it.
    shortest_px
        The period that measures.
    noise_rad
        Standard uncertainty of each phase.
    steps
        Frames of each set.
    most_periods
        How many periods at most.

    Raises
    ------
    PhaseError
        A number that is not above zero.
    """
    if not (shortest_px >= 3 and range_px >= shortest_px and most_periods >= 1):
        raise PhaseError(f"a period of {shortest_px} px in {range_px:g} px; 3 px at least, and within the range")
    found: list[PeriodChoice] = []
    for count in range(1, most_periods + 1):
        for how, periods in _candidates(range_px, shortest_px, count, noise_rad):
            rate = order_error_rate(periods, range_px, noise_rad)
            found.append(PeriodChoice(how, tuple(map(float, periods)), rate, count * steps))
    return tuple(sorted(found, key=lambda one: (one.frames, one.error_rate)))


def _candidates(range_px: float, shortest: int, count: int, noise_rad: float) -> Iterator[tuple[str, tuple[int, ...]]]:
    if count == 1:
        yield "one period", (shortest,)
        return
    yield "widening", _widening(range_px, shortest, count)
    beating = _beating(range_px, shortest, count, noise_rad)
    if beating:
        yield "beating", beating


def _widening(range_px: float, shortest: int, count: int) -> tuple[int, ...]:
    """Periods that widen by one factor, up to one that fills the range."""
    factor = (range_px / shortest) ** (1 / (count - 1))
    between = [math.ceil(shortest * factor**k - 1e-9) for k in range(1, count - 1)]
    return (shortest, *between, math.ceil(range_px))


def _beating(range_px: float, shortest: int, count: int, noise_rad: float) -> tuple[int, ...]:
    """Of periods near the shortest those that number the range with the lowest error rate; empty where none do."""
    further = range(shortest + 1, min(math.ceil(_WIDEST * shortest), shortest + _TRIED) + 1)
    if count > 3:  # the third and fourth are looked for beside the best three
        best = _beating(range_px, shortest, count - 1, noise_rad)
        sets = [(*best, one) for one in further if one not in best] if best else []
    else:
        sets = [(shortest, *rest) for rest in itertools.combinations(further, count - 1)]
    rates = [(order_error_rate(each, range_px, noise_rad), each) for each in sets]
    return min(rates, default=(1.0, ()))[1]
