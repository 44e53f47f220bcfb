"""Fringe order of an object's phase: each connected piece is decided by evidence, or left undecided."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from fringecal.numerics import TURN

Array = NDArray[np.float64]

_NEAR_PLATE = 0.35  # rad; a plate pixel's phase differs from the model by noise and ripple only
_MIN_PLATE_PIXELS = 200
_MIN_SHARE = 0.02  # of a piece's pixels that must be plate, unless they are very many
_MANY = 2000
_MOST_LEVELS = 60  # fringes above or below the plate that are looked at
_STRIPS = 8  # of the picture, counted at once
_SAMPLE = 2000  # pixels of a piece at which the heights of an order are looked at
_TOP_MM, _TOP_SHARE = 0.15, 0.02  # how far a piece's top may lie from the known one that decides its order
_BELOW = 0.1  # of a cycle below the plate, where pieces are looked for too
_TOP = 0.995  # quantile of a piece's heights that is its top

HeightOf = Callable[[Array, NDArray[np.intp]], Array]
"""Heights (mm) of phase steps (rad) at flat pixel indices."""


@dataclass(frozen=True)
class PieceOrders:
    """Absolute phase step over the plate (rad, NaN where undecided) and what was decided for each piece.

    `orders` maps piece number to the multiple of 2 pi that was added, None where nothing decided it.
    """

    step_rad: Array
    orders: dict[int, int | None]

    @property
    def undecided(self) -> tuple[int, ...]:
        """Numbers of the pieces whose order is open."""
        return tuple(piece for piece, order in self.orders.items() if order is None)


def decide_pieces(
    step_rad: Array,
    pieces: NDArray[np.integer],
    *,
    height_of: HeightOf | None = None,
    height_range_mm: tuple[float, float] | None = None,
    tops_mm: tuple[float, ...] = (),
    fringes_per_turn: int = 1,
    rising: int = 1,
    range_turns: tuple[float, float] = (0.0, 0.0),
) -> PieceOrders:
    """Add to each piece the multiple of a turn at which its plate pixels lie on the plate.

    Parameters
    ----------
    step_rad
        Unwrapped phase over the plate's, continuous within a piece, shape (H, W).
    pieces
        Piece numbers from 1; 0 is masked.
    height_of, height_range_mm
        Heights of phase steps, and the heights an object can have: decides a piece without plate pixels if exactly
        one order fits.
    tops_mm
        Known heights of tops, as of balls: decide a piece without plate pixels if exactly one order brings its
        highest point to one.
    fringes_per_turn, rising, range_turns
        What the step is known up to: one fringe, or the cycle of several periods; sign of the step of what stands on
        the plate; cycles between which the stated heights lie. With several periods every pixel lies in the one cycle
        above the plate, unless stated heights or a piece with plate reach beyond that.
    """
    number = int(pieces.max(initial=0))
    turn = TURN * fringes_per_turn
    levels, counts, sizes = _plate_votes(step_rad, pieces, number, turn)
    orders: dict[int, int | None] = {}
    for piece in (np.flatnonzero(sizes[1:]) + 1).tolist():
        enough = max(_MIN_PLATE_PIXELS, min(_MANY, int(_MIN_SHARE * sizes[piece])))
        orders[piece] = -int(levels[piece]) if counts[piece] >= enough else None
    below = max(_BELOW, -range_turns[0])
    fits = fringes_per_turn > 1 and range_turns[1] + below <= 1
    if fits and not _leaves_cycle(step_rad, pieces, orders, rising * turn, below):
        return PieceOrders(_in_cycle(step_rad, rising * turn, below), dict.fromkeys(orders, 0))
    if height_of is not None and height_range_mm is not None:
        for piece, pixels in _pixels_of(pieces, [p for p, order in orders.items() if order is None]):
            orders[piece] = _order_by_height(step_rad, pixels, turn, height_of, height_range_mm, tops_mm)
    turns = np.full(number + 1, np.nan)
    for piece, order in orders.items():
        turns[piece] = np.nan if order is None else turn * order
    result = np.empty(step_rad.shape)
    _add_turns(step_rad, pieces, turns, result)
    return PieceOrders(result, orders)


def _plate_votes(
    step: Array, pieces: NDArray[np.integer], number: int, turn: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Return for every piece the fringe level near which most of its flat pixels lie, how many do, and its size.

    Pieces that are too small to be decided by the plate have no votes.
    """
    sizes = _sizes(pieces, number)
    large = sizes >= _MIN_PLATE_PIXELS
    large[0] = False
    rows = np.where(large, np.cumsum(large), 0)
    votes = np.zeros((_STRIPS, int(large.sum()) + 1, 2 * _MOST_LEVELS + 1), np.int32)
    _count_levels(np.asarray(step, float), pieces, rows, turn, votes)
    total = votes.sum(axis=0)
    total[0] = 0
    return (total.argmax(axis=1) - _MOST_LEVELS)[rows], total.max(axis=1)[rows], sizes


