"""Fringe orders from sets of several periods: every pixel decides for itself, and uncertain ones by their neighbours.

One rule holds the known ones: of all fringes that the shortest period may be in, the one is chosen at which all longer
periods agree best. With a longest fringe over the whole field that is hierarchical unwrapping, with two periods
close to one another it is the beat (heterodyne), with several of either kind it is both at once.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, wrap
from fringecal.phase.orders import order_kernels
from fringecal.phase.orders.period_cycle import ORDER_RULES, OrderRules, PeriodSample, cycle_of, nearest_orders
from fringecal.phase.orders.period_zeros import Zeros, find_zeros

NEAR_PLATE_RAD = 0.35
"""Most that a pixel of bare plate may be off the plate's phase, as a rig or a model counts it, rad.

Three standard deviations of a noise of 0.1 rad, with a little ripple. A surface that passes through the phase of the
plate does so over a ninth of a fringe; twice as far, over two ninths.
"""

LEAST_PLATE_PIXELS = 200
"""Pixels on the plate's phase that decide an order by it; fewer are a flank that passes through it."""

_RATIO_TOLERANCE = 1e-4  # of a ratio of periods, within which two sets are of the same periods
_BEYOND = 2  # orders beyond the stated number: a fringe is cut at either end
_NAMED_DEG = 3.0  # from which an offset is named: three times what noise and ripple leave of it
_LEAD = 3  # times as many pixels as for any other number must agree on the plate's


@dataclass(frozen=True)
class FringeOrders:
    """Phase of the shortest fringe, absolute within a cycle of fringes.

    Parameters
    ----------
    phase
        `phi + 2 pi n`, n = 0 ... cycle - 1, rad, float32, (H, W); NaN where no order is decided.
    cycle
        Fringes after which the periods meet again: orders are known up to multiples of it.
    ratios
        Shortest period over each longer one; empty for a Gray code.
    zeros_rad
        Phase of each longer fringe where the shortest one's is 0, rad.
    error_rate
        Predicted share of pixels whose order noise makes wrong, as long as each pixel decides for itself.
    asked
        Share of the pixels that carry a phase whose order their neighbours decided.
    undecided
        Share of the pixels that carry a phase whose order is open.
    offset_rad
        Constant that the phases of all periods share, rad: -pi / 2 for sines; None where the zeros are others.
    numbers_all
        True if `phase` numbers every fringe that is projected: nothing comes back after a cycle.
    """

    phase: NDArray[np.float32]
    cycle: int
    ratios: tuple[float, ...]
    zeros_rad: tuple[float, ...]
    error_rate: float
    asked: float
    undecided: float
    offset_rad: float | None = 0.0
    numbers_all: bool = False

    def of(self, phase: ArrayLike) -> "FringeOrders":
        """Return the same orders for another wrapped phase of the same scene, such as a filtered one, rad, (H, W)."""
        wrapped = np.asarray(phase, np.float32)
        turns = np.rint((self.phase - wrapped) / np.float32(TURN))
        return replace(self, phase=(wrapped + np.float32(TURN) * turns).astype(np.float32))

    def sentence(self) -> str:
        """Say how orders were decided, and how surely."""
        if not self.ratios:
            return (
                f"orders by Gray code of {self.cycle} fringes; beside its edges {self.asked:.2%} of the pixels were "
                f"decided with their neighbours; {self.undecided:.2%} stay undecided"
            )
        share = "less than 1e-9" if self.error_rate < 1e-9 else f"{self.error_rate:.2g}"
        return (
            f"orders by {len(self.ratios) + 1} periods, known within {self.cycle} fringes; noise would make "
            f"{share} of them wrong, so {self.asked:.2%} of the pixels were decided with their neighbours; "
            f"{self.undecided:.2%} stay undecided{self._offset()}"
        )

    def _offset(self) -> str:
        """Say what constant was found, if it is more than what noise may make."""
        degrees = 0.0 if self.offset_rad is None else float(np.rad2deg(self.offset_rad))
        if abs(degrees) < _NAMED_DEG:
            return ""
        quarter = abs(abs(degrees) - 90) < _NAMED_DEG  # noqa: PLR2004 -- a quarter of a fringe
        named = "; the fringes are sines, not cosines: " if quarter else "; "
        return f"{named}all periods' phases are offset by {degrees:.0f} deg, which is allowed for"


