"""Crossings as intersections: every line near a node is a parabola about a smooth map of the whole grid."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from fringecal.detect.grid.line_points import LineStatus
from fringecal.detect.grid.shape_map import OUTLIER_SIGMAS, Deviations, SmoothMap
from fringecal.numerics import robust_sd

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Sampling leaves about this much even in a picture without noise, px.
MIN_SIGMA_PX = 1e-4
# Points on the two adjoining edges suffice for a crossing if each has this many; else the next edges join.
ENOUGH_POINTS = 3
# Points from which a parabola is fitted, not a straight line: two more than it has coefficients; and the least.
QUADRATIC_POINTS = 5
MIN_POINTS = 2
# Standard deviation of the points' index along the line: one edge alone (0.2) aims too badly.
MIN_SPREAD = 0.3
# Of the normal equations scaled to a unit diagonal, where 1 is best: below, slope and curvature are rounding errors.
MIN_DETERMINANT = 1e-10
# Lines that meet at less than about 15 degrees are not a grid's two families.
MIN_CROSSING_SINE = 0.25
# Sharp thin lines sway by this much against the pixel raster; smaller residuals are not outliers.
OUTLIER_FLOOR_PX = 0.1
# Least part of a point's variance that its residual keeps beside the parabola that it helped to fit: below, the
# residual tells nothing.
MIN_FREE_PART = 0.1
# Instead of a division by 0.
NO_WEIGHT = 1e-300


@dataclass(frozen=True)
class LocalLines:
    """The line of one family near every node: a parabola of the deviation over the index along the line.

    Parameters
    ----------
    coefficients
        Offset, slope and curvature, px per index to the powers 0, 1, 2, (rows, columns, 3); NaN where unknown.
    covariance
        Of the coefficients, (rows, columns, 3, 3), for the points' own sigma.
    """

    coefficients: FloatArray
    covariance: FloatArray

    @property
    def sigma_px(self) -> FloatArray:
        """Standard uncertainty of the offset at the node, px."""
        return np.sqrt(self.covariance[..., 0, 0])


def fit_local_lines(
    shape: tuple[int, int], family: int, seen: Deviations, sigma_px: FloatArray, usable: BoolArray
) -> LocalLines:
    """Fit a parabola to the deviations of a family's line on both sides of every node.

    Parameters
    ----------
    shape
        Numbers of rows and columns of nodes.
    family
        0 for horizontal lines, 1 for vertical ones.
    seen, sigma_px, usable
        Deviations of the points, their standard uncertainty and which of them may be used, (n,).
    """
    line, place = seen.line[usable], seen.place[usable]
    row, column = (line, np.floor(place)) if family == 0 else (np.floor(place), line)
    sites = np.stack([row, column], axis=1).astype(np.int64)
    part = place - np.floor(place)
    weight = 1 / np.maximum(sigma_px[usable], MIN_SIGMA_PX) ** 2
    sums, count = _moments(shape, 1 - family, sites, part, seen.offset_px[usable], weight)
    return _solve_parabolas(sums, count)


@njit(cache=True)
def _moments(shape, axis, sites, part, offset, weight):  # type: ignore[no-untyped-def] # pragma: no cover
    """Weighted sums of t^0..t^4 and s t^0..t^2 at every node, and the number of points in them.

    A point counts at the two nodes of its edge, and at the next ones where their own edges hold few points.
    """
    rows, columns = shape
    near = np.zeros((rows, columns, 2), np.int64)
    sums = np.zeros((rows, columns, 8))
    count = np.zeros((rows, columns), np.int64)
    ways = (1 - axis, axis)
    for n in range(len(part)):
        for step in (0, 1):
            i, j = sites[n, 0] + step * ways[0], sites[n, 1] + step * ways[1]
            if 0 <= i < rows and 0 <= j < columns:
                near[i, j, step] += 1
    for n in range(len(part)):
        for step in (-1, 0, 1, 2):
            i, j = sites[n, 0] + step * ways[0], sites[n, 1] + step * ways[1]
            if not (0 <= i < rows and 0 <= j < columns):
                continue
            if step in (-1, 2) and near[i, j].min() >= ENOUGH_POINTS:
                continue
            count[i, j] += 1
            t, power = part[n] - step, weight[n]
            for k in range(5):
                sums[i, j, k] += power
                if k < 3:
                    sums[i, j, 5 + k] += power * offset[n]
                power *= t
    return sums, count


def _site(
    line: IntArray, place: IntArray, family: int, shape: tuple[int, int]
) -> tuple[tuple[IntArray, IntArray], BoolArray]:
    """(row, column) of a place on a line, clipped into the grid, and whether it lay inside."""
    row, column = (line, place) if family == 0 else (place, line)
    ok = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    return (np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)), ok


def _solve_parabolas(sums: FloatArray, count: IntArray) -> LocalLines:
    """Solve the normal equations of every node; a straight line where a parabola is not determined."""
    matrix, right = sums[..., np.add.outer(np.arange(3), np.arange(3))], sums[..., 5:8].copy()
    straight = count < QUADRATIC_POINTS
    matrix[straight, 2, :2] = matrix[straight, :2, 2] = right[straight, 2] = 0.0
    matrix[straight, 2, 2] = 1.0
    unknown = (count < MIN_POINTS) | (_spread(sums) < MIN_SPREAD)
    matrix[unknown] = np.eye(3)
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", matrix), NO_WEIGHT))
    matrix = matrix / (scale[..., :, None] * scale[..., None, :])
    # Points in one short piece do not determine slope and curvature; the condition guards the extrapolation.
    unknown |= np.linalg.det(matrix) < MIN_DETERMINANT
    matrix[unknown] = np.eye(3)
    covariance = np.linalg.inv(matrix) / (scale[..., :, None] * scale[..., None, :])
    covariance[straight, 2, 2] = 0.0
    coefficients = np.einsum("...ab,...b->...a", covariance, right)
    coefficients[unknown] = covariance[unknown] = np.nan
    return LocalLines(coefficients, covariance)


def _spread(sums: FloatArray) -> FloatArray:
    """Weighted standard deviation of the points' index along the line, (rows, columns)."""
    weight = np.maximum(sums[..., 0], NO_WEIGHT)
    return np.sqrt(np.maximum(sums[..., 2] / weight - (sums[..., 1] / weight) ** 2, 0))


