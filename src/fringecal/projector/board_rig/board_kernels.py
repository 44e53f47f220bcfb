"""Compiled sums over the points of a board rig: residuals, their derivatives, and each pose's normal equations.

A pose's points are taken together: every quantity is a row of numbers, one for each point, and every loop over points
is plain arithmetic without a branch, so that it runs several points at once. The order of parameters is that of
`board_problem`.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

_FAST = {"contract", "nsz"}
_LEAST_AREA = 1e-12  # of a point's image, relative: below it the board is seen edge-on and a corner has no place on it
#: Rows of the work: points turned into the camera's axes, in the camera's and in the projector's frame; derivatives of
#: the camera's and the projector's two coordinates by the point (six each), and by the place on the board (four each).
_TURNED, _IN_CAMERA, _IN_PROJECTOR, _SLOPES, _ACROSS, WORK_ROWS = 0, 3, 6, 9, 21, 29


class PointArrays(NamedTuple):
    """Points of all poses: on the board (3, n), the warp's lifts (terms, n), in both pictures (4, n), coupled (n,)."""

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


class PoseWork(NamedTuple):
    """Buffers for one pose: derivatives (4, size, points), rests (4, points), and `WORK_ROWS` rows of points."""

    columns: np.ndarray
    rest: np.ndarray
    rows: np.ndarray


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _place(pose, first, count, points, state, work):  # type: ignore[no-untyped-def]
    """Put the points of a pose on their board, into the camera's frame and into the projector's."""
    shared, turn, shift, r = state.shared, state.pose_rotations, state.pose_shifts, state.rotation
    along, down = 1 + shared[24] + shared[25] / 2, 1 + shared[24] - shared[25] / 2
    lift = work[_ACROSS]
    for n in range(count):
        lift[n] = points.board[2, first + n]
    for j in range(points.lifts.shape[0]):
        w = shared[26 + j]
        for n in range(count):
            lift[n] += w * points.lifts[j, first + n]
    for i in range(3):
        a, b, c, t = turn[pose, i, 0] * along, turn[pose, i, 1] * down, turn[pose, i, 2], shift[pose, i]
        for n in range(count):
            turned = a * points.board[0, first + n] + b * points.board[1, first + n] + c * lift[n]
            work[_TURNED + i, n], work[_IN_CAMERA + i, n] = turned, turned + t
    for i in range(3):
        a, b, c, t = r[i, 0], r[i, 1], r[i, 2], shared[21 + i]
        for n in range(count):
            x, y, z = work[_IN_CAMERA, n], work[_IN_CAMERA + 1, n], work[_IN_CAMERA + 2, n]
            work[_IN_PROJECTOR + i, n] = a * x + b * y + c * z + t


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _see(device, count, shared, work):  # type: ignore[no-untyped-def]
    """Project points by a device (0 camera, 1 projector) and differentiate by the point and by the lens."""
    c, at, to, row = 9 * device, _IN_CAMERA + 3 * device, _SLOPES + 6 * device, 2 * device
    fx, fy, cx, cy = shared[c], shared[c + 1], shared[c + 2], shared[c + 3]
    k1, k2, p1, p2, k3 = shared[c + 4], shared[c + 5], shared[c + 6], shared[c + 7], shared[c + 8]
    rows, first, second = work.rows, work.columns[row], work.columns[row + 1]
    for n in range(count):
        w = 1 / rows[at + 2, n]
        x, y = rows[at, n] * w, rows[at + 1, n] * w
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        rise = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        cross = x * y * rise + 2 * p1 * x + 2 * p2 * y
        work.rest[row, n], work.rest[row + 1, n] = fx * xd + cx, fy * yd + cy
        a, b = fx * w * (radial + x * x * rise + 2 * p1 * y + 6 * p2 * x), fx * w * cross
        d, e = fy * w * cross, fy * w * (radial + y * y * rise + 6 * p1 * y + 2 * p2 * x)
        rows[to, n], rows[to + 1, n], rows[to + 2, n] = a, b, -(a * x + b * y)
        rows[to + 3, n], rows[to + 4, n], rows[to + 5, n] = d, e, -(d * x + e * y)
        first[c, n], second[c + 1, n], first[c + 2, n], second[c + 3, n] = xd, yd, 1.0, 1.0
        first[c + 4, n], second[c + 4, n] = fx * x * r2, fy * y * r2
        first[c + 5, n], second[c + 5, n] = fx * x * r2 * r2, fy * y * r2 * r2
        first[c + 6, n], second[c + 6, n] = fx * 2 * x * y, fy * (r2 + 2 * y * y)
        first[c + 7, n], second[c + 7, n] = fx * (r2 + 2 * x * x), fy * 2 * x * y
        first[c + 8, n], second[c + 8, n] = fx * x * r2 * r2 * r2, fy * y * r2 * r2 * r2


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _by_turn(k, slope, arm, count, to, work):  # type: ignore[no-untyped-def]
    """Derivatives of coordinate k by a small turn of points `arm` away from its axis: arm x slope."""
    out, rows = work.columns[k], work.rows
    for n in range(count):
        a0, a1, a2 = rows[arm, n], rows[arm + 1, n], rows[arm + 2, n]
        s0, s1, s2 = rows[slope, n], rows[slope + 1, n], rows[slope + 2, n]
        out[to, n], out[to + 1, n], out[to + 2, n] = s2 * a1 - s1 * a2, s0 * a2 - s2 * a0, s1 * a0 - s0 * a1


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _by_rig(k, slope, count, state, work):  # type: ignore[no-untyped-def]
    """Derivatives of a projector's coordinate by the rig's turn and shift; then its slope in the camera's axes."""
    out, rows, r = work.columns[k], work.rows, state.rotation
    for n in range(count):
        out[21, n], out[22, n], out[23, n] = rows[slope, n], rows[slope + 1, n], rows[slope + 2, n]
    _by_turn(k, slope, _IN_PROJECTOR, count, 18, work)
    for n in range(count):
        s0, s1, s2 = rows[slope, n], rows[slope + 1, n], rows[slope + 2, n]
        rows[slope, n] = s0 * r[0, 0] + s1 * r[1, 0] + s2 * r[2, 0]
        rows[slope + 1, n] = s0 * r[0, 1] + s1 * r[1, 1] + s2 * r[2, 1]
        rows[slope + 2, n] = s0 * r[0, 2] + s1 * r[1, 2] + s2 * r[2, 2]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _by_board(k, slope, pose, first, count, points, state, work):  # type: ignore[no-untyped-def]
    """Derivatives of a coordinate by the board's form and by its pose."""
    out, rows, turn, size = work.columns[k], work.rows, state.pose_rotations, work.columns.shape[1]
    across, terms = _ACROSS + 2 * k, points.lifts.shape[0]
    a, b, c = turn[pose, 0, 0], turn[pose, 1, 0], turn[pose, 2, 0]
    d, e, f = turn[pose, 0, 1], turn[pose, 1, 1], turn[pose, 2, 1]
    g, h, i = turn[pose, 0, 2], turn[pose, 1, 2], turn[pose, 2, 2]
    for n in range(count):
        s0, s1, s2 = rows[slope, n], rows[slope + 1, n], rows[slope + 2, n]
        along, down = s0 * a + s1 * b + s2 * c, s0 * d + s1 * e + s2 * f
        x, y = points.board[0, first + n] * along, points.board[1, first + n] * down
        rows[across, n], rows[across + 1, n] = along, down
        out[24, n], out[25, n] = x + y, 0.5 * (x - y)
        out[size - 3, n], out[size - 2, n], out[size - 1, n] = s0, s1, s2
    for j in range(terms):
        for n in range(count):
            up = rows[slope, n] * g + rows[slope + 1, n] * h + rows[slope + 2, n] * i
            out[26 + j, n] = up * points.lifts[j, first + n]
    _by_turn(k, slope, _TURNED, count, size - 6, work)


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _without_corner_errors(first, count, coupled, work):  # type: ignore[no-untyped-def]
    """Take the camera's residual, as it moves the place where the phase is read, out of the projector's."""
    rows, one, two = work.rows, work.rows[_TURNED], work.rows[_TURNED + 1]
    for k in range(2, 4):
        for n in range(count):
            a, b = rows[_ACROSS, n], rows[_ACROSS + 1, n]
            d, e = rows[_ACROSS + 2, n], rows[_ACROSS + 3, n]
            f, g = rows[_ACROSS + 2 * k, n], rows[_ACROSS + 2 * k + 1, n]
            area = a * e - b * d
            usable = coupled[first + n] and abs(area) > _LEAST_AREA * (a * a + b * b + d * d + e * e)
            share = 1 / area if usable else 0.0
            one[n], two[n] = (f * e - g * d) * share, (g * a - f * b) * share
            work.rest[k, n] -= one[n] * work.rest[0, n] + two[n] * work.rest[1, n]
        for j in range(work.columns.shape[1]):
            for n in range(count):
                work.columns[k, j, n] -= one[n] * work.columns[0, j, n] + two[n] * work.columns[1, j, n]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _pose_equations(pose, first, count, points, state, work):  # type: ignore[no-untyped-def]
    """Write the equations of a pose's points into the buffers."""
    _place(pose, first, count, points, state, work.rows)
    _see(0, count, state.shared, work)
    _see(1, count, state.shared, work)
    work.columns[2:, :9, :count] = 0.0
    for i in range(3):
        for n in range(count):
            work.rows[_IN_PROJECTOR + i, n] -= state.shared[21 + i]
    for k in range(4):
        for n in range(count):
            work.rest[k, n] = points.seen[k, first + n] - work.rest[k, n]
        if k >= 2:
            _by_rig(k, _SLOPES + 3 * k, count, state, work)
        _by_board(k, _SLOPES + 3 * k, pose, first, count, points, state, work)
    coupled = False
    for n in range(count):
        coupled |= points.coupled[first + n]
    if coupled:
        _without_corner_errors(first, count, points.coupled, work)


