"""Texture of a plate in its background: what neither light, nor vignetting, nor the fringes leave there."""

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import robust_sd

LEAST_SHARE = 0.3
"""Share of a window that must be seen for its texture to be known."""

_HARMONICS = 3  # of the fringes that leave a ripple in the background: three frames alias the third
_KEPT_SIGMAS = 4.0  # robust standard deviations beyond which a pixel is an edge or dirt: one good pixel in 16 000
_ROUNDS = 2
_RIDGE = 1e-6  # of the diagonal: fringes wider than the window are no terms of their own


def texture_of(background: NDArray[np.floating], phase_rad: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the background of a window less a quadratic and three harmonics of the fringes, NaN where it is not seen.

    Parameters
    ----------
    background, phase_rad
        Of the window, (h, w); a phase of NaN masks.
    """
    height, width = background.shape
    kept = np.isfinite(phase_rad) & np.isfinite(background)
    left = np.full(background.shape, np.nan, np.float32)
    if kept.mean() < LEAST_SHARE:
        return left
    terms = _terms(np.where(kept, phase_rad, 0.0), height, width)
    values = np.where(kept, background, 0.0).astype(np.float32).ravel()
    use = kept.ravel()
    for _ in range(_ROUNDS):
        chosen = terms * use
        matrix = chosen @ terms.T
        matrix += _RIDGE * np.diag(np.diag(matrix))
        rest = values - np.linalg.solve(matrix, chosen @ values) @ terms
        use = kept.ravel() & (np.abs(rest) <= _KEPT_SIGMAS * robust_sd(rest[use], about=0))
    left.ravel()[use] = rest[use]
    return left


def _terms(phase: NDArray[np.floating], height: int, width: int) -> NDArray[np.float32]:
    """Return a quadratic and the harmonics at every pixel, one row for each term."""
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    turn = np.exp(1j * phase.astype(np.float64))
    powers = [turn ** (k + 1) for k in range(_HARMONICS)]
    rows = [np.ones_like(x), x, y, x * x, x * y, y * y, *(p.real for p in powers), *(p.imag for p in powers)]
    return np.array([row.ravel() for row in rows], np.float32)