def intersect(smooth: SmoothMap, horizontal: LocalLines, vertical: LocalLines) -> FloatArray:
    """Crossings (rows, columns, 2), px, of the two families' lines, NaN where either is unknown.

    Notes
    -----
    The crossing lies within a pixel of the smooth map, where the map's own bend is negligible: two
    straight lines with the deviations' offsets and slopes are intersected.
    """
    row, column = _places(horizontal.coefficients.shape)
    normals = crossing_normals(smooth, horizontal, vertical)
    offsets = np.stack([horizontal.coefficients[..., 0], vertical.coefficients[..., 0]], axis=-1)
    return np.asarray(smooth(row, column) + shift_of(normals, offsets))


def _places(shape: tuple[int, ...]) -> FloatArray:
    return np.mgrid[: shape[0], : shape[1]].astype(float)


def crossing_normals(smooth: SmoothMap, horizontal: LocalLines, vertical: LocalLines) -> FloatArray:
    """Normals (rows, columns, 2, 2) of the horizontal and of the vertical line at every crossing, as (u, v)."""
    row, column = _places(horizontal.coefficients.shape)
    normals = []
    for family, lines in enumerate((horizontal, vertical)):
        step = smooth.step(row, column, family)
        length = np.hypot(step[..., 0], step[..., 1])
        direction = step / length[..., None]
        normal = np.stack([-direction[..., 1], direction[..., 0]], axis=-1)
        normals.append(normal - (lines.coefficients[..., 1] / length)[..., None] * direction)
    return np.stack(normals, axis=-2)


def shift_of(normals: FloatArray, offsets_px: FloatArray) -> FloatArray:
    """Shift (..., 2), px, of a crossing whose lines move by (..., 2) along their normals; NaN where they meet flat."""
    a, b, p, q = normals[..., 0, :], normals[..., 1, :], offsets_px[..., 0], offsets_px[..., 1]
    determinant = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    shift = np.stack([p * b[..., 1] - q * a[..., 1], q * a[..., 0] - p * b[..., 0]], axis=-1)
    clear = np.abs(determinant) > MIN_CROSSING_SINE
    return np.asarray(np.where(clear[..., None], shift / np.where(clear, determinant, 1.0)[..., None], np.nan))


def residuals(family: int, seen: Deviations, sigma_px: FloatArray, lines: LocalLines) -> FloatArray:
    """Distance of every point across the parabola of the nearer node, px (NaN where there is none).

    Divided by sqrt(1 - leverage), because a parabola through few points runs too close to them.
    """
    nearest = np.round(seen.place).astype(int)
    shape = lines.coefficients.shape[:2]
    at, _ = _site(seen.line, nearest, family, (shape[0], shape[1]))
    t = seen.place - (at[1] if family == 0 else at[0])
    powers = np.stack([np.ones_like(t), t, t**2], axis=1)
    leverage = np.einsum("na,nab,nb->n", powers, lines.covariance[at], powers) / sigma_px**2
    rest = seen.offset_px - (powers * lines.coefficients[at]).sum(axis=1)
    return rest / np.sqrt(np.clip(1 - leverage, MIN_FREE_PART, 1.0))


def mark_outliers(status: IntArray, residual_px: FloatArray) -> IntArray:
    """Status with OUTLIER where a good point lies off its line's neighbourhood."""
    good = status == LineStatus.OK
    limit = max(OUTLIER_SIGMAS * robust_sd(residual_px[good], about=0), OUTLIER_FLOOR_PX)
    return np.where(good & (np.abs(residual_px) > limit), int(LineStatus.OUTLIER), status)
