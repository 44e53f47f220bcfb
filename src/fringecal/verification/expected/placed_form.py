"""A form at its place on the plate: which of its tops each line of sight meets, and how high."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.targets import Top
from fringecal.verification.expected.known_rig import Floats, Sight

PLATE = -1
HIDDEN = -2
_INSIDE_MM = 0.05  # below a top's surface: a line of sight that ends so deep in a body has passed its wall


@dataclass(frozen=True)
class FormPlace:
    """Where a form lies: the middle of its footprint in plate mm, and its turn from +x, rad."""

    x_mm: float
    y_mm: float
    turn_rad: float

    def inside(self, x_mm: Floats, y_mm: Floats) -> tuple[Floats, Floats]:
        """Return plate points in the form's own frame, mm."""
        return self.turned(x_mm - self.x_mm, y_mm - self.y_mm)

    def turned(self, x_mm: Floats, y_mm: Floats) -> tuple[Floats, Floats]:
        """Return plate directions in the form's own frame."""
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        return c * x_mm + s * y_mm, c * y_mm - s * x_mm


@dataclass(frozen=True)
class Met:
    """What lines of sight meet: height in mm, and the number of the top, `PLATE`, or `HIDDEN` for a wall."""

    z_mm: Floats
    top: NDArray[np.int16]


def met_by_sight(tops: Sequence[Top], place: FormPlace, sight: Sight) -> Met:
    """Follow lines of sight to the form.

    Parameters
    ----------
    tops
        The form, in its own frame.
    place
        Where it lies.
    sight
        Lines of sight in the plate frame.
    """
    s, t = place.inside(sight.ax, sight.ay)
    ds, dt = place.turned(sight.bx, sight.by)
    z, number = np.zeros(s.shape), np.full(s.shape, PLATE, np.int16)
    for k, top in enumerate(tops):
        height = top.met_by(s, t, ds, dt)
        with np.errstate(invalid="ignore"):
            nearer = (height > z) | ((number == PLATE) & (height >= z - _lowest(tops)))
        z, number[nearer] = np.where(nearer, height, z), k
    behind_wall = np.zeros(s.shape, dtype=np.bool_)
    for k, top in enumerate(tops):
        across, along = s + ds * z, t + dt * z
        with np.errstate(invalid="ignore"):
            behind_wall |= (number != k) & top.covers(across, along) & (top.height(across, along) > z + _INSIDE_MM)
    number[behind_wall] = HIDDEN
    return Met(z, number)


def _lowest(tops: Sequence[Top]) -> float:
    """How far below the plate a flat may lie that has no height of its own: 0 for what stands on it."""
    return 0.0 if any(top.heights_mm[1] > 0 for top in tops) else math.inf