@dataclass(frozen=True)
class PlateOrders:
    """How a rig counts the fringes that further periods number: what makes orders of later captures absolute.

    Parameters
    ----------
    cycle, ratios, zeros_rad
        As of the plate's `FringeOrders`.
    number
        Fringes to be added to these orders, up to the cycle, to count as the rig does.
    """

    cycle: int
    ratios: tuple[float, ...]
    zeros_rad: tuple[float, ...]
    number: int

    @classmethod
    def of(cls, orders: FringeOrders, plate_rad: ArrayLike) -> "PlateOrders | None":
        """Compare orders with the plate's phase as the rig counts it, rad, (H, W); None where they do not agree."""
        number = plate_number(orders, plate_rad)
        return None if number is None else cls(orders.cycle, orders.ratios, orders.zeros_rad, number)

    def number_for(self, orders: FringeOrders) -> int | None:
        """Return the fringes to be added to a capture's orders; None if its periods are others."""
        if (orders.cycle, len(orders.ratios)) != (self.cycle, len(self.ratios)):
            return None
        if not np.allclose(orders.ratios, self.ratios, rtol=_RATIO_TOLERANCE):
            return None
        if not self.ratios:
            return self.number
        # Zeros are found up to whole orders: the same set may be numbered from another fringe.
        turns = np.outer(np.arange(self.cycle), self.ratios)
        turns -= (np.array(orders.zeros_rad) - self.zeros_rad) / TURN
        return int(self.number + np.argmin(np.abs(turns - np.rint(turns)).max(axis=1))) % self.cycle


def plate_number(orders: FringeOrders, plate_rad: ArrayLike) -> int | None:
    """Return the fringes to be added to orders so that most of what lies on the plate has the plate's phase.

    Parameters
    ----------
    orders
        Orders of a capture that shows plate.
    plate_rad
        The plate's phase as the rig counts it, rad, (H, W); NaN where it is not known.

    Returns
    -------
    int or None
        None unless 200 pixels or more agree, and three times as many as on any other.
    """
    turns = (np.asarray(plate_rad) - orders.phase) / TURN
    near = np.rint(turns)
    on_plate = np.abs(turns - near) < NEAR_PLATE_RAD / TURN  # false where either is missing
    votes = np.bincount(near[on_plate].astype(np.int64) % orders.cycle, minlength=2)
    first, second = np.sort(votes)[::-1][:2]
    return int(votes.argmax()) if first >= max(LEAST_PLATE_PIXELS, _LEAD * second) else None


