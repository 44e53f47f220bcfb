"""Fringe orders from sets of several periods: every pixel decides for itself, and uncertain ones by their neighbours.

One rule holds the known ones: of all fringes that the shortest period may be in, the one is chosen at which all longer
periods agree best. With a longest fringe over the whole field that is hierarchical unwrapping, with two periods
close to one another it is the beat (heterodyne), with several of either kind it is both at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, wrap
from fringecal.phase.orders import order_kernels

NEAR_PLATE_RAD = 0.35
"""Most that a pixel of bare plate may be off the plate's phase, as a rig or a model counts it, rad.

Three standard deviations of a noise of 0.1 rad, with a little ripple. A surface that passes through the phase of the
plate does so over a ninth of a fringe; twice as far, over two ninths.
"""

LEAST_PLATE_PIXELS = 200
"""Pixels on the plate's phase that decide an order by it; fewer are a flank that passes through it."""

_MOST_FRINGES = 1024  # of a cycle: 1024 orders are tried at every pixel, and a projector shows no more fringes
# A cycle ends where the periods meet again: to within 0.25 rad, which noise hides, and so much closer than before.
_MEETS_TURNS, _CLOSER = 0.04, 0.5
_RATIO_TOLERANCE = 1e-4  # of a ratio of periods, within which two sets are of the same periods
_LEAD = 3  # times as many pixels as for any other number must agree on the plate's
_CHI2_MEDIAN = 0.455  # median of chi squared with one degree of freedom


@dataclass(frozen=True)
class OrderRules:
    """When longer periods decide the order of a fringe. Chi-squared is in squares of standard uncertainties.

    Parameters
    ----------
    clear
        Lead in chi-squared over the second best order from which a pixel decides by itself: the likelihood of the
        second is exp(-15 / 2) of the first's, 1 in 1800.
    most_chi_squared
        Chi-squared per further period up to which a pixel's best order is accepted: five standard uncertainties.
    wrong_periods
        Median chi-squared per further period from which the stated periods are refused; 1 where they are right, and
        twice the stated uncertainty makes 4.
    model_rad
        Standard uncertainty of each longer phase beside noise, rad: what is left of ripple when phase shifts and gamma
        are corrected (0.001 to 0.02 rad, docs/phase.md).
    most_model
        Share of the distance between two orders that further ripple, as the pictures show it, may add to the
        uncertainty; more, and the orders' own distance would be taken for ripple.
    seen
        Distance between two orders in standard uncertainties from which an offset of the longer fringe is looked for.
    least_agreement, least_offset
        An offset is believed from this length of the mean direction of the remainders (0 to 1), and this share of the
        distance between two orders; a smaller one is noise, and harmless.
    sample
        Pixels from which chi-squared are taken: their median is known to 1 %.
    """

    clear: float = 15.0
    most_chi_squared: float = 25.0
    wrong_periods: float = 4.0
    model_rad: float = 0.02
    most_model: float = 0.1
    seen: float = 6.0
    least_agreement: float = 0.5
    least_offset: float = 0.05
    sample: int = 40_000


