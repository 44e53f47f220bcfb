"""From orders that are known within a cycle of fringes to one phase over the whole picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, robust_sd, wrap
from fringecal.phase.orders.multi_period import FringeOrders
from fringecal.phase.orders.order_kernels import hang_together
from fringecal.phase.orders.piece_links import linked_pieces
from fringecal.phase.unwrapping.spatial import Unwrapped

_WRONG_SHARE = 1e-4  # of the pixels, at either end of their range, that may be wrong orders and do not count
_ROUNDED = 1e-3  # of a cycle that a stated number of fringes may be above it by rounding
_BINS = 8  # of a fringe, in which orders that nothing has are looked for
_PLANE_PIXELS = 20_000  # that a plane is fitted to


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
class AbsoluteRules:
    """When a piece that hangs together with nothing is given a cycle.

    Parameters
    ----------
    displaced
        Most by which a height displaces the fringes, share of the fringes that the picture shows across: with a
        projection angle of 30 deg, a height of 1.3 times the picture's width.
    spans
        Share of the picture's sides over which the largest piece must extend for its slope to be the picture's.
    gap
        Fringes between the last and the first that are seen, from which every pixel lies on one side of the seam.
    """

    displaced: float = 0.75
    spans: float = 0.4
    gap: float = 1.0


ABSOLUTE_RULES = AbsoluteRules()


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
        True if the picture holds no more fringes than the periods distinguish.
    undecided
        Share of the pixels with an order whose cycle is open.
    known_by
        `numbers`: the periods number every fringe that is projected; `displacement`: pieces are taken to be displaced
        by less than three quarters of what the picture shows; `pieces`: only what continues the largest piece, over
        gaps as well, is counted.
    """

    phase: NDArray[np.float64]
    fringes: float
    in_one_cycle: bool
    undecided: float
    known_by: str = "pieces"

    def sentence(self) -> str:
        """Say which parts of the picture are counted together."""
        if self.known_by == "numbers":
            return f"{self.fringes:.1f} fringes in the picture, all that are projected are numbered{self._left()}"
        if self.known_by == "displacement":
            return (
                f"{self.fringes:.1f} fringes in the picture; pieces are counted on the assumption that no surface "
                "displaces the fringes by more than three quarters of what the picture shows; --extent or --counts, "
                f"which state how many are projected, make that needless{self._left()}"
            )
        return (
            f"{self.fringes:.1f} fringes in the picture, which may hold more than one cycle: {self.undecided:.2%} of "
            "the pixels do not continue the largest piece and stay undecided by whole cycles; state how many fringes "
            "are projected (--extent or --counts), or add a longer period"
        )

    def _left(self) -> str:
        """Say what stays open though the cycle is known."""
        return f"; {self.undecided:.2%} of the pixels stay undecided" if self.undecided > 0 else ""


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


def absolute_phase(
    orders: FringeOrders, *, projected: float | None = None, rules: AbsoluteRules = ABSOLUTE_RULES
) -> AbsolutePhase:
    """Count fringes over the whole picture.

    Parameters
    ----------
    orders
        Orders within a cycle.
    projected
        Fringes of the shortest period in the whole projected picture, where that is known.
    rules
        When a piece that hangs together with nothing is given a cycle.

    Notes
    -----
    Where a code or the periods number every fringe that is projected, each pixel stands for itself. If not, pieces
    (`pieces_in_cycles`) that continue one another over gaps (`linked_pieces`) are counted together. Of the others
    one lies in the cycle that displaces it least from the plane through the largest piece, if any other would displace
    it by more than three quarters of what the picture shows; else its cycle is open.

    Raises
    ------
    PhaseError
        No order is decided anywhere, or more fringes than are said to be projected.
    """
    known = np.isfinite(orders.phase)
    if not known.any():
        raise PhaseError("no order is decided at any pixel: less noise, or periods further apart, are needed")
    if orders.numbers_all:
        return _counted(orders.phase.astype(np.float64), known, "numbers", np.inf)
    found = pieces_in_cycles(orders.phase, orders.cycle)
    if projected is not None and projected <= orders.cycle * (1 + _ROUNDED):
        return _counted(_numbered(orders, found, rules), known, "numbers", np.inf)
    found = linked_pieces(found, orders.cycle)
    sizes = np.bincount(found.pieces.ravel(), minlength=2)
    sizes[0] = 0
    main = found.pieces == sizes.argmax()
    if not main.any():
        return _counted(np.where(main, found.phase, np.nan), known, "pieces", TURN * orders.cycle)
    return _with_the_rest(orders, found, main, known, rules)


