"""Frames for a projector's raster: a fringe at each pixel's centre, whatever its period, in whole grey values."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import PhaseError
from fringecal.patterns.projector_response import Response

Array = NDArray[np.float64]
Frame = NDArray[Any]  # uint8, or uint16 where a grey value has more than 8 bits
Axis = Literal["u", "v"]

LEAST_PERIOD_PX = 3.0  # px: two are flat at the wrong phase, and no camera resolves fewer
_GOLDEN = (math.sqrt(5) - 1) / 2  # multiples of it, without their whole parts, fill 0 to 1 as evenly as any sequence
_MOST_SIDE_PX = 16_384  # of a projector: twice what is built
_BITS = (8, 16)  # of a PNG: more than 8 bits are written as 16, in the upper ones


@dataclass(frozen=True)
class Raster:
    """A projector: columns, rows, bits of a grey value (8 to 16), and how its light follows them.

    Raises
    ------
    PhaseError
        A size or number of bits that no projector has.
    """

    width_px: int
    height_px: int
    bits: int = 8
    response: Response | None = None

    def __post_init__(self) -> None:
        if not (1 <= self.width_px <= _MOST_SIDE_PX and 1 <= self.height_px <= _MOST_SIDE_PX):
            raise PhaseError(f"a projector of {self.width_px} x {self.height_px} px; 1 to {_MOST_SIDE_PX} a side")
        if not _BITS[0] <= self.bits <= _BITS[1]:
            raise PhaseError(f"grey values of {self.bits} bits; {_BITS[0]} to {_BITS[1]} can be drawn")

    @property
    def white(self) -> int:
        """Largest grey value."""
        return int(2**self.bits - 1)

    def extent_px(self, axis: Axis) -> int:
        """Pixels along an axis: "u" counts columns, "v" rows."""
        return self.width_px if axis == "u" else self.height_px

    def spread(self, along: NDArray[Any], axis: Axis) -> NDArray[Any]:
        """Return values along an axis (n,) as a picture."""
        line = along[None, :] if axis == "u" else along[:, None]
        return np.ascontiguousarray(np.broadcast_to(line, (self.height_px, self.width_px)))

    def frame(self, grey: NDArray[Any]) -> Frame:
        """Return grey values, whole numbers, as a picture of 8 or 16 bit."""
        if self.bits == _BITS[0]:
            return grey.astype(np.uint8)
        return (grey.astype(np.uint16) << (_BITS[1] - self.bits)).astype(np.uint16)


def fringe_frame(
    raster: Raster,
    axis: Axis,
    period_px: float,
    shift_rad: float,
    *,
    contrast: float = 1.0,
    dithered: bool = False,
) -> Frame:
    """Draw one frame of fringes, `light = (1 + contrast cos(2 pi x / p + shift)) / 2` at each pixel's centre x.

    Parameters
    ----------
    raster
        The projector; its response is undone.
    axis
        Along which the fringes vary: "u" for fringes that count columns.
    period_px
        Fringe period, px, whole or not: pixels are drawn at their centres, so that their phase is exact.
    shift_rad
        Phase shift.
    contrast
        Modulation over background, 0 to 1: less than 1 leaves room at the response's ends.
    dithered
        Whether rounding is spread over the other axis: of many pixels along a fringe as many are one grey value
        brighter as the wanted light asks for. Otherwise all of a fringe round alike.

    Raises
    ------
    PhaseError
        A period that no raster shows, or a contrast that is none.
    """
    demand_period(period_px, raster.extent_px(axis))
    demand_contrast(contrast)
    x = np.arange(raster.extent_px(axis))
    light = (1 + contrast * np.cos(2 * np.pi * x / period_px + shift_rad)) / 2
    wanted = light if raster.response is None else raster.response.wanted(light)
    if not dithered:
        return raster.spread(raster.frame(np.rint(wanted * raster.white)), axis)
    exact = raster.spread(wanted * raster.white, axis)
    across = np.arange(raster.height_px if axis == "u" else raster.width_px)
    threshold = (_GOLDEN * across + 0.5) % 1.0
    line = threshold[:, None] if axis == "u" else threshold[None, :]
    return raster.frame(np.minimum(np.floor(exact + line), raster.white))


def flat_frame(raster: Raster, light: float) -> Frame:
    """Draw a frame of one light, 0 (black) to 1 (white), with the response undone."""
    grey = light if raster.response is None else float(raster.response.wanted(light))
    value = raster.frame(np.array(round(grey * raster.white)))
    return np.full((raster.height_px, raster.width_px), value, dtype=value.dtype)


def demand_contrast(contrast: float) -> None:
    """Refuse a modulation that is none, or more than its background."""
    if not 0 < contrast <= 1:
        raise PhaseError(f"a contrast of {contrast:g}; it lies above 0 and at most at 1")


def demand_period(period_px: float, extent_px: int) -> None:
    """Refuse a period that a raster cannot show, and name the nearest that it can."""
    if not (math.isfinite(period_px) and period_px >= LEAST_PERIOD_PX):
        raise PhaseError(
            f"a period of {period_px:g} px cannot be drawn: fewer than {LEAST_PERIOD_PX:g} pixels show no cosine; the "
            f"nearest that can is {LEAST_PERIOD_PX:g} px, of {extent_px} px {extent_px / LEAST_PERIOD_PX:.0f} fringes"
        )
