"""Fringe order of an object's phase: each connected piece is decided by evidence, or left undecided."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import TURN, over_bands
from fringecal.phase import LEAST_PLATE_PIXELS, NEAR_PLATE_RAD

Array = NDArray[np.float64]

_MOST_LEVELS = 60  # fringes above or below the plate that are looked at: 480 mm at 8 mm pitch and 45 deg
_STRIPS = 8  # of the picture, counted at once, each with votes of its own
_FLAT_OVER_PX = 2  # to either side, over which a plate pixel's neighbours have nearly its step


@dataclass(frozen=True)
class PieceRules:
    """When the order of a connected piece is decided by the plate in it, or by the heights it can have.

    Parameters
    ----------
    plate_pixels
        Least number of pixels on the plate's phase.
    plate_share, many_pixels
        Share of a piece's pixels that must be on the plate's phase, unless there are so many: in a large piece chance
        alone brings hundreds there.
    sample
        Pixels of a piece at which the heights of an order are looked at: a share of 2 % is then known to 0.3 %.
    inside
        Share of them that must lie in the stated range of heights; what is left to wrong pixels is 2 %.
    below
        Share of a cycle below the plate in which pieces are looked for too; as much is lost above.
    """

    plate_pixels: int = LEAST_PLATE_PIXELS
    plate_share: float = 0.02
    many_pixels: int = 2000
    sample: int = 2000
    inside: float = 0.98
    below: float = 0.1


PIECE_RULES = PieceRules()

HeightOf = Callable[[Array, NDArray[np.intp]], Array]
"""Heights (mm) of phase differences (rad) at flat pixel indices."""


@dataclass(frozen=True)
class PieceOrders:
    """Absolute phase difference to the plate (rad, NaN where undecided) and what was decided for each piece.

    `orders` maps piece number to the multiple of 2 pi that was added, None where nothing decided it.
    """

    difference_rad: Array
    orders: dict[int, int | None]

    @property
    def undecided(self) -> tuple[int, ...]:
        """Numbers of the pieces whose order is open."""
        return tuple(piece for piece, order in self.orders.items() if order is None)


def decide_pieces(
    difference_rad: Array,
    pieces: NDArray[np.integer],
    *,
    height_of: HeightOf | None = None,
    height_range_mm: tuple[float, float] | None = None,
    fringes_per_turn: int = 1,
    rising: int = 1,
    range_turns: tuple[float, float] = (0.0, 0.0),
    rules: PieceRules = PIECE_RULES,
) -> PieceOrders:
    """Add to each piece the multiple of a turn at which its plate pixels lie on the plate.

    Parameters
    ----------
    difference_rad
        Unwrapped phase over the plate's, continuous within a piece, shape (H, W).
    pieces
        Piece numbers from 1; 0 is masked.
    height_of, height_range_mm
        Heights of phase differences, and the heights an object can have: decides a piece without plate pixels if
        exactly one order fits.
    fringes_per_turn, rising, range_turns
        What the step is known up to: one fringe, or the cycle of several periods; sign of the step of what stands on
        the plate; cycles between which the stated heights lie. With several periods every pixel lies in the one cycle
        above the plate, unless stated heights or a piece with plate reach beyond that.
    rules
        When an order is decided.
    """
    number = int(pieces.max(initial=0))
    turn = TURN * fringes_per_turn
    levels, counts, sizes = plate_votes(difference_rad, pieces, number, turn, rules.plate_pixels)
    orders: dict[int, int | None] = {}
    for piece in (np.flatnonzero(sizes[1:]) + 1).tolist():
        enough = max(rules.plate_pixels, min(rules.many_pixels, int(rules.plate_share * sizes[piece])))
        orders[piece] = -int(levels[piece]) if counts[piece] >= enough else None
    below = max(rules.below, -range_turns[0])
    fits = fringes_per_turn > 1 and range_turns[1] + below <= 1
    if fits and not _leaves_cycle(difference_rad, pieces, orders, rising * turn, below, rules.plate_pixels):
        return PieceOrders(_in_cycle(difference_rad, rising * turn, below), dict.fromkeys(orders, 0))
    if height_of is not None and height_range_mm is not None:
        for piece, pixels in pixels_of(pieces, [p for p, order in orders.items() if order is None]):
            orders[piece] = order_by_height(difference_rad, pixels, turn, height_of, height_range_mm, rules)
    turns = np.full(number + 1, np.nan)
    for piece, order in orders.items():
        turns[piece] = np.nan if order is None else turn * order
    result = np.empty(difference_rad.shape)
    over_bands(add_turns, len(result), difference_rad, pieces, turns, result)
    return PieceOrders(result, orders)


def plate_votes(
    step: Array, pieces: NDArray[np.integer], number: int, turn: float, least: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Return for every piece the fringe level near which most of its flat pixels lie, how many do, and its size.

    Pieces that are too small to be decided by the plate have no votes.
    """
    sizes = _sizes(pieces, number)
    large = sizes >= least
    large[0] = False
    rows = np.where(large, np.cumsum(large), 0)
    votes = np.zeros((_STRIPS, int(large.sum()) + 1, 2 * _MOST_LEVELS + 1), np.int32)
    over_bands(_count_levels, _STRIPS, np.asarray(step, float), pieces, rows, turn, votes, least=1)
    total = votes.sum(axis=0)
    total[0] = 0
    return (total.argmax(axis=1) - _MOST_LEVELS)[rows], total.max(axis=1)[rows], sizes


