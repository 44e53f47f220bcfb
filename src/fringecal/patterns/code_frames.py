"""Gray-code frames that number the fringes of one period, with edges between pixels."""

import math

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import PhaseError
from fringecal.patterns.frame_drawing import Axis, Frame, Raster, demand_period

_WHOLE_PX = 1e-9  # of a period: rounding of what was typed


def stripe_numbers(extent_px: int, period_px: float) -> NDArray[np.int64]:
    """Number of the fringe at each pixel, (extent,): fringe n begins with pixel n p.

    Raises
    ------
    PhaseError
        A period whose edges do not fall between pixels.

    Examples
    --------
    >>> stripe_numbers(8, 4).tolist()
    [0, 0, 0, 0, 1, 1, 1, 1]
    """
    demand_period(period_px, extent_px)
    whole = round(period_px)
    if abs(period_px - whole) > _WHOLE_PX * period_px:
        low, high = math.floor(period_px), math.ceil(period_px)
        raise PhaseError(
            f"a Gray code of fringes of {period_px:g} px cannot be drawn: its edges fall inside pixels; the nearest "
            f"periods that can are {low} px ({extent_px / low:.4g} fringes) and {high} px ({extent_px / high:.4g}), or "
            "number the fringes by a longer period instead"
        )
    return np.arange(extent_px) // whole


def gray_frames(raster: Raster, axis: Axis, period_px: float, *, complementary: bool = False) -> tuple[Frame, ...]:
    """Draw the Gray code of fringe numbers, the coarsest bit first, bright is 1.

    Parameters
    ----------
    raster, axis
        The projector, and the axis along which the numbers count.
    period_px
        Fringe period, a whole number of px.
    complementary
        Whether all bits follow once more with dark and bright exchanged: the threshold is then where both are equal,
        whatever surface and light do.

    Raises
    ------
    PhaseError
        As `stripe_numbers`; or one fringe, which needs no number.
    """
    numbers = stripe_numbers(raster.extent_px(axis), period_px)
    bits = int(numbers[-1]).bit_length()
    if not bits:
        raise PhaseError(f"fringes of {period_px:g} px: one fills the projector's picture and needs no Gray code")
    code = numbers ^ (numbers >> 1)
    lit = [(code >> bit) & 1 for bit in range(bits - 1, -1, -1)]
    lit += [1 - each for each in lit] if complementary else []
    return tuple(raster.spread(raster.frame(raster.white * each), axis) for each in lit)
