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


def plate_likeness(step: Array, usable: Mask, factor: int) -> tuple[Array, Mask]:
    """Map the agreement with the bare plate, 0 to 1, and where it is known.

    On a strip the step may be anything, even a whole fringe along some line, so only its absence is
    judged: over the noise, and over what the plate as a whole has drifted.
    """
    single = step.astype(np.float32)
    parts = [reduced(np.where(usable, wave(single), np.float32(0)), factor) for wave in (np.sin, np.cos)]
    known = reduced(usable.astype(np.float32), factor) > 0.6
    angle = np.arctan2(*parts)
    if factor == 1 and _noise(angle, known) > _CLEAN_RAD:
        angle = np.arctan2(*(ndimage.uniform_filter(part, 3) for part in parts))
    tolerance = float(np.clip(5 * _noise(angle, known) + 0.04, 0.08, 0.9))
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
    rows = slice(None, None, max(1, angle.size // 100_000))
    angle, known = angle[rows], known[rows]
    difference = wrap(angle[:, 3:] - angle[:, :-3])
    both = known[:, 3:] & known[:, :-3]
    return robust_sd(difference[both], about=0) / math.sqrt(2)


def _drift(angle: Array, tolerance: float) -> float:
    """Common phase shift of the plate between the captures, if it is small."""
    centre = 0.0
    angle = angle[:: max(1, angle.size // 50_000)]
    for _ in range(4):
        left = wrap(angle - centre)
        near = np.abs(left) < 1.5 * tolerance
        if not near.any():
            return 0.0
        centre += float(np.mean(left[near]))
    return centre if abs(centre) < 2 * tolerance else 0.0
