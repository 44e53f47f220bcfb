"""Edges within a region that look like none from pixel to pixel: a step of nearly whole fringes.

Both sides are continued to every pixel from a window, whose mean noise is far below that of a pixel. On curved surfaces
this finds more than edges; so it serves only where a region is known to be two surfaces in one.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

AHEAD_PX = 8
"""Length of the windows on either side from which a surface is continued."""
BESIDE_PX = 4
"""Half their breadth."""

Array = NDArray[np.floating]


def faint_edges(values: Array, inside: NDArray[np.bool_], limit_sigmas: float, sigma_rad: float) -> NDArray[np.bool_]:
    """Mark the pixels of a surface at which it breaks by more than noise, along rows or along columns, (H, W).

    Parameters
    ----------
    values
        Phase, continuous where `inside`, rad, (H, W).
    inside
        Where the surface is.
    limit_sigmas
        Break that counts, in its standard uncertainties.
    sigma_rad
        Random standard uncertainty of a pixel's phase, rad.
    """
    step = np.where(inside, values, 0.0).astype(np.float32)
    found = np.zeros(inside.shape, np.uint8)
    for kernel in (_break_kernel(), _break_kernel().T):
        whole = cv2.erode(inside.astype(np.uint8), np.ones(kernel.shape, np.uint8), borderValue=0) > 0
        limit = limit_sigmas * sigma_rad * float(np.sqrt(np.sum(kernel**2)))
        found |= whole & (np.abs(cv2.filter2D(step, -1, kernel)) > limit)
    reach = np.ones((2 * BESIDE_PX + 3,) * 2, np.uint8)
    return np.asarray(cv2.dilate(found, reach) > 0)


def _break_kernel() -> NDArray[np.float32]:
    """Weights along a row that continue straight lines from both sides to the middle, and subtract."""
    at = np.arange(1, AHEAD_PX + 1)
    continued = np.linalg.pinv(np.column_stack([np.ones(AHEAD_PX), at]))[0]
    row = np.concatenate([-continued[::-1], [0.0], continued])
    return np.tile(row / (2 * BESIDE_PX + 1), (2 * BESIDE_PX + 1, 1)).astype(np.float32)
