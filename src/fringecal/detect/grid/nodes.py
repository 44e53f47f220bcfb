"""Crossings of a grid as dense arrays: prediction of missing ones and edges between them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fringecal.errors import DetectionError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


# Instead of a division by 0 where two crossings coincide, px.
NO_LENGTH_PX = 1e-9


@dataclass(frozen=True)
class Edges:
    """Edges of one family between adjacent sites: line (index of the line), place (index along it), ends."""

    line: IntArray
    place: IntArray
    start: FloatArray
    end: FloatArray
    spacing: FloatArray


def predict_missing(nodes: FloatArray) -> FloatArray:
    """Fill every free site beside a node with its prediction from the neighbours, elsewhere NaN.

    Parameters
    ----------
    nodes
        Crossings (rows, columns, 2) in px, NaN where unknown.

    Returns
    -------
    FloatArray
        Same shape; the known nodes unchanged.
    """
    guesses = []
    for axis, way in ((0, 1), (0, -1), (1, 1), (1, -1)):
        near, next_, far = (_shifted(nodes, axis, way * k) for k in (1, 2, 3))
        quadratic = 3 * near - 3 * next_ + far
        guesses.append(np.where(np.isfinite(quadratic), quadratic, 2 * near - next_))
    for down in (1, -1):
        for right in (1, -1):
            beside, above = _shifted(nodes, 1, right), _shifted(nodes, 0, down)
            guesses.append(beside + above - _shifted(_shifted(nodes, 1, right), 0, down))
    stack = np.stack(guesses)
    known = np.isfinite(stack)
    total = np.where(known, stack, 0).sum(axis=0)
    count = known.sum(axis=0)
    mean = np.full(nodes.shape, np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    return np.where(np.isfinite(nodes), nodes, mean)


def _shifted(nodes: FloatArray, axis: int, by: int) -> FloatArray:
    """Value of the neighbour `by` sites further along an axis, NaN beyond the border."""
    moved = np.full_like(nodes, np.nan)
    size = nodes.shape[axis]
    if abs(by) < size:
        target = [slice(None)] * 3
        source = [slice(None)] * 3
        target[axis] = slice(max(0, -by), size - max(0, by))
        source[axis] = slice(max(0, by), size - max(0, -by))
        moved[tuple(target)] = nodes[tuple(source)]
    return moved


def along(nodes: FloatArray, family: int) -> FloatArray:
    """Step (rows, columns, 2) from each node to the next along a family's lines (0 rows, 1 columns), px."""
    axis = 1 - family
    forward = _shifted(nodes, axis, 1) - nodes
    backward = nodes - _shifted(nodes, axis, -1)
    both = 0.5 * (forward + backward)
    step = np.where(np.isfinite(both), both, np.where(np.isfinite(forward), forward, backward))
    known = np.isfinite(step[..., 0])
    if not known.any():
        raise DetectionError("no grid found: no two crossings are neighbours on a line")
    typical = np.median(step[known], axis=0)
    return np.where(np.isfinite(step), step, typical)


def edges_between(nodes: FloatArray, family: int) -> Edges:
    """All edges of a family (0: horizontal lines, 1: vertical) whose two ends are known."""
    ends = _shifted(nodes, 1 - family, 1)
    row, column = np.nonzero(np.isfinite(nodes[..., 0]) & np.isfinite(ends[..., 0]))
    return _edges(nodes, family, row, column, ends[row, column])


def stubs(nodes: FloatArray, family: int, way: int) -> Edges:
    """Edges that leave the known grid, from a node to where the next one would be (way +1 or -1)."""
    near = _shifted(nodes, 1 - family, way)
    row, column = np.nonzero(np.isfinite(nodes[..., 0]) & ~np.isfinite(near[..., 0]))
    before = _shifted(nodes, 1 - family, -way)[row, column]
    linear = 2 * nodes[row, column] - before
    quadratic = 3 * nodes[row, column] - 3 * before + _shifted(nodes, 1 - family, -2 * way)[row, column]
    ends = np.where(np.isfinite(quadratic), quadratic, linear)
    ok = np.isfinite(ends[:, 0])
    return _edges(nodes, family, row[ok], column[ok], ends[ok])


def _edges(nodes: FloatArray, family: int, row: IntArray, column: IntArray, ends: FloatArray) -> Edges:
    start = nodes[row, column]
    step = ends - start
    across = along(nodes, 1 - family)[row, column]
    length = np.hypot(step[:, 0], step[:, 1])
    spacing = np.abs(step[:, 0] * across[:, 1] - step[:, 1] * across[:, 0]) / np.maximum(length, NO_LENGTH_PX)
    line, place = (row, column) if family == 0 else (column, row)
    return Edges(line, place, start, ends, spacing)
