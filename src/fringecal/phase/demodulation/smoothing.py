"""Filters for wrapped phase, on its sine and cosine: a mean over a jump of 2 pi would be nonsense."""

from typing import Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.phase.demodulation.demodulate import single_precision


def smooth_phase(phase: ArrayLike, *, kind: Literal["mean", "median"] = "mean", size: int = 3) -> NDArray[np.float32]:
    """Filter a wrapped phase map.

    Parameters
    ----------
    phase
        Wrapped phase, rad, (H, W), NaN where masked.
    kind
        "mean" over the valid pixels of a square, or "median" of sine and cosine each (masked pixels count as 0).
    size
        Side of the square, px, odd; a median takes 3 or 5.

    Returns
    -------
    numpy.ndarray
        Filtered phase in (-pi, pi], rad, float32; NaN where it was.

    Notes
    -----
    A mean over m pixels divides the noise by sqrt(m) and shortens fringes' detail alike; fringes should be longer
    than about four times the square.

    Raises
    ------
    PhaseError
        Not a 2-D map, or another kind or size.

    Examples
    --------
    >>> spike = np.full((5, 5), 1.0)
    >>> spike[2, 2] = 1.3
    >>> round(float(smooth_phase(spike, kind="median")[2, 2]), 5)
    1.0
    """
    wrapped = np.asarray(phase, np.float32)
    allowed = {"mean": size % 2 == 1 and size >= 1, "median": size in (3, 5)}
    if wrapped.ndim != 2 or not allowed.get(kind, False):
        raise PhaseError(
            f"found a map of shape {wrapped.shape}, filter {kind!r} of size {size}; needed: (height, width), and "
            '"mean" of odd size or "median" of 3 or 5'
        )
    masked = ~np.isfinite(wrapped)
    flat = np.where(masked, 0, wrapped)
    sine, cosine = (np.where(masked, 0, part(flat)).astype(np.float32) for part in (np.sin, np.cos))
    # The mean needs no division by the number of valid pixels: both parts would be divided by the same.
    filtered = [
        cv2.boxFilter(part, -1, (size, size), borderType=cv2.BORDER_CONSTANT)
        if kind == "mean"
        else cv2.medianBlur(part, size)
        for part in (sine, cosine)
    ]
    return np.where(masked, np.float32(np.nan), single_precision(np.arctan2(*filtered)))
