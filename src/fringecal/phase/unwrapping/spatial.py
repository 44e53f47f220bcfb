"""Spatial unwrapping: most reliable neighbours first, every connected piece of the mask on its own.

The order of joining is that of Herraez et al., Appl. Opt. 41 (2002) 7437, by classes of quality: neighbours
are joined class by class, in raster order within a class (`joining`).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, over_bands
from fringecal.phase.unwrapping import joining

_PER_TURN = 1 / TURN
_FAST = {"nsz", "contract"}  # NaN marks masked pixels and must survive
_CLASSES = (0.5, 0.7, 0.85, 0.96, 0.98, 0.99, 0.995, 0.9975)
"""Shares of the pixels, the best first, that part the classes.

The first must lie below 0.59, where random pixels of a square lattice are connected: above it, joining one class in
raster order would join the whole picture, across edges too.
"""
_SAMPLE_PIXELS = 20_000  # that the shares are taken from: the share of 0.5 is then met to 0.4 %
_NONE = 1e-30  # instead of a division by 0, where no pixel has any quality
_NO_QUALITY = 1e-6  # of the best quality, added to all: a quality of 0 is bad, and not infinitely so


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
    if wrapped.size > joining.MAX_PIXELS:
        raise PhaseError(f"found {wrapped.size} pixels; unwrapping takes {joining.MAX_PIXELS}: unwrap parts of the map")
    wrapped = np.ascontiguousarray(wrapped, None if wrapped.dtype == np.float32 else np.float64)
    single = _single(wrapped, valid)
    badness = _second_differences(single) if quality is None else _badness(quality, wrapped.shape)
    classes, width = _classified(badness, single).reshape(-1), wrapped.shape[1]
    nodes = joining.join_best(single.reshape(-1), classes, width)
    joining.join_links(single.reshape(-1), width, joining.sorted_links(classes, width), nodes)
    joining.hang_on_roots(nodes, width)
    pieces = joining.number_roots(nodes, classes)
    return Unwrapped(joining.add_periods(wrapped, classes, nodes, pieces), pieces.reshape(wrapped.shape))


def _single(wrapped: NDArray, valid: ArrayLike | None) -> NDArray[np.float32]:
    """Return the phase that orders are decided with: float32, NaN where it is not to be used."""
    with np.errstate(over="ignore"):  # what float32 cannot hold is no phase, and masked
        single = wrapped.astype(np.float32, copy=valid is not None)
    if valid is not None:
        single[~_same_shape(valid, wrapped.shape, "valid").astype(bool)] = np.nan
    return single


def _same_shape(array: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray:
    """Return the array if it has the map's shape."""
    found = np.asarray(array)
    if found.shape != shape:
        raise PhaseError(f"{name} has shape {found.shape}, the phase map {shape}: give one value per pixel")
    return found


def _badness(quality: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Turn a quality into what the buckets are sorted by; unknown quality is the worst."""
    q = np.nan_to_num(_same_shape(quality, shape, "quality").astype(np.float32), nan=0.0, neginf=0.0)
    return (1 / (_NO_QUALITY + np.maximum(q, 0) / max(float(q.max(initial=0)), _NONE))).astype(np.float32)


def _classified(badness: NDArray[np.float32], wrapped: NDArray) -> NDArray[np.uint8]:
    """Rank the badness of pixels by quantiles of a sample; masked pixels get a class of their own."""
    step = max(1, int(np.sqrt(badness.size / _SAMPLE_PIXELS)))
    sample = badness[::step, ::step]
    sample = sample[np.isfinite(sample)]
    limits = np.quantile(sample, _CLASSES) if sample.size else np.zeros(len(_CLASSES))
    classes = np.empty(badness.shape, np.uint8)
    over_bands(_classify, len(classes), badness, wrapped, limits.astype(np.float32), classes)
    return classes


@njit(nogil=True, cache=True, fastmath=_FAST)
def _classify(first, last, badness, wrapped, limits, classes):  # type: ignore[no-untyped-def]
    """Count the limits that are not above each value of some rows, which a NaN exceeds all."""
    width = badness.shape[1]
    for i in range(first, last):
        here, phases, mine = badness[i], wrapped[i], classes[i]
        rank = np.zeros(width, np.float32)
        for limit in limits:
            for j in range(width):
                rank[j] += np.float32(0) if here[j] <= limit else np.float32(1)
        for j in range(width):
            rank[j] = rank[j] if abs(phases[j]) < np.inf else np.float32(joining.MASKED)
            mine[j] = np.uint8(np.int32(rank[j]))


@njit(inline="always", fastmath=_FAST)
def _curvature(left, centre, right):  # type: ignore[no-untyped-def]
    """Return the squared wrapped second difference of three neighbours."""
    one, two = left - centre, centre - right
    one -= np.float32(TURN) * np.rint(one * np.float32(_PER_TURN))
    two -= np.float32(TURN) * np.rint(two * np.float32(_PER_TURN))
    return (one - two) * (one - two)


def _second_differences(phase: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the sum of squared second differences in four directions; NaN where a neighbour is missing."""
    curvature = np.full(phase.shape, np.float32(np.nan))
    over_bands(_sum_squares, len(phase), phase, curvature)
    return curvature


@njit(nogil=True, cache=True, fastmath=_FAST)
def _sum_squares(first, last, phase, curvature):  # type: ignore[no-untyped-def]
    """Write the sums of some rows."""
    height, width = phase.shape
    for i in range(max(first, 1), min(last, height - 1)):
        above, here, below = phase[i - 1], phase[i], phase[i + 1]
        for j in range(1, width - 1):
            p = np.float32(here[j])
            total = _curvature(np.float32(here[j - 1]), p, np.float32(here[j + 1]))
            total += _curvature(np.float32(above[j]), p, np.float32(below[j]))
            total += _curvature(np.float32(above[j - 1]), p, np.float32(below[j + 1]))
            curvature[i, j] = total + _curvature(np.float32(above[j + 1]), p, np.float32(below[j - 1]))
