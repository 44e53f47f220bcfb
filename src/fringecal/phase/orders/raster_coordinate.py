"""From the phases of several periods to a coordinate of the projector's raster, the same for every capture of a rig."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, wrap
from fringecal.phase.orders.multi_period import FringeOrders, decide_orders
from fringecal.phase.orders.period_cycle import ORDER_RULES, cycle_of

_EDGE_PX = 1.0  # beyond the projector's first and last pixel that noise and blur may carry a coordinate
_MOSTLY, _HARDLY = 0.95, 0.5  # of the pixels that lie on the projector if the phase falls, and if it rises
_TORN = 1e-3  # of the neighbours in a picture that noise or an edge may put on either side of a seam
_NAMED_RAD = 0.05  # 3 deg: what ripple leaves of no offset, and of a quarter of a fringe
_SAME_RAD = 0.1  # that zeros of one constant may differ by: ripple, and the constant's own error
# On a projector's raster each pixel is numbered by itself; fringes of two or three camera pixels have no neighbours.
_RULES = replace(ORDER_RULES, most_alone=0.05)
_WHOLE = 1 + 1e-9  # fringes across the picture up to which one period numbers all of it: rounding


@dataclass(frozen=True)
class RasterCoordinate:
    """Which column (or row) of the projector lights each pixel of the camera.

    Parameters
    ----------
    px
        Coordinate along the axis, px of the projector, float64, (H, W), 0 at the centre of its first pixel; NaN where
        no order is decided.
    u_px
        Its random standard uncertainty, px, float32, (H, W).
    extent_px
        Pixels of the projector along the axis.
    cycle_px
        Length after which the periods meet again, px.
    zeros_rad
        Phase of each period at coordinate 0, rad, in the order of the periods: as stated, or as found.
    falls
        Whether the phase falls where the coordinate rises.
    orders
        How the orders were decided; None where one period alone numbers the whole picture, or where each pixel went
        from period to period by itself.
    """

    px: NDArray[np.float64]
    u_px: NDArray[np.float32]
    extent_px: float
    cycle_px: float
    zeros_rad: tuple[float, ...]
    falls: bool
    orders: FringeOrders | None = None

    def mirrored(self) -> "RasterCoordinate":
        """Return the coordinate counted the other way: what it is if the phase falls and was taken to rise."""
        return replace(self, px=_on_raster(-self.px, self.extent_px, self.cycle_px), falls=not self.falls)

    def within(self, mask: NDArray[np.bool_]) -> "RasterCoordinate":
        """Return the same where a mask is true, and nothing elsewhere."""
        return replace(self, px=np.where(mask, self.px, np.nan))

    @property
    def outside(self) -> float:
        """Share of the known pixels whose coordinate the projector does not have."""
        known = self.px[np.isfinite(self.px)]
        beyond = (known < -0.5 - _EDGE_PX) | (known > self.extent_px - 0.5 + _EDGE_PX)
        return float(beyond.mean()) if known.size else 0.0

    def sentence(self) -> str:
        """Say how the coordinate was found."""
        alone = "one period numbers the whole picture"
        if len(self.zeros_rad) > 1:
            alone = f"orders from period to period of {len(self.zeros_rad)}, each pixel by itself"
        how = alone if self.orders is None else self.orders.sentence()
        falls = "; the phase falls where the projector's pixels are counted up" if self.falls else ""
        return f"{how}; the periods meet again after {self.cycle_px:.4g} px of {self.extent_px:g}{falls}"


def raster_coordinate(
    phases: ArrayLike,
    sigmas: ArrayLike,
    periods_px: Sequence[float],
    extent_px: float,
    *,
    zeros_rad: Sequence[float] | None = None,
    falls: bool | None = None,
) -> RasterCoordinate:
    """Count projector pixels by the phases of one or several periods.

    Parameters
    ----------
    phases, sigmas
        Wrapped phases and their standard uncertainties, rad, (K, H, W); NaN where masked.
    periods_px
        Fringe periods, px of the projector, in the order of the maps.
    extent_px
        Pixels of the projector along the axis.
    zeros_rad
        Phase of each period at the first pixel, rad, where that is known; else 0 is tried, then a constant that all
        share, then one of each (`find_zeros`).
    falls
        Whether the phase falls along the axis; None leaves it to the pictures, which show it where the phase would
        else lie beyond the projector.

    Notes
    -----
    `phi_k = s 2 pi x / p_k + zeta_k`, s = 1, or -1 for a phase that falls. Zeros that are found are known up to whole
    fringes: give those of one capture to the others, and all count from one place.

    Raises
    ------
    PhaseError
        One period that repeats within the projector's picture, or periods that the pictures contradict.
    """
    periods, stated = np.asarray(periods_px, np.float64), _zeros(zeros_rad, len(periods_px))
    sign = -1.0 if falls else 1.0
    turned = wrap(sign * (np.asarray(phases, np.float64) - stated[:, None, None])).astype(np.float32)
    shortest = int(np.argmin(periods))
    u_px = (np.asarray(sigmas, np.float32)[shortest] * np.float32(periods[shortest] / TURN)).astype(np.float32)
    if len(periods) == 1:
        _demand_whole(periods[0], extent_px)
        px = _on_raster(turned[0] * (periods[0] / TURN), extent_px, periods[0])
        return RasterCoordinate(px, u_px, extent_px, float(periods[0]), tuple(stated.tolist()), bool(falls))
    projected = extent_px / periods[shortest]
    orders = decide_orders(turned, sigmas, periods.tolist(), projected=projected, rules=_RULES)
    px, own = _counted(orders, periods, shortest)
    whole_px = cycle_of(orders.ratios) * float(periods[shortest])
    zeros = tuple(wrap(stated + sign * own).tolist())
    found = RasterCoordinate(_on_raster(px, extent_px, whole_px), u_px, extent_px, whole_px, zeros, bool(falls), orders)
    if falls is None and _must_fall(px, extent_px, whole_px):
        return found.mirrored()
    return _settled(found, periods, shortest, sign) if zeros_rad is None and orders.offset_rad is not None else found


def raster_by_gray(
    orders: FringeOrders, sigma: ArrayLike, period_px: float, extent_px: float, *, zero_rad: float = 0.0
) -> RasterCoordinate:
    """Count projector pixels by fringes whose orders a Gray code gives (`orders_by_gray`)."""
    px = (orders.phase.astype(np.float64) - zero_rad) * (period_px / TURN)
    u_px = (np.asarray(sigma, np.float32) * np.float32(period_px / TURN)).astype(np.float32)
    return RasterCoordinate(px, u_px, extent_px, orders.cycle * period_px, (zero_rad,), False, orders)


def _zeros(zeros_rad: Sequence[float] | None, n_periods: int) -> NDArray[np.float64]:
    found = np.zeros(n_periods) if zeros_rad is None or not len(zeros_rad) else np.asarray(zeros_rad, np.float64)
    if found.shape != (n_periods,):
        raise PhaseError(f"{found.size} phase zeros for {n_periods} periods; state one for each")
    return found


def _demand_whole(period_px: float, extent_px: float) -> None:
    """Refuse a single period that the projector shows more than once."""
    if extent_px > period_px * _WHOLE:
        raise PhaseError(
            f"one period of {period_px:g} px repeats within the projector's {extent_px:g} px: which of its fringes a "
            "pixel shows stays open; add a longer period or a Gray code"
        )


def _on_raster(px: NDArray, extent_px: float, cycle_px: float) -> NDArray[np.float64]:
    """Put coordinates that are known up to cycles on the projector, or as near to its middle as they go."""
    middle = (extent_px - 1) / 2
    return middle + wrap(px - middle, cycle_px)


def _counted(orders: FringeOrders, periods: NDArray, shortest: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return coordinates counted from the projector's first pixel, and the phase of each period there, rad."""
    others = [k for k in range(len(periods)) if k != shortest]
    own = 0.0 if orders.offset_rad is None else orders.offset_rad
    starts = np.array([-1, 1 - orders.cycle] if orders.numbers_all else [0])
    if orders.offset_rad is None:  # zeros of their own: any whole number of fringes explains them as well
        starts = np.arange(orders.cycle)
    ratios, long = np.array(orders.ratios), np.array(orders.zeros_rad)
    zeros = wrap(long + ratios * (own - TURN * starts[:, None]))
    apart = np.abs(wrap(zeros - own)).max(axis=1)
    phase = orders.phase.astype(np.float64)
    k = int(np.argmin(apart))
    found = np.empty(len(periods))
    found[shortest], found[others] = own, zeros[k]
    return (phase + TURN * starts[k] - own) * (periods[shortest] / TURN), found


