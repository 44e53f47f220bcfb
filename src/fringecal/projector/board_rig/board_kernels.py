"""Compiled sums over the points of a board rig: residuals, their derivatives, and each pose's normal equations.

The order of parameters is that of `board_problem`. Every function works on buffers that its caller made.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

_FAST = {"contract", "nsz"}
_LEAST_AREA = 1e-12  # of a point's image, relative: below it the board is seen edge-on and a corner has no place on it


class PointArrays(NamedTuple):
    """Points of all poses: on the board (n, 3), the warp's lifts (n, terms), in both pictures (n, 4), coupled (n,)."""

    board: np.ndarray
    lifts: np.ndarray
    seen: np.ndarray
    coupled: np.ndarray


class StateArrays(NamedTuple):
    """Values: shared parameters in order, the rotation to the projector, and each pose's rotation and shift."""

    shared: np.ndarray
    rotation: np.ndarray
    pose_rotations: np.ndarray
    pose_shifts: np.ndarray


class PointWork(NamedTuple):
    """Buffers for one point: derivatives, (4, size) by all, (4, 3) by the place, (4, 2) on the board; rests; places.

    Whole buffers are handed on, with the row where a device's begin (0 camera, 2 projector): a slice costs as much as
    half a point.
    """

    rows: np.ndarray
    rest: np.ndarray
    points: np.ndarray
    slopes: np.ndarray
    across: np.ndarray


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _seen(first, place, shared, work):  # type: ignore[no-untyped-def]
    """Project a place and differentiate by it and by the lens, as `lens_gradient` does, into two rows from `first`."""
    c, second, rows, slopes = 9 * (first // 2), first + 1, work.rows, work.slopes
    fx, fy, k1, k2 = shared[c], shared[c + 1], shared[c + 4], shared[c + 5]
    p1, p2, k3 = shared[c + 6], shared[c + 7], shared[c + 8]
    w = 1 / work.points[place, 2]
    x, y = work.points[place, 0] * w, work.points[place, 1] * w
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    rise = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    cross = x * y * rise + 2 * p1 * x + 2 * p2 * y
    work.rest[first], work.rest[second] = fx * xd + shared[c + 2], fy * yd + shared[c + 3]
    slopes[first, 0] = fx * w * (radial + x * x * rise + 2 * p1 * y + 6 * p2 * x)
    slopes[first, 1], slopes[second, 0] = fx * w * cross, fy * w * cross
    slopes[second, 1] = fy * w * (radial + y * y * rise + 6 * p1 * y + 2 * p2 * x)
    slopes[first, 2] = -(slopes[first, 0] * x + slopes[first, 1] * y)
    slopes[second, 2] = -(slopes[second, 0] * x + slopes[second, 1] * y)
    rows[first, c], rows[second, c + 1], rows[first, c + 2], rows[second, c + 3] = xd, yd, 1.0, 1.0
    x, y = fx * x, fy * y
    rows[first, c + 4], rows[second, c + 4] = x * r2, y * r2
    rows[first, c + 5], rows[second, c + 5] = x * r2 * r2, y * r2 * r2
    rows[first, c + 8], rows[second, c + 8] = x * r2 * r2 * r2, y * r2 * r2 * r2
    x, y = x / fx, y / fy
    rows[first, c + 6], rows[second, c + 6] = fx * 2 * x * y, fy * (r2 + 2 * y * y)
    rows[first, c + 7], rows[second, c + 7] = fx * (r2 + 2 * x * x), fy * 2 * x * y


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _place(n, pose, points, state, out):  # type: ignore[no-untyped-def]
    """Put a point on its board (0), turned to the camera's axes (1), in the camera's (2) and projector's frame (3)."""
    shared = state.shared
    scale, stretch = shared[24], shared[25]
    lift = points.board[n, 2]
    for j in range(points.lifts.shape[1]):
        lift += shared[26 + j] * points.lifts[n, j]
    out[0, 0] = points.board[n, 0] * (1 + scale + stretch / 2)
    out[0, 1] = points.board[n, 1] * (1 + scale - stretch / 2)
    out[0, 2] = lift
    turn, rotation = state.pose_rotations[pose], state.rotation
    for i in range(3):
        out[1, i] = turn[i, 0] * out[0, 0] + turn[i, 1] * out[0, 1] + turn[i, 2] * out[0, 2]
        out[2, i] = out[1, i] + state.pose_shifts[pose, i]
    for i in range(3):
        out[3, i] = rotation[i, 0] * out[2, 0] + rotation[i, 1] * out[2, 1] + rotation[i, 2] * out[2, 2]
        out[3, i] += shared[21 + i]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _turned(row, arm, first, work):  # type: ignore[no-untyped-def]
    """Derivative of a coordinate by a small turn of a point about an axis, `arm` away from it: arm x slope."""
    a0, a1, a2 = work.points[arm, 0], work.points[arm, 1], work.points[arm, 2]
    s0, s1, s2 = work.slopes[row, 0], work.slopes[row, 1], work.slopes[row, 2]
    work.rows[row, first] = s2 * a1 - s1 * a2
    work.rows[row, first + 1] = s0 * a2 - s2 * a0
    work.rows[row, first + 2] = s1 * a0 - s0 * a1


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _moved_by_board(row, n, pose, points, state, work):  # type: ignore[no-untyped-def]
    """Derivatives of a coordinate by scale, stretch, warp and the pose, by its derivative by the point."""
    turn, out, size = state.pose_rotations, work.rows, work.rows.shape[1]
    s0, s1, s2 = work.slopes[row, 0], work.slopes[row, 1], work.slopes[row, 2]
    along = s0 * turn[pose, 0, 0] + s1 * turn[pose, 1, 0] + s2 * turn[pose, 2, 0]
    down = s0 * turn[pose, 0, 1] + s1 * turn[pose, 1, 1] + s2 * turn[pose, 2, 1]
    up = s0 * turn[pose, 0, 2] + s1 * turn[pose, 1, 2] + s2 * turn[pose, 2, 2]
    x, y = points.board[n, 0] * along, points.board[n, 1] * down
    out[row, 24], out[row, 25] = x + y, (x - y) / 2
    for j in range(points.lifts.shape[1]):
        out[row, 26 + j] = up * points.lifts[n, j]
    out[row, size - 3], out[row, size - 2], out[row, size - 1] = s0, s1, s2
    _turned(row, 1, size - 6, work)
    work.across[row, 0], work.across[row, 1] = along, down


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _without_corner_error(work):  # type: ignore[no-untyped-def]
    """Take the camera's residual, as it moves the place where the phase is read, out of the projector's."""
    rows, rest, slopes = work.rows, work.rest, work.across
    a, b, d, e = slopes[0, 0], slopes[0, 1], slopes[1, 0], slopes[1, 1]
    area = a * e - b * d
    if abs(area) <= _LEAST_AREA * (a * a + b * b + d * d + e * e):
        return
    for k in range(2, 4):
        f, g = slopes[k, 0], slopes[k, 1]
        first, second = (f * e - g * d) / area, (g * a - f * b) / area
        rest[k] -= first * rest[0] + second * rest[1]
        for j in range(rows.shape[1]):
            rows[k, j] -= first * rows[0, j] + second * rows[1, j]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _to_camera(row, state, work):  # type: ignore[no-untyped-def]
    """Write what a projector's coordinate says of turn and shift, then turn its slope to the camera's axes."""
    rotation, slopes = state.rotation, work.slopes
    for j in range(3):
        work.rows[row, 21 + j] = slopes[row, j]
    _turned(row, 0, 18, work)
    s0, s1, s2 = slopes[row, 0], slopes[row, 1], slopes[row, 2]
    for j in range(3):
        slopes[row, j] = s0 * rotation[0, j] + s1 * rotation[1, j] + s2 * rotation[2, j]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _point_rows(n, pose, points, state, work):  # type: ignore[no-untyped-def]
    """Write a point's four equations into the buffers."""
    rest, at = work.rest, work.points
    _place(n, pose, points, state, at)
    _seen(0, 2, state.shared, work)
    _seen(2, 3, state.shared, work)
    for j in range(9):
        work.rows[2, j] = work.rows[3, j] = 0.0
    for j in range(3):
        at[0, j] = at[3, j] - state.shared[21 + j]
    _to_camera(2, state, work)
    _to_camera(3, state, work)
    for row in range(4):
        rest[row] = points.seen[n, row] - rest[row]
        _moved_by_board(row, n, pose, points, state, work)
    if points.coupled[n]:
        _without_corner_error(work)


@njit(cache=True, error_model="numpy")
def write_rows(pose_of, points, state, work, rests, rows):  # type: ignore[no-untyped-def]
    """Write all residuals (n, 4) and, unless `rows` is empty, their derivatives (n, 4, size)."""
    for n in range(pose_of.size):
        _point_rows(n, pose_of[n], points, state, work)
        rests[n] = work.rest
        if rows.shape[0] > 0:
            rows[n] = work.rows


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _write_weighted(n, row, weights, work, block, rest):  # type: ignore[no-untyped-def]
    """Write a point's weighted equations, two of either device, into blocks (2, rows, size) and (2, rows)."""
    for k in range(4):
        w = weights[n, k]
        device, at = k // 2, row + k % 2
        rest[device, at] = w * work.rest[k] if w != 0 else 0.0
        for j in range(block.shape[2]):
            block[device, at, j] = w * work.rows[k, j] if w != 0 else 0.0


@njit(cache=True, error_model="numpy")
def sum_equations(starts, points, state, work, weights, matrices, rights, squares):  # type: ignore[no-untyped-def]
    """Sum each device's and pose's normal equations: (2, poses, size, size), (2, poses, size), and squares."""
    size = matrices.shape[2]
    for pose in range(matrices.shape[1]):
        first, last = starts[pose], starts[pose + 1]
        block, rest = np.empty((2, 2 * (last - first), size)), np.empty((2, 2 * (last - first)))
        for n in range(first, last):
            _point_rows(n, pose, points, state, work)
            _write_weighted(n, 2 * (n - first), weights, work, block, rest)
        for device in range(2):
            matrices[device, pose] = np.dot(block[device].T, block[device])
            rights[device, pose] = np.dot(block[device].T, rest[device])
            squares[device, pose] = np.dot(rest[device], rest[device])