def _counted(phase: NDArray[np.float64], known: NDArray[np.bool_], known_by: str, turn: float) -> AbsolutePhase:
    """Count the fringes and what is left open."""
    left = np.isfinite(phase)
    low, high = np.quantile(phase[left], [_WRONG_SHARE, 1 - _WRONG_SHARE]) if left.any() else (0.0, 0.0)
    undecided = float(1 - left.sum() / known.sum())
    within = known_by != "pieces" and bool(high - low < turn)
    return AbsolutePhase(phase, float((high - low) / TURN), within, undecided, known_by)


def _numbered(orders: FringeOrders, found: Unwrapped, rules: AbsoluteRules) -> NDArray[np.float64]:
    """Put all pixels into the one cycle that is projected; it begins where the fewest fringes are seen."""
    turn = TURN * orders.cycle
    seam, gap = _seam(orders, turn)
    middle = seam + turn / 2
    phase = middle + wrap(orders.phase - middle, turn)
    if gap >= TURN * rules.gap:
        return phase
    # Noise carries pixels over the seam: they belong with their piece, and without one are open.
    offset = np.rint((found.phase - phase) / turn)
    whole = ndimage.median(np.nan_to_num(offset), found.pieces, range(found.n_pieces + 1))
    beside = np.abs(wrap(phase - seam, turn)) < TURN / 2
    inside = found.pieces > 0
    alone = np.where(beside, np.nan, phase)
    return np.where(inside, found.phase - turn * np.rint(whole)[found.pieces], alone)


def _seam(orders: FringeOrders, turn: float) -> tuple[float, float]:
    """Return the middle of the widest range of phase in a cycle that (almost) no pixel has, and its width, rad."""
    bins = _BINS * orders.cycle
    seen = np.mod(orders.phase[np.isfinite(orders.phase)], turn) * (bins / turn)
    counts = np.bincount(np.minimum(seen.astype(np.int64), bins - 1), minlength=bins)
    full = np.flatnonzero(counts > max(_WRONG_SHARE * seen.size / _BINS, 0))
    gaps = np.diff(np.append(full, full[0] + bins))
    k = int(gaps.argmax())
    width = float((gaps[k] - 1) * turn / bins)
    if width < TURN / 2 and orders.offset_rad is not None:
        return orders.offset_rad, width
    return float((full[k] + 1) * turn / bins + width / 2), width


def _with_the_rest(
    orders: FringeOrders,
    found: Unwrapped,
    main: NDArray[np.bool_],
    known: NDArray[np.bool_],
    rules: AbsoluteRules,
) -> AbsolutePhase:
    """Count the largest piece, and of the others what can be in one cycle only."""
    turn = TURN * orders.cycle
    phase = np.where(main, found.phase, np.nan)
    plane, across = _plane(phase)
    most = rules.displaced * across
    rows, columns = np.nonzero(main)
    sides = np.array([np.ptp(rows), np.ptp(columns)]) / phase.shape
    if (sides < rules.spans).any() or most >= turn:
        return _counted(_beside(orders, phase, found, turn), known, "pieces", turn)
    displaced = wrap(orders.phase - plane, turn)
    clear = np.abs(displaced) < np.minimum(most, turn - most)
    rest = np.where(clear & ~main, plane + displaced, phase)
    return _counted(_beside(orders, rest, found, turn), known, "displacement", turn)


def _plane(phase: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the plane through a piece, rad, and what it rises by over the picture, rad."""
    rows, columns = np.nonzero(np.isfinite(phase))
    some = slice(None, None, max(1, rows.size // _PLANE_PIXELS))
    terms = np.stack([np.ones(rows[some].size), rows[some], columns[some]], axis=1)
    (start, down, along), *_ = np.linalg.lstsq(terms, phase[rows[some], columns[some]])
    grid = np.ogrid[: phase.shape[0], : phase.shape[1]]
    return start + down * grid[0] + along * grid[1], float(abs(down) * phase.shape[0] + abs(along) * phase.shape[1])


def _beside(orders: FringeOrders, phase: NDArray[np.float64], found: Unwrapped, turn: float) -> NDArray[np.float64]:
    """Give pixels that pieces keep off, beside edges, the count of the nearest piece where they continue it."""
    open_ = np.isnan(phase) & np.isfinite(orders.phase) & (found.pieces == 0)
    if not open_.any() or not np.isfinite(phase).any():
        return phase
    row, column = ndimage.distance_transform_edt(found.pieces == 0, return_distances=False, return_indices=True)
    away = wrap(orders.phase - phase[row, column], turn)
    near = open_ & (np.abs(away) < TURN / 2)
    return np.where(near, phase[row, column] + away, phase)
