"""Least squares over camera, projector, poses and the board's form: steps, wrong corners, weights, covariance."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import robust_sd
from fringecal.projector.board_rig.board_problem import (
    BoardData,
    BoardState,
    Normal,
    Sums,
    independent_residuals,
    summed,
    without_poses,
)

Array = NDArray[np.float64]

#: Residuals beyond this many robust standard deviations are wrong corners: of normal ones none in two million is.
OUTLIER_SIGMAS = 5.0
_HUBER_SIGMAS = 2.0  # while wrong corners are looked for: beyond it a residual counts by its size, not its square
_LEAST_S_PX = 1e-6  # drawn points have no scatter, but rounding
_STEPS = 30  # of one minimum; from a start by closed forms it takes five to ten
_CONVERGED = (
    1e-8  # relative change of the sum of squares, which the next step would change by far less: it is quadratic
)
_FEW_STEPS, _ROUGHLY = 3, 1e-4  # of a minimum whose weights are not final
_HUBER_SETTLED = 0.02  # relative fall of the robust standard deviations: they serve to find wrong corners alone
_ROUNDS = 6  # of weights: they settle after two or three
_SETTLED = 1e-3  # relative change of both standard deviations
_FIRST_DAMPING, _DAMPING_FACTOR, _MOST_DAMPING = 1e-6, 10.0, 1e6


@dataclass(frozen=True)
class Expected:
    """What is known of the shared parameters before: mean and u, (m,); u = 0 holds one, infinite leaves it open."""

    mean: Array
    u: Array

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters may move."""
        return self.u > 0

    @property
    def weight(self) -> Array:
        """One over the variance; 0 where nothing is expected or nothing moves."""
        known = self.free & np.isfinite(self.u)
        return np.where(known, 1 / np.where(known, self.u, 1.0) ** 2, 0.0)

    def holding(self, names: slice | NDArray[np.bool_]) -> "Expected":
        """Return the same with some parameters held."""
        u = self.u.copy()
        u[names] = 0.0
        return Expected(self.mean, u)


@dataclass(frozen=True)
class Solution:
    """The solved state with its weights, residuals and covariance.

    Parameters
    ----------
    state
        Values.
    covariance
        (m, m) of the shared parameters.
    rest_px
        (n, 4) independent residuals, px, as in `Rows`.
    used
        (n, 4) which were used.
    s_px
        Standard deviation of one coordinate in the camera and in the projector; over the stated u where stated.
    dof
        Degrees of freedom of either.
    normal
        Normal equations at the end, with what was expected.
    """

    state: BoardState
    covariance: Array
    rest_px: Array
    used: NDArray[np.bool_]
    s_px: tuple[float, float]
    dof: tuple[float, float]
    normal: Normal


def minimise(
    state: BoardState,
    data: BoardData,
    weights: Array,
    expected: Expected,
    *,
    steps: int = _STEPS,
    enough: float = _CONVERGED,
) -> tuple[BoardState, Normal]:
    """Find the least sum of squares of weighted residuals (Levenberg and Marquardt).

    Parameters
    ----------
    state, data, weights, expected
        Where to start, the points, (n, 4) weights, and what is known before.
    steps
        At most.
    enough
        Relative fall of the sum of squares below which the search ends.
    """
    return _descent(
        state, data, weights, expected, (steps, enough), _expecting(summed(state, data, weights), state, expected)
    )


def _descent(
    state: BoardState, data: BoardData, weights: Array, expected: Expected, limits: tuple[int, float], now: Normal
) -> tuple[BoardState, Normal]:
    """Go down from a state whose normal equations are known already."""
    steps, enough = limits
    damping = _FIRST_DAMPING
    for _ in range(steps):
        shared = _step(now, damping, expected.free)
        tried = state.moved(shared, now.pose_steps(shared))
        then = _expecting(summed(tried, data, weights), tried, expected)
        if then.squares < now.squares:
            gain = (now.squares - then.squares) / max(now.squares, 1e-300)
            state, now, damping = tried, then, damping / _DAMPING_FACTOR
            if gain < enough:
                break
        elif damping > _MOST_DAMPING or abs(float(shared @ now.right)) < enough * now.squares:
            break
        else:
            damping *= _DAMPING_FACTOR**2
    return state, now


def _expecting(sums: Sums, state: BoardState, expected: Expected) -> Normal:
    """Normal equations with what was expected of the shared parameters."""
    found = without_poses(sums)
    off, weight = expected.mean - state.shared, expected.weight
    squares = found.squares + float((weight * off**2).sum())
    return replace(
        found,
        matrix=found.matrix + np.diag(weight),
        right=found.right + weight * off,
        squares=squares if math.isfinite(squares) else math.inf,
    )


def _step(now: Normal, damping: float, free: NDArray[np.bool_]) -> Array:
    """Step of the free shared parameters, each in the scale of its own column."""
    matrix = now.matrix[np.ix_(free, free)]
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    unit = matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
    step = np.zeros(len(free))
    step[free] = np.linalg.solve(unit, now.right[free] / scale) / scale
    return step


