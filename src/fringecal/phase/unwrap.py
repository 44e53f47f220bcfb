"""Spatial unwrapping: most reliable neighbours first, every connected piece of the mask on its own.

The order of joining is that of Herraez et al., Appl. Opt. 41 (2002) 7437; the edges are sorted into a few
dozen buckets, within which they stay in memory order, and pieces are joined by a union-find whose
links carry whole periods.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError

_TWO_PI = 2 * np.pi
_BUCKETS = 32


@dataclass(frozen=True)
class Unwrapped:
    """A phase without jumps of 2 pi inside each connected piece.

    Parameters
    ----------
    phase
        Unwrapped phase, rad, float64, (H, W); NaN where not valid.
    pieces
        Labels 1, 2, ... of the 4-connected pieces of the mask in raster order, int32, (H, W); 0 = masked.
        The order (multiple of 2 pi) of one piece against another is not known.
    """

    phase: NDArray[np.float64]
    pieces: NDArray[np.int32]

    @property
    def n_pieces(self) -> int:
        """Return the number of pieces."""
        return int(self.pieces.max(initial=0))


def unwrap(phase: ArrayLike, valid: ArrayLike | None = None, *, quality: ArrayLike | None = None) -> Unwrapped:
    """Unwrap a phase map, joining reliable neighbours first.

    Parameters
    ----------
    phase
        Wrapped phase, rad, (H, W).
    valid
        True where the phase is to be used, (H, W); non-finite phase is never used.
    quality
        Larger where the phase is more trusted, (H, W), not negative, for example modulation or 1/u(phi);
        by default the reliability of Herraez et al.: the inverse of the wrapped second differences.

    Returns
    -------
    Unwrapped
        The first pixel of each piece, in raster order, keeps its wrapped value.

    Notes
    -----
    Right wherever true neighbours differ by less than pi along a path of reliable pixels. A step of the
    surface of more than pi inside a piece is not seen: use `unwrap_temporal` or a reference there.

    Raises
    ------
    PhaseError
        Not a 2-D map, or a mask or quality of another shape.

    Examples
    --------
    >>> ramp = np.linspace(0, 20, 50)[None, :] * np.ones((4, 1))
    >>> found = unwrap(np.angle(np.exp(1j * ramp)))
    >>> bool(np.allclose(found.phase, ramp)), found.n_pieces
    (True, 1)
    """
    wrapped = np.ascontiguousarray(phase, dtype=np.float64)
    if wrapped.ndim != 2 or wrapped.size == 0:
        raise PhaseError(f"found a phase map of shape {wrapped.shape}; unwrapping needs (height, width)")
    mask = np.isfinite(wrapped)
    if valid is not None:
        mask &= _same_shape(valid, wrapped.shape, "valid").astype(bool)
    badness = _second_differences(wrapped, mask) if quality is None else _badness(quality, wrapped.shape)
    edges = _sorted_edges(mask, _bucketed(badness, mask))
    roots, orders = _join(wrapped, edges)
    result, pieces = _finish(wrapped, mask, roots, orders)
    return Unwrapped(result, pieces)


def _same_shape(array: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray:
    """Return the array if it has the map's shape."""
    found = np.asarray(array)
    if found.shape != shape:
        raise PhaseError(f"{name} has shape {found.shape}, the phase map {shape}: give one value per pixel")
    return found


