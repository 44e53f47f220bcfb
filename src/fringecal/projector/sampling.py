"""Which pixels of a region go into a fit, and which of them are correlated."""

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import DRAW_SEED

Array = NDArray[np.float64]

_BLOCK_PX = (
    24  # side of the blocks of neighbours whose residuals are correlated: about two fringes, whose ripple they share
)
_BLOCK_ROW = 100_000  # in a block's number: more than a picture has blocks beside one another
OUTLIER_SDS = 4.5
"""Robust standard deviations from the rest beyond which a point is left out of a fit: 7 in a million of normally
distributed ones are."""


def pick_points(
    inside: NDArray[np.bool_], number: int, *, seed: int = DRAW_SEED
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Draw pixels of a region evenly, with the number of the block of neighbours that each lies in.

    Parameters
    ----------
    inside
        The region, shape (H, W).
    number
        How many pixels at most.
    seed
        Of the draw.

    Returns
    -------
    u_px, v_px, cluster
        In the order of the raster.

    Examples
    --------
    >>> u, v, cluster = pick_points(np.ones((4, 5), bool), 100)
    >>> len(u), int(u.max()), int(v.max())
    (20, 4, 3)
    """
    v, u = np.nonzero(inside)
    # A fixed stride over the raster would walk along columns: a draw has no such beat with fringes.
    chosen = np.sort(np.random.default_rng(seed).permutation(v.size)[:number])
    v, u = v[chosen], u[chosen]
    cluster = (v // _BLOCK_PX) * _BLOCK_ROW + u // _BLOCK_PX
    return u.astype(float), v.astype(float), cluster.astype(np.intp)
