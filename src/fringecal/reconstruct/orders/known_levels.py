"""Fringe order from known heights: what stands upright on the plate has no slope that leads up to it.

The phase on top of a box or a step says its height up to whole fringes, and along some stretch of its edge the jump
is nearly whole, so that the top seems to touch the plate. Where the heights are certified, each pixel is given to the
level whose phase it has, if no other level, the plate included, has nearly the same one there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.numerics import wrap

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LevelRules:
    """When a pixel lies on a known level.

    Parameters
    ----------
    reach_rad
        Most that it may be off the phase of its level, rad: 16 % of a fringe's height, for a rig whose heights are not
        calibrated yet.
    lead_rad
        By how much every other level must be farther, rad: four standard deviations of a noise of 0.1 rad.
    least_pixels
        Of a connected top; the border of a shadow and a flank that passes through a level's phase make smaller ones.
    opening_px
        Side of the square that must fit into a top, px: a flank's crossing is narrower.
    """

    reach_rad: float = 1.0
    lead_rad: float = 0.4
    least_pixels: int = 100
    opening_px: int = 5


LEVEL_RULES = LevelRules()


@dataclass(frozen=True)
class Levels:
    """Heights at which an artefact is known to have surfaces, mm, the plate's left out.

    `top` says that they are the highest points of curved surfaces, as of balls; else whole flat tops.
    """

    heights_mm: tuple[float, ...]
    top: bool = False


def steps_at_levels(
    difference_rad: Array, valid: NDArray[np.bool_], predicted_rad: Array, *, rules: LevelRules = LEVEL_RULES
) -> Array:
    """Return the absolute phase difference of the pixels that lie on a known level, NaN elsewhere.

    Parameters
    ----------
    difference_rad
        Phase over the plate's, rad, any multiple of 2 pi away from the truth, (H, W).
    valid
        Where it is known, (H, W).
    predicted_rad
        Absolute phase difference of each level at every pixel, (levels, H, W).
    rules
        When a pixel lies on a level.
    """
    nearest = np.zeros(difference_rad.shape, np.int32)
    best = _distance(difference_rad, 0.0)
    second = np.full(difference_rad.shape, np.inf)
    for number, predicted in enumerate(predicted_rad, start=1):
        distance = _distance(difference_rad, predicted)
        closer = distance < best
        second = np.where(closer, best, np.minimum(second, distance))
        nearest[closer], best = number, np.minimum(best, distance)
    sure = valid & (best < rules.reach_rad) & (second - best > rules.lead_rad)
    result = np.full(difference_rad.shape, np.nan)
    for number, predicted in enumerate(predicted_rad, start=1):
        inside = _large_pieces(sure & (nearest == number), rules)
        result[inside] = predicted[inside] + wrap(difference_rad[inside] - predicted[inside])
    return result


def _distance(difference_rad: Array, predicted_rad: Array | float) -> Array:
    return np.abs(wrap(np.nan_to_num(difference_rad) - predicted_rad))


def _large_pieces(inside: NDArray[np.bool_], rules: LevelRules) -> NDArray[np.bool_]:
    """Leave out specks: a flank that passes through a level's phase, the border of a shadow."""
    labels, number = ndimage.label(ndimage.binary_opening(inside, np.ones((rules.opening_px,) * 2, dtype=bool)))
    large = np.bincount(labels.ravel(), minlength=number + 1) >= rules.least_pixels
    large[0] = False
    return large[labels]
