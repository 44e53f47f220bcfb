"""The shape of the whole grid without its details: a polynomial map from (row, column) to px."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre
from scipy import linalg

from fringecal.detect.grid.line_points import LinePoints
from fringecal.detect.grid.nodes import Edges
from fringecal.errors import DetectionError
from fringecal.numerics import robust_sd

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
# Indices are whole at nodes and fractional between them.
IndexArray = npt.NDArray[Any]

# Degree 5 follows a strong barrel to a few tenths of a pixel; the parabolas at the nodes take the rest.
MAX_DEGREE = 5
# Coarse crossings are only good for this.
MAX_COARSE_DEGREE = 3
# Observations that a coefficient needs: else it follows the noise.
OBSERVATIONS_PER_COEFFICIENT = 3
# Residuals below this are none, px: drawn pictures have no noise.
NEGLIGIBLE_PX = 1e-3
# Part of the mean diagonal that is added to normal equations: far below any use but above rounding.
RIDGE = 1e-13
# The map only has to be near; the parabolas use all points.
MAX_POINTS = 1_500
# Robust standard deviations beyond which a point is an outlier: ink is not normal noise.
OUTLIER_SIGMAS = 5.0


@dataclass(frozen=True)
class SmoothMap:
    """Polynomial map from grid index (row, column) to px.

    Lines are fitted as deviations from it, so that neither a parabola's truncation nor one-sided fits at
    the border bend the crossings of a strongly distorted picture.
    """

    coefficients: FloatArray
    middle: FloatArray
    half: FloatArray

    def __call__(self, row: IndexArray, column: IndexArray) -> FloatArray:
        """Position (..., 2), px, of fractional indices."""
        return self._values(row, column, self.coefficients)

    def step(self, row: IndexArray, column: IndexArray, family: int) -> FloatArray:
        """Return the derivative (..., 2), px per index, along a family's lines (0 horizontal, 1 vertical)."""
        axis = 1 - family
        slope = legendre.legder(self.coefficients, axis=axis + 1) / self.half[axis]
        return self._values(row, column, slope)

    def _values(self, row: IndexArray, column: IndexArray, coefficients: FloatArray) -> FloatArray:
        """Both components (..., 2) of sum c_ij P_i P_j."""
        y, x = self._unit(row, column)
        rows = legendre.legvander(y, coefficients.shape[1] - 1)
        columns = legendre.legvander(x, coefficients.shape[2] - 1)
        return np.stack([((rows @ c) * columns).sum(axis=-1) for c in coefficients], axis=-1)

    def basis(self, row: IndexArray, column: IndexArray, degree: int) -> FloatArray:
        """Values (n, terms) at the indices of the products of Legendre polynomials up to a total degree."""
        y, x = self._unit(row, column)
        i, j = _terms(degree)
        return legendre.legvander(y, degree)[:, i] * legendre.legvander(x, degree)[:, j]

    def _unit(self, row: IndexArray, column: IndexArray) -> tuple[FloatArray, FloatArray]:
        return (row - self.middle[0]) / self.half[0], (column - self.middle[1]) / self.half[1]


def _terms(degree: int) -> tuple[IntArray, IntArray]:
    """Powers (of rows, of columns) of all terms up to a total degree."""
    i, j = np.mgrid[: degree + 1, : degree + 1]
    return i[i + j <= degree], j[i + j <= degree]


def fit_to_nodes(nodes: FloatArray) -> SmoothMap:
    """Fit the map to crossings (rows, columns, 2), px, NaN where unknown."""
    row, column = np.nonzero(np.isfinite(nodes[..., 0]))
    size = np.array([np.ptp(row), np.ptp(column)]) + 1
    middle = np.array([row.min(), column.min()]) + (size - 1) / 2
    frame = SmoothMap(np.zeros((2, 1, 1)), middle, np.maximum((size - 1) / 2, 1.0))
    basis = frame.basis(row, column, MAX_COARSE_DEGREE)
    empty = np.zeros_like(basis)
    design = np.concatenate([np.hstack([basis, empty]), np.hstack([empty, basis])])
    return _fitted(frame, design, nodes[row, column].T.ravel(), (size[0], size[1]))[0]


@dataclass(frozen=True)
class Deviations:
    """Points as seen from the map: line, fractional place along it, unit normal and offset along that, px."""

    line: IntArray
    place: IndexArray
    normal: FloatArray
    offset_px: FloatArray


