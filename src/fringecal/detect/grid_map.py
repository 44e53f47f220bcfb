"""The shape of the whole grid without its details: a polynomial map from (row, column) to px."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

from fringecal.detect.grid_nodes import Edges
from fringecal.detect.line_points import LinePoints

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
# Indices are whole at nodes and fractional between them.
IndexArray = npt.NDArray[Any]

# Degree 5 follows a strong barrel to a few tenths of a pixel; the parabolas at the nodes take the rest.
MAX_DEGREE = 5
# Coarse crossings are only good for this.
MAX_COARSE_DEGREE = 3
OBSERVATIONS_PER_COEFFICIENT = 3
NEGLIGIBLE_PX = 1e-3
STEP_INDEX = 1e-4
# The map only has to be near; the parabolas use all points.
MAX_POINTS = 6_000
REJECT_SIGMAS = 5.0


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
        y, x = self._unit(row, column)
        return np.stack([legendre.legval2d(y, x, c) for c in self.coefficients], axis=-1)

    def step(self, row: IndexArray, column: IndexArray, family: int) -> FloatArray:
        """Return the derivative (..., 2), px per index, along a family's lines (0 horizontal, 1 vertical)."""
        dr, dc = (0.0, STEP_INDEX) if family == 0 else (STEP_INDEX, 0.0)
        return (self(row + dr, column + dc) - self(row - dr, column - dc)) / (2 * STEP_INDEX)

    def basis(self, row: IndexArray, column: IndexArray, degree: int) -> FloatArray:
        """Values (n, (degree + 1)^2) of all products of Legendre polynomials at the indices."""
        y, x = self._unit(row, column)
        return np.asarray(legendre.legvander2d(y, x, [degree, degree]), dtype=float)

    def _unit(self, row: IndexArray, column: IndexArray) -> tuple[FloatArray, FloatArray]:
        return (row - self.middle[0]) / self.half[0], (column - self.middle[1]) / self.half[1]


def fit_to_nodes(nodes: FloatArray) -> SmoothMap:
    """Fit the map to crossings (rows, columns, 2), px, NaN where unknown."""
    row, column = np.nonzero(np.isfinite(nodes[..., 0]))
    size = np.array([np.ptp(row), np.ptp(column)]) + 1
    middle = np.array([row.min(), column.min()]) + (size - 1) / 2
    frame = SmoothMap(np.zeros((2, 1, 1)), middle, np.maximum((size - 1) / 2, 1.0))
    basis = frame.basis(row, column, MAX_COARSE_DEGREE)
    empty = np.zeros_like(basis)
    design = np.concatenate([np.hstack([basis, empty]), np.hstack([empty, basis])])
    return _fitted(frame, design, nodes[row, column].T.ravel(), (size[0], size[1]))


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
    first = _fitted(smooth, design, target, shape)
    padded = np.zeros((2, MAX_DEGREE + 1, MAX_DEGREE + 1))
    padded[:, : first.coefficients.shape[1], : first.coefficients.shape[2]] = first.coefficients
    rest = target - design @ padded.ravel()
    kept = np.abs(rest) <= max(REJECT_SIGMAS * robust_sd(rest), NEGLIGIBLE_PX)
    return _fitted(smooth, design[kept], target[kept], shape)


def _fitted(frame: SmoothMap, design: FloatArray, target: FloatArray, shape: tuple[int, int]) -> SmoothMap:
    """Solve for the coefficients of the degree with the least Bayesian information criterion.

    A needless degree would follow the errors at the border and feed them back.
    """
    top = round(np.sqrt(design.shape[1] / 2)) - 1
    order = np.arange(top + 1)
    matrix, right, square = design.T @ design, design.T @ target, float(target @ target)
    best, least = np.zeros((2, top + 1, top + 1)), np.inf
    for degree in range(1, top + 1):
        kept = np.add.outer(order, order) <= degree
        kept &= (order[:, None] < shape[0]) & (order < shape[1])
        pick = np.flatnonzero(np.tile(kept.ravel(), 2))
        if degree > 1 and len(pick) * OBSERVATIONS_PER_COEFFICIENT > len(target):
            break
        solved, *_ = np.linalg.lstsq(matrix[np.ix_(pick, pick)], right[pick], rcond=1e-12)
        rest = max(square - float(solved @ right[pick]), 0.0) / len(target) + NEGLIGIBLE_PX**2
        criterion = len(target) * np.log(rest) + len(pick) * np.log(len(target))
        if criterion < least:
            coefficients = np.zeros(design.shape[1])
            coefficients[pick] = solved
            best, least = coefficients.reshape(2, top + 1, top + 1), criterion
    return SmoothMap(best, frame.middle, frame.half)


def robust_sd(values: FloatArray) -> float:
    """Return 1.4826 times the median absolute value of the finite entries (0 if there are none)."""
    finite = np.abs(values[np.isfinite(values)])
    return 1.4826 * float(np.median(finite)) if finite.size else 0.0
