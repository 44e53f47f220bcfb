"""Index loose points as a two-dimensional lattice: a seed with four neighbours, then growth by prediction."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from fringecal.detect.grid.lattice_growth import grow
from fringecal.detect.grid.nodes import NO_LENGTH_PX, along

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Opposite neighbours of a seed agree with its own position within this part of the spacing.
SEED_TOLERANCE = 0.12
# Nearest points among which a seed's four neighbours are sought: dirt may lie between them.
NEIGHBOURS = 12
# Seeds are grown in turn until a lattice covers this part of the points that were seeds themselves.
COVERED_PART = 0.5
# The second direction lies more than 45 degrees (sine) from the first, and is less than twice as long: sheets seen
# obliquely shear and shorten the grid.
MIN_SINE, MAX_LENGTH_RATIO = 0.7, 2.0
# Seeds are sought among this many points, spread evenly over all: noise gives a fine level 1e5 of them.
MAX_SEED_POINTS = 400


@dataclass(frozen=True)
class Lattice:
    """Indexed points among loose ones.

    Parameters
    ----------
    points
        All points, px, (n, 2) as (u, v).
    member
        Numbers of those in the lattice, (m,).
    row, column
        Their indices, from 0, rows downward and columns to the right, (m,).
    """

    points: FloatArray
    member: IntArray
    row: IntArray
    column: IntArray

    def scaled(self, factor: int) -> "Lattice":
        """Move from level pixels, each the mean of `factor` x `factor` pixels, to full resolution."""
        return replace(self, points=self.points * factor + 0.5 * (factor - 1))

    def nodes(self) -> FloatArray:
        """Positions (rows, columns, 2), px, NaN where there is none."""
        nodes = np.full((self.row.max() + 1, self.column.max() + 1, 2), np.nan)
        nodes[self.row, self.column] = self.points[self.member]
        return nodes

    def regrown(self, kept: BoolArray) -> "Lattice":
        """Grow anew from the members at the kept ones of the sites (rows, columns)."""
        nodes = np.where(kept[..., None], self.nodes(), np.nan)
        pick = kept[self.row, self.column]
        return replace(self, member=self.member[pick], row=self.row[pick], column=self.column[pick])._grown(nodes)

    def _grown(self, nodes: FloatArray, *, rows: int = 1, columns: int = 1) -> "Lattice":
        """Grow from all members by the steps between nodes, divided by so many rows and columns."""
        at = self.row, self.column
        bases = np.stack([along(nodes, 0)[at] / columns, along(nodes, 1)[at] / rows], axis=1)
        column, row = columns * (self.column - self.column[0]), rows * (self.row - self.row[0])
        return _oriented(self.points, grow(self.points, np.stack([self.member, column, row], axis=1), bases))

    def halved(self, *, rows: int, columns: int) -> "Lattice":
        """Count so many rows, or columns, where one was counted, and grow anew into those between."""
        return self._grown(self.nodes(), rows=rows, columns=columns)

    def sheared(self, down: int, right: int) -> "Lattice":
        """Count rows, or columns, along a diagonal instead: row + down column, column + right row; grown anew."""
        row, column = self.row + down * self.column, self.column + right * self.row
        turned = replace(self, row=row - row.min(), column=column - column.min())
        return turned.regrown(np.ones(turned.nodes().shape[:2], dtype=bool))

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
        members = grow(points, np.array([[seeds[k], 0, 0]]), np.array([[first[k], second[k]]]))
        covered[members[:, 0]] = True
        if best is None or len(members) > len(best):
            best = members
        if len(best) * min(1.0, MAX_SEED_POINTS / len(points)) > COVERED_PART * len(seeds):
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
    second_ok = paired & (cross > MIN_SINE * length * length[rows, first][:, None])
    second = np.argmax(second_ok, axis=1)
    ok = paired[rows, first] & second_ok[rows, second] & (length[rows, second] < MAX_LENGTH_RATIO * length[rows, first])
    score = mismatch[rows, first] + mismatch[rows, second]
    order = np.flatnonzero(ok)[np.argsort(score[ok], kind="stable")]
    return tried[order], a[order], vectors[rows, second][order]


def _opposites(vectors: FloatArray, length: FloatArray) -> tuple[BoolArray, FloatArray]:
    """For every neighbour, whether another one lies opposite, and by how much (relative) it fails to."""
    paired = np.zeros(length.shape, dtype=bool)
    mismatch = np.full(length.shape, np.inf)
    for j in range(length.shape[1]):
        total = vectors + vectors[:, j : j + 1]
        mismatch[:, j] = np.hypot(total[..., 0], total[..., 1]).min(axis=1) / np.maximum(length[:, j], NO_LENGTH_PX)
        paired[:, j] = mismatch[:, j] < SEED_TOLERANCE
    return paired, mismatch


def _spread(seeds: IntArray, tries: int) -> IntArray:
    """Choose the seeds to try: the best one, then others evenly through the ranking."""
    return np.unique(np.linspace(0, len(seeds) - 1, tries).astype(np.int64)) if len(seeds) else seeds


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
    return Lattice(points, members[:, 0], j - j.min(), i - i.min())
