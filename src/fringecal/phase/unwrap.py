"""Spatial unwrapping: most reliable neighbours first, every connected piece of the mask on its own.

The order of joining is that of Herraez et al., Appl. Opt. 41 (2002) 7437, by classes of quality: neighbours
are joined class by class, in raster order within a class, and pieces are kept by a union-find whose links
carry whole periods. Sweeps over the picture join the better 96 % of the pixels, at a few nanoseconds each;
only the links that are still open then are sorted.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError

_TWO_PI = 2 * np.pi
_PER_TURN = 1 / _TWO_PI
_FAST = {"nsz", "contract"}  # NaN marks masked pixels and must survive
_SWEEPS = (0.5, 0.7, 0.85, 0.96)
"""Shares of the pixels, the best first, that are joined by sweeps; what is left is joined link by link.

The first must lie below 0.59, where random pixels of a square lattice hang together: above it, one sweep in
raster order would join the whole picture, across edges too.
"""
_CLASSES = (*_SWEEPS, 0.98, 0.99, 0.995, 0.9975)
_MASKED = np.uint8(255)
_SAMPLE_PIXELS = 20_000


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
    wrapped = np.asarray(phase)
    if wrapped.ndim != 2 or wrapped.size == 0:
        raise PhaseError(f"found a phase map of shape {wrapped.shape}; unwrapping needs (height, width)")
    wrapped = wrapped.astype(np.float32 if wrapped.dtype == np.float32 else np.float64, order="C")
    if valid is not None:
        wrapped[~_same_shape(valid, wrapped.shape, "valid").astype(bool)] = np.nan
    badness = _second_differences(wrapped) if quality is None else _badness(quality, wrapped.shape)
    classes = _classified(badness, wrapped)
    parent = np.arange(wrapped.size, dtype=np.int32)
    order = np.zeros(wrapped.size, np.int32)
    _first_sweep(wrapped, classes, parent, order)
    for worst in range(1, len(_SWEEPS)):
        _sweep(wrapped, classes, worst, parent, order)
    _join_links(wrapped, _open_links(classes, parent, order), parent, order)
    return Unwrapped(*_finish(wrapped, classes, parent, order, _flatten(classes, parent, order)))


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


def _classified(badness: NDArray[np.float32], wrapped: NDArray) -> NDArray[np.uint8]:
    """Rank the badness of pixels by quantiles of a sample; masked pixels get a class of their own."""
    step = max(1, int(np.sqrt(badness.size / _SAMPLE_PIXELS)))
    sample = badness[::step, ::step]
    sample = sample[np.isfinite(sample)]
    limits = np.quantile(sample, _CLASSES) if sample.size else np.zeros(len(_CLASSES))
    return _classify(badness, wrapped, limits.astype(np.float32))


@njit(parallel=True, cache=True, fastmath=_FAST)
def _classify(badness, wrapped, limits):  # type: ignore[no-untyped-def]
    """Count the limits that are not above each value, which a NaN exceeds all."""
    height, width = badness.shape
    classes = np.empty((height, width), np.uint8)
    for i in prange(height):
        here, phases, mine = badness[i], wrapped[i], classes[i]
        rank = np.zeros(width, np.float32)
        for limit in limits:
            for j in range(width):
                rank[j] += np.float32(0) if here[j] <= limit else np.float32(1)
        for j in range(width):
            rank[j] = rank[j] if abs(phases[j]) < np.inf else np.float32(_MASKED)
            mine[j] = np.uint8(np.int32(rank[j]))
    return classes


@njit(inline="always", fastmath=_FAST)
def _bend(left, centre, right):  # type: ignore[no-untyped-def]
    """Return the squared wrapped second difference of three neighbours."""
    one, two = left - centre, centre - right
    one -= np.float32(_TWO_PI) * np.rint(one * np.float32(_PER_TURN))
    two -= np.float32(_TWO_PI) * np.rint(two * np.float32(_PER_TURN))
    return (one - two) * (one - two)


@njit(parallel=True, cache=True, fastmath=_FAST)
def _second_differences(phase):  # type: ignore[no-untyped-def]
    """Return the sum of squared second differences in four directions; NaN where a neighbour is missing."""
    height, width = phase.shape
    bend = np.full((height, width), np.float32(np.nan))
    for i in prange(1, height - 1):
        above, here, below = phase[i - 1], phase[i], phase[i + 1]
        for j in range(1, width - 1):
            p = np.float32(here[j])
            total = _bend(np.float32(here[j - 1]), p, np.float32(here[j + 1]))
            total += _bend(np.float32(above[j]), p, np.float32(below[j]))
            total += _bend(np.float32(above[j - 1]), p, np.float32(below[j + 1]))
            bend[i, j] = total + _bend(np.float32(above[j + 1]), p, np.float32(below[j - 1]))
    return bend


@njit(inline="always")
def _find(parent, order, pixel):  # type: ignore[no-untyped-def]
    """Return the root of a pixel and its order against it, halving the path on the way."""
    total = 0
    while True:
        above = parent[pixel]
        top = parent[above]
        if top == above:
            # The root, or one that hangs on it; the order of a root is 0.
            return above, total + order[pixel]
        order[pixel] += order[above]
        parent[pixel] = top
        total += order[pixel]
        pixel = top


@njit(inline="always")
def _join(flat, p, q, at_p, at_q, parent, order):  # type: ignore[no-untyped-def]
    """Join the pieces of neighbours p and q, whose roots and orders are known; return q's root and order.

    The root of a piece is its first pixel in raster order.
    """
    (root_p, order_p), (root_q, order_q) = at_p, at_q
    if root_p == root_q:
        return at_q
    # Periods to add to q's piece so that p and q differ by less than half a period.
    jump = np.int64(np.rint((flat[p] - flat[q]) * _PER_TURN)) + order_p - order_q
    if root_p < root_q:
        parent[root_q], order[root_q] = root_p, jump
        return root_p, order_q + jump
    parent[root_p], order[root_p] = root_q, -jump
    return at_q


@njit(cache=True)
def _sweep(phase, classes, worst, parent, order):  # type: ignore[no-untyped-def]
    """Join those neighbours, to the left and above, of which the worse pixel is of one class."""
    width = phase.shape[1]
    flat = phase.ravel()
    for i in range(phase.shape[0]):
        known, at = -2, _find(parent, order, i * width)  # the pixel whose root and order were found last
        for j in range(width):
            mine, pixel = classes[i, j], i * width + j
            beside = j > 0 and max(classes[i, j - 1], mine) == worst
            above = i > 0 and max(classes[i - 1, j], mine) == worst
            if beside or above:
                left, at = at, _find(parent, order, pixel)
                if beside:
                    if known != pixel - 1:
                        left = _find(parent, order, pixel - 1)
                    at = _join(flat, pixel - 1, pixel, left, at, parent, order)
                if above:
                    up = _find(parent, order, pixel - width)
                    at = _join(flat, pixel - width, pixel, up, at, parent, order)
                known = pixel


@njit(cache=True)
def _first_sweep(phase, classes, parent, order):  # type: ignore[no-untyped-def]
    """Do the same as `_sweep` for class 0, where a pixel that is new needs no search for its root."""
    width = phase.shape[1]
    flat, kind = phase.ravel(), classes.ravel()
    for start in range(0, phase.size, width):
        connected, root, mine = False, start, np.int64(0)
        for pixel in range(start, start + width):
            if kind[pixel] != 0:
                connected = False
                continue
            if connected:
                mine += np.int64(np.rint((flat[pixel - 1] - flat[pixel]) * _PER_TURN))
            else:
                connected, root, mine = True, pixel, np.int64(0)
            parent[pixel], order[pixel] = root, mine
            up = pixel - width
            if start > 0 and kind[up] == 0:
                at = _find(parent, order, up)
                if at[0] != root:
                    root, mine = _join(flat, up, pixel, at, (root, mine), parent, order)


@njit(cache=True)
def _open_links(classes, parent, order):  # type: ignore[no-untyped-def]
    """Sort the links between pixels of different pieces, the best first; link = 2 pixel + (1 if downward)."""
    height, width = classes.shape
    found = np.empty(4 * (classes >= len(_SWEEPS)).sum(), np.int64)
    buckets = np.empty(found.size, np.uint8)
    starts = np.zeros(2 * len(_CLASSES) + 2, np.int64)
    count = 0
    for i in range(height):
        for j in range(width):
            for down in range(2):
                k, m = i + down, j + 1 - down
                if k == height or m == width:
                    continue
                worse = max(classes[i, j], classes[k, m])
                if worse < len(_SWEEPS) or worse == _MASKED:
                    continue
                pixel = i * width + j
                if _find(parent, order, pixel)[0] != _find(parent, order, k * width + m)[0]:
                    found[count] = 2 * pixel + down
                    buckets[count] = classes[i, j] + classes[k, m]
                    starts[buckets[count] + 1] += 1
                    count += 1
    return _counting_sorted(found[:count], buckets, np.cumsum(starts))


@njit(cache=True)
def _counting_sorted(values, buckets, starts):  # type: ignore[no-untyped-def]
    """Sort values by bucket, those of one bucket in their old order."""
    result = np.empty_like(values)
    for k in range(values.size):
        result[starts[buckets[k]]] = values[k]
        starts[buckets[k]] += 1
    return result


@njit(cache=True)
def _join_links(phase, links, parent, order):  # type: ignore[no-untyped-def]
    """Join pixels link by link."""
    width = phase.shape[1]
    flat = phase.ravel()
    for link in links:
        p = link >> 1
        q = p + (width if link & 1 else 1)
        _join(flat, p, q, _find(parent, order, p), _find(parent, order, q), parent, order)


@njit(cache=True)
def _flatten(classes, parent, order):  # type: ignore[no-untyped-def]
    """Let every pixel point to its root, and number the roots in raster order; return the numbers."""
    flat = classes.ravel()
    labels = np.zeros(flat.size, np.int32)
    count = 0
    for pixel in range(flat.size):
        above = parent[pixel]
        if above != pixel:
            # A root comes before its pixels, so whatever this one points to is settled.
            order[pixel] += order[above]
            parent[pixel] = parent[above]
        elif flat[pixel] != _MASKED:
            count += 1
            labels[pixel] = count
    return labels


@njit(parallel=True, cache=True)
def _finish(phase, classes, parent, order, labels):  # type: ignore[no-untyped-def]
    """Add the periods and label the pieces; the first pixel of each keeps its wrapped value."""
    height, width = phase.shape
    result = np.empty((height, width))
    pieces = np.empty((height, width), np.int32)
    for i in prange(height):
        for j in range(width):
            pixel = i * width + j
            masked = classes[i, j] == _MASKED
            result[i, j] = np.nan if masked else phase[i, j] + _TWO_PI * order[pixel]
            pieces[i, j] = 0 if masked else labels[parent[pixel]]
    return result, pieces