def decide_orders(
    phases: ArrayLike,
    sigmas: ArrayLike,
    periods: Sequence[float],
    *,
    projected: float | None = None,
    rules: OrderRules = ORDER_RULES,
) -> FringeOrders:
    """Decide the order of the shortest fringe at each pixel from the longer ones.

    Parameters
    ----------
    phases
        Wrapped phases, one map for each period, rad, (K, H, W), K >= 2; NaN where masked.
    sigmas
        Their standard uncertainties, rad, (K, H, W).
    periods
        Fringe periods in any one unit, in the order of the maps; all fringes rise the same way.
    projected
        Fringes of the shortest period in the whole projected picture, where that is known: no more orders are tried.
    rules
        When an order is decided.

    Notes
    -----
    With `r_k = p / p_k`, and `u_k^2 = sigma_k^2 + r_k^2 sigma^2 + u_model^2`, the order is the n that makes
    `sum_k wrap(phi_k - r_k (phi + 2 pi n) - zero_k)^2 / u_k^2` least. Where it leads by less than 15, the sums over
    5 x 5 pixels decide. A pixel that has fewer than three neighbours within half a fringe stays undecided. With one
    longer period the share of errors is `erfc(pi r_k / (sqrt 2 u_k))` for r_k = 1/8, 1/9, ..., as of Huntley and
    Saldner's rule (`order_error_rate`).
    Zeros that are not at the same place for all periods are found from the pictures, up to whole orders
    (`find_zeros`): a constant that all phases share, as where sines are taken for cosines, or each its own.

    Raises
    ------
    PhaseError
        Fewer than two periods, two that are equal, or periods that the pictures contradict; a reading of the periods
        that the pictures do not contradict is named.

    Examples
    --------
    >>> u = np.tile(np.arange(100.0), (5, 1))  # fringes of 10 and 11 px meet again after 110 px
    >>> phases = np.angle(np.exp(2j * np.pi * np.stack([u / 10, u / 11])))
    >>> found = decide_orders(phases, np.full(phases.shape, 0.01), (10, 11))
    >>> found.cycle, bool(np.abs(found.phase - 2 * np.pi * u / 10).max() < 1e-3)
    (11, True)
    """
    maps, u_maps = np.asarray(phases, np.float32), np.asarray(sigmas, np.float32)
    lengths = np.asarray(periods, np.float64)
    _demand(maps, u_maps, lengths)
    read = _read(maps, u_maps, lengths, projected, rules)
    if read.left > rules.wrong_periods:
        raise PhaseError(_refusal(read, maps, u_maps, lengths, rules))
    phi, cycle, zeros, ratios = read.phi, read.cycle, read.zeros.rad, read.ratios
    u_long = np.hypot(read.u_long, read.more[:, None, None]).astype(np.float32)
    order, asked = order_kernels.orders(
        phi, read.long, u_long, ratios, zeros, cycle, rules.clear, rules.most_chi_squared
    )
    absolute = np.where(order >= 0, phi + np.float32(TURN) * order, np.float32(np.nan)).astype(np.float32)
    alone, valid = order_kernels.alone(absolute, TURN * cycle), np.isfinite(phi)
    count = max(int(valid.sum()), 1)
    if (alone & valid).sum() <= rules.most_alone * count:
        absolute[alone] = np.nan
    known = np.isfinite(absolute)
    return FringeOrders(
        phase=absolute,
        cycle=cycle,
        ratios=tuple(ratios.tolist()),
        zeros_rad=tuple(zeros.tolist()),
        error_rate=_error_rate(PeriodSample.of(phi, read.long, u_long, ratios, rules.sample).u, ratios, cycle),
        asked=float((asked & known).sum() / count),
        undecided=float((valid & ~known).sum() / count),
        offset_rad=read.zeros.offset_rad,
        numbers_all=read.numbers_all,
    )


def _demand(maps: NDArray, u_maps: NDArray, periods: NDArray) -> None:
    """Refuse what does not fit together."""
    if maps.ndim != 3 or maps.shape != u_maps.shape or len(maps) != periods.size or periods.size < 2:
        raise PhaseError(
            f"found phases of shape {maps.shape}, sigmas {u_maps.shape} and {periods.size} periods; needed: one map "
            "of each for each of two periods or more"
        )
    if not (periods > 0).all() or np.unique(periods).size < periods.size:
        raise PhaseError(f"found periods {periods.tolist()}; needed: positive and all different")


def _combined(u_maps: NDArray, sigma: NDArray, ratios: NDArray, rules: OrderRules) -> NDArray[np.float32]:
    """Return the uncertainty of each longer phase against what the shortest says of it, (K - 1, H, W)."""
    rows = [np.sqrt(d**2 + (r * sigma) ** 2 + rules.model_rad**2) for d, r in zip(u_maps, ratios, strict=True)]
    return np.asarray(rows, np.float32)


