"""Crossings of a grid as dense arrays: prediction of missing ones, edges between them, intersections."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fringecal.detect.line_points import LinePoints, LineStatus

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Points on the two adjoining edges suffice for a crossing if each has this many; else the next edges join.
ENOUGH_POINTS = 3
QUADRATIC_POINTS = 5
OUTLIER_SIGMAS = 5.0
# Ruled lines are never straighter than this to their neighbourhood; smaller residuals are not outliers.
OUTLIER_FLOOR_PX = 0.03


@dataclass(frozen=True)
class Edges:
    """Edges of one family between adjacent sites: line (index of the line), place (index along it), ends."""

    line: IntArray
    place: IntArray
    start: FloatArray
    end: FloatArray
    spacing: FloatArray


@dataclass(frozen=True)
class LocalLines:
    """The line of one family near every node, as a parabola across its direction.

    Parameters
    ----------
    direction
        Unit vectors along the line, (rows, columns, 2).
    coefficients
        Offset (px), slope and bow (1/px) of the parabola, (rows, columns, 3); NaN where unknown.
    covariance
        Of the coefficients, (rows, columns, 3, 3), for the points' own sigma.
    """

    direction: FloatArray
    coefficients: FloatArray
    covariance: FloatArray

    @property
    def sigma_px(self) -> FloatArray:
        """Standard uncertainty of the offset at the node, px."""
        return np.sqrt(self.covariance[..., 0, 0])


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
    typical = np.nanmedian(step.reshape(-1, 2), axis=0)
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
    spacing = np.abs(step[:, 0] * across[:, 1] - step[:, 1] * across[:, 0]) / np.maximum(length, 1e-9)
    line, place = (row, column) if family == 0 else (column, row)
    return Edges(line, place, start, ends, spacing)


def fit_local_lines(
    nodes: FloatArray, family: int, edges: Edges, points: LinePoints, usable: BoolArray
) -> LocalLines:
    """Fit a parabola to the points of a family's line on both sides of every node.

    Parameters
    ----------
    nodes
        Crossings (rows, columns, 2), px.
    family
        0 for horizontal lines, 1 for vertical ones.
    edges, points
        The family's edges and the points measured on them.
    usable
        Which points may be used, (n,).
    """
    grid = nodes.shape[:2]
    step = along(nodes, family)
    length = np.hypot(step[..., 0], step[..., 1])
    direction = step / length[..., None]
    line, place = edges.line[points.edge], edges.place[points.edge]
    near = np.zeros(grid, dtype=int)
    crowded = np.ones(grid, dtype=bool)
    for offset in (0, 1):
        count = np.zeros(grid, dtype=int)
        at, ok = _site(line, place + offset, family, grid)
        np.add.at(count, (at[0][ok & usable], at[1][ok & usable]), 1)
        crowded &= count >= ENOUGH_POINTS
        near += count
    sums = np.zeros((*grid, 8))
    for offset in (-1, 0, 1, 2):
        at, ok = _site(line, place + offset, family, grid)
        use = ok & usable & np.isfinite(nodes[at[0], at[1], 0])
        if offset in (-1, 2):
            use &= ~crowded[at]
        here = at[0][use], at[1][use]
        t, s = _local(points, use, nodes[here], direction[here])
        t = t / length[here]
        weight = 1 / np.maximum(points.sigma_px[use], 1e-4) ** 2
        terms = np.stack([weight * t**k for k in range(5)] + [weight * s * t**k for k in range(3)], axis=1)
        np.add.at(sums, here, terms)
        if offset in (-1, 2):
            np.add.at(near, here, 1)
    return _solve_parabolas(sums, near, length, direction)


def _site(
    line: IntArray, place: IntArray, family: int, grid: tuple[int, ...]
) -> tuple[tuple[IntArray, IntArray], BoolArray]:
    """(row, column) of a place on a line, clipped into the grid, and whether it lay inside."""
    row, column = (line, place) if family == 0 else (place, line)
    ok = (row >= 0) & (row < grid[0]) & (column >= 0) & (column < grid[1])
    return (np.clip(row, 0, grid[0] - 1), np.clip(column, 0, grid[1] - 1)), ok


def _local(
    points: LinePoints, use: BoolArray, origin: FloatArray, direction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Coordinates of points along and across a direction, px."""
    du, dv = points.u_px[use] - origin[:, 0], points.v_px[use] - origin[:, 1]
    return du * direction[:, 0] + dv * direction[:, 1], dv * direction[:, 0] - du * direction[:, 1]


