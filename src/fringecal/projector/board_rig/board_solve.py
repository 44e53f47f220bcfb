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
_CONVERGED = 1e-8  # relative change of the sum of squares; steps shrink quadratically, the next would do far less
_FEW_STEPS, _ROUGHLY = 3, 1e-4  # of a minimum whose weights are not final
_HUBER_SETTLED = 0.02  # relative fall of the robust standard deviations: they serve to find wrong corners alone
_ROUNDS = 6  # of weights: they settle after two or three
_MOST_UNLIKE = 8.0
"""Times the median of all poses by which the scatter of one may differ: glare and defocus do as much; beyond, the pose
is not noisy but wrong."""
_PRIOR_DOF = 20.0
"""Degrees of freedom of the median of all poses beside those of a pose's own scatter, expected within a sixth of it."""
_SETTLED = 1e-2  # relative change of the squares of the standard deviations
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
        Standard deviation of one coordinate, (poses, 2), in the camera and in the projector; over the stated u where
        stated.
    dof
        Degrees of freedom of either.
    normal
        Normal equations at the end, with what was expected.
    """

    state: BoardState
    covariance: Array
    rest_px: Array
    used: NDArray[np.bool_]
    s_px: Array
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


def solve(state: BoardState, data: BoardData, expected: Expected, *, equal: bool = False) -> Solution:
    """Solve with weights from the residuals, pose by pose, leaving out wrong corners.

    The loss: squares up to five robust standard deviations, nothing beyond. Wrong corners are looked for with
    Huber's loss, which they cannot draw far. With `equal` all coordinates of both pictures have one weight.
    """
    known = _Known(
        data,
        expected,
        1 / np.hstack([data.camera_u, data.projector_u]),
        np.hstack([data.in_camera, data.in_projector]),
        equal,
    )
    state, scaled, s = _without_pull(state, known)
    used = known.not_wrong(scaled, s)
    for _ in range(_ROUNDS):
        state, now, s, dof = _weighted(state, known, used, s)
        better = known.not_wrong(known.scaled(state), s)
        if np.array_equal(used, better):
            break
        used = better
    rest = np.where(known.seen, independent_residuals(state, data), 0.0)
    return Solution(state, inverse_of(now.matrix, expected.free), rest, used, s, dof, now)


def balanced(state: BoardState, data: BoardData, expected: Expected) -> tuple[BoardState, BoardData]:
    """Find how the scatter of the projector's two axes compares, and put it into the points' u.

    A raster with pixels twice as wide as high has rows that scatter by twice as many of them. The u of both axes change
    by the root of the ratio, one up and one down; how large they are is left to `solve`.
    """
    stated, seen = 1 / np.hstack([data.camera_u, data.projector_u]), np.hstack([data.in_camera, data.in_projector])
    state, scaled, s = _without_pull(state, _Known(data, expected, stated, seen, equal=False))
    sizes = scaled / of_points(s, data)
    u, v = (robust_sd(sizes[:, k][seen[:, k]], about=0) for k in (2, 3))
    if not (u > 0 and v > 0):
        return state, data
    root = math.sqrt(float(np.clip(v / u, 1 / _MOST_UNLIKE, _MOST_UNLIKE)))
    return state, replace(data, projector_u=data.projector_u * [1 / root, root])


@dataclass(frozen=True)
class _Known:
    """The points, what is expected, one over each stated u (n, 4), which coordinates are seen, and how they count."""

    data: BoardData
    expected: Expected
    stated: Array
    seen: NDArray[np.bool_]
    equal: bool

    def scaled(self, state: BoardState) -> Array:
        """Residuals over their stated u, (n, 4), 0 where nothing was seen."""
        return np.where(self.seen, independent_residuals(state, self.data) * self.stated, 0.0)

    def weights(self, s: Array, used: NDArray[np.bool_]) -> Array:
        """Weights (n, 4) from standard deviations (poses, 2)."""
        return np.where(used, self.stated / of_points(s, self.data), 0.0)

    def robust_s(self, scaled: Array) -> Array:
        """Robust standard deviations (poses, 2) of camera and projector, within bounds of their medians."""
        found = np.ones((len(self.data.starts) - 1, 2))
        if self.equal:
            return np.full_like(found, self.robust_whole(scaled))
        for k, columns in enumerate((slice(0, 2), slice(2, 4))):
            own = [robust_sd(scaled[p, columns][self.seen[p, columns]], about=0) for p in self.data.slices()]
            whole = robust_sd(scaled[:, columns][self.seen[:, columns]], about=0)
            some = np.array([each for each in own if each > 0] or [whole or 1.0])
            usual = max(float(np.median(some)), _LEAST_S_PX)
            found[:, k] = np.clip(own, usual / _MOST_UNLIKE, usual * _MOST_UNLIKE)
        return found

    def robust_whole(self, scaled: Array) -> float:
        """Robust standard deviation of all residuals together."""
        return max(robust_sd(scaled[self.seen], about=0), _LEAST_S_PX)

    def not_wrong(self, scaled: Array, s: Array) -> NDArray[np.bool_]:
        """Where both coordinates of a point in a picture are within the limit, (n, 4)."""
        inside = np.abs(scaled) <= OUTLIER_SIGMAS * of_points(s, self.data)
        inside[:, :2] = inside[:, :2].all(axis=1, keepdims=True)
        inside[:, 2:] = inside[:, 2:].all(axis=1, keepdims=True)
        return np.asarray(self.seen & inside)


def of_points(s: Array, data: BoardData) -> Array:
    """Standard deviations (poses, 2) as those of each point's four coordinates, (n, 4)."""
    return np.asarray(np.repeat(s, 2, axis=1)[data.pose_of])