@njit(cache=True, error_model="numpy")
def write_rows(starts, points, state, work, rests, rows):  # type: ignore[no-untyped-def]
    """Write all residuals (n, 4) and, unless `rows` is empty, their derivatives (n, 4, size)."""
    for pose in range(starts.size - 1):
        first, count = starts[pose], starts[pose + 1] - starts[pose]
        _pose_equations(pose, first, count, points, state, work)
        for k in range(4):
            for n in range(count):
                rests[first + n, k] = work.rest[k, n]
                if rows.shape[0] > 0:
                    rows[first + n, k] = work.columns[k, :, n]


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _weigh(k, first, count, weights, chosen, work, block, rest):  # type: ignore[no-untyped-def]
    """Copy the chosen columns of a coordinate's equations, weighted, into its half of a block (size, 2 points)."""
    off = count * (k % 2)
    for n in range(count):
        w = weights[first + n, k]
        rest[off + n] = w * work.rest[k, n] if w != 0 else 0.0
        work.rows[_TURNED, n] = w
    for i in range(chosen.size):
        j = chosen[i]
        for n in range(count):
            w = work.rows[_TURNED, n]
            block[i, off + n] = w * work.columns[k, j, n] if w != 0 else 0.0


@njit(cache=True, error_model="numpy")
def _add_block(block, rest, chosen, matrix, right):  # type: ignore[no-untyped-def]
    """Put a block's products where its columns belong."""
    products, sums = np.dot(block, block.T), np.dot(block, rest)
    for i in range(chosen.size):
        right[chosen[i]] = sums[i]
        for j in range(chosen.size):
            matrix[chosen[i], chosen[j]] = products[i, j]


@njit(cache=True, error_model="numpy")
def sum_equations(starts, points, state, work, weights, chosen, matrices, rights, squares):  # type: ignore[no-untyped-def]
    """Sum each device's and pose's normal equations: (2, poses, size, size), (2, poses, size), and squares.

    `chosen` holds, for either device, the columns that are not 0.
    """
    for pose in range(matrices.shape[1]):
        first, count = starts[pose], starts[pose + 1] - starts[pose]
        _pose_equations(pose, first, count, points, state, work)
        rest = np.empty(2 * count)
        for device in range(2):
            block = np.empty((chosen[device].size, 2 * count))
            for k in range(2 * device, 2 * device + 2):
                _weigh(k, first, count, weights, chosen[device], work, block, rest)
            _add_block(block, rest, chosen[device], matrices[device, pose], rights[device, pose])
            squares[device, pose] = np.dot(rest, rest)
