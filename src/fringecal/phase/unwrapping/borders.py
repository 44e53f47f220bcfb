"""Which regions of a phase map are connected: both sides of a border are continued to it and must meet there.

Two surfaces that touch, at a fold, meet in one phase, however steep they are. Over an edge the phases differ by
anything, and by whole fringes only by chance, which no single picture can tell from touching.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import TURN, over_bands, robust_sd

Array = NDArray[np.float64]
Seen = tuple[NDArray[np.float32], NDArray[np.int32]]
"""Modulation of the fringes, grey levels, and the regions' numbers where they are smooth, (H, W) both."""

# Borders are cut by cells of this side, px: along an edge the jump passes through whole fringes, by chance, over a
# stretch, and larger cells would mix it with what differs.
_CELL_PX = 16
_AGREEING = 0.75  # share of a stretch's pixel pairs that must agree on the order for it to vote
_MEETING = 0.5  # share of a vote's pixel pairs whose sides must meet
_LEAST_BORDER = 5  # pixel pairs that must agree: fewer are a corner
_LEAST_LEAD = 1.5  # how many times more pixel pairs lie in stretches that agree than in all others
# What two continued sides may differ by, rad: at least; per change of slope along a side (curvature, noise); per
# difference of slope between the sides, in px by which the border may lie beside the fold; at most, a fifth of a turn.
_MEETING_RAD, _CURVED, _BESIDE_FOLD_PX, _MOST_RAD = 0.15, 4.0, 1.2, 1.2
# A cell meets if its mean step does: over many pixel pairs noise averages out, so that whole fringes but for a
# fiftieth are told from touching. At least what curvature of the third order leaves, rad; standard errors of the mean.
_CELL_RAD, _CELL_SIGMAS = 0.03, 4.0
# Standard deviations, in those of a pixel's phase, of the step of one pair and of the change of slope over it, both
# averaged over five lines: from the weights of the pixels that are continued.
_STEP_SD, _CHANGE_SD = 0.75, 0.77
_BEHIND_PX = (2, 4, 6)  # from the border, of the three pixels that are continued: nearer ones are blurred over it
_BESIDE_PX = 2  # to either side over which the continuation is averaged
# A border beside which the modulation dips shows two phases mixed in one pixel: an edge, whatever order they meet in.
_WAY_PX = 24  # from a border, the farthest to the smooth pixels of either side between which it is looked for
_DIP_SHARE = 0.7  # of the darker of those


@njit(cache=True)
def _continued(values, labels, row, column, towards):  # type: ignore[no-untyped-def]
    """Continue a region to half a pixel beyond (row, column) along the first axis: value, slope, change of slope."""
    label, total, slope, curvature, count = labels[row, column], 0.0, 0.0, 0.0, 0
    for beside in range(-_BESIDE_PX, _BESIDE_PX + 1):
        c = column + beside
        far = row - _BEHIND_PX[2] * towards
        if c < 0 or c >= labels.shape[1] or far < 0 or far >= labels.shape[0]:
            continue
        one, two = row - _BEHIND_PX[0] * towards, row - _BEHIND_PX[1] * towards
        if labels[one, c] != label or labels[two, c] != label or labels[far, c] != label:
            continue
        near_slope = (values[one, c] - values[two, c]) / 2
        far_slope = (values[two, c] - values[far, c]) / 2
        total += values[one, c]
        slope += (near_slope + far_slope) / 2
        curvature += near_slope - far_slope
        count += 1
    if count == 0:
        return np.nan, np.nan, np.nan
    return (total + (_BEHIND_PX[0] + 0.5) * slope) / count, slope / count * towards, curvature / count


@njit(cache=True)
def _steps_over(values, labels, rows, columns):  # type: ignore[no-untyped-def]
    """Step over borders between row and row + 1, what it may differ from whole fringes, change of slope, of curvature.

    Where a side is too narrow to be continued, the pair says which order is nearest, and does not count as meeting;
    what changes over it is NaN.
    """
    steps, tolerances = np.zeros(rows.size), np.zeros(rows.size)
    bends, curves = np.full(rows.size, np.nan), np.full(rows.size, np.nan)
    for i in range(rows.size):
        above, slope_above, curvature_above = _continued(values, labels, rows[i], columns[i], 1)
        below, slope_below, curvature_below = _continued(values, labels, rows[i] + 1, columns[i], -1)
        if np.isfinite(above) and np.isfinite(below):
            steps[i], bends[i] = above - below, slope_above - slope_below
            # Alike curved on both sides, a surface is continued alike.
            curves[i] = curvature_above - curvature_below
            curved = abs(curvature_above) + abs(curvature_below)
            tolerances[i] = min(_MEETING_RAD + _BESIDE_FOLD_PX * abs(bends[i]) + _CURVED * curved, _MOST_RAD)
        else:
            steps[i] = values[rows[i], columns[i]] - values[rows[i] + 1, columns[i]]
    return steps, tolerances, bends, curves