def _weighted(
    state: BoardState, known: _Known, used: NDArray[np.bool_], s: Array
) -> tuple[BoardState, Normal, Array, tuple[float, float]]:
    """Solve with some points used, the standard deviations by their residuals."""
    data, expected = known.data, known.expected
    counts = np.stack([[used[p, :2].sum(), used[p, 2:].sum()] for p in data.slices()])
    state, now = minimise(state, data, known.weights(s, used), expected, enough=_ROUGHLY)
    for _ in range(_ROUNDS):
        better, dof = _by_dof(now, expected, s, counts, equal=known.equal)
        factors, s = (s / better) ** 2, better
        now = _expecting(now.sums.scaled(factors), state, expected)
        state, now = _descent(state, data, known.weights(s, used), expected, (_STEPS, _CONVERGED), now)
        if np.abs(factors - 1).max() < _SETTLED:
            break
    return state, now, s, dof


def _without_pull(state: BoardState, known: _Known) -> tuple[BoardState, Array, Array]:
    """Solve by Huber's loss about robust standard deviations; return scaled residuals and those."""
    scaled = known.scaled(state)
    s = known.robust_s(scaled)
    for _ in range(_ROUNDS):
        weights = known.weights(s, known.seen) * _huber(scaled / of_points(s, known.data))
        state, _ = minimise(state, known.data, weights, known.expected, steps=_FEW_STEPS, enough=_ROUGHLY)
        scaled, before = known.scaled(state), s
        s = known.robust_s(scaled)
        if np.median(s, axis=0).sum() > (1 - _HUBER_SETTLED) * np.median(before, axis=0).sum():
            break
    return state, scaled, s


def _huber(sizes: Array) -> Array:
    return np.sqrt(np.minimum(1.0, _HUBER_SIGMAS / np.maximum(np.abs(sizes), 1e-12)))


def _by_dof(
    now: Normal, expected: Expected, s: Array, counts: NDArray[np.intp], *, equal: bool
) -> tuple[Array, tuple[float, float]]:
    """Standard deviations (poses, 2) by the residuals, and the degrees of freedom in camera and projector.

    The parameters follow `trace(C N)` of a picture's equations, with its own part `N` of the normal equations and the
    covariance `C` of all; the rest are its degrees of freedom (iterated estimates of variance components: K. R. Koch,
    Parameter Estimation and Hypothesis Testing in Linear Models, 2nd ed. 1999, 3.6). A pose's own estimate counts by
    its degrees of freedom beside the median of all poses, as if that had some of its own.
    """
    joint = now.joint_covariance(inverse_of(now.matrix, expected.free))
    followed = np.einsum("pij,dpij->pd", joint, now.sums.matrices)
    dof = np.maximum(counts - followed, 0.0)
    squares = now.sums.squares.T * s**2
    if equal:
        whole = max(math.sqrt(float(squares.sum()) / max(float(dof.sum()), 1.0)), _LEAST_S_PX)
        return np.full_like(s, whole), (max(float(dof.sum()), 1.0),) * 2
    found = s.copy()
    for k in range(2):
        told = dof[:, k] >= 1
        if told.any():
            usual = float(np.median(squares[told, k] / dof[told, k]))
            own = (squares[:, k] + _PRIOR_DOF * usual) / (dof[:, k] + _PRIOR_DOF)
            found[:, k] = np.sqrt(np.clip(own, 0.0, _MOST_UNLIKE**2 * usual))
    total = np.maximum(dof.sum(axis=0), 1.0)
    return np.maximum(found, _LEAST_S_PX), (float(total[0]), float(total[1]))
