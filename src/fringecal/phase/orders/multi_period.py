"""Fringe orders from sets of several periods: every pixel decides for itself, and doubtful ones ask their neighbours.

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
from fringecal.numerics import TURN
from fringecal.phase.orders import order_kernels

_MOST_FRINGES = 1024
_CLOSES, _MEETS = 0.5, 0.04  # a cycle ends where periods meet again: closer by this factor than before, in turns
_CLEAR = 15.0  # lead in misfit: the second best order is right once in 10 000
_MOST_MISFIT = 25.0
_WRONG_PERIODS = 4.0  # mean misfit per further period; 1 where they are right
_MODEL_RAD = 0.02  # what is left of ripple when steps and gamma are undone
_MOST_MODEL = 0.1  # of the distance between two orders
_SEEN = 6.0  # standard uncertainties between two orders, for a zero to be found
_SAMPLE = 40_000
_NEAR_PLATE = 0.35  # rad; a plate pixel's phase differs from the rig's by noise and ripple only
_LEAST_VOTES, _LEAD = 200, 3


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
                f"orders by Gray code of {self.cycle} fringes; beside its edges {self.asked:.2%} of the pixels asked "
                f"their neighbours; {self.undecided:.2%} stay undecided"
            )
        share = "less than 1e-9" if self.error_rate < 1e-9 else f"{self.error_rate:.2g}"
        return (
            f"orders by {len(self.ratios) + 1} periods, known within {self.cycle} fringes; noise would make "
            f"{share} of them wrong, so {self.asked:.2%} of the pixels asked their neighbours; "
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
        if not np.allclose(orders.ratios, self.ratios, rtol=1e-4):
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
        None unless 200 pixels or more are of one mind, and three times as many as of any other.
    """
    turns = (np.asarray(plate_rad) - orders.phase) / TURN
    near = np.rint(turns)
    on_plate = np.abs(turns - near) < _NEAR_PLATE / TURN  # false where either is missing
    votes = np.bincount(near[on_plate].astype(np.int64) % orders.cycle, minlength=2)
    first, second = np.sort(votes)[::-1][:2]
    return int(votes.argmax()) if first >= max(_LEAST_VOTES, _LEAD * second) else None


def cycle_of(ratios: ArrayLike) -> int:
    """Return after how many of the shortest fringes all periods meet again.

    Parameters
    ----------
    ratios
        Shortest period over each longer one, between 0 and 1.

    Notes
    -----
    Fringes are told apart by the phases `2 pi ratio n` of the longer ones. The cycle is the first n at which
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
    closing = np.flatnonzero((apart < np.minimum(_CLOSES * closest, _MEETS)) & np.isfinite(closest))
    if closing.size == 0:
        raise PhaseError(f"periods with ratios {shares.tolist()} do not meet again within {_MOST_FRINGES} fringes")
    return int(closing[0]) + 1


def decide_orders(phases: ArrayLike, sigmas: ArrayLike, periods: Sequence[float]) -> FringeOrders:
    """Decide the order of the shortest fringe at each pixel from the longer ones.

    Parameters
    ----------
    phases
        Wrapped phases, one map for each period, rad, (K, H, W), K >= 2; NaN where masked.
    sigmas
        Their standard uncertainties, rad, (K, H, W).
    periods
        Fringe periods in any one unit, in the order of the maps; all fringes rise the same way.

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
    maps, doubts = np.asarray(phases, np.float32), np.asarray(sigmas, np.float32)
    lengths = np.asarray(periods, np.float64)
    _demand(maps, doubts, lengths)
    fine = int(np.argmin(lengths))
    others = [k for k in range(len(lengths)) if k != fine]
    ratios = lengths[fine] / lengths[others]
    cycle = cycle_of(ratios)
    phi, sigma = maps[fine], doubts[fine]
    long, u_long = np.ascontiguousarray(maps[others]), _combined(doubts[others], sigma, ratios)
    zeros = np.array([_zero(phi, *pair) for pair in zip(long, u_long, ratios, strict=True)])
    u_long = _with_model(phi, long, u_long, ratios, zeros, cycle, lengths)
    order, asked = order_kernels.orders(phi, long, u_long, ratios, zeros, cycle, _CLEAR, _MOST_MISFIT)
    absolute = np.where(order >= 0, phi + np.float32(TURN) * order, np.float32(np.nan)).astype(np.float32)
    absolute[order_kernels.alone(absolute, TURN * cycle)] = np.nan
    known, valid = np.isfinite(absolute), np.isfinite(phi)
    count = max(int(valid.sum()), 1)
    return FringeOrders(
        phase=absolute,
        cycle=cycle,
        ratios=tuple(ratios.tolist()),
        zeros_rad=tuple(zeros.tolist()),
        error_rate=_error_rate(_sampled(phi, long, u_long)[2], ratios, cycle),
        asked=float((asked & known).sum() / count),
        undecided=float((valid & ~known).sum() / count),
    )


