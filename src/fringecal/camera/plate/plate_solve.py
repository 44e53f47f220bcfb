"""Solve for the camera on the plate, and leave crossings out that disagree."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from fringecal.camera.distortion.crossing_scatter import shared_factor, shared_scatter
from fringecal.camera.plate.plate_problem import Problem, noticeable, residual_px, residuals
from fringecal.errors import FitError
from fringecal.numerics import robust_sd

Array = NDArray[np.float64]

MIN_CROSSINGS = 12
"""Of a grid: 24 coordinates for the camera's and the sheet's numbers, some dozen without those that are stated."""
_OUTLIER = 4.0  # residuals beyond this many robust standard deviations are wrong crossings, not noise
_LEAST_ROBUST = 1e-9  # drawn crossings scatter by rounding alone; none is an outlier of that
_LEAST_AGREEING = 0.5  # of the crossings: fewer are no majority, and either half might be the wrong one
_ROUNDS = 3  # of leaving crossings out and scaling their sigma: the set settles after two
_CONVERGED = 1e-10  # relative change of parameters and of the sum of squares at which the solver stops
#: Of the largest singular value, all parameters being of one size: below it derivatives are rounding errors.
_LEAST_SINGULAR = 1e-7
_STEP = 0.05  # of a derivative: so many standard uncertainties of the parameter, were the others known
_LEAST_FACTOR = 0.02  # residuals of drawn pictures may vanish; the priors must still be felt beside them


@dataclass(frozen=True)
class Solution:
    """Parameters (the problem's free ones, then turn, shift and stretch of the sheet) with their covariance.

    `factor` is what the crossings' stated sigma was multiplied by.
    """

    vector: Array
    covariance: Array
    factor: float


def _least_squares(residuals: Callable[[Array], Array], start: Array, sizes: Array) -> tuple[Array, Array]:
    """Return the parameters, (n,), at which the sum of squares is least, and the derivatives there, (m, n).

    Parameters differ in size by ten orders: each is counted in what it is known to, and derivatives are differences
    over a share of that. `sizes` are changes that residuals notice, for the first derivatives only.
    """
    unit = _known_to(_derivatives(residuals, start, sizes), sizes)

    def scaled(q: Array) -> Array:
        return residuals(start + unit * q)

    def slopes(q: Array) -> Array:
        return _derivatives(residuals, start + unit * q, _STEP * unit) * unit

    found = least_squares(scaled, np.zeros(start.size), slopes, x_scale="jac", xtol=_CONVERGED, ftol=_CONVERGED)
    return start + unit * found.x, slopes(found.x) / unit


def _derivatives(residuals: Callable[[Array], Array], at: Array, steps: Array) -> Array:
    """Return central differences, (m, n)."""
    columns = [(residuals(at + step) - residuals(at - step)) / (2 * step.max()) for step in np.diag(steps)]
    return np.column_stack(columns)


def _known_to(jacobian: Array, steps: Array) -> Array:
    """Return the change of each parameter that moves the residuals by one in all; its step where nothing moves."""
    length = np.linalg.norm(jacobian, axis=0)
    return np.where(length > 0, 1 / np.where(length > 0, length, 1.0), steps)


def _solve(problem: Problem, start: Array, keep: NDArray[np.bool_], factor: float) -> Solution:
    whitened = problem.noise.picked(keep).whitening()
    vector, jacobian = _least_squares(
        lambda v: residuals(problem, v, keep, factor, whitened), start, noticeable(problem, start)
    )
    unit = 1 / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    _, singular, right = np.linalg.svd(jacobian * unit, full_matrices=False)
    if singular[-1] < _LEAST_SINGULAR * singular[0]:
        raise FitError(
            "The grid does not determine the camera: two of its parameters cannot be distinguished. Photograph a "
            "larger part of the grid, or state the lens."
        )
    covariance = (right.T / singular**2) @ right * np.outer(unit, unit)
    return Solution(vector, covariance, factor)


def solve_robustly(
    problem: Problem, start: Array, index: tuple[NDArray[np.int64], NDArray[np.int64]] | None
) -> tuple[Solution, NDArray[np.bool_]]:
    """Solve, drop crossings that disagree, solve again with sigma scaled to the residuals found."""
    keep = np.ones(problem.u.size, dtype=bool)
    # Far from the solution crossings weigh little against what is stated: a first iteration could lose the height.
    far = float(np.sqrt(np.mean((np.concatenate(residual_px(problem, start)) / np.tile(problem.sigma, 2)) ** 2)))
    solution = _solve(problem, start, keep, max(1.0, far))
    for _ in range(_ROUNDS):
        du, dv = residual_px(problem, solution.vector)
        size = np.hypot(du, dv) / problem.sigma
        robust = robust_sd(np.concatenate([du, dv]) / np.tile(problem.sigma, 2), about=0)
        keep = size < _OUTLIER * math.sqrt(2) * max(robust, _LEAST_ROBUST)
        if np.count_nonzero(keep) < max(MIN_CROSSINGS, _LEAST_AGREEING * keep.size):
            raise FitError(
                f"Only {np.count_nonzero(keep)} of {keep.size} crossings agree with one flat sheet seen by one "
                "camera: the sheet is not flat, or lines were confused."
            )
        factor = _factor(problem, np.column_stack([du, dv]), keep, solution.vector.size)
        if index is not None:
            factor *= math.sqrt(_shared(problem, np.column_stack([du, dv]), keep))
        solution = _solve(problem, solution.vector, keep, factor)
    return solution, keep


def displaced_solution(problem: Problem, solution: Solution, keep: NDArray[np.bool_], moves_px: Array) -> Array:
    """Return by how much the solution changes when crossings are displaced, to first order.

    Parameters
    ----------
    problem, solution, keep
        A problem, what solves it, and which of its crossings are used.
    moves_px
        Displacements along u and v, shape (k, 2, n), px.

    Returns
    -------
    changes
        Shape (k, parameters).
    """
    whitened = problem.noise.picked(keep).whitening()

    def rest(vector: Array, one: Problem = problem) -> Array:
        return residuals(one, vector, keep, solution.factor, whitened)

    base = rest(solution.vector)
    gain = solution.covariance @ _derivatives(rest, solution.vector, noticeable(problem, solution.vector)).T
    moved = (replace(problem, u=problem.u + du, v=problem.v + dv) for du, dv in moves_px)
    return np.stack([-gain @ (rest(solution.vector, one) - base) for one in moved])


def _factor(problem: Problem, rest: Array, keep: NDArray[np.bool_], unknowns: int) -> float:
    """What the crossings' sigma has to be multiplied by for their residuals to be as large as it says."""
    spread = problem.noise.picked(keep).whitening()(rest[keep])
    return max(math.sqrt(np.sum(spread**2) / max(1, spread.size - unknowns)), _LEAST_FACTOR)


def _shared(problem: Problem, rest: Array, keep: NDArray[np.bool_]) -> float:
    """Factor of variance for what crossings share beyond what is known of their covariance."""
    noise = problem.noise.picked(keep)
    if noise.scatter is not None:
        return shared_factor(noise.row, noise.column, noise.whitening()(rest[keep]))
    return shared_scatter(noise.row, noise.column, np.column_stack([problem.u, problem.v])[keep], rest[keep])
