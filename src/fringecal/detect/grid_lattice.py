"""Index loose points as a two-dimensional lattice: a seed with four neighbours, then growth by prediction."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import cKDTree

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# A neighbour is accepted within this part of the spacing from its prediction: half-way to the next
# crossing would be 0.5, so an index cannot slip, and perspective or barrel changes the spacing by far less.
MATCH_RADIUS = 0.25
# Opposite neighbours of a seed agree with its own position within this part of the spacing.
SEED_TOLERANCE = 0.12
NEIGHBOURS = 12
# Seeds are sought among this many points, spread evenly over all: noise gives a fine level 1e5 of them.
MAX_SEED_POINTS = 400


@dataclass(frozen=True)
class Lattice:
    """Indexed points: column and row numbers from 0 and positions in px, all of length n."""

    column: IntArray
    row: IntArray
    u_px: FloatArray
    v_px: FloatArray

    def scaled(self, factor: int) -> "Lattice":
        """Move from level pixels, each the mean of `factor` x `factor` pixels, to full resolution."""
        shift = 0.5 * (factor - 1)
        return Lattice(self.column, self.row, self.u_px * factor + shift, self.v_px * factor + shift)

    def nodes(self) -> FloatArray:
        """Positions (rows, columns, 2), px, NaN where there is none; both indices from 0."""
        nodes = np.full((self.row.max() + 1, self.column.max() + 1, 2), np.nan)
        nodes[self.row, self.column] = np.stack([self.u_px, self.v_px], axis=1)
        return nodes

    def whole_cells(self) -> int:
        """Count the cells with all four corners known."""
        known = np.isfinite(self.nodes()[..., 0])
        return int((known[1:, 1:] & known[1:, :-1] & known[:-1, 1:] & known[:-1, :-1]).sum())


def grow_lattice(points: FloatArray, *, tries: int) -> Lattice | None:
    """Index the largest lattice that grows from one of the best seeds, or None if there is no seed.

    Parameters
    ----------
    points
        Candidate positions, px, (n, 2) as (u, v).
    tries
        Number of seeds to grow before the largest lattice is taken.
    """
    seeds, first, second = _seeds(points)
    best: IntArray | None = None
    covered = np.zeros(len(points), dtype=bool)
    for k in _spread(seeds, tries):
        if covered[seeds[k]]:
            continue
        members = _grow(points, int(seeds[k]), first[k], second[k])
        covered[members[:, 0]] = True
        if best is None or len(members) > len(best):
            best = members
        if len(best) * min(1.0, MAX_SEED_POINTS / len(points)) > 0.5 * len(seeds):
            break
    return None if best is None else _oriented(points, best)


def _seeds(points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Points half-way between two pairs of opposite neighbours, with the two basis vectors; best first."""
    tree = cKDTree(points)
    count = min(NEIGHBOURS, len(points) - 1)
    tried = np.unique(np.linspace(0, len(points) - 1, MAX_SEED_POINTS).astype(np.int64))
    _, neighbour = tree.query(points[tried], k=count + 1)
    vectors = points[neighbour[:, 1:]] - points[tried, None, :]
    length = np.hypot(vectors[..., 0], vectors[..., 1])
    paired, mismatch = _opposites(vectors, length)
    first = np.argmax(paired, axis=1)
    rows = np.arange(len(tried))
    a = vectors[rows, first]
    cross = np.abs(a[:, None, 0] * vectors[..., 1] - a[:, None, 1] * vectors[..., 0])
    # The second direction lies more than 45 degrees from the first (sheets seen obliquely shear the grid).
    second_ok = paired & (cross > 0.7 * length * length[rows, first][:, None])
    second = np.argmax(second_ok, axis=1)
    ok = paired[rows, first] & second_ok[rows, second] & (length[rows, second] < 2 * length[rows, first])
    score = mismatch[rows, first] + mismatch[rows, second]
    order = np.flatnonzero(ok)[np.argsort(score[ok], kind="stable")]
    return tried[order], a[order], vectors[rows, second][order]


