"""How much each pixel looks like bare plate: where strips added no phase."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.numerics import robust_sd, wrap

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CLEAN_RAD = 0.08  # noise of the step below which smoothing would only blur the edges
_SMOOTHED_PX = 3  # side of the square over which it is smoothed
_LEAST_KNOWN = 0.6  # share of a block's pixels with a phase: the mean of fewer is a rim's
# Step up to which a pixel looks like plate: so many standard deviations of the noise and a little ripple, not less
# than ripple and not more than a seventh of a fringe, rad.
_NOISE_SIGMAS, _RIPPLE_RAD, _TOLERANCE_RAD = 5.0, 0.04, (0.08, 0.9)
_APART_PX = 3  # between the pixels whose difference tells the noise: the smoothing couples nearer ones
_NOISE_SAMPLE, _DRIFT_SAMPLE = 100_000, 50_000  # pixels from which noise and drift are taken
_DRIFT_ROUNDS = 4
_PLATE_TOLERANCES, _DRIFT_TOLERANCES = 1.5, 2.0  # tolerances within which the plate is, and may have drifted


def plate_likeness(step: Array, usable: Mask, factor: int) -> tuple[Array, Mask]:
    """Map the agreement with the bare plate, 0 to 1, and where it is known.

    On a strip the step may be anything, even a whole fringe along some line, so only its absence is
    judged: over the noise, and over what the plate as a whole has drifted.
    """
    single = step.astype(np.float32)
    parts = [reduced(np.where(usable, wave(single), np.float32(0)), factor) for wave in (np.sin, np.cos)]
    known = reduced(usable.astype(np.float32), factor) > _LEAST_KNOWN
    angle = np.arctan2(*parts)
    if factor == 1 and _noise(angle, known) > _CLEAN_RAD:
        angle = np.arctan2(*(ndimage.uniform_filter(part, _SMOOTHED_PX) for part in parts))
    tolerance = float(np.clip(_NOISE_SIGMAS * _noise(angle, known) + _RIPPLE_RAD, *_TOLERANCE_RAD))
    off = np.abs(angle - np.float32(_drift(angle[known], tolerance)))
    return np.clip(2 - np.minimum(off, 2 * math.pi - off) / tolerance, 0, 1), known


def reduced(picture: NDArray, factor: int) -> NDArray:
    """Mean over blocks of factor x factor px; what is left over at the far sides is dropped."""
    if factor == 1:
        return picture
    height, width = (n // factor for n in picture.shape)
    whole = np.ascontiguousarray(picture[: height * factor, : width * factor], dtype=np.float32)
    return cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)


def _noise(angle: Array, known: Mask) -> float:
    """Scatter of the smoothed step, from differences of neighbours three apart: edges are few."""
    rows = slice(None, None, max(1, angle.size // _NOISE_SAMPLE))
    angle, known = angle[rows], known[rows]
    difference = wrap(angle[:, _APART_PX:] - angle[:, :-_APART_PX])
    both = known[:, _APART_PX:] & known[:, :-_APART_PX]
    return robust_sd(difference[both], about=0) / math.sqrt(2)


def _drift(angle: Array, tolerance: float) -> float:
    """Common phase shift of the plate between the captures, if it is small."""
    centre = 0.0
    angle = angle[:: max(1, angle.size // _DRIFT_SAMPLE)]
    for _ in range(_DRIFT_ROUNDS):
        left = wrap(angle - centre)
        near = np.abs(left) < _PLATE_TOLERANCES * tolerance
        if not near.any():
            return 0.0
        centre += float(np.mean(left[near]))
    return centre if abs(centre) < _DRIFT_TOLERANCES * tolerance else 0.0
