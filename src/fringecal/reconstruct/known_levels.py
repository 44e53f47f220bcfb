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

_REACH_RAD = 1.0  # a pixel may be this far from the phase of its level: some 15 % of a fringe's height
_LEAD_RAD = 0.4  # by which every other level must be farther
_LEAST_PIXELS = 100  # of a connected top


@dataclass(frozen=True)
class Levels:
    """Heights at which an artefact is known to have surfaces, mm, the plate's left out.

    `top` says that they are the highest points of curved surfaces, as of balls; else whole flat tops.
    """

    heights_mm: tuple[float, ...]
    top: bool = False


def steps_at_levels(step_rad: Array, valid: NDArray[np.bool_], predicted_rad: Array) -> Array:
    """Return the absolute phase step of the pixels that lie on a known level, NaN elsewhere.

    Parameters
    ----------
    step_rad
        Phase over the plate's, rad, any multiple of 2 pi away from the truth, (H, W).
    valid
        Where it is known, (H, W).
    predicted_rad
        Absolute phase step of each level at every pixel, (levels, H, W).
    """
    nearest = np.zeros(step_rad.shape, np.int32)
    best = _distance(step_rad, 0.0)
    second = np.full(step_rad.shape, np.inf)
    for number, predicted in enumerate(predicted_rad, start=1):
        distance = _distance(step_rad, predicted)
        closer = distance < best
        second = np.where(closer, best, np.minimum(second, distance))
        nearest[closer], best = number, np.minimum(best, distance)
    sure = valid & (best < _REACH_RAD) & (second - best > _LEAD_RAD)
    result = np.full(step_rad.shape, np.nan)
    for number, predicted in enumerate(predicted_rad, start=1):
        inside = _large_pieces(sure & (nearest == number))
        result[inside] = predicted[inside] + wrap(step_rad[inside] - predicted[inside])
    return result


def _distance(step_rad: Array, predicted_rad: Array | float) -> Array:
    return np.abs(wrap(np.nan_to_num(step_rad) - predicted_rad))


def _large_pieces(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Leave out specks: a flank that passes through a level's phase, the border of a shadow."""
    labels, number = ndimage.label(ndimage.binary_opening(inside, np.ones((5, 5), dtype=bool)))
    large = np.bincount(labels.ravel(), minlength=number + 1) >= _LEAST_PIXELS
    large[0] = False
    return large[labels]