def _opposites(vectors: FloatArray, length: FloatArray) -> tuple[npt.NDArray[np.bool_], FloatArray]:
    """For every neighbour, whether another one lies opposite, and by how much (relative) it fails to."""
    paired = np.zeros(length.shape, dtype=bool)
    mismatch = np.full(length.shape, np.inf)
    for j in range(length.shape[1]):
        total = vectors + vectors[:, j : j + 1]
        mismatch[:, j] = np.hypot(total[..., 0], total[..., 1]).min(axis=1) / np.maximum(length[:, j], 1e-9)
        paired[:, j] = mismatch[:, j] < SEED_TOLERANCE
    return paired, mismatch


def _spread(seeds: IntArray, tries: int) -> IntArray:
    """Choose the seeds to try: the best one, then others evenly through the ranking."""
    return np.unique(np.linspace(0, len(seeds) - 1, tries).astype(np.int64)) if len(seeds) else seeds


def _grow(points: FloatArray, seed: int, a: FloatArray, b: FloatArray) -> IntArray:
    """Members (point, i, j) of the lattice that grows from a seed with basis a, b."""
    spacing = min(np.hypot(*a), np.hypot(*b))
    lower = points.min(axis=0)
    cells = ((points - lower) / spacing).astype(np.int64)
    shape = cells.max(axis=0) + 1
    key = cells[:, 1] * shape[0] + cells[:, 0]
    order = np.argsort(key, kind="stable")
    start = np.searchsorted(key[order], np.arange(shape[0] * shape[1] + 1))
    reach = int(min(len(points), 4 * np.hypot(*(shape * 1.0)) + 4))
    return _grow_kernel(points, seed, np.array([a, b]), (lower, spacing, shape, order, start), reach)


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
            if du * du + dv * dv > (1.4 * MATCH_RADIUS) ** 2 * size:
                return False
    return True


@njit(cache=True)
def _grow_kernel(points, seed, basis, hashed, reach):  # type: ignore[no-untyped-def] # pragma: no cover
    """Breadth-first growth: predict each free neighbour from the node's own basis, match, verify, index."""
    count = len(points)
    site = np.full((2 * reach + 1, 2 * reach + 1), -1, np.int32)
    used = np.zeros(count, np.bool_)
    queue = np.empty((count, 3), np.int64)
    bases = np.empty((count, 2, 2))
    queue[0, 0], queue[0, 1], queue[0, 2] = seed, 0, 0
    bases[0] = basis
    site[reach, reach] = seed
    used[seed] = True
    head, tail = 0, 1
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
                bases[tail] = local
                bases[tail, axis, 0] += 0.5 * (way * (points[found, 0] - points[p, 0]) - local[axis, 0])
                bases[tail, axis, 1] += 0.5 * (way * (points[found, 1] - points[p, 1]) - local[axis, 1])
                site[ni + reach, nj + reach] = found
                used[found] = True
                queue[tail, 0], queue[tail, 1], queue[tail, 2] = found, ni, nj
                tail += 1
    return queue[:tail]


def _oriented(points: FloatArray, members: IntArray) -> Lattice:
    """Name the axes: columns count along +u, rows along +v, both from 0."""
    position = points[members[:, 0]]
    index = members[:, 1:].astype(float)
    centred = index - index.mean(axis=0)
    slope, *_ = np.linalg.lstsq(centred, position - position.mean(axis=0), rcond=None)
    i, j = members[:, 1], members[:, 2]
    if abs(slope[0, 0]) * np.hypot(*slope[1]) < abs(slope[1, 0]) * np.hypot(*slope[0]):
        i, j, slope = j, i, slope[::-1]
    i = i if slope[0, 0] >= 0 else -i
    j = j if slope[1, 1] >= 0 else -j
    return Lattice(i - i.min(), j - j.min(), position[:, 0], position[:, 1])