@njit(cache=True)
def _sizes(pieces, number):  # type: ignore[no-untyped-def]
    sizes = np.zeros(number + 1, np.int64)
    for piece in pieces.ravel():
        sizes[piece] += 1
    return sizes


@njit(parallel=True, cache=True)
def _count_levels(step, pieces, rows, turn, votes):  # type: ignore[no-untyped-def]
    """Count flat pixels within reach of each multiple of a turn, by piece.

    Flat are those whose neighbours on both sides have nearly the same step: plate, not a flank passing through.
    """
    height, width = step.shape
    for s in prange(votes.shape[0]):
        first, last = max(2, height * s // votes.shape[0]), min(height - 2, height * (s + 1) // votes.shape[0])
        for v in range(first, last):
            for u in range(2, width - 2):
                value = step[v, u]
                level = np.rint(value / turn)
                if not (abs(value - turn * level) < _NEAR_PLATE and abs(level) <= _MOST_LEVELS):
                    continue
                across = abs(step[v, u + 2] - step[v, u - 2])
                along = abs(step[v + 2, u] - step[v - 2, u])
                if across < 2 * _NEAR_PLATE and along < 2 * _NEAR_PLATE:
                    votes[s, rows[pieces[v, u]], int(level) + _MOST_LEVELS] += 1


@njit(parallel=True, cache=True)
def _add_turns(step, pieces, turns, out):  # type: ignore[no-untyped-def]
    for v in prange(step.shape[0]):
        for u in range(step.shape[1]):
            out[v, u] = step[v, u] + turns[pieces[v, u]]


def _pixels_of(pieces: NDArray[np.integer], wanted: list[int]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Yield flat indices of the pixels of some pieces."""
    chosen = np.zeros(int(pieces.max(initial=0)) + 1, dtype=bool)
    chosen[wanted] = True
    pixels = np.flatnonzero(chosen[pieces])
    numbers = pieces.ravel()[pixels]
    ordered = np.argsort(numbers, kind="stable")
    ends = np.searchsorted(numbers[ordered], wanted, side="right")
    starts = np.searchsorted(numbers[ordered], wanted, side="left")
    for piece, start, end in zip(wanted, starts, ends, strict=True):
        yield piece, pixels[ordered[start:end]]


def _leaves_cycle(
    step: Array, pieces: NDArray[np.integer], orders: dict[int, int | None], turn: float, below: float
) -> bool:
    """Tell whether what hangs together with the plate reaches beyond the one cycle that begins a little below it."""
    decided = {piece: order for piece, order in orders.items() if order is not None}
    for piece, pixels in _pixels_of(pieces, list(decided)):
        cycles = step.ravel()[pixels] / turn + np.sign(turn) * decided[piece]
        if np.count_nonzero((cycles < -below) | (cycles > 1 - below)) > _MIN_PLATE_PIXELS:
            return True
    return False


def _in_cycle(step: Array, turn: float, below: float) -> Array:
    """Return each step in the one cycle that begins a little below the plate; a turn is negative if steps fall."""
    return step - turn * np.floor(step / turn + below)


def _order_by_height(
    step: Array,
    pixels: NDArray[np.intp],
    turn: float,
    height_of: HeightOf,
    height_range: tuple[float, float],
    tops_mm: tuple[float, ...],
) -> int | None:
    """Find the only order at which a piece lies in the range, or, of several, ends at a known top."""
    chosen = pixels[:: max(1, pixels.size // _SAMPLE)]
    values = step.ravel()[chosen]
    low, high = height_range
    orders = np.arange(-_MOST_LEVELS, _MOST_LEVELS + 1)
    heights = height_of(values + turn * orders[:, None], chosen)
    inside = np.mean((heights > low) & (heights < high), axis=1) > 0.98
    fitting = {int(order): z for order, z in zip(orders[inside], heights[inside], strict=True)}
    if tops_mm:
        fitting = {order: z for order, z in fitting.items() if _ends_at(float(np.quantile(z, _TOP)), tops_mm)}
    return next(iter(fitting)) if len(fitting) == 1 else None


def _ends_at(top_mm: float, tops_mm: tuple[float, ...]) -> bool:
    return any(abs(top_mm - known) < _TOP_MM + _TOP_SHARE * known for known in tops_mm)