def _badness(quality: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Turn a quality into what the buckets are sorted by; unknown quality is the worst."""
    q = np.nan_to_num(_same_shape(quality, shape, "quality").astype(np.float32), nan=0.0, neginf=0.0)
    return (1 / (1e-6 + np.maximum(q, 0) / max(float(q.max(initial=0)), 1e-30))).astype(np.float32)


def _bucketed(badness: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Rank the badness of pixels into half as many ranks as there are buckets, by quantiles of a sample."""
    sample = badness[mask]
    sample = sample[:: max(1, sample.size // 20_000)]
    if sample.size == 0:
        return np.zeros(badness.shape, np.uint8)
    limits = np.quantile(sample, np.linspace(0, 1, _BUCKETS // 2 + 1)[1:-1]).astype(np.float32)
    return _rank(badness, limits)


@njit(parallel=True, cache=True)
def _rank(badness, limits):  # type: ignore[no-untyped-def]
    """Return how many of the ascending limits lie below each value."""
    height, width = badness.shape
    ranks = np.empty((height, width), np.uint8)
    for i in prange(height):
        for j in range(width):
            low, high = 0, limits.size
            while low < high:
                middle = (low + high) >> 1
                if limits[middle] < badness[i, j]:
                    low = middle + 1
                else:
                    high = middle
            ranks[i, j] = low
    return ranks


@njit(inline="always")
def _wrap(x):  # type: ignore[no-untyped-def]
    """Wrap a difference of two wrapped phases into [-pi, pi]."""
    if x > np.pi:
        return x - _TWO_PI
    return x + _TWO_PI if x < -np.pi else x


@njit(inline="always")
def _bend(left, centre, right):  # type: ignore[no-untyped-def]
    """Return the squared wrapped second difference of three neighbours."""
    d = _wrap(left - centre) - _wrap(centre - right)
    return d * d


@njit(parallel=True, cache=True)
def _second_differences(phase, mask):  # type: ignore[no-untyped-def]
    """Return the sum of squared second differences in four directions; the worst where one is missing."""
    height, width = phase.shape
    bend = np.full((height, width), np.float32(1e6))
    for i in prange(1, height - 1):
        for j in range(1, width - 1):
            if mask[i - 1 : i + 2, j - 1 : j + 2].all():
                p = phase[i, j]
                total = _bend(phase[i, j - 1], p, phase[i, j + 1]) + _bend(phase[i - 1, j], p, phase[i + 1, j])
                total += _bend(phase[i - 1, j - 1], p, phase[i + 1, j + 1])
                total += _bend(phase[i - 1, j + 1], p, phase[i + 1, j - 1])
                bend[i, j] = total
    return bend


@njit(inline="always")
def _edge_bucket(mask, ranks, i, j, down):  # type: ignore[no-untyped-def]
    """Return the bucket of the edge to the right of, or down from, a valid pixel; -1 if there is none."""
    k, m = (i + 1, j) if down else (i, j + 1)
    if k >= mask.shape[0] or m >= mask.shape[1] or not mask[k, m]:
        return -1
    return np.int64(ranks[i, j]) + np.int64(ranks[k, m])


@njit(cache=True)
def _sorted_edges(mask, ranks):  # type: ignore[no-untyped-def]
    """Sort all edges by the sum of their pixels' ranks (counting sort); edge = 2 pixel + (1 if downward)."""
    height, width = mask.shape
    starts = np.zeros(_BUCKETS + 1, np.int64)
    edges = np.empty(0, np.int64)
    for filling in (False, True):
        if filling:
            starts = np.cumsum(starts)
            edges = np.empty(starts[-1], np.int64)
        for i in range(height):
            for j in range(width):
                for down in range(2 if mask[i, j] else 0):
                    bucket = _edge_bucket(mask, ranks, i, j, down == 1)
                    if bucket >= 0 and filling:
                        edges[starts[bucket]] = 2 * (i * width + j) + down
                        starts[bucket] += 1
                    elif bucket >= 0:
                        starts[bucket + 1] += 1
    return edges


@njit(inline="always")
def _find(parent, order, pixel):  # type: ignore[no-untyped-def]
    """Return the root of a pixel and its order against it, halving the path on the way."""
    total = 0
    while parent[pixel] != pixel:
        above = parent[pixel]
        order[pixel] += order[above]
        parent[pixel] = parent[above]
        total += order[pixel]
        pixel = parent[pixel]
    return pixel, total


@njit(cache=True)
def _join(phase, edges):  # type: ignore[no-untyped-def]
    """Join pixels edge by edge; return each pixel's root and its whole periods against that root."""
    width = phase.shape[1]
    flat = phase.ravel()
    parent = np.arange(flat.size).astype(np.int32)
    size = np.ones(flat.size, np.int32)
    order = np.zeros(flat.size, np.int32)
    for edge in edges:
        p = edge >> 1
        q = p + (width if edge & 1 else 1)
        root_p, order_p = _find(parent, order, p)
        root_q, order_q = _find(parent, order, q)
        if root_p != root_q:
            # Periods to add to q's piece so that p and q differ by less than half a period.
            jump = np.int32(np.rint((flat[p] - flat[q]) / _TWO_PI)) + order_p - order_q
            if size[root_p] < size[root_q]:
                root_p, root_q, jump = root_q, root_p, -jump
            parent[root_q] = root_p
            order[root_q] = jump
            size[root_p] += size[root_q]
    for pixel in range(flat.size):
        root, total = _find(parent, order, pixel)
        parent[pixel] = root
        order[pixel] = total if root != pixel else 0
    return parent, order


@njit(cache=True)
def _finish(phase, mask, roots, orders):  # type: ignore[no-untyped-def]
    """Add the periods and label the pieces, the first pixel of each keeping its wrapped value."""
    height, width = phase.shape
    result = np.full((height, width), np.nan)
    pieces = np.zeros((height, width), np.int32)
    label = np.zeros(height * width, np.int32)
    first = np.zeros(height * width, np.int32)
    count = 0
    for i in range(height):
        for j in range(width):
            if mask[i, j]:
                pixel = i * width + j
                root = roots[pixel]
                if label[root] == 0:
                    count += 1
                    label[root] = count
                    first[root] = orders[pixel]
                pieces[i, j] = label[root]
                result[i, j] = phase[i, j] + _TWO_PI * (orders[pixel] - first[root])
    return result, pieces