@njit(cache=True)
def _sizes(pieces, number):  # type: ignore[no-untyped-def]
    sizes = np.zeros(number + 1, np.int64)
    for piece in pieces.ravel():
        sizes[piece] += 1
    return sizes


@njit(nogil=True, cache=True)
def _count_levels(first_strip, last_strip, step, pieces, rows, turn, votes):  # type: ignore[no-untyped-def]
    """Count flat pixels of some strips within reach of each multiple of a turn, by piece.

    Flat are those whose neighbours on both sides have nearly the same step: plate, not a flank passing through.
    """
    height, width = step.shape
    for s in range(first_strip, last_strip):
        first = max(_FLAT_OVER_PX, height * s // votes.shape[0])
        last = min(height - _FLAT_OVER_PX, height * (s + 1) // votes.shape[0])
        for v in range(first, last):
            for u in range(_FLAT_OVER_PX, width - _FLAT_OVER_PX):
                value = step[v, u]
                level = np.rint(value / turn)
                if not (abs(value - turn * level) < NEAR_PLATE_RAD and abs(level) <= _MOST_LEVELS):
                    continue
                across = abs(step[v, u + _FLAT_OVER_PX] - step[v, u - _FLAT_OVER_PX])
                along = abs(step[v + _FLAT_OVER_PX, u] - step[v - _FLAT_OVER_PX, u])
                if across < 2 * NEAR_PLATE_RAD and along < 2 * NEAR_PLATE_RAD:
                    votes[s, rows[pieces[v, u]], int(level) + _MOST_LEVELS] += 1


@njit(nogil=True, cache=True)
def add_turns(first, last, step, pieces, turns, out):  # type: ignore[no-untyped-def]
    """Write the step plus its piece's turns, rad, in some rows."""
    for v in range(first, last):
        for u in range(step.shape[1]):
            out[v, u] = step[v, u] + turns[pieces[v, u]]


def pixels_of(pieces: NDArray[np.integer], wanted: list[int]) -> Iterator[tuple[int, NDArray[np.intp]]]:
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
    step: Array, pieces: NDArray[np.integer], orders: dict[int, int | None], turn: float, below: float, most: int
) -> bool:
    """Return whether more than so many pixels of what is connected with the plate lie beyond the cycle about it."""
    decided = {piece: order for piece, order in orders.items() if order is not None}
    for piece, pixels in pixels_of(pieces, list(decided)):
        cycles = step.ravel()[pixels] / turn + np.sign(turn) * decided[piece]
        if np.count_nonzero((cycles < -below) | (cycles > 1 - below)) > most:
            return True
    return False


def _in_cycle(step: Array, turn: float, below: float) -> Array:
    """Return each step in the one cycle that begins a little below the plate; a turn is negative if steps fall."""
    return step - turn * np.floor(step / turn + below)


def order_by_height(  # noqa: PLR0913, PLR0917 -- a piece, its heights, and what they may be
    step: Array,
    pixels: NDArray[np.intp],
    turn: float,
    height_of: HeightOf,
    height_range: tuple[float, float],
    rules: PieceRules = PIECE_RULES,
) -> int | None:
    """Find the only order at which a piece lies in the range."""
    chosen = pixels[:: max(1, pixels.size // rules.sample)]
    values = step.ravel()[chosen]
    low, high = height_range
    orders = np.arange(-_MOST_LEVELS, _MOST_LEVELS + 1)
    heights = height_of(values + turn * orders[:, None], chosen)
    inside = np.mean((heights > low) & (heights < high), axis=1) > rules.inside
    return int(orders[inside][0]) if np.count_nonzero(inside) == 1 else None
