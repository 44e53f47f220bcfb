"""Which regions of a phase map hang together: both sides of a border are continued to it and must meet there.

Two surfaces that touch, at a fold, meet in one phase, however steep they are. Over an edge the phases differ by
anything, and by whole fringes only by chance, which no single picture can tell from touching.
"""

from collections import Counter, defaultdict
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TWO_PI = 2 * np.pi
_LEAST_BORDER = 5  # pixel pairs
_LEAST_LEAD = 1.5  # how many times more pixel pairs lie in stretches that agree than in all others
_OF_ONE_MIND = 0.75  # share of a stretch's pixel pairs that must agree on the order
_CELL_PX = 16  # side of the cells into which borders are cut
# What two continued sides may differ by: at least; per change of slope along a side (curvature, noise); per difference
# of slope between the sides, in px by which the border may lie beside the fold; at most.
_MEETING_RAD, _CURVED, _BESIDE_FOLD_PX, _MOST_RAD = 0.15, 4.0, 1.2, 1.2
_BEHIND = (2, 4, 6)  # px from the border: nearer ones are blurred over it
_BESIDE = 2  # px to either side over which the continuation is averaged


@njit(cache=True)
def _continued(values, labels, row, column, towards):  # type: ignore[no-untyped-def]
    """Continue a region to half a pixel beyond (row, column) along the first axis: value, slope, change of slope."""
    label, total, slope, bend, count = labels[row, column], 0.0, 0.0, 0.0, 0
    for beside in range(-_BESIDE, _BESIDE + 1):
        c = column + beside
        far = row - _BEHIND[2] * towards
        if c < 0 or c >= labels.shape[1] or far < 0 or far >= labels.shape[0]:
            continue
        one, two = row - _BEHIND[0] * towards, row - _BEHIND[1] * towards
        if labels[one, c] != label or labels[two, c] != label or labels[far, c] != label:
            continue
        near_slope = (values[one, c] - values[two, c]) / 2
        far_slope = (values[two, c] - values[far, c]) / 2
        total += values[one, c]
        slope += (near_slope + far_slope) / 2
        bend += near_slope - far_slope
        count += 1
    if count == 0:
        return np.nan, np.nan, np.nan
    return (total + (_BEHIND[0] + 0.5) * slope) / count, slope / count * towards, abs(bend) / count


@njit(cache=True)
def _steps_over(values, labels, rows, columns):  # type: ignore[no-untyped-def]
    """Step from one side to the other of borders between row and row + 1, and what it may differ from whole fringes."""
    steps, tolerances = np.zeros(rows.size), np.zeros(rows.size)
    for i in range(rows.size):
        above, slope_above, bend_above = _continued(values, labels, rows[i], columns[i], 1)
        below, slope_below, bend_below = _continued(values, labels, rows[i] + 1, columns[i], -1)
        if np.isfinite(above) and np.isfinite(below):
            steps[i] = above - below
            folded = _BESIDE_FOLD_PX * abs(slope_above - slope_below)
            tolerances[i] = min(_MEETING_RAD + folded + _CURVED * (bend_above + bend_below), _MOST_RAD)
        else:
            # Too narrow to be continued: the pair says which order is nearest, and does not count as meeting.
            steps[i] = values[rows[i], columns[i]] - values[rows[i] + 1, columns[i]]
    return steps, tolerances


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
    """List the pixel pairs over all borders: regions a < b, cell of the picture, order lacking, meeting or not."""
    found = []
    v, u = np.indices(labels.shape)
    cells = (v // _CELL_PX) * (labels.shape[1] // _CELL_PX + 1) + u // _CELL_PX
    for axis in (0, 1):
        one, phases, cell = (np.moveaxis(m, axis, 0) for m in (labels, values, cells))
        first, second = one[:-1], one[1:]
        at = (first != second) & (first > 0) & (second > 0)
        rows, columns = np.nonzero(at)
        step, tolerance = _steps_over(phases, one, rows, columns)
        jump = np.where(first > second, -1, 1)[at] * step
        order = np.floor(jump / _TWO_PI + 0.5)
        meets = np.abs(jump - _TWO_PI * order) < tolerance
        low, high = np.minimum(first, second)[at], np.maximum(first, second)[at]
        found.append(np.column_stack([low, high, cell[:-1][at], order, meets]))
    return np.concatenate(found).astype(np.int64)


def _borders(values: Array, labels: NDArray[np.int32]) -> list[_Border]:
    """Judge every border cell by cell: a cell votes if nearly all of its pixel pairs are of one mind.

    Along a true edge the sides differ by any amount, and where they happen to meet that is so over a short stretch
    only; along a fold they meet throughout.
    """
    pairs = _pairs(values, labels)
    cells, inverse = np.unique(pairs[:, :3], axis=0, return_inverse=True)
    total = np.bincount(inverse.ravel(), minlength=len(cells))
    votes, at = np.unique(pairs[:, :4], axis=0, return_inverse=True)
    number = np.bincount(at.ravel(), minlength=len(votes))
    meeting = np.bincount(at.ravel(), weights=pairs[:, 4], minlength=len(votes))
    agreeing: dict[tuple[int, int], Counter[int]] = defaultdict(Counter)
    sizes: Counter[tuple[int, int]] = Counter()
    of_cell = {tuple(c): int(n) for c, n in zip(cells.tolist(), total, strict=True)}
    for (a, b, _), n in of_cell.items():
        sizes[a, b] += n
    for (a, b, cell, order), n, few in zip(votes.tolist(), number.tolist(), meeting.tolist(), strict=True):
        if n >= _OF_ONE_MIND * of_cell[a, b, cell] and few >= 0.5 * n:
            agreeing[a, b][order] += n
    best = ((pair, *max(found.items(), key=lambda f: (f[1], -abs(f[0])))) for pair, found in agreeing.items())
    return [_Border(a, b, order, n, sizes[a, b] - n) for (a, b), order, n in best]


def join_regions(values: Array, labels: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Join regions over trusted borders, the longest first.

    Parameters
    ----------
    values
        Phase, continuous within each region, rad, (H, W).
    labels
        Numbers of the regions from 1, (H, W); 0 is masked.

    Returns
    -------
    orders, groups
        For every label the fringes to be added, and the number of the group that it hangs together with.
    """
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
