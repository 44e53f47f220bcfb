"""Lens, poses and the warp of a board, solved together: the least squares behind a lens fit without mrcal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fringecal.camera.lens.brown_lens import LENS_NAMES
from fringecal.errors import FitError
from fringecal.numerics import robust_sd

Array = NDArray[np.float64]

#: Least eigenvalue of the normal equations of the shared parameters, scaled to a unit diagonal: below it some sum of
#: parameters is known a 30 000th as well as each by itself would be, and seven of float64's sixteen digits are left.
MIN_CONDITION = 1e-9
#: Points farther out than this many robust standard deviations are wrong corners, not noise.
OUTLIER_SIGMAS = 5.0
_LEAST_LIMIT_PX = 1e-6  # drawn corners have no scatter, but rounding
_LEAST_KEPT = 4  # points of a view: four fix its pose
_ROUNDS = 8  # of leaving out wrong corners; the set settles after two or three
_STEPS = 40  # of a minimum, at most; from OpenCV's start it takes some ten
_CONVERGED = 1e-13  # relative change of the sum of squares
_POSE = 6  # parameters: three of the turn, three of the shift


@dataclass(frozen=True)
class _Damping:
    """Levenberg and Marquardt's damping, in units of each parameter's own diagonal.

    Parameters
    ----------
    start
        Next to none: OpenCV's solve is near the minimum.
    factor
        By which it falls after a step that helped, and grows after one that did not (Marquardt, J. SIAM 11 (1963) 431).
    most
        Beyond it a step is a thousandth of the gradient's, and nothing better will be found.
    """

    start: float = 1e-6
    factor: float = 10.0
    most: float = 1e3


_DAMPING = _Damping()


@dataclass(frozen=True)
class BoardPoints:
    """One picture's points: on the flat board (n, 3), mm, y down its rows, and in the picture (n, 2), px.

    `warp_shape` (n, 2) is by how much a unit warp across the columns and across the rows lifts each point: 1 in the
    middle of the board, 0 at its first and last point.
    """

    board_mm: Array
    seen_px: Array
    warp_shape: Array

    def kept(self, keep: NDArray[np.bool_]) -> "BoardPoints":
        """Return the points where `keep` is True."""
        return BoardPoints(self.board_mm[keep], self.seen_px[keep], self.warp_shape[keep])


@dataclass(frozen=True)
class Bundle:
    """The solved lens with its covariance, and poses, warp, residuals and wrong corners.

    Parameters
    ----------
    values, covariance
        The lens, in the order of `LENS_NAMES`.
    poses
        Turn (Rodrigues) and shift in mm of the board in the camera's frame, (n, 6).
    warp_mm
        Bow of the board across its columns and rows; None if it was taken as flat.
    residuals
        Seen minus modelled, px, (n, 2) per view.
    used
        False where a point was left out, (n,) per view.
    dof
        Degrees of freedom.
    """

    values: Array
    covariance: Array
    poses: Array
    warp_mm: tuple[float, float] | None
    residuals: tuple[Array, ...]
    used: tuple[NDArray[np.bool_], ...]
    dof: int


@dataclass(frozen=True)
class _State:
    values: Array
    poses: Array
    warp: Array


@dataclass(frozen=True)
class _Reduced:
    """Normal equations of the shared parameters, the poses eliminated, and what gives the poses back."""

    matrix: Array
    right: Array
    squares: float
    views: tuple[tuple[Array, Array, Array], ...]


def board_points(points_px: Array, spacing_mm: float) -> BoardPoints:
    """List the seen points of a board (rows, columns, 2), px, NaN where hidden.

    Examples
    --------
    >>> found = board_points(np.zeros((2, 3, 2)), 10.0)
    >>> found.board_mm[1].tolist(), found.warp_shape[1].tolist()
    ([10.0, 0.0, 0.0], [1.0, 0.0])
    """
    row, column = np.nonzero(np.isfinite(points_px).all(axis=2))
    share = [place / max(count - 1, 1) for place, count in zip((column, row), points_px.shape[1::-1], strict=True)]
    warp_shape = np.stack([4 * s * (1 - s) for s in share], axis=1)
    board = spacing_mm * np.stack([column, row, np.zeros(len(row))], axis=1)
    return BoardPoints(board.astype(float), points_px[row, column], warp_shape)


def solve_bundle(
    points: Sequence[BoardPoints], values: Array, poses: Array, *, radial_terms: int = 2, warped: bool = True
) -> Bundle:
    """Solve for lens, poses and warp by least squares, leaving out wrong corners.

    Parameters
    ----------
    points
        The points of every picture.
    values, poses
        Start: lens in the order of `LENS_NAMES`, and turn (Rodrigues) with shift in mm of every view, (n, 6).
    radial_terms
        2, or 3 with k3 free too.
    warped
        Whether the board may be warped: z = w_x 4 s (1 - s) + w_y 4 t (1 - t), s and t from 0 to 1 across it.

    Raises
    ------
    FitError
        The views do not determine the shared parameters.

    Notes
    -----
    Levenberg and Marquardt's steps; in each the poses are eliminated (Schur complement), so that time grows
    with the number of views and not with its cube. The covariance is that of the linearised problem times the
    variance of the residuals. Bow as in mrcal's documentation, "calibration object deformation".
    """
    free = _Free(radial_terms + 6, warped)
    used = [np.ones(len(each.seen_px), dtype=bool) for each in points]
    state = _State(values.astype(float), poses.astype(float), np.zeros(2))
    for _ in range(_ROUNDS):
        kept = [each.kept(k) for each, k in zip(points, used, strict=True)]
        state = _minimise(kept, state, free)
        better = _not_wrong([_residual(state, k, each) for k, each in enumerate(points)])
        if all(np.array_equal(a, b) for a, b in zip(used, better, strict=True)):
            break
        used = better
    kept = [each.kept(k) for each, k in zip(points, used, strict=True)]
    state = _minimise(kept, state, free)
    residuals = tuple(_residual(state, k, each) for k, each in enumerate(points))
    covariance, dof = _covariance(_reduced(kept, state, free), free, kept)
    warp = (float(state.warp[0]), float(state.warp[1])) if warped else None
    return Bundle(state.values, covariance, state.poses, warp, residuals, tuple(used), dof)


def _not_wrong(residuals: Sequence[Array]) -> list[NDArray[np.bool_]]:
    """Points whose residual is no larger than the scatter of most explains, and of each view the best few."""
    limit = max(OUTLIER_SIGMAS * robust_sd(np.concatenate(residuals), about=0), _LEAST_LIMIT_PX)
    sizes = [np.abs(each).max(axis=1) for each in residuals]
    return [size <= max(limit, float(np.sort(size)[:_LEAST_KEPT][-1])) for size in sizes]


@dataclass(frozen=True)
class _Free:
    """Which shared parameters are free: the first `lens` of `LENS_NAMES`, then the two warps or none."""

    lens: int
    warped: bool

    @property
    def size(self) -> int:
        return self.lens + 2 * self.warped

    def moved(self, state: _State, shared: Array, poses: Array) -> _State:
        values, warp = state.values.copy(), state.warp.copy()
        values[: self.lens] += shared[: self.lens]
        if self.warped:
            warp += shared[self.lens :]
        return _State(values, state.poses + poses, warp)


def placed(points: BoardPoints, pose: Array, warp_mm: tuple[float, float] | None) -> Array:
    """Return the points of a board in the camera's frame (n, 3), mm."""
    return np.asarray(_bent(points, np.zeros(2) if warp_mm is None else np.array(warp_mm)) @ _turn(pose).T + pose[3:])


