"""Fringe order of an object's phase: each connected piece is decided by evidence, or left undecided."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NEAR_PLATE = 0.35  # rad; a plate pixel's phase differs from the model by noise and ripple only
_MIN_PLATE_PIXELS = 200
_MIN_SHARE = 0.02  # of a piece's pixels that must be plate, unless they are very many
_MANY = 2000
_SAMPLE = 2000  # pixels of a piece at which the heights of an order are looked at
_TOP_MM, _TOP_SHARE = 0.15, 0.02  # how far a piece's top may lie from the known one that decides its order
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
) -> PieceOrders:
    """Add to each piece the multiple of 2 pi at which its plate pixels lie on the plate.

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
    """
    result = np.full(step_rad.shape, np.nan)
    orders: dict[int, int | None] = {}
    for piece in range(1, int(pieces.max(initial=0)) + 1):
        inside = pieces == piece
        if not inside.any():
            continue
        order = _order_by_plate(step_rad, inside)
        if order is None and height_of is not None and height_range_mm is not None:
            order = _order_by_height(step_rad, np.flatnonzero(inside), height_of, height_range_mm, tops_mm)
        orders[piece] = order
        if order is not None:
            result[inside] = step_rad[inside] + 2 * math.pi * order
    return PieceOrders(result, orders)


def _order_by_plate(step: Array, inside: NDArray[np.bool_]) -> int | None:
    """Find the level at which most flat pixels lie within reach of a multiple of 2 pi."""
    flat = inside & _flat(step)
    values = step[flat]
    multiple = np.round(values / (2 * math.pi)).astype(int)
    near = np.abs(values - 2 * math.pi * multiple) < _NEAR_PLATE
    if not near.any():
        return None
    levels, counts = np.unique(multiple[near], return_counts=True)
    best = int(np.argmax(counts))
    enough = max(_MIN_PLATE_PIXELS, min(_MANY, int(_MIN_SHARE * np.count_nonzero(inside))))
    return -int(levels[best]) if counts[best] >= enough else None


def _flat(step: Array) -> NDArray[np.bool_]:
    """Pixels whose neighbours on both sides have nearly the same step: plate, not a flank passing through."""
    flat = np.zeros(step.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        across = np.abs(step[2:-2, 4:] - step[2:-2, :-4])
        along = np.abs(step[4:, 2:-2] - step[:-4, 2:-2])
        flat[2:-2, 2:-2] = (across < 2 * _NEAR_PLATE) & (along < 2 * _NEAR_PLATE)
    return flat


def _order_by_height(
    step: Array,
    pixels: NDArray[np.intp],
    height_of: HeightOf,
    height_range: tuple[float, float],
    tops_mm: tuple[float, ...],
) -> int | None:
    """Find the only order at which a piece lies in the range, or, of several, ends at a known top."""
    chosen = pixels[:: max(1, pixels.size // _SAMPLE)]
    values = step.ravel()[chosen]
    low, high = height_range
    fitting: dict[int, Array] = {}
    for order in range(-40, 41):
        z = height_of(values + 2 * math.pi * order, chosen)
        if np.mean((z > low) & (z < high)) > 0.98:
            fitting[order] = z
    if tops_mm:
        fitting = {order: z for order, z in fitting.items() if _ends_at(float(np.quantile(z, _TOP)), tops_mm)}
    return next(iter(fitting)) if len(fitting) == 1 else None


def _ends_at(top_mm: float, tops_mm: tuple[float, ...]) -> bool:
    return any(abs(top_mm - known) < _TOP_MM + _TOP_SHARE * known for known in tops_mm)