def _solve_parabolas(
    sums: FloatArray, count: IntArray, length: FloatArray, direction: FloatArray
) -> LocalLines:
    """Solve the normal equations of every node; a straight line where a parabola is not determined."""
    order = np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4]])
    matrix, right = sums[..., order], sums[..., 5:8].copy()
    straight = count < QUADRATIC_POINTS
    matrix[straight, 2, :2] = matrix[straight, :2, 2] = right[straight, 2] = 0.0
    matrix[straight, 2, 2] = 1.0
    unknown = (count < 2) | (sums[..., 0] <= 0)
    matrix[unknown], right[unknown] = np.eye(3), 0.0
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", matrix), 1e-300))
    scaled = matrix / (scale[..., :, None] * scale[..., None, :])
    # Points all on one side determine slope and bow poorly; the condition guards the extrapolation.
    unknown |= np.linalg.cond(scaled) > 1e10
    scaled[unknown] = np.eye(3)
    inverse = np.linalg.inv(scaled) / (scale[..., :, None] * scale[..., None, :])
    coefficients = np.einsum("...ab,...b->...a", inverse, right)
    unit = np.stack([np.ones_like(length), 1 / length, 1 / length**2], axis=-1)
    inverse[straight, 2, 2] = 0.0
    coefficients = coefficients * unit
    covariance = inverse * unit[..., :, None] * unit[..., None, :]
    coefficients[unknown] = covariance[unknown] = np.nan
    return LocalLines(direction, coefficients, covariance)


def intersect(nodes: FloatArray, horizontal: LocalLines, vertical: LocalLines) -> FloatArray:
    """Crossings of the two local parabolas, px, NaN where either is unknown."""
    shift = np.zeros_like(nodes)
    for _ in range(4):
        rows, right = [], []
        for lines in (horizontal, vertical):
            d, c = lines.direction, lines.coefficients
            t = (shift * d).sum(axis=-1)
            slope = c[..., 1] + 2 * c[..., 2] * t
            normal = np.stack([-d[..., 1], d[..., 0]], axis=-1)
            rows.append(normal - slope[..., None] * d)
            right.append(c[..., 0] - c[..., 2] * t**2)
        (a, b), (p, q) = rows, right
        determinant = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        shift = np.stack(
            [(p * b[..., 1] - q * a[..., 1]) / determinant, (q * a[..., 0] - p * b[..., 0]) / determinant],
            axis=-1,
        )
    return nodes + shift


def residuals(
    nodes: FloatArray, family: int, edges: Edges, points: LinePoints, lines: LocalLines
) -> FloatArray:
    """Distance of every point across the parabola of the nearer end of its edge, px (NaN if unknown).

    Divided by sqrt(1 - leverage), because a parabola through few points runs too close to them.
    """
    line, place = edges.line[points.edge], edges.place[points.edge]
    to_start = np.hypot(points.u_px - edges.start[points.edge, 0], points.v_px - edges.start[points.edge, 1])
    to_end = np.hypot(points.u_px - edges.end[points.edge, 0], points.v_px - edges.end[points.edge, 1])
    at, _ = _site(line, place + (to_end < to_start), family, nodes.shape[:2])
    everything = np.ones(len(points.u_px), dtype=bool)
    t, s = _local(points, everything, nodes[at], lines.direction[at])
    c = lines.coefficients[at]
    powers = np.stack([np.ones_like(t), t, t**2], axis=1)
    leverage = np.einsum("na,nab,nb->n", powers, lines.covariance[at], powers) / points.sigma_px**2
    return (s - (powers * c).sum(axis=1)) / np.sqrt(np.clip(1 - leverage, 0.1, 1.0))


def robust_sd(values: FloatArray) -> float:
    """Return 1.4826 times the median absolute value of the finite entries (0 if there are none)."""
    finite = np.abs(values[np.isfinite(values)])
    return 1.4826 * float(np.median(finite)) if finite.size else 0.0


def mark_outliers(points: LinePoints, residual_px: FloatArray) -> npt.NDArray[np.int64]:
    """Status with OUTLIER where a good point lies off its line's neighbourhood."""
    good = points.status == LineStatus.OK
    limit = max(OUTLIER_SIGMAS * robust_sd(residual_px[good]), OUTLIER_FLOOR_PX)
    return np.where(good & (np.abs(residual_px) > limit), int(LineStatus.OUTLIER), points.status)
