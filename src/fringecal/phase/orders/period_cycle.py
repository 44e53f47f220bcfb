"""After how many fringes several periods meet again, and how far apart the fringes in between are for them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, wrap

_MOST_FRINGES = 1024  # of a cycle: 1024 orders are tried at every pixel, and a projector shows no more fringes
# A cycle ends where the periods meet again: to within 0.25 rad, which noise hides, and so much closer than before.
_MEETS_TURNS, _CLOSER = 0.04, 0.5
_PER_MEAN = 5  # px of the sides of the square that a mean is taken over: a fifth of the noise
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
    most_alone
        Share of the pixels without neighbours within half a fringe up to which these count as wrong. Where more are,
        fringes are too narrow in the picture for neighbours to say anything, and all stay; at 1 they never do.
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
    most_alone: float = 1.0


ORDER_RULES = OrderRules()


def cycle_of(ratios: ArrayLike) -> int:
    """Return after how many of the shortest fringes all periods meet again.

    Parameters
    ----------
    ratios
        Shortest period over each longer one, between 0 and 1.

    Notes
    -----
    Fringes are distinguished by the phases `2 pi ratio n` of the longer ones. The cycle is the first n at which
    these come back to within 0.04 of a turn, and twice as close as at any n before; 1024 where they do not.

    Raises
    ------
    PhaseError
        Ratios that are not between 0 and 1.

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
    return int(closing[0]) + 1 if closing.size else _MOST_FRINGES


def nearest_orders(ratios: ArrayLike, cycle: int) -> float:
    """Return how far apart the closest two orders lie in the longer fringes' phases, rad."""
    turns = np.outer(np.arange(1, cycle), np.asarray(ratios))
    return float(TURN * np.abs(turns - np.rint(turns)).max(axis=1).min(initial=0.5))


@dataclass(frozen=True)
class PeriodSample:
    """Pixels that all periods know.

    Parameters
    ----------
    fine
        Phase of the shortest fringe, rad, (M,).
    coarse, u
        Phases of the longer fringes and their u against what the shortest says of them, rad, (K - 1, M).
    ratios
        Shortest period over each longer one, (K - 1,).
    """

    fine: NDArray[np.float64]
    coarse: NDArray[np.float64]
    u: NDArray[np.float64]
    ratios: NDArray[np.float64]

    @classmethod
    def of(cls, phi: NDArray, long: NDArray, u_long: NDArray, ratios: NDArray, pixels: int) -> "PeriodSample":
        """Take some of the pixels of the maps, (H, W) and (K - 1, H, W).

        Raises
        ------
        PhaseError
            No pixel carries fringes of all periods.
        """
        step = max(1, int(np.sqrt(phi.size / pixels)))
        known = np.isfinite(phi[::step, ::step]) & np.isfinite(long[:, ::step, ::step]).all(axis=0)
        if not known.any():
            raise PhaseError("no pixel carries fringes of all periods: check that the sets show the same scene")
        parts = (phi[::step, ::step][known], long[:, ::step, ::step][:, known], u_long[:, ::step, ::step][:, known])
        fine, coarse, u = (part.astype(np.float64) for part in parts)
        return cls(fine, coarse, u, ratios)

    @classmethod
    def around(cls, phi: NDArray, long: NDArray, u_long: NDArray, ratios: NDArray, rules: OrderRules) -> "PeriodSample":
        """Take means over 5 x 5 pixels at some places, where noise hides at single pixels what lies between orders."""
        places = _places(np.isfinite(phi) & np.isfinite(long).all(axis=0), rules.sample // _PER_MEAN**2)
        rows, columns = (_around(axis[:, None, None], size) for axis, size in zip(places.T, phi.shape, strict=True))
        near = phi[rows, columns.transpose(0, 2, 1)].astype(np.float64).reshape(len(places), -1)
        fine = phi[tuple(places.T)].astype(np.float64)
        rise = wrap(near - fine[:, None])
        turned = np.exp(1j * (long[:, rows, columns.transpose(0, 2, 1)].reshape(len(ratios), *near.shape)))
        turned *= np.exp(-1j * ratios[:, None, None] * rise)
        count = np.isfinite(rise).sum(axis=1)
        mean = np.nansum(rise, axis=1) / count
        coarse = np.angle(np.nansum(turned, axis=2)) + ratios[:, None] * mean
        noise2 = np.maximum(u_long[:, places[:, 0], places[:, 1]].astype(np.float64) ** 2 - rules.model_rad**2, 0)
        return cls(fine + mean, coarse, np.sqrt(noise2 / count + rules.model_rad**2), ratios)

    def thinned(self, most: int) -> "PeriodSample":
        """Return at most so many of the pixels."""
        step = -(-self.fine.size // most)
        return PeriodSample(self.fine[::step], self.coarse[:, ::step], self.u[:, ::step], self.ratios)

    def with_u(self, more: NDArray) -> "PeriodSample":
        """Return the same with a further uncertainty of each longer phase, rad, (K - 1,)."""
        return PeriodSample(self.fine, self.coarse, np.hypot(self.u, more[:, None]), self.ratios)

    def hides(self, cycle: int, rules: OrderRules) -> bool:
        """Tell whether the noise of a pixel hides what lies between two orders."""
        return rules.seen * float(np.median(self.u)) > nearest_orders(self.ratios, cycle)

    def best(self, zeros: NDArray, cycle: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the least chi-squared of each pixel over all orders of the cycle, and the order, (M,)."""
        least, order = np.full(self.fine.size, np.inf), np.zeros(self.fine.size, np.int64)
        for n in range(cycle):
            off = wrap(self.coarse - self.ratios[:, None] * (self.fine + TURN * n) - zeros[:, None])
            here = ((off / self.u) ** 2).sum(axis=0)
            order[here < least] = n
            least = np.minimum(least, here)
        return least, order

    def chi_squared(self, zeros: NDArray, cycle: int) -> float:
        """Return the median chi-squared per further period of the best order, 1 where noise alone is left."""
        return float(np.median(self.best(zeros, cycle)[0]) / _CHI2_MEDIAN / len(self.ratios))


def _places(known: NDArray[np.bool_], most: int) -> NDArray[np.int64]:
    """Return some of the pixels (row, column) that are known, evenly, (M, 2)."""
    places = np.argwhere(known)
    return places[:: -(-len(places) // most)]


def _around(centre: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """Return the coordinates of neighbours along one axis, held within the picture, (M, 5, 1)."""
    return np.clip(centre + np.arange(-(_PER_MEAN // 2), _PER_MEAN // 2 + 1)[:, None], 0, size - 1)