def deviations(smooth: SmoothMap, family: int, edges: Edges, points: LinePoints) -> Deviations:
    """Place and offset of every point against the map's line of the same index."""
    line = edges.line[points.edge]
    start, chord = edges.start[points.edge], (edges.end - edges.start)[points.edge]
    at = np.stack([points.u_px, points.v_px], axis=1)
    place: IndexArray = edges.place[points.edge] + ((at - start) * chord).sum(axis=1) / (chord**2).sum(axis=1)
    for _ in range(2):
        row, column = (line, place) if family == 0 else (place, line)
        step = smooth.step(row, column, family)
        rest = at - smooth(row, column)
        place = place + (rest * step).sum(axis=1) / (step**2).sum(axis=1)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.hypot(step[:, 0], step[:, 1])[:, None]
    return Deviations(line, place, normal, (rest * normal).sum(axis=1))


def fit_to_points(
    smooth: SmoothMap, seen: Sequence[Deviations], usable: Sequence[BoolArray], shape: tuple[int, int]
) -> SmoothMap:
    """Fit the map anew to the points of both families, each of which knows its place across its line only.

    Parameters
    ----------
    smooth
        The map so far, from which the deviations were taken.
    seen, usable
        Deviations of the horizontal and vertical lines' points, and which of them may be used.
    shape
        Numbers of rows and columns.
    """
    designs, targets = [], []
    for family, (dev, use) in enumerate(zip(seen, usable, strict=True)):
        good = np.flatnonzero(use)
        pick = good[:: max(1, len(good) // MAX_POINTS)]
        line, place, normal = dev.line[pick], dev.place[pick], dev.normal[pick]
        row, column = (line, place) if family == 0 else (place, line)
        basis = smooth.basis(row, column, MAX_DEGREE)
        designs.append(np.hstack([normal[:, :1] * basis, normal[:, 1:] * basis]))
        targets.append((normal * smooth(row, column)).sum(axis=1) + dev.offset_px[pick])
    design, target = np.concatenate(designs), np.concatenate(targets)
    first, flat = _fitted(smooth, design, target, shape)
    rest = target - design @ flat
    kept = np.abs(rest) <= max(OUTLIER_SIGMAS * robust_sd(rest, about=0), NEGLIGIBLE_PX)
    return first if kept.all() else _fitted(smooth, design[kept], target[kept], shape)[0]


def _fitted(
    frame: SmoothMap, design: FloatArray, target: FloatArray, shape: tuple[int, int]
) -> tuple[SmoothMap, FloatArray]:
    """Solve for the coefficients of the degree with the least Bayesian information criterion.

    A needless degree would follow the errors at the border and feed them back. The coefficients come
    as a map and as the design's columns have them.

    Notes
    -----
    With the columns in order of degree, one Cholesky factor L of the normal equations serves all degrees:
    y = L^-1 b, and the first m columns explain sum(y[:m]^2).
    """
    top = round((np.sqrt(4 * design.shape[1] + 1) - 3) / 2)
    i, j = _terms(top)
    degrees = np.tile(i + j, 2)
    possible = np.flatnonzero(np.tile((i < shape[0]) & (j < shape[1]), 2))
    columns = possible[np.argsort(degrees[possible], kind="stable")]
    matrix, right = _normal_equations(design[:, columns], target)
    try:
        factor = linalg.cholesky(matrix, lower=True)
    except (linalg.LinAlgError, ValueError) as error:
        raise DetectionError(
            "no line grid found: what was taken for its lines does not determine a grid's shape; check that the "
            "picture shows a ruled grid, sharp and evenly lit"
        ) from error
    half_solved = linalg.solve_triangular(factor, right, lower=True)
    count = _best_count(degrees[columns], half_solved, target)
    flat = np.zeros(design.shape[1])
    flat[columns[:count]] = linalg.solve_triangular(factor[:count, :count].T, half_solved[:count])
    coefficients = np.zeros((2, top + 1, top + 1))
    coefficients[:, i, j] = flat.reshape(2, -1)
    return SmoothMap(coefficients, frame.middle, frame.half), flat


def _normal_equations(design: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Matrix and right-hand side, with a ridge far below any use but above rounding."""
    matrix = design.T @ design
    return matrix + RIDGE * np.trace(matrix) / len(matrix) * np.eye(len(matrix)), design.T @ target


def _best_count(degree: IntArray, half_solved: FloatArray, target: FloatArray) -> int:
    """Count the columns, sorted by degree, up to the degree with the least criterion."""
    counts = np.searchsorted(degree, np.arange(1, degree[-1] + 1), side="right")
    counts = counts[(counts * OBSERVATIONS_PER_COEFFICIENT <= len(target)) | (counts == counts[0])]
    explained = np.cumsum(half_solved**2)[counts - 1]
    rest = np.maximum(float(target @ target) - explained, 0.0) / len(target) + NEGLIGIBLE_PX**2
    return int(counts[np.argmin(len(target) * np.log(rest) + counts * np.log(len(target)))])
