"""Unwrapping over edges: smooth regions first, then regions joined where their common border agrees.

Where a surface breaks off, a path from pixel to pixel picks up any multiple of 2 pi, and some pixel of the edge
always looks harmless because the jump there happens to be a whole number of fringes. So the picture is cut into
regions in which the phase is smooth, and two regions are joined only if the pixels along their common border
agree on one order with only a small step left: a fold does, an edge does not.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.phase.unwrapping import joining
from fringecal.phase.unwrapping.borders import join_regions
from fringecal.phase.unwrapping.flooding import add_orders, drop_crumbs, flood, smooth_pixels
from fringecal.phase.unwrapping.spatial import Unwrapped, unwrap

_LEAST_PIXELS = 25  # of a region, one square of the opening that finds them; smaller ones go to their neighbours
_QUIET_RAD = 0.1  # noise of the curvature up to which neighbours in a smooth region never differ by half a fringe


def unwrap_regions(phase: ArrayLike, valid: ArrayLike) -> Unwrapped:
    """Unwrap smooth regions and join those whose common border agrees on an order.

    Parameters
    ----------
    phase
        Wrapped phase, rad, (H, W); best the object's minus the plate's, which is small and slow.
    valid
        True where the phase is to be used, (H, W).

    Returns
    -------
    Unwrapped
        `pieces` numbers what is connected: the order of one piece against another is open.

    Notes
    -----
    An edge whose jump lies within some 0.15 rad (more where the surface is curved or noisy) of whole fringes along most
    of its length looks like a surface that touches its neighbour there, and is taken for one.
    """
    single = np.array(phase, np.float32)
    single[~(np.asarray(valid, dtype=bool) & np.isfinite(single))] = np.nan
    smooth, noise = smooth_pixels(single)
    values, labels = _cores(single, smooth, noise)
    number = drop_crumbs(labels, int(labels.max(initial=0)), _LEAST_PIXELS)
    if number == 0:
        return unwrap(single)
    flood(values, labels, single)
    offsets, groups = join_regions(values, labels)
    add_orders(values, labels, offsets, _numbered(groups))
    return Unwrapped(values, labels)


def _cores(
    phase: NDArray[np.float32], smooth: NDArray[np.uint8], noise: float
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Unwrap the smooth pixels; where they are quiet too, all paths agree and no order of joining is needed."""
    if noise > _QUIET_RAD:
        found = unwrap(phase, smooth)
        return found.phase, found.pieces
    classes = np.where(smooth, np.uint8(0), joining.MASKED).reshape(-1)
    nodes = joining.join_best(phase.reshape(-1), classes, phase.shape[1])
    joining.hang_on_roots(nodes, phase.shape[1])
    pieces = joining.number_roots(nodes, classes)
    return joining.add_periods(phase, classes, nodes, pieces), pieces.reshape(phase.shape)


def _numbered(groups: NDArray[np.int32]) -> NDArray[np.int32]:
    """Number groups of labels 1, 2, ... in the order of their first label, which is that of the raster."""
    _, first, inverse = np.unique(groups[1:], return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.concatenate([[0], rank[inverse] + 1]).astype(np.int32)