@dataclass(frozen=True)
class _Reading:
    """Phases as one reading of the periods puts them, the zeros found, and chi-squared before and after `more`."""

    phi: NDArray[np.float32]
    long: NDArray[np.float32]
    u_long: NDArray[np.float32]
    ratios: NDArray[np.float64]
    cycle: int
    numbers_all: bool
    zeros: Zeros
    more: NDArray[np.float64]
    left: float


def _read(maps: NDArray, u_maps: NDArray, periods: NDArray, projected: float | None, rules: OrderRules) -> _Reading:
    """Find zeros, and what the pictures show beyond noise, if it is small beside the orders' distance."""
    fine = int(np.argmin(periods))
    others = [k for k in range(len(periods)) if k != fine]
    ratios = periods[fine] / periods[others]
    whole = cycle_of(ratios)
    cycle = whole if projected is None else min(whole, int(np.ceil(projected)) + _BEYOND)
    phi, long = maps[fine], np.ascontiguousarray(maps[others])
    u_long = _combined(u_maps[others], u_maps[fine], ratios, rules)
    sample = PeriodSample.of(phi, long, u_long, ratios, rules.sample)
    hidden = sample.hides(cycle, rules)
    zeros = find_zeros(PeriodSample.around(phi, long, u_long, ratios, rules) if hidden else sample, cycle, whole, rules)
    if hidden:
        zeros = replace(zeros, chi_squared=sample.chi_squared(zeros.rad, cycle))
    most = rules.most_model * nearest_orders(ratios, cycle)
    more = np.minimum(np.sqrt(max(zeros.chi_squared - 1, 0.0)) * np.median(sample.u, axis=1), most)
    left = sample.with_u(more).chi_squared(zeros.rad, cycle)
    return _Reading(phi, long, u_long, ratios, cycle, cycle < whole, zeros, more, left)


def _refusal(read: _Reading, maps: NDArray, u_maps: NDArray, periods: NDArray, rules: OrderRules) -> str:
    """Say that the pictures contradict the periods, and which other reading of these they do not contradict."""
    fits = [words for words, other in _other_readings(periods) if _fits(maps, u_maps, other, rules)]
    advice = f"They fit {' or '.join(fits)}." if fits else "Check the order of periods and images."
    return (
        f"the pictures do not fit the stated periods {periods.tolist()}: the phases of the longer fringes deviate by "
        f"{np.sqrt(read.zeros.chi_squared):.1f} standard uncertainties from what the shortest predict. {advice}"
    )


def _other_readings(periods: NDArray) -> Iterator[tuple[str, NDArray]]:
    """Give what else a list of periods may mean, in words and as periods."""
    counts = ", ".join(f"{count:g}" for count in periods)
    yield f"if the numbers are fringes in the picture and not lengths (--counts {counts})", 1 / periods
    yield "if the sets stand in the reversed order", periods[::-1]


def _fits(maps: NDArray, u_maps: NDArray, periods: NDArray, rules: OrderRules) -> bool:
    """Tell whether the pictures fit a reading of the periods as well as those of the right one do."""
    return _read(maps, u_maps, periods, None, rules).left <= rules.wrong_periods


def _error_rate(u: NDArray, ratios: NDArray, cycle: int) -> float:
    """Return the mean probability that another order fits better: the sum over the orders that lie next."""
    codes = wrap(TURN * np.outer(np.arange(cycle), ratios))
    typical = np.median(u, axis=1)
    rate = np.zeros(u.shape[1])
    for other in codes[1:]:
        between = wrap(codes - other / 2)
        distance = ((between / typical) ** 2).sum(axis=1)
        if distance.min() > (1 - 1e-6) * ((other / 2 / typical) ** 2).sum():  # but for rounding, nothing lies between
            half = np.sqrt(((other[:, None] / 2 / u) ** 2).sum(axis=0))
            rate += special.erfc(half / np.sqrt(2)) / 2
    return float(min(rate.mean(), 1.0))