@njit(cache=True)
def _way(light, cores, row, column, towards):  # type: ignore[no-untyped-def]
    """Go from a border to the nearest smooth pixel: the least modulation on the way, and that at its end."""
    least = here = light[row, column]
    for _ in range(_WAY_PX):
        if cores[row, column] > 0 or not 0 <= row + towards < light.shape[0]:
            break
        row += towards
        here = light[row, column]
        least = min(least, here)
    return least, here


@njit(cache=True)
def _dips(light, cores, rows, columns):  # type: ignore[no-untyped-def]
    """Whether the modulation dips between the smooth pixels on both sides of borders between row and row + 1."""
    dips = np.zeros(rows.size, np.bool_)
    for i in range(rows.size):
        above, level_above = _way(light, cores, rows[i], columns[i], -1)
        below, level_below = _way(light, cores, rows[i] + 1, columns[i], 1)
        dips[i] = min(above, below) < _DIP_SHARE * min(level_above, level_below)
    return dips


def _places(labels: NDArray[np.int32], along: bool) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find where two regions touch: pixels whose neighbour below, or along the row, has another label."""
    dv, du = (0, 1) if along else (1, 0)
    height = labels.shape[0] - dv
    ends = np.zeros(height + 1, np.int64)
    over_bands(_count_places, height, labels, dv, du, ends)
    ends = np.cumsum(ends)
    rows, columns = np.empty(ends[-1], np.int64), np.empty(ends[-1], np.int64)
    over_bands(_write_places, height, labels, dv, du, ends, rows, columns)
    return rows, columns


@njit(nogil=True, cache=True)
def _count_places(first, last, labels, dv, du, ends):  # type: ignore[no-untyped-def]
    """Count the places of some rows, each in the number after its own."""
    for v in range(first, last):
        for u in range(labels.shape[1] - du):
            one, two = labels[v, u], labels[v + dv, u + du]
            ends[v + 1] += one != two and one > 0 and two > 0


@njit(nogil=True, cache=True)
def _write_places(first, last, labels, dv, du, ends, rows, columns):  # type: ignore[no-untyped-def]
    """Write the places of some rows where `ends` says."""
    width = labels.shape[1] - du
    for v in range(first, last):
        at = ends[v]
        if ends[v + 1] > at:
            for u in range(width):
                one, two = labels[v, u], labels[v + dv, u + du]
                if one != two and one > 0 and two > 0:
                    rows[at], columns[at] = v, u
                    at += 1


class _Pairs(NamedTuple):
    """Pixel pairs over all borders: regions a < b, cell of the picture, order lacking, whether they meet; and changes.

    `left_rad` is what the order leaves of the step, `bend` and `curve` change over the border, NaN where unknown.
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    cell: NDArray[np.int64]
    order: NDArray[np.int64]
    meets: NDArray[np.int64]
    left_rad: Array
    bend: Array
    curve: Array


