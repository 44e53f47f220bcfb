"""Fringe order from a reference and a range of heights: each pixel decided by itself, or left undecided."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import TURN


def unwrap_guided(
    phase: ArrayLike, reference: ArrayLike, low_rad: ArrayLike, high_rad: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Give a wrapped phase the one order that a reference and a range allow.

    Parameters
    ----------
    phase
        Wrapped phase of the object, rad, (H, W).
    reference
        Unwrapped phase of the plate, rad, (H, W).
    low_rad, high_rad
        What the object's phase can differ from the plate's by, rad, each a number or (H, W): the phase shifts of
        the lowest and the highest point that the object can have, with a margin for noise.

    Returns
    -------
    unwrapped, ambiguous
        `phase + 2 pi k`, rad, float64, NaN where no order or more than one fits the range; and True where more
        than one does. A range shorter than 2 pi is never ambiguous.

    Raises
    ------
    PhaseError
        Maps of different shape, or a range that is empty.

    Examples
    --------
    >>> plate = np.array([[0.0, 10.0, 20.0]])
    >>> true = plate + [[0.5, 4.0, 5.5]]
    >>> found, ambiguous = unwrap_guided(np.angle(np.exp(1j * true)), plate, -0.1, 6.0)
    >>> (found - plate).round(6), bool(ambiguous.any())
    (array([[0.5, 4. , 5.5]]), False)
    """
    wrapped, plate = np.asarray(phase, np.float64), np.asarray(reference, np.float64)
    low, high = np.asarray(low_rad, np.float64), np.asarray(high_rad, np.float64)
    if wrapped.shape != plate.shape:
        raise PhaseError(f"the phase has shape {wrapped.shape}, the reference {plate.shape}: they must be equal")
    if not (high >= low).all():
        raise PhaseError("the range of the phase is empty somewhere: low_rad must not exceed high_rad")
    difference = wrapped - plate
    first = np.ceil((low - difference) / TURN)
    last = np.floor((high - difference) / TURN)
    return np.where(first == last, wrapped + TURN * first, np.nan), last > first