def _settled(found: RasterCoordinate, periods: NDArray, shortest: int, sign: float) -> RasterCoordinate:
    """Of all constants of the periods that explain their zeros alike, count by the one that a projector would have.

    Fringes of 0.9, 3.9 and 15.9 a picture are the same a picture further on, but for 36 deg of each. The pixels seen
    must be the projector's and hang together; then no constant goes before a quarter of a fringe (sines), and that
    before the least.
    """
    tried = [found, *_alike(found, periods, shortest, sign)]
    return min(tried, key=lambda one: (one.outside > 1 - _MOSTLY, _seam(one) > _TORN, *_strangeness(one, shortest)))


def _alike(found: RasterCoordinate, periods: NDArray, shortest: int, sign: float) -> Iterator[RasterCoordinate]:
    """Give the same coordinate counted by each constant that all zeros can have in common."""
    ratios, fringes = periods[shortest] / periods, round(found.cycle_px / periods[shortest])
    other = int(np.argmin(ratios))
    m = np.arange(-fringes, fringes + 1)
    zeros = sign * np.array(found.zeros_rad)
    start, zeros = zeros[shortest], zeros - zeros[shortest] * ratios
    constant = wrap(zeros[other] - TURN * m * ratios[other]) / (1 - ratios[other])
    left = np.abs(wrap(zeros - TURN * m[:, None] * ratios - (1 - ratios) * constant[:, None])).max(axis=1)
    for k in np.flatnonzero((left < _SAME_RAD) & (np.abs(constant) <= np.pi)):
        move = (TURN * m[k] + start - constant[k]) * (periods[shortest] / TURN)
        px = _on_raster(found.px + move, found.extent_px, found.cycle_px)
        yield replace(found, px=px, zeros_rad=tuple(np.full(len(periods), sign * constant[k]).tolist()))


def _seam(found: RasterCoordinate) -> float:
    """Return the share of neighbours along rows between which the coordinate jumps by half a cycle and more."""
    jumps = np.abs(np.diff(found.px, axis=1))
    known = np.isfinite(jumps)
    return float((jumps[known] > found.cycle_px / 2).mean()) if known.any() else 0.0


def _strangeness(found: RasterCoordinate, shortest: int) -> tuple[int, float]:
    """Rank a constant: none, a quarter of a fringe, any other by its size."""
    size = abs(found.zeros_rad[shortest])
    if size < _NAMED_RAD:
        return 0, size
    return (1, size) if abs(size - TURN / 4) < _NAMED_RAD else (2, size)


def _must_fall(px: NDArray, extent_px: float, cycle_px: float) -> bool:
    """Tell whether coordinates lie on the projector only if the phase is taken to fall."""
    known = px[np.isfinite(px)]
    rising, falling = (
        float(np.mean(np.abs(wrap(way * known - (extent_px - 1) / 2, cycle_px)) <= extent_px / 2 + _EDGE_PX))
        for way in (1, -1)
    )
    return rising < _HARDLY and falling > _MOSTLY
