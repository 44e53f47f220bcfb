"""Unwrapping over edges: smooth regions first, then regions joined where their common border agrees.

Where a surface breaks off, a path from pixel to pixel picks up any multiple of 2 pi, and some pixel of the edge
always looks harmless because the jump there happens to be a whole number of fringes. So the picture is cut into
regions in which the phase is smooth, and two regions are joined only if the pixels along their common border
agree on one order with only a small step left: a fold does, an edge does not.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from fringecal.phase.borders import join_regions
from fringecal.phase.unwrap import Unwrapped, unwrap

Array = NDArray[np.float64]

_TWO_PI = 2 * np.pi
_BEND_LIMITS_RAD = (0.12, 0.45)  # change of slope over three px above which the smoothed phase is cut
_BEND_SIGMAS = 6.0  # of the noise, between those limits
_LEAST_PIXELS = 25  # of a region; smaller ones are given to their neighbours


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
        `pieces` numbers what hangs together: the order of one piece against another is open.

    Notes
    -----
    An edge whose jump lies within some 0.15 rad (more where the surface is curved or noisy) of whole fringes along most
    of its length looks like a surface that touches its neighbour there, and is taken for one.
    """
    wrapped = np.asarray(phase, dtype=float)
    usable = np.asarray(valid, dtype=bool) & np.isfinite(wrapped)
    wrapped = np.where(usable, wrapped, 0.0)
    cores = unwrap(wrapped, _smooth(wrapped, usable))
    labels = _without_crumbs(cores.pieces)
    values = np.where(labels > 0, cores.phase, 0.0)
    if labels.max(initial=0) == 0:
        return unwrap(wrapped, usable)
    _flood(values, labels, wrapped, usable)
    offsets, groups = join_regions(values, labels)
    result = np.where(labels > 0, values + _TWO_PI * offsets[labels], np.nan)
    return Unwrapped(result, _numbered(np.where(labels > 0, groups[labels], 0)))


def _smooth(wrapped: Array, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels around which the phase bends nowhere sharply."""
    field = np.where(usable, np.exp(1j * wrapped), 0)
    size = (3, 3)
    mean = ndimage.uniform_filter(field.real, size) + 1j * ndimage.uniform_filter(field.imag, size)
    smooth = ndimage.binary_erosion(usable, np.ones(size, dtype=bool))
    for axis in (0, 1):
        slope = np.angle(np.roll(mean, -1, axis) * np.conj(mean))
        bend = np.abs(np.roll(slope, -1, axis) - np.roll(slope, 2, axis))
        bend = np.minimum(bend, _TWO_PI - bend)
        noise = 1.4826 * float(np.median(bend[usable])) if usable.any() else 0.0
        smooth &= bend < np.clip(_BEND_SIGMAS * noise, *_BEND_LIMITS_RAD)
    # The mean over nine pixels shrinks where they disagree: an edge, whatever its bend.
    smooth &= np.abs(mean) > 0.6
    # A bridge over an edge, where the jump happens to be whole fringes, is a few pixels wide: it must not stay.
    return ndimage.binary_erosion(smooth, np.ones((5, 5), dtype=bool))


def _without_crumbs(pieces: NDArray[np.int32]) -> NDArray[np.int32]:
    sizes = np.bincount(pieces.ravel())
    keep = sizes >= _LEAST_PIXELS
    keep[0] = False
    numbers = np.where(keep, np.cumsum(keep), 0).astype(np.int32)
    return numbers[pieces]


@njit(cache=True)
def _flood(values, labels, wrapped, usable):  # type: ignore[no-untyped-def]
    """Grow all regions ring by ring over the pixels left, each continuing from the pixel it is reached from."""
    height, width = labels.shape
    queue_v = np.empty(height * width, np.int32)
    queue_u = np.empty(height * width, np.int32)
    tail = 0
    for v in range(height):
        for u in range(width):
            if labels[v, u] > 0:
                queue_v[tail] = v
                queue_u[tail] = u
                tail += 1
    head = 0
    while head < tail:
        v, u = queue_v[head], queue_u[head]
        head += 1
        for dv, du in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            y, x = v + dv, u + du
            if 0 <= y < height and 0 <= x < width and usable[y, x] and labels[y, x] == 0:
                difference = (values[v, u] - wrapped[y, x]) / _TWO_PI
                values[y, x] = wrapped[y, x] + _TWO_PI * np.floor(difference + 0.5)
                labels[y, x] = labels[v, u]
                queue_v[tail] = y
                queue_u[tail] = x
                tail += 1


def _numbered(groups: NDArray[np.int32]) -> NDArray[np.int32]:
    """Number the groups 1, 2, ... in the order in which the raster meets them."""
    found, first = np.unique(groups, return_index=True)
    numbers = np.zeros(int(groups.max(initial=0)) + 1, dtype=np.int32)
    count = 0
    for group in found[np.argsort(first)]:
        if group > 0:
            count += 1
            numbers[group] = count
    return numbers[groups]
