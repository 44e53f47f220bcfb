"""From orders that are known within a cycle of fringes to one phase over the whole picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, robust_sd, wrap
from fringecal.phase.orders.multi_period import FringeOrders
from fringecal.phase.orders.order_kernels import hang_together
from fringecal.phase.unwrapping.spatial import Unwrapped

_WRONG_SHARE = 1e-4  # of the largest piece, at either end of its range, that may be wrong orders and does not count


@dataclass(frozen=True)
class EdgeRules:
    """Where a surface ends, for what is connected to be counted.

    Parameters
    ----------
    continues_rad
        Most that neighbours on one surface differ by, rad: of half a turn, 1.1 rad is left to noise.
    curvature_rad, curvature_sigmas
        Second difference from which a pixel is an edge: the larger of a tenth of a fringe and so many robust standard
        deviations of the picture's own. Below, noise would cut a surface; above, a step of a tenth of a fringe would
        pass for a slope.
    rough_share
        Share of a pixel's 3 x 3 neighbourhood that must be edge: three of nine, which a line through it is and a
        single outlier is not.
    beside, beside_px
        How far pieces keep off edges, so that a gap in an edge is not passed: share of the picture's shorter side, and
        least, px.
    """

    continues_rad: float = 2.0
    curvature_rad: float = 0.6
    curvature_sigmas: float = 6.0
    rough_share: float = 0.3
    beside: float = 0.01
    beside_px: int = 2


EDGE_RULES = EdgeRules()


@dataclass(frozen=True)
class AbsolutePhase:
    """A phase of one count over the whole picture.

    Parameters
    ----------
    phase
        Absolute phase of the shortest fringe, rad, float64, (H, W); NaN where masked or undecided.
    fringes
        Fringes from the least to the largest.
    in_one_cycle
        True if the picture holds no more fringes than the periods distinguish: every pixel then stands for itself.
        If not, only what is connected with the largest piece is counted.
    undecided
        Share of the pixels with an order whose cycle is open.
    """

    phase: NDArray[np.float64]
    fringes: float
    in_one_cycle: bool
    undecided: float

    def sentence(self) -> str:
        """Say which parts of the picture are counted together."""
        if self.in_one_cycle:
            return f"{self.fringes:.1f} fringes in the picture, within one cycle: every pixel is decided by itself"
        return (
            f"{self.fringes:.1f} fringes in the picture, more than one cycle: {self.undecided:.2%} of the pixels "
            "are not connected with the largest piece and stay undecided by whole cycles; add a longer period"
        )


def pieces_in_cycles(phase: NDArray[np.floating], cycle: int, *, edges: EdgeRules = EDGE_RULES) -> Unwrapped:
    """Return the pieces that are connected, each without jumps of whole cycles.

    Parameters
    ----------
    phase
        Phase that is known up to cycles, rad, (H, W); NaN where masked.
    cycle
        Fringes of a cycle.
    edges
        Where a surface ends.

    Notes
    -----
    Along an edge of the surface the jump changes, and somewhere it is a whole number of cycles. So pieces keep off
    edges by 1 % of the picture's shorter side: a gap in an edge that is narrower than twice as much is not passed.
    """
    turn = TURN * cycle
    curvature = _curvature(phase, turn)
    noise = robust_sd(curvature, about=0)
    curved = curvature > max(edges.curvature_rad, edges.curvature_sigmas * noise)
    rough = ndimage.uniform_filter(curved.astype(np.float32), 3) > edges.rough_share
    reach = max(edges.beside_px, round(edges.beside * min(phase.shape)))
    inner = ndimage.distance_transform_edt(~rough) > reach if rough.any() else np.ones(phase.shape, bool)
    return Unwrapped(*hang_together(np.where(inner, phase, np.nan), turn, edges.continues_rad))


def _curvature(phase: NDArray[np.floating], turn: float) -> NDArray[np.float64]:
    """Return the larger of both second differences at each pixel, up to whole cycles; NaN at masked neighbours."""
    bends = np.full((2, *phase.shape), np.nan)
    bends[0, :, 1:-1] = phase[:, 2:] - 2 * phase[:, 1:-1] + phase[:, :-2]
    bends[1, 1:-1] = phase[2:] - 2 * phase[1:-1] + phase[:-2]
    return np.fmax(*np.abs(wrap(bends, turn)))


def absolute_phase(orders: FringeOrders) -> AbsolutePhase:
    """Count fringes over the whole picture.

    Parameters
    ----------
    orders
        Orders within a cycle.

    Notes
    -----
    If the largest piece (`pieces_in_cycles`) stays within one cycle, all pixels are put into the same one; else the
    cycles that the others are in are open.

    Raises
    ------
    PhaseError
        No order is decided anywhere.
    """
    known = np.isfinite(orders.phase)
    if not known.any():
        raise PhaseError("no order is decided at any pixel: less noise, or periods further apart, are needed")
    turn = TURN * orders.cycle
    found = pieces_in_cycles(orders.phase, orders.cycle)
    sizes = np.bincount(found.pieces.ravel(), minlength=2)
    sizes[0] = 0
    main = found.pieces == sizes.argmax()
    low, high = np.quantile(found.phase[main], [_WRONG_SHARE, 1 - _WRONG_SHARE]) if main.any() else (0.0, np.inf)
    in_one_cycle = bool(high - low < turn)
    phase = np.where(main, found.phase, np.nan)
    if in_one_cycle:
        middle = (low + high) / 2
        phase = middle + wrap(orders.phase - middle, turn)
    left = np.isfinite(phase)
    return AbsolutePhase(phase, float((high - low) / TURN), in_one_cycle, float(1 - left.sum() / known.sum()))