def inverse_of(matrix: Array, free: NDArray[np.bool_]) -> Array:
    """Covariance of unit weight from normal equations: 0 where a parameter was held."""
    inner = matrix[np.ix_(free, free)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    found = np.zeros_like(matrix)
    found[np.ix_(free, free)] = np.linalg.pinv(inner / np.outer(scale, scale), rcond=1e-15, hermitian=True) / np.outer(
        scale, scale
    )
    return found


def solve(state: BoardState, data: BoardData, expected: Expected) -> Solution:
    """Solve with weights from the residuals, leaving out wrong corners.

    The loss: squares up to five robust standard deviations, nothing beyond. Wrong corners are looked for with
    Huber's loss, which they cannot draw far.
    """
    stated = 1 / np.hstack([data.camera_u, data.projector_u])
    seen = np.hstack([data.in_camera, data.in_projector])
    state, scaled, s = _without_pull(state, data, expected, (stated, seen))
    used = _not_wrong(scaled, seen, s)
    for _ in range(_ROUNDS):
        state, now, s, dof = _weighted(state, data, expected, (stated, used, s))
        better = _not_wrong(np.where(seen, independent_residuals(state, data) * stated, 0.0), seen, s)
        if np.array_equal(used, better):
            break
        used = better
    rest = np.where(seen, independent_residuals(state, data), 0.0)
    return Solution(state, inverse_of(now.matrix, expected.free), rest, used, s, dof, now)


def _weighted(
    state: BoardState, data: BoardData, expected: Expected, known: tuple[Array, NDArray[np.bool_], tuple[float, float]]
) -> tuple[BoardState, Normal, tuple[float, float], tuple[float, float]]:
    """Solve with some points used, the two standard deviations by their residuals."""
    stated, used, s = known
    counts = int(used[:, :2].sum()), int(used[:, 2:].sum())
    state, now = minimise(state, data, np.where(used, stated / _of_columns(s), 0.0), expected, enough=_ROUGHLY)
    for _ in range(_ROUNDS):
        s, dof, factors = _by_dof(now, expected, s, counts)
        now = _expecting(now.sums.scaled(factors), state, expected)
        weights = np.where(used, stated / _of_columns(s), 0.0)
        state, now = _descent(state, data, weights, expected, (_STEPS, _CONVERGED), now)
        if max(abs(factor - 1) for factor in factors) < _SETTLED:
            break
    return state, now, s, dof


def _without_pull(
    state: BoardState, data: BoardData, expected: Expected, known: tuple[Array, NDArray[np.bool_]]
) -> tuple[BoardState, Array, tuple[float, float]]:
    """Solve by Huber's loss about robust standard deviations; return scaled residuals too."""
    stated, seen = known
    scaled, squares = np.where(seen, independent_residuals(state, data) * stated, 0.0), math.inf
    for _ in range(_ROUNDS):
        s = _robust_s(scaled, seen)
        weights = np.where(seen, stated * _huber(scaled, s) / _of_columns(s), 0.0)
        state, _ = minimise(state, data, weights, expected, steps=_FEW_STEPS, enough=_ROUGHLY)
        scaled = np.where(seen, independent_residuals(state, data) * stated, 0.0)
        before, squares = squares, float(sum(_robust_s(scaled, seen)))
        if squares > (1 - _HUBER_SETTLED) * before:
            break
    return state, scaled, _robust_s(scaled, seen)


def _of_columns(s: tuple[float, float]) -> Array:
    return np.array([s[0], s[0], s[1], s[1]])


def _robust_s(scaled: Array, used: NDArray[np.bool_]) -> tuple[float, float]:
    """Robust standard deviation of scaled residuals in camera and projector; 1 where there are none."""
    parts = [scaled[:, columns][used[:, columns]] for columns in (slice(0, 2), slice(2, 4))]
    camera, projector = (max(robust_sd(part, about=0), _LEAST_S_PX) if part.size else 1.0 for part in parts)
    return camera, projector


def _huber(scaled: Array, s: tuple[float, float]) -> Array:
    size = np.abs(scaled) / _of_columns(s)
    return np.sqrt(np.minimum(1.0, _HUBER_SIGMAS / np.maximum(size, 1e-12)))


def _not_wrong(scaled: Array, seen: NDArray[np.bool_], s: tuple[float, float]) -> NDArray[np.bool_]:
    """Where both coordinates of a point in a picture are within the limit."""
    inside = np.abs(scaled) <= OUTLIER_SIGMAS * _of_columns(s)
    inside[:, :2] = inside[:, :2].all(axis=1, keepdims=True)
    inside[:, 2:] = inside[:, 2:].all(axis=1, keepdims=True)
    return np.asarray(seen & inside)


def _by_dof(
    now: Normal, expected: Expected, s: tuple[float, float], counts: tuple[int, int]
) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Standard deviations by the residuals and their degrees of freedom, and by how much the weights change.

    The parameters follow `trace(C N)` of a picture's equations, with its own part `N` of the normal equations and the
    covariance `C` of all; the rest are its degrees of freedom (iterated estimates of variance components: K. R. Koch,
    Parameter Estimation and Hypothesis Testing in Linear Models, 2nd ed. 1999, 3.6).
    """
    joint = now.joint_covariance(inverse_of(now.matrix, expected.free))
    found, dofs, factors = list(s), [1.0, 1.0], [1.0, 1.0]
    for k in range(2):
        dof = float(counts[k]) - float((joint * now.sums.matrices[k]).sum())
        if counts[k] and dof >= 1:
            found[k] = max(s[k] * math.sqrt(float(now.sums.squares[k]) / dof), _LEAST_S_PX)
            dofs[k], factors[k] = dof, (s[k] / found[k]) ** 2
    return (found[0], found[1]), (dofs[0], dofs[1]), (factors[0], factors[1])