ORDER_RULES = OrderRules()


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
    """

    phase: NDArray[np.float32]
    cycle: int
    ratios: tuple[float, ...]
    zeros_rad: tuple[float, ...]
    error_rate: float
    asked: float
    undecided: float

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
            f"{self.undecided:.2%} stay undecided"
        )


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


def cycle_of(ratios: ArrayLike) -> int:
    """Return after how many of the shortest fringes all periods meet again.

    Parameters
    ----------
    ratios
        Shortest period over each longer one, between 0 and 1.

    Notes
    -----
    Fringes are distinguished by the phases `2 pi ratio n` of the longer ones. The cycle is the first n at which
    these come back to within 0.04 of a turn, and twice as close as at any n before.

    Raises
    ------
    PhaseError
        Ratios that are not between 0 and 1, or no cycle within 1024 fringes.

    Examples
    --------
    >>> cycle_of([2 / 3]), cycle_of([1 / 8]), cycle_of([1 / 8, 1 / 64]), cycle_of([0.93])
    (3, 8, 64, 14)
    """
    shares = np.asarray(ratios, np.float64).ravel()
    if shares.size == 0 or not ((shares > 0) & (shares < 1)).all():
        raise PhaseError(f"ratios of periods are {shares.tolist()}; needed: shortest over longer, between 0 and 1")
    turns = np.outer(np.arange(1, _MOST_FRINGES + 1), shares)
    apart = np.abs(turns - np.rint(turns)).max(axis=1)
    closest = np.minimum.accumulate(np.concatenate([[np.inf], apart[:-1]]))
    closing = np.flatnonzero((apart < np.minimum(_CLOSER * closest, _MEETS_TURNS)) & np.isfinite(closest))
    if closing.size == 0:
        raise PhaseError(f"periods with ratios {shares.tolist()} do not meet again within {_MOST_FRINGES} fringes")
    return int(closing[0]) + 1


def decide_orders(
    phases: ArrayLike, sigmas: ArrayLike, periods: Sequence[float], *, rules: OrderRules = ORDER_RULES
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
    rules
        When an order is decided.

    Notes
    -----
    With `r_k = p / p_k`, and `u_k^2 = sigma_k^2 + r_k^2 sigma^2 + u_model^2`, the order is the n that makes
    `sum_k wrap(phi_k - r_k (phi + 2 pi n) - zero_k)^2 / u_k^2` least. Where it leads by less than 15, the sums over
    5 x 5 pixels decide. A pixel that has fewer than three neighbours within half a fringe stays undecided. With one
    longer period the share of errors is `erfc(pi r_k / (sqrt 2 u_k))` for r_k = 1/8, 1/9, ..., as of Huntley and
    Saldner's rule (`order_error_rate`).
    A zero that is not at the same place for all periods is found from the pictures, up to whole orders.

    Raises
    ------
    PhaseError
        Fewer than two periods, two that are equal, or periods that the pictures contradict.
    """
    maps, u_maps = np.asarray(phases, np.float32), np.asarray(sigmas, np.float32)
    lengths = np.asarray(periods, np.float64)
    _demand(maps, u_maps, lengths)
    fine = int(np.argmin(lengths))
    others = [k for k in range(len(lengths)) if k != fine]
    ratios = lengths[fine] / lengths[others]
    cycle = cycle_of(ratios)
    phi, sigma = maps[fine], u_maps[fine]
    long, u_long = np.ascontiguousarray(maps[others]), _combined(u_maps[others], sigma, ratios, rules)
    zeros = np.array([_zero(phi, *pair, rules) for pair in zip(long, u_long, ratios, strict=True)])
    u_long = _with_model(phi, long, u_long, ratios, zeros, cycle, lengths, rules)
    order, asked = order_kernels.orders(phi, long, u_long, ratios, zeros, cycle, rules.clear, rules.most_chi_squared)
    absolute = np.where(order >= 0, phi + np.float32(TURN) * order, np.float32(np.nan)).astype(np.float32)
    absolute[order_kernels.alone(absolute, TURN * cycle)] = np.nan
    known, valid = np.isfinite(absolute), np.isfinite(phi)
    count = max(int(valid.sum()), 1)
    return FringeOrders(
        phase=absolute,
        cycle=cycle,
        ratios=tuple(ratios.tolist()),
        zeros_rad=tuple(zeros.tolist()),
        error_rate=_error_rate(_sampled(phi, long, u_long, rules)[2], ratios, cycle),
        asked=float((asked & known).sum() / count),
        undecided=float((valid & ~known).sum() / count),
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


def _nearest(ratios: ArrayLike, cycle: int) -> float:
    """Return how far apart the closest two orders lie in the longer fringes' phases, rad."""
    turns = np.outer(np.arange(1, cycle), np.asarray(ratios))
    return float(TURN * np.abs(turns - np.rint(turns)).max(axis=1).min(initial=0.5))


def _with_model(  # noqa: PLR0913, PLR0917 -- private: the whole of what orders are decided from
    phi: NDArray,
    long: NDArray,
    u_long: NDArray,
    ratios: NDArray,
    zeros: NDArray,
    cycle: int,
    periods: NDArray,
    rules: OrderRules,
) -> NDArray[np.float32]:
    """Add to the uncertainties what the pictures show beyond noise, if it is small beside the orders' distance."""
    fine, coarse, u = _sampled(phi, long, u_long, rules)
    chi_squared = _own_chi_squared(fine, coarse, u, ratios, zeros, cycle)
    most = rules.most_model * _nearest(ratios, cycle)
    more = np.minimum(np.sqrt(max(chi_squared - 1, 0.0)) * np.median(u, axis=1), most)
    left = _own_chi_squared(fine, coarse, np.hypot(u, more[:, None]), ratios, zeros, cycle)
    if left > rules.wrong_periods:
        raise PhaseError(
            f"the pictures do not fit the stated periods {periods.tolist()}: the phases of the longer "
            f"fringes deviate by {np.sqrt(chi_squared):.1f} standard uncertainties from what the shortest predict. "
            "Check the order of periods and images."
        )
    return np.hypot(u_long, more[:, None, None]).astype(np.float32)


def _sampled(phi: NDArray, long: NDArray, u_long: NDArray, rules: OrderRules) -> tuple[NDArray, NDArray, NDArray]:
    """Return pixels that all periods know: phase (M,), longer phases and their u (K - 1, M)."""
    step = max(1, int(np.sqrt(phi.size / rules.sample)))
    known = np.isfinite(phi[::step, ::step]) & np.isfinite(long[:, ::step, ::step]).all(axis=0)
    if not known.any():
        raise PhaseError("no pixel carries fringes of all periods: check that the sets show the same scene")
    return phi[::step, ::step][known], long[:, ::step, ::step][:, known], u_long[:, ::step, ::step][:, known]


def _zero(phi: NDArray, long: NDArray, u_long: NDArray, ratio: float, rules: OrderRules) -> float:
    """Return the longer fringe's phase where the shortest one's is 0, as near to 0 as whole orders allow, rad."""
    near = _nearest([ratio], cycle_of([ratio]))
    fine, coarse, u = _sampled(phi, long[None], u_long[None], rules)
    if rules.seen * np.median(u) > near:
        return 0.0
    # Orders lie `near` apart, so that the remainder of it is the same for all of them.
    turned = np.mean(np.exp(1j * (coarse[0].astype(float) - ratio * fine) * TURN / near))
    offset = float(np.angle(turned) * near / TURN)
    return offset if abs(turned) > rules.least_agreement and abs(offset) > rules.least_offset * near else 0.0


def _own_chi_squared(fine: NDArray, long: NDArray, u: NDArray, ratios: NDArray, zeros: NDArray, cycle: int) -> float:
    """Return the mean chi-squared per further period of the best order, outliers left out."""
    best = np.full(fine.size, np.inf)
    for n in range(cycle):
        off = wrap(long - ratios[:, None] * (fine + TURN * n) - zeros[:, None])
        best = np.minimum(best, ((off / u) ** 2).sum(axis=0))
    return float(np.median(best) / _CHI2_MEDIAN / len(ratios))


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
