"""Flank angles along a profile: the height scale seen as a slope, free of any offset."""

import math
from dataclasses import dataclass

import numpy as np

from fringecal.verification.zigzag.zigzag_shape import Floats, ZigzagShape, bar_number, ridge_offset

_MIN_PIXELS = 5  # of a flank: a line through fewer has hardly any scatter of its own to state a u by


@dataclass(frozen=True)
class FlankAngle:
    """Angle of one flank against the plate, measured minus target, degrees; positive is too steep.

    `u_deg` comes from the scatter of the flank's pixels about their line.
    """

    bar: int
    side: str
    n: int
    error_deg: float
    u_deg: float


def flank_angles(across: Floats, error: Floats, shape: ZigzagShape) -> tuple[FlankAngle, ...]:
    """Fit a line to the pixels of each flank of a profile.

    Parameters
    ----------
    across, error
        (n,) place across the ridges and height error of the profile's flank pixels, mm.
    """
    bar, left = bar_number(across, shape), ridge_offset(across, shape) < 0
    angles = []
    for number in range(shape.count):
        for side in ("left", "right"):
            chosen = (bar == number) & (left if side == "left" else ~left)
            if np.count_nonzero(chosen) >= _MIN_PIXELS:
                angles.append(_angle(number + 1, side, across[chosen], error[chosen], shape.slope))
    return tuple(angles)


def _angle(bar: int, side: str, across: Floats, error: Floats, slope: float) -> FlankAngle:
    uphill = (across - across.mean()) * (1 if side == "left" else -1)
    spread = float(uphill @ uphill)
    extra = float(uphill @ error) / spread
    scatter = error - error.mean() - extra * uphill
    u_slope = math.sqrt(float(scatter @ scatter) / (len(error) - 2) / spread)
    angle = math.degrees(math.atan(slope + extra) - math.atan(slope))
    return FlankAngle(bar, side, len(error), angle, math.degrees(u_slope / (1 + (slope + extra) ** 2)))
