"""Least squares over camera, projector, poses and the board's form: steps, wrong corners, weights, covariance."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import robust_sd
from fringecal.projector.board_rig.board_problem import (
    POSE,
    BoardData,
    BoardState,
    Normal,
    Rows,
    normal_equations,
    observation_rows,
)

Array = NDArray[np.float64]

#: Residuals beyond this many robust standard deviations are wrong corners: of normal ones none in two million is.
OUTLIER_SIGMAS = 5.0
_HUBER_SIGMAS = 2.0  # while wrong corners are looked for: beyond it a residual counts by its size, not its square
_LEAST_S_PX = 1e-6  # drawn points have no scatter, but rounding
_STEPS = 30  # of one minimum; from a start by closed forms it takes five to ten
_CONVERGED = 1e-11  # relative change of the sum of squares: of parameters some 1e-6 of their u
_ROUNDS = 8  # of weights: they settle after three or four
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
    squares
        Weighted sum of squares.
    """

    state: BoardState
    covariance: Array
    rest_px: Array
    used: NDArray[np.bool_]
    s_px: tuple[float, float]
    dof: tuple[float, float]
    squares: float


def minimise(state: BoardState, data: BoardData, weights: Array, expected: Expected) -> tuple[BoardState, Normal]:
    """Find the least sum of squares of weighted residuals (Levenberg and Marquardt)."""
    damping, now = _FIRST_DAMPING, _normal(state, data, weights, expected)
    for _ in range(_STEPS):
        shared = _step(now, damping, expected.free)
        tried = state.moved(shared, now.pose_steps(shared))
        then = _normal(tried, data, weights, expected)
        if then.squares < now.squares:
            gain = (now.squares - then.squares) / max(now.squares, 1e-300)
            state, now, damping = tried, then, damping / _DAMPING_FACTOR
            if gain < _CONVERGED:
                break
        elif damping > _MOST_DAMPING or _predicted(now, shared) < _CONVERGED * now.squares:
            break
        else:
            damping *= _DAMPING_FACTOR**2
    return state, now


def _predicted(now: Normal, shared: Array) -> float:
    """By how much a step should lower the sum of squares."""
    poses = now.pose_steps(shared)
    return float(shared @ now.right + abs((poses * now.pose_rights).sum()))


