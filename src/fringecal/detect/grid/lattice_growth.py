"""Growth of an indexed lattice through loose points, from neighbour to neighbour."""

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# A neighbour is accepted within this part of the spacing from its prediction: half-way to the next
# crossing would be 0.5, and perspective or barrel changes the spacing by far less.
MATCH_RADIUS = 0.25
# Every step to an indexed neighbour suits the prediction within this part of the spacing: both ends may be off it.
NEIGHBOUR_RADIUS = 1.4 * MATCH_RADIUS
# Part by which a node's own step replaces the one before it: the spacing changes slowly, and a crossing is noisy.
NEW_STEP_PART = 0.5
# Sites about the first one that an array holds, per spacing of the picture's diagonal and besides.
REACH_PER_SPACING, REACH_BESIDE = 4, 4


def grow(points: FloatArray, known: IntArray, bases: FloatArray) -> IntArray:
    """Members (point, i, j) of the lattice that grows from known ones.

    Parameters
    ----------
    points
        All positions, px, (n, 2) as (u, v).
    known
        Members to start from, (m, 3); indices about 0.
    bases
        Steps to the next i and the next j at each of them, px, (m, 2, 2).
    """
    spacing = float(np.median(np.hypot(bases[..., 0], bases[..., 1]).min(axis=1)))
    lower = points.min(axis=0)
    cells = ((points - lower) / spacing).astype(np.int64)
    shape = cells.max(axis=0) + 1
    key = cells[:, 1] * shape[0] + cells[:, 0]
    order = np.argsort(key, kind="stable")
    start = np.searchsorted(key[order], np.arange(shape[0] * shape[1] + 1))
    reach = int(min(len(points), REACH_PER_SPACING * np.hypot(*(shape * 1.0)) + REACH_BESIDE)) + int(
        np.abs(known[:, 1:]).max()
    )
    return _grow_kernel(points, known, bases, (lower, spacing, shape, order, start), reach)


@njit(cache=True)
def _nearest(points, hashed, x, y, radius):  # type: ignore[no-untyped-def] # pragma: no cover
    """Index of the point nearest to (x, y) within `radius`, or -1."""
    lower, spacing, shape, order, start = hashed
    best, best_squared = -1, radius * radius
    i0, i1 = int((x - radius - lower[0]) // spacing), int((x + radius - lower[0]) // spacing)
    j0, j1 = int((y - radius - lower[1]) // spacing), int((y + radius - lower[1]) // spacing)
    for j in range(max(j0, 0), min(j1, shape[1] - 1) + 1):
        for i in range(max(i0, 0), min(i1, shape[0] - 1) + 1):
            cell = j * shape[0] + i
            for k in range(start[cell], start[cell + 1]):
                p = order[k]
                squared = (points[p, 0] - x) ** 2 + (points[p, 1] - y) ** 2
                if squared < best_squared:
                    best, best_squared = p, squared
    return best


@njit(cache=True)
def _fits(points, site, i, j, found, basis, reach):  # type: ignore[no-untyped-def] # pragma: no cover
    """Whether a point suits every indexed neighbour of the site (i, j): distances as the basis says."""
    for axis in range(2):
        for way in (-1, 1):
            ni, nj = i + way * (1 - axis), j + way * axis
            if abs(ni) > reach or abs(nj) > reach:
                continue
            other = site[ni + reach, nj + reach]
            if other < 0:
                continue
            du = (points[other, 0] - points[found, 0]) * way - basis[axis, 0]
            dv = (points[other, 1] - points[found, 1]) * way - basis[axis, 1]
            size = basis[axis, 0] ** 2 + basis[axis, 1] ** 2
            if du * du + dv * dv > NEIGHBOUR_RADIUS**2 * size:
                return False
    return True


@njit(cache=True)
def _grow_kernel(points, known, known_bases, hashed, reach):  # type: ignore[no-untyped-def] # pragma: no cover
    """Breadth-first growth: predict each free neighbour from the node's own basis, match, verify, index."""
    count, tail = len(points), len(known)
    site = np.full((2 * reach + 1, 2 * reach + 1), -1, np.int32)
    used = np.zeros(count, np.bool_)
    queue = np.empty((count, 3), np.int64)
    bases = np.empty((count, 2, 2))
    for k in range(tail):  # number by number: copies of whole arrays take three seconds to compile
        for n in range(3):
            queue[k, n] = known[k, n]
        for n in range(4):
            bases[k, n // 2, n % 2] = known_bases[k, n // 2, n % 2]
        site[known[k, 1] + reach, known[k, 2] + reach] = known[k, 0]
        used[known[k, 0]] = True
    head = 0
    while head < tail:
        p, i, j = queue[head, 0], queue[head, 1], queue[head, 2]
        local = bases[head]
        head += 1
        for axis in range(2):
            for way in (-1, 1):
                ni, nj = i + way * (1 - axis), j + way * axis
                if abs(ni) > reach or abs(nj) > reach or site[ni + reach, nj + reach] >= 0:
                    continue
                size = np.hypot(local[axis, 0], local[axis, 1])
                x = points[p, 0] + way * local[axis, 0]
                y = points[p, 1] + way * local[axis, 1]
                found = _nearest(points, hashed, x, y, MATCH_RADIUS * size)
                if found < 0 or used[found] or not _fits(points, site, ni, nj, found, local, reach):
                    continue
                for n in range(4):
                    bases[tail, n // 2, n % 2] = local[n // 2, n % 2]
                bases[tail, axis, 0] += NEW_STEP_PART * (way * (points[found, 0] - points[p, 0]) - local[axis, 0])
                bases[tail, axis, 1] += NEW_STEP_PART * (way * (points[found, 1] - points[p, 1]) - local[axis, 1])
                site[ni + reach, nj + reach] = found
                used[found] = True
                queue[tail, 0], queue[tail, 1], queue[tail, 2] = found, ni, nj
                tail += 1
    return queue[:tail]
