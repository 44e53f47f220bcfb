"""Artefacts on the plate as connected pieces of a measured surface, their rims left out."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.errors import FitError
from fringecal.verification.zigzag.zigzag_shape import Floats, Surface

Mask = NDArray[np.bool_]

RIM_PX = 3
"""Left out along every border: blur mixes what lies on both sides of it."""

_OPENED_PX = 3  # ridges of shadow borders and single wrong pixels are narrower
MIN_PIXELS = 60
"""Of a piece, without its rim: of fewer, the uncertainty of a plane or cap cannot be found from their scatter."""
_ENDS = (0.01, 0.99)  # quantiles of the heights that a refusal names: single wrong pixels lie outside


def valid_points(surface: Surface) -> tuple[Floats, Mask]:
    """Return all points (H, W, 3) in mm and which of them are valid.

    Raises
    ------
    FitError
        Hardly any pixel is valid.
    """
    points = np.stack([np.asarray(m, float) for m in (surface.x, surface.y, surface.z)], axis=-1)
    valid = np.asarray(surface.mask, bool) & np.isfinite(points).all(axis=-1)
    if np.count_nonzero(valid) < MIN_PIXELS:
        raise FitError(
            f"only {np.count_nonzero(valid)} valid pixels in the surface, at least {MIN_PIXELS} are needed; look at "
            "the mask's reasons first"
        )
    return points, valid


def pieces_between(points: Floats, valid: Mask, low_mm: float, high_mm: float, *, rim_px: int = RIM_PX) -> list[Mask]:
    """Return the connected pieces whose heights lie between two levels, the largest first, without their rims."""
    z = points[..., 2]
    opened = ndimage.binary_opening(valid & (z > low_mm) & (z < high_mm), np.ones((_OPENED_PX, _OPENED_PX), dtype=bool))
    labels, number = ndimage.label(opened)
    sizes = np.bincount(labels.ravel(), minlength=number + 1)
    kernel = np.ones((2 * rim_px + 1, 2 * rim_px + 1), dtype=bool)
    found = []
    for label in sorted(range(1, number + 1), key=lambda k: -sizes[k]):
        if sizes[label] < MIN_PIXELS:
            break
        core = ndimage.binary_erosion(labels == label, kernel) & valid
        if np.count_nonzero(core) >= MIN_PIXELS:
            found.append(core)
    return found


def one_piece(points: Floats, valid: Mask, low_mm: float, high_mm: float, *, what: str) -> Mask:
    """Return the largest piece between two levels.

    Raises
    ------
    FitError
        There is none.
    """
    found = pieces_between(points, valid, low_mm, high_mm)
    if not found:
        lowest, highest = np.quantile(points[..., 2][valid], _ENDS)
        raise FitError(
            f"no {what} in the surface: nothing connected lies between {low_mm:.3g} and {high_mm:.3g} mm (measured "
            f"heights run from {lowest:.3g} to {highest:.3g} mm). Check the target of the "
            "capture, and that the artefact is lit and in the picture"
        )
    return found[0]