def _pairs(values: Array, labels: NDArray[np.int32], seen: Seen | None) -> _Pairs:
    """List the pixel pairs over all borders."""
    numbers, changes = [], []
    for along in (False, True):
        v, u = _places(labels, along)
        first, second = labels[v, u], labels[v + (not along), u + along]
        # The other axis is the first one of the transposed picture.
        over = _steps_over(values.T, labels.T, u, v) if along else _steps_over(values, labels, v, u)
        sign = np.where(first > second, -1, 1)
        jump, bend, curve = (sign * over[k] for k in (0, 2, 3))
        order = np.floor(jump / TURN + 0.5)
        meets = np.abs(jump - TURN * order) < over[1]
        if seen is not None:
            meets &= ~(_dips(seen[0].T, seen[1].T, u, v) if along else _dips(*seen, v, u))
        cells = (v // _CELL_PX) * (labels.shape[1] // _CELL_PX + 1) + u // _CELL_PX
        numbers.append(np.stack([np.minimum(first, second), np.maximum(first, second), cells, order, meets]))
        changes.append(np.stack([jump - TURN * order, bend, curve]))
    return _Pairs(*np.concatenate(numbers, axis=1).astype(np.int64), *np.concatenate(changes, axis=1))


def _on_average(pairs: _Pairs, vote: NDArray[np.int64], votes: int) -> NDArray[np.bool_]:
    """Whether the mean step of each vote's pixel pairs is that of sides which meet; true where none could be continued.

    What a fold or curvature may add is judged by their means, so that noise does not widen it.
    """
    known = np.isfinite(pairs.curve)
    number = np.bincount(vote[known], minlength=votes)
    left, bend, curve = (
        np.abs(np.bincount(vote[known], change[known], votes)) / np.maximum(number, 1)
        for change in (pairs.left_rad, pairs.bend, pairs.curve)
    )
    sigma = robust_sd(pairs.curve[known], about=0) / _CHANGE_SD if known.any() else 0.0
    independent = np.maximum(number / (2 * _BESIDE_PX + 1), 1)
    error = _STEP_SD * sigma / np.sqrt(independent)
    close = left < _CELL_RAD + _CELL_SIGMAS * error + _BESIDE_FOLD_PX * bend + _CURVED * curve
    return np.asarray(close | (number == 0))


def _numbers(*columns: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number the different rows of integer columns: where each stands first, and the number of every row."""
    number = np.zeros(columns[0].size, np.int64)
    first = np.zeros(0, np.int64)
    for column in columns:
        low = column.min(initial=0)
        key = number * (column.max(initial=0) - low + 1) + column - low
        _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return first, number


def trusted_borders(values: Array, labels: NDArray[np.int32], seen: Seen | None = None) -> NDArray[np.int64]:
    """Judge every border cell by cell; rows of a, b, the order that b lacks, and how many pixel pairs agree, (n, 4).

    The longest border comes first. A cell votes if nearly all of its pixel pairs agree on one order, and if they meet,
    one by one and on average. Along a true edge the sides differ by any amount, and where they happen to meet that is
    so over a short stretch only; along a fold they meet throughout; where the modulation that was `seen` dips, they do
    not.
    """
    pairs = _pairs(values, labels, seen)
    a, b, cell, order, meets = pairs[:5]
    border_first, border = _numbers(a, b)
    cell_first, of_cell = _numbers(border, cell)
    vote_first, of_vote = _numbers(of_cell, order)
    number = np.bincount(of_vote, minlength=vote_first.size)
    meeting = np.bincount(of_vote, weights=meets, minlength=vote_first.size)
    agreed = (number >= _AGREEING * np.bincount(of_cell)[of_cell[vote_first]]) & (meeting >= _MEETING * number)
    agreed &= _on_average(pairs, of_vote, vote_first.size)
    voting = vote_first[agreed]
    best_first, candidate = _numbers(border[voting], order[voting])
    agreeing = np.bincount(candidate, weights=number[agreed], minlength=best_first.size).astype(np.int64)
    chosen = voting[best_first]
    # The order with most pairs, of equals the smallest, comes first for its border.
    ranked = np.lexsort((np.abs(order[chosen]), -agreeing, border[chosen]))
    leading = ranked[np.unique(border[chosen][ranked], return_index=True)[1]]
    chosen, agreeing = chosen[leading], agreeing[leading]
    others = np.bincount(border, minlength=border_first.size)[border[chosen]] - agreeing
    trusted = agreeing >= np.maximum(_LEAST_BORDER, _LEAST_LEAD * others)
    found = np.column_stack([np.column_stack([a, b, order])[chosen[trusted]], agreeing[trusted]])
    return found[np.lexsort((found[:, 1], found[:, 0], (others - agreeing)[trusted]))]


@njit(cache=True)
def _join(borders, orders, groups):  # type: ignore[no-untyped-def]
    """Join groups over borders in their order: the group of b takes the number of a's, and its fringes."""
    following = np.full(groups.size, -1)  # the next member of a group, from its number on
    last = groups.copy()
    for k in range(borders.shape[0]):
        a, b, order = borders[k, 0], borders[k, 1], borders[k, 2]
        into, from_ = groups[a], groups[b]
        if into != from_:
            change = order + orders[a] - orders[b]
            following[last[into]] = from_
            last[into] = last[from_]
            member = from_
            while member >= 0:
                orders[member] += change
                groups[member] = into
                member = following[member]


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
        For every label the fringes to be added, and the number of the group that it is connected with.
    """
    number = int(labels.max())
    orders = np.zeros(number + 1, dtype=np.int64)
    groups = np.arange(number + 1, dtype=np.int32)
    _join(trusted_borders(values, labels), orders, groups)
    return orders, groups