def _bent(points: BoardPoints, warp: Array) -> Array:
    return np.asarray(points.board_mm + np.outer(points.warp_shape @ warp, [0, 0, 1]))


def _turn(pose: Array) -> Array:
    return np.asarray(cv2.Rodrigues(pose[:3])[0], dtype=float)


def _projected(state: _State, view: int, points: BoardPoints) -> tuple[Array, Array]:
    """Pixels (n, 2) and OpenCV's derivatives (2 n, 6 + 4 + 5) by pose, core and distortion."""
    matrix = camera_matrix(state.values)
    board, pose = _bent(points, state.warp), state.poses[view]
    pixels, jacobian = cv2.projectPoints(board, pose[:3], pose[3:], matrix, state.values[4:])
    return np.asarray(pixels, dtype=float).reshape(-1, 2), np.asarray(jacobian, dtype=float)


def _residual(state: _State, view: int, points: BoardPoints) -> Array:
    return points.seen_px - _projected(state, view, points)[0]


def camera_matrix(values: Array) -> Array:
    """Return the 3 x 3 matrix of a lens's focal lengths and principal point, as OpenCV wants it."""
    return np.array([[values[0], 0, values[2]], [0, values[1], values[3]], [0, 0, 1]])


def _shared_gradient(state: _State, view: int, points: BoardPoints, jacobian: Array, free: _Free) -> Array:
    """Derivatives by the shared parameters; a warp moves a point along the board's normal."""
    lens = jacobian[:, _POSE : _POSE + free.lens]
    if not free.warped:
        return lens
    lift = jacobian[:, 3:_POSE] @ _turn(state.poses[view])[:, 2]
    return np.column_stack([lens, lift[:, None] * np.repeat(points.warp_shape, 2, axis=0)])


