"""Unwrapping over edges: smooth regions first, then regions joined where their common border agrees.

Where a surface breaks off, a path from pixel to pixel picks up any multiple of 2 pi, and some pixel of the edge
always looks harmless because the jump there happens to be a whole number of fringes. So the picture is cut into
regions in which the phase is smooth, and two regions are joined only if the pixels along their common border
agree on one order with only a small step left: a fold does, an edge does not.
"""

from collections import Counter, defaultdict
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from fringecal.phase.unwrap import Unwrapped, unwrap

Array = NDArray[np.float64]

_TWO_PI = 2 * np.pi
_BEND_LIMITS_RAD = (0.12, 0.45)  # change of slope over three px above which the smoothed phase is cut
_BEND_SIGMAS = 6.0  # of the noise, between those limits
_LEAST_PIXELS = 25  # of a region; smaller ones are given to their neighbours
_LEAST_BORDER = 5  # pixel pairs
_LEAST_LEAD = 1.5  # how many times more pixel pairs lie in stretches that agree than in all others
_OF_ONE_MIND = 0.75  # share of a stretch's pixel pairs that must agree on the order
_GREATEST_STEP_RAD = 2.0  # median step left over a border that is no edge, the slope's share in it
_CELL_PX = 16  # side of the cells into which borders are cut


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
    An edge whose jump stays within about half a radian of whole fringes over more than six pixels looks like a surface
    that touches its neighbour there, and is taken for one.
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
    offsets, groups = _join(values, labels)
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


@dataclass(frozen=True)
class _Border:
    """Border of two touching regions a < b: the order that b lacks, and the pixel pairs for and against it."""

    a: int
    b: int
    order: int
    agreeing: int
    others: int

    @property
    def trusted(self) -> bool:
        """Tell whether the border is a fold, or almost all of it is."""
        return self.agreeing >= max(_LEAST_BORDER, _LEAST_LEAD * self.others)


def _pairs(values: Array, labels: NDArray[np.int32]) -> NDArray[np.int64]:
    """List the pixel pairs over all borders: regions a < b, cell of the picture, order lacking, small or not."""
    found = []
    v, u = np.indices(labels.shape)
    cells = (v // _CELL_PX) * (labels.shape[1] // _CELL_PX + 1) + u // _CELL_PX
    for axis in (0, 1):
        one, phases, cell = (np.moveaxis(m, axis, 0) for m in (labels, values, cells))
        first, second = one[:-1], one[1:]
        at = (first != second) & (first > 0) & (second > 0)
        jump = np.where(first > second, -1, 1)[at] * (phases[:-1] - phases[1:])[at]
        order = np.floor(jump / _TWO_PI + 0.5)
        small = np.abs(jump - _TWO_PI * order) < _GREATEST_STEP_RAD
        low, high = np.minimum(first, second)[at], np.maximum(first, second)[at]
        found.append(np.column_stack([low, high, cell[:-1][at], order, small]))
    return np.concatenate(found).astype(np.int64)


def _borders(values: Array, labels: NDArray[np.int32]) -> list[_Border]:
    """Judge every border cell by cell: a cell votes if nearly all of its pixel pairs are of one mind.

    Along a true edge the steps left over are of any size, and where they happen to be small that is so over a short
    stretch only; along a fold they are small throughout.
    """
    pairs = _pairs(values, labels)
    cells, inverse = np.unique(pairs[:, :3], axis=0, return_inverse=True)
    total = np.bincount(inverse.ravel(), minlength=len(cells))
    votes, at = np.unique(pairs[:, :4], axis=0, return_inverse=True)
    number = np.bincount(at.ravel(), minlength=len(votes))
    small = np.bincount(at.ravel(), weights=pairs[:, 4], minlength=len(votes))
    agreeing: dict[tuple[int, int], Counter[int]] = defaultdict(Counter)
    sizes: Counter[tuple[int, int]] = Counter()
    of_cell = {tuple(c): int(n) for c, n in zip(cells.tolist(), total, strict=True)}
    for (a, b, _), n in of_cell.items():
        sizes[a, b] += n
    for (a, b, cell, order), n, few in zip(votes.tolist(), number.tolist(), small.tolist(), strict=True):
        if n >= _OF_ONE_MIND * of_cell[a, b, cell] and few >= 0.5 * n:
            agreeing[a, b][order] += n
    best = ((pair, *max(found.items(), key=lambda f: (f[1], -abs(f[0])))) for pair, found in agreeing.items())
    return [_Border(a, b, order, n, sizes[a, b] - n) for (a, b), order, n in best]


def _join(values: Array, labels: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Join regions over trusted borders, the longest first; return each region's order and group."""
    number = int(labels.max())
    offsets = np.zeros(number + 1, dtype=np.int64)
    groups = np.arange(number + 1, dtype=np.int32)
    trusted = [border for border in _borders(values, labels) if border.trusted]
    for border in sorted(trusted, key=lambda x: (x.others - x.agreeing, x.a, x.b)):
        if groups[border.a] != groups[border.b]:
            inside = groups == groups[border.b]
            offsets[inside] += border.order + offsets[border.a] - offsets[border.b]
            groups[inside] = groups[border.a]
    return offsets, groups


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
