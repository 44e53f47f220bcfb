"""Pieces of a surface that continue one another over a gap: counted together where slope and phase go on alike."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.numerics import TURN
from fringecal.phase.unwrapping.spatial import Unwrapped

_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # places of the sums 1, y, x, yy, yx, xx in a normal matrix
_SPREAD = 1.2533  # standard error of a median over that of a mean


@dataclass(frozen=True)
class LinkRules:
    """When two pieces are one surface. Phases in fringes.

    Parameters
    ----------
    gap
        Widest gap, share of the picture's shorter side.
    places
        Places along the gap that decide: fewer may be chance.
    reach_px
        Pixels to each side whose plane is the piece's slope at its border.
    off, off_sigmas
        Most by which the pieces miss each other half way across the gap, beside the scatter of this mean: with a
        cycle of eight fringes one jump in eighty is as near to whole cycles by chance.
    scatter
        Most scatter of that along the gap, robust: a surface at another height runs at another distance.
    bend
        Most that both slopes differ by, times the width of the gap: what is left of it after meeting half way is the
        third derivative, a sixth of it or less.
    """

    gap: float = 0.2
    places: int = 8
    reach_px: int = 6
    off: float = 0.05
    off_sigmas: float = 3.0
    scatter: float = 0.12
    bend: float = 0.4


LINK_RULES = LinkRules()


def linked_pieces(found: Unwrapped, cycle: int, *, rules: LinkRules = LINK_RULES) -> Unwrapped:
    """Count pieces together that continue one another over gaps.

    Parameters
    ----------
    found
        Pieces that are each continuous, rad, known against one another up to cycles.
    cycle
        Fringes of a cycle.
    rules
        When two pieces are one surface.

    Returns
    -------
    Unwrapped
        The same phases with whole cycles added, and labels of what is counted together.
    """
    if found.n_pieces < 2:  # noqa: PLR2004 -- nothing to be linked
        return found
    here, there = _across(found.pieces, rules.gap * min(found.pieces.shape))
    values, slopes = _planes(found, np.concatenate([here, there]), rules.reach_px)
    number = len(here)
    jumps = _jumps(here, there, values, slopes)
    bends = np.abs(np.einsum("ij,ij->i", slopes[:number] - slopes[number:], there - here)) / TURN
    pairs = np.stack([found.pieces[tuple(here.T)], found.pieces[tuple(there.T)]])
    cycles, groups = _joined(pairs, jumps / (TURN * cycle), bends, cycle, found.n_pieces, rules)
    shift = np.concatenate([[0.0], cycles]) * TURN * cycle
    labels = np.concatenate([[0], groups]).astype(np.int32)
    return Unwrapped(found.phase + shift[found.pieces], labels[found.pieces])


def _across(pieces: NDArray[np.int32], widest: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the ends (row, column) of lines across gaps: the pixels of two pieces nearest to a place between them."""
    place = ndimage.distance_transform_edt(pieces == 0, return_distances=False, return_indices=True)
    ends = []
    for axis in (0, 1):
        first = place.take(range(pieces.shape[axis] - 1), axis + 1)
        second = place.take(range(1, pieces.shape[axis]), axis + 1)
        between = pieces[tuple(first)] != pieces[tuple(second)]
        ends.append(np.stack([first[:, between], second[:, between]]))
    here, there = np.concatenate(ends, axis=2).astype(np.int64).transpose(0, 2, 1)
    swapped = pieces[tuple(here.T)] > pieces[tuple(there.T)]
    here[swapped], there[swapped] = there[swapped], here[swapped]
    near = np.hypot(*(there - here).T) <= widest
    both = np.unique(np.concatenate([here[near], there[near]], axis=1), axis=0)
    return both[:, :2], both[:, 2:]


def _planes(found: Unwrapped, places: NDArray[np.int64], reach: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the phase and its slope along rows and columns at some places, each from its own piece alone."""
    sums = np.zeros((len(places), 9))
    _sum_around(found.phase, found.pieces, places, reach, sums)
    normal, right = sums[:, _SYMMETRIC], sums[:, 6:, None]
    flat = np.linalg.det(normal) < 1.0  # a piece that is a line there: of fewer than three pixels off it
    normal[flat] = np.eye(3)
    planes = np.linalg.solve(normal, right)[..., 0]
    planes[flat] = np.nan
    return planes[:, 0], planes[:, 1:]


@njit(cache=True)
def _sum_around(phase, pieces, places, reach, sums):  # type: ignore[no-untyped-def]
    """Add up what planes by least squares take: 1, y, x, yy, yx, xx and the phase times 1, y, x."""
    height, width = phase.shape
    for k in range(len(places)):
        i, j = places[k]
        for a in range(max(0, i - reach), min(height, i + reach + 1)):
            for b in range(max(0, j - reach), min(width, j + reach + 1)):
                if pieces[a, b] == pieces[i, j]:
                    y, x, value = a - i, b - j, phase[a, b]
                    sums[k, 0] += 1
                    sums[k, 1] += y
                    sums[k, 2] += x
                    sums[k, 3] += y * y
                    sums[k, 4] += y * x
                    sums[k, 5] += x * x
                    sums[k, 6] += value
                    sums[k, 7] += value * y
                    sums[k, 8] += value * x


def _jumps(
    here: NDArray[np.int64], there: NDArray[np.int64], values: NDArray[np.float64], slopes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return by how much two pieces miss each other half way across the gap, rad."""
    number = len(here)
    mean = (slopes[:number] + slopes[number:]) / 2
    return values[number:] - values[:number] - np.einsum("ij,ij->i", mean, there - here)


def _joined(  # noqa: PLR0913, PLR0917 -- private: what a decision for each pair of pieces takes
    pairs: NDArray[np.int32],
    jumps: NDArray[np.float64],
    bends: NDArray[np.float64],
    cycle: int,
    number: int,
    rules: LinkRules,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the cycles to be added to each piece, and its group; the pairs with most places are joined first."""
    cycles, groups = np.zeros(number), np.arange(1, number + 1)
    known = np.isfinite(jumps)
    both, which, counts = np.unique(pairs[:, known], axis=1, return_inverse=True, return_counts=True)
    rows = np.split(np.argsort(which.ravel(), kind="stable"), np.cumsum(counts)[:-1])
    jumps, bends = jumps[known], bends[known]
    for k in np.argsort(-counts, kind="stable"):
        first, second = both[:, k] - 1
        turns = _whole_cycles(jumps[rows[k]], bends[rows[k]], cycle, rules)
        if turns is None or groups[first] == groups[second]:
            continue
        moved = groups == groups[second]
        cycles[moved] += cycles[first] - cycles[second] - turns
        groups[moved] = groups[first]
    return cycles, groups


def _whole_cycles(jumps: NDArray[np.float64], bends: NDArray[np.float64], cycle: int, rules: LinkRules) -> float | None:
    """Return the whole cycles by which one piece is ahead of the other; None if they do not continue one another."""
    if jumps.size < rules.places or np.median(bends) > rules.bend:
        return None
    turns = float(np.rint(np.median(jumps)))
    off = (jumps - turns) * cycle
    scatter = 1.4826 * float(np.median(np.abs(off - np.median(off))))
    u = _SPREAD * scatter / np.sqrt(jumps.size / rules.reach_px)  # neighbours along the gap share most of their planes
    near = abs(np.median(off)) <= rules.off + min(rules.off_sigmas * u, rules.off)
    return turns if near and scatter <= rules.scatter else None


__all__ = ["LINK_RULES", "LinkRules", "linked_pieces"]