def _demand(maps: NDArray, doubts: NDArray, periods: NDArray) -> None:
    """Refuse what does not fit together."""
    if maps.ndim != 3 or maps.shape != doubts.shape or len(maps) != periods.size or periods.size < 2:
        raise PhaseError(
            f"found phases of shape {maps.shape}, sigmas {doubts.shape} and {periods.size} periods; needed: one map "
            "of each for each of two periods or more"
        )
    if not (periods > 0).all() or np.unique(periods).size < periods.size:
        raise PhaseError(f"found periods {periods.tolist()}; needed: positive and all different")


def _combined(doubts: NDArray, sigma: NDArray, ratios: NDArray) -> NDArray[np.float32]:
    """Return the uncertainty of each longer phase against what the shortest says of it, (K - 1, H, W)."""
    rows = [np.sqrt(d**2 + (r * sigma) ** 2 + _MODEL_RAD**2) for d, r in zip(doubts, ratios, strict=True)]
    return np.asarray(rows, np.float32)


def _nearest(ratios: ArrayLike, cycle: int) -> float:
    """Return how far apart the closest two orders lie in the longer fringes' phases, rad."""
    turns = np.outer(np.arange(1, cycle), np.asarray(ratios))
    return float(TURN * np.abs(turns - np.rint(turns)).max(axis=1).min(initial=0.5))


def _with_model(  # noqa: PLR0913, PLR0917 -- private: the whole of what orders are decided from
    phi: NDArray, long: NDArray, u_long: NDArray, ratios: NDArray, zeros: NDArray, cycle: int, periods: NDArray
) -> NDArray[np.float32]:
    """Add to the uncertainties what the pictures show beyond noise, if it is small beside the orders' distance."""
    fine, coarse, u = _sampled(phi, long, u_long)
    misfit = _own_misfit(fine, coarse, u, ratios, zeros, cycle)
    most = _MOST_MODEL * _nearest(ratios, cycle)
    more = np.minimum(np.sqrt(max(misfit - 1, 0.0)) * np.median(u, axis=1), most)
    left = _own_misfit(fine, coarse, np.hypot(u, more[:, None]), ratios, zeros, cycle)
    if left > _WRONG_PERIODS:
        raise PhaseError(
            f"the pictures do not fit the stated periods {periods.tolist()}: the longer fringes lie beside where the "
            f"shortest put them by {np.sqrt(misfit):.1f} standard uncertainties. Check the order of periods and images."
        )
    return np.hypot(u_long, more[:, None, None]).astype(np.float32)


def _sampled(phi: NDArray, long: NDArray, u_long: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return pixels that all periods know: phase (M,), longer phases and their u (K - 1, M)."""
    step = max(1, int(np.sqrt(phi.size / _SAMPLE)))
    known = np.isfinite(phi[::step, ::step]) & np.isfinite(long[:, ::step, ::step]).all(axis=0)
    if not known.any():
        raise PhaseError("no pixel carries fringes of all periods: check that the sets show the same scene")
    return phi[::step, ::step][known], long[:, ::step, ::step][:, known], u_long[:, ::step, ::step][:, known]


def _zero(phi: NDArray, long: NDArray, u_long: NDArray, ratio: float) -> float:
    """Return the longer fringe's phase where the shortest one's is 0, as near to 0 as whole orders allow, rad."""
    near = _nearest([ratio], cycle_of([ratio]))
    fine, coarse, u = _sampled(phi, long[None], u_long[None])
    if _SEEN * np.median(u) > near:
        return 0.0
    # Orders lie `near` apart, so that the remainder of it is the same for all of them.
    turned = np.mean(np.exp(1j * (coarse[0].astype(float) - ratio * fine) * TURN / near))
    offset = float(np.angle(turned) * near / TURN)
    return offset if abs(turned) > 0.5 and abs(offset) > near / 20 else 0.0


def _own_misfit(fine: NDArray, long: NDArray, u: NDArray, ratios: NDArray, zeros: NDArray, cycle: int) -> float:
    """Return the mean misfit per further period of the best order, outliers left out."""
    best = np.full(fine.size, np.inf)
    for n in range(cycle):
        off = long - ratios[:, None] * (fine + TURN * n) - zeros[:, None]
        off -= TURN * np.rint(off / TURN)
        best = np.minimum(best, ((off / u) ** 2).sum(axis=0))
    return float(np.median(best) / 0.455 / len(ratios))  # median of chi squared with one degree of freedom


def _error_rate(u: NDArray, ratios: NDArray, cycle: int) -> float:
    """Return the mean probability that another order fits better: the sum over the orders that lie next."""
    codes = TURN * np.outer(np.arange(cycle), ratios)
    codes -= TURN * np.rint(codes / TURN)
    typical = np.median(u, axis=1)
    rate = np.zeros(u.shape[1])
    for other in codes[1:]:
        between = codes - other / 2
        between -= TURN * np.rint(between / TURN)
        distance = ((between / typical) ** 2).sum(axis=1)
        if distance.min() > (1 - 1e-6) * ((other / 2 / typical) ** 2).sum():  # nothing lies between
            half = np.sqrt(((other[:, None] / 2 / u) ** 2).sum(axis=0))
            rate += special.erfc(half / np.sqrt(2)) / 2
    return float(min(rate.mean(), 1.0))