def _normal(state: BoardState, data: BoardData, weights: Array, expected: Expected) -> Normal:
    """Normal equations with what was expected of the shared parameters."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        found = normal_equations(observation_rows(state, data).weighted(weights), data)
    off, weight = expected.mean - state.shared, expected.weight
    squares = found.squares + float((weight * off**2).sum())
    squares = squares if math.isfinite(squares) else math.inf
    return Normal(
        found.matrix + np.diag(weight),
        found.right + weight * off,
        squares,
        found.pose_matrices,
        found.pose_rights,
        found.mixed,
    )


def _step(now: Normal, damping: float, free: NDArray[np.bool_]) -> Array:
    """Step of the free shared parameters, each in the scale of its own column."""
    matrix = now.matrix[np.ix_(free, free)]
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    unit = matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
    step = np.zeros(len(free))
    step[free] = np.linalg.lstsq(unit, now.right[free] / scale, rcond=1e-14)[0] / scale
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


class _Weighing(NamedTuple):
    """One over each stated u, which equations are used, their weights, and the standard deviations behind those."""

    stated: Array
    used: NDArray[np.bool_]
    weights: Array
    s: tuple[float, float]


def solve(state: BoardState, data: BoardData, expected: Expected) -> Solution:
    """Solve with weights from the residuals, leaving out wrong corners.

    The loss: squares up to five robust standard deviations, nothing beyond. Wrong corners are looked for with
    Huber's loss, which they cannot draw far.
    """
    stated = 1 / np.hstack([data.camera_u, data.projector_u])
    seen = np.hstack([data.in_camera, data.in_projector])
    s = (1.0, 1.0)
    used = seen
    loss = np.ones(seen.shape)
    for round_number in range(_ROUNDS):
        weights = np.where(used, stated * loss / np.array([s[0], s[0], s[1], s[1]]), 0.0)
        state, now = minimise(state, data, weights, expected)
        rows = observation_rows(state, data)
        last = s
        if round_number < 2:
            s = _robust_s(rows.rest * stated, seen)
            loss = _huber(rows.rest * stated, s)
            used = seen
            continue
        used_before = used
        used = seen & _not_wrong(np.where(seen, rows.rest * stated, 0.0), s)
        loss = np.ones(seen.shape)
        if round_number == 2:
            s = _robust_s(rows.rest * stated, used)
            continue
        s, dof = _by_dof(rows, data, now, expected, _Weighing(stated, used, weights, s))
        if np.array_equal(used, used_before) and max(abs(a / b - 1) for a, b in zip(s, last, strict=True)) < _SETTLED:
            break
    weights = np.where(used, stated / np.array([s[0], s[0], s[1], s[1]]), 0.0)
    state, now = minimise(state, data, weights, expected)
    rest = np.where(seen, observation_rows(state, data).rest, 0.0)
    return Solution(state, inverse_of(now.matrix, expected.free), rest, used, s, dof, now.squares)


def _robust_s(scaled: Array, used: NDArray[np.bool_]) -> tuple[float, float]:
    """Robust standard deviation of scaled residuals in camera and projector; 1 where there are none."""
    parts = [scaled[:, columns][used[:, columns]] for columns in (slice(0, 2), slice(2, 4))]
    camera, projector = (max(robust_sd(part, about=0), _LEAST_S_PX) if part.size else 1.0 for part in parts)
    return camera, projector


def _huber(scaled: Array, s: tuple[float, float]) -> Array:
    size = np.abs(scaled) / np.array([s[0], s[0], s[1], s[1]])
    return np.sqrt(np.minimum(1.0, _HUBER_SIGMAS / np.maximum(size, 1e-12)))


def _not_wrong(scaled: Array, s: tuple[float, float]) -> NDArray[np.bool_]:
    """Where both coordinates of a point in a picture are within the limit."""
    inside = np.abs(scaled) <= OUTLIER_SIGMAS * np.array([s[0], s[0], s[1], s[1]])
    inside[:, :2] = inside[:, :2].all(axis=1, keepdims=True)
    inside[:, 2:] = inside[:, 2:].all(axis=1, keepdims=True)
    return inside


def _by_dof(
    rows: Rows, data: BoardData, now: Normal, expected: Expected, weighing: _Weighing
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Standard deviations by the residuals and their degrees of freedom, in camera and projector.

    A residual's share of the degrees of freedom is one less its leverage (K. R. Koch, Parameter Estimation and
    Hypothesis Testing in Linear Models, 2nd ed. 1999, 3.6: iterated estimates of variance components).
    """
    stated, used, s = weighing.stated, weighing.used, weighing.s
    shares = leverages(rows.derivatives * weighing.weights[..., None], data, now, expected)
    found, dofs = [], []
    for columns, before in ((slice(0, 2), s[0]), (slice(2, 4), s[1])):
        here = used[:, columns]
        dof = float((1 - shares[:, columns])[here].sum())
        squares = float(((rows.rest * stated)[:, columns][here] ** 2).sum())
        found.append(max(math.sqrt(squares / dof), _LEAST_S_PX) if dof >= 1 and here.any() else before)
        dofs.append(max(dof, 1.0))
    return (found[0], found[1]), (dofs[0], dofs[1])


def leverages(derivatives: Array, data: BoardData, now: Normal, expected: Expected) -> Array:
    """Leverage of every weighted equation, (n, 4): how much of it the parameters follow."""
    m = derivatives.shape[2] - POSE
    shared = inverse_of(now.matrix, expected.free)
    found = np.zeros(derivatives.shape[:2])
    for k, part in enumerate(data.slices()):
        own = np.linalg.inv(now.pose_matrices[k])
        back = own @ now.mixed[k].T
        joint = derivatives[part][..., :m] - derivatives[part][..., m:] @ back
        found[part] = np.einsum("nri,ij,nrj->nr", joint, shared, joint, optimize=True)
        found[part] += np.einsum(
            "nri,ij,nrj->nr", derivatives[part][..., m:], own, derivatives[part][..., m:], optimize=True
        )
    return found