def _reduced(points: Sequence[BoardPoints], state: _State, free: _Free) -> _Reduced:
    normal, right, squares, views = np.zeros((free.size, free.size)), np.zeros(free.size), 0.0, []
    for view, each in enumerate(points):
        pixels, jacobian = _projected(state, view, each)
        rest = (each.seen_px - pixels).ravel()
        shared = _shared_gradient(state, view, each, jacobian, free)
        # The pose absorbs all it can; what is left of the columns is what this view says of the shared ones.
        basis, triangle = np.linalg.qr(jacobian[:, :_POSE])
        left = shared - basis @ (basis.T @ shared)
        normal += left.T @ left
        right += left.T @ rest
        squares += float(rest @ rest)
        views.append((triangle, basis.T @ rest, basis.T @ shared))
    return _Reduced(normal, right, squares, tuple(views))


def _minimise(points: Sequence[BoardPoints], state: _State, free: _Free) -> _State:
    damping, now = _DAMPING.start, _reduced(points, state, free)
    for _ in range(_STEPS):
        shared = _step(now.matrix, now.right, damping)
        poses = np.array([np.linalg.lstsq(t, r - s @ shared, rcond=None)[0] for t, r, s in now.views])
        tried = free.moved(state, shared, poses)
        then = _reduced(points, tried, free)
        if then.squares < now.squares:
            gain = (now.squares - then.squares) / now.squares
            state, now, damping = tried, then, damping / _DAMPING.factor
            if gain < _CONVERGED:
                break
        elif damping > _DAMPING.most or not math.isfinite(damping):
            break
        else:
            damping *= _DAMPING.factor
    return state


def _step(matrix: Array, right: Array, damping: float) -> Array:
    """Levenberg and Marquardt's step of the shared parameters, each in the scale of its own column."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    unit = matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
    return np.asarray(np.linalg.lstsq(unit, right / scale, rcond=None)[0] / scale)


def _covariance(now: _Reduced, free: _Free, points: Sequence[BoardPoints]) -> tuple[Array, int]:
    """Covariance of the lens (9, 9), zero where it is not free, and the degrees of freedom."""
    scale = np.sqrt(np.maximum(np.diag(now.matrix), 1e-300))
    unit = now.matrix / np.outer(scale, scale)
    if np.linalg.eigvalsh(unit)[0] < MIN_CONDITION:
        raise FitError(undetermined("not at all"))
    dof = max(1, 2 * sum(len(each.seen_px) for each in points) - free.size - _POSE * len(points))
    inverse = np.linalg.inv(unit) / np.outer(scale, scale)
    covariance = np.zeros((len(LENS_NAMES),) * 2)
    covariance[: free.lens, : free.lens] = inverse[: free.lens, : free.lens] * now.squares / dof
    return covariance, dof


def undetermined(how_well: str) -> str:
    """Say why views that do not determine the focal length are refused, and what to do."""
    return (
        f"the views do not determine the focal length (known to {how_well}): a board seen square-on, or always under "
        "one tilt, fits any focal length, however small the residuals; photograph it tilted 20 to 40 degrees to "
        "different sides, also in the corners"
    )
