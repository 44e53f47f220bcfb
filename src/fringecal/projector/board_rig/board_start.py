"""Start values of a board rig in closed form: homographies, Zhang's constraints, the projector's matrix from points."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.projector.board_rig.board_poses import BoardPose
from fringecal.projector.board_rig.rig_value import turn_matrix

Array = NDArray[np.float64]
Size = tuple[int, int]

#: Bounds of a first focal length, in lengths of the picture's longer side: fields of 118 deg and of 2 deg.
_FOCAL_BOUNDS = (0.3, 30.0)
_WRONG_POSE = 4.0  # by so much the squares fall without a pose that contradicts the others
_MOST_WRONG = 0.34  # share of the poses that may be left out of the start


def camera_start(poses: Sequence[BoardPose], size: Size) -> tuple[Array, Array, Array]:
    """Return the camera's lens without distortion, and each pose's rotation (p, 3, 3) and shift (p, 3).

    Parameters
    ----------
    poses
        The board in its poses.
    size
        Picture's (width, height), px.

    Notes
    -----
    Z. Zhang, IEEE Trans. PAMI 22 (2000) 1330, eq. 3 and 4, with the principal point at the picture's centre.
    """
    homographies = [homography(pose.board_mm[pose.in_camera, :2], pose.camera_px[pose.in_camera]) for pose in poses]
    centre = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    focal = _focal_lengths([_centred(h, centre) for h in homographies], size)
    lens = np.concatenate([focal, centre, np.zeros(5)])
    places = [_placed(_centred(h, centre), focal) for h in homographies]
    return lens, np.stack([p[0] for p in places]), np.stack([p[1] for p in places])


def pose_start(flat: Array, seen: Array, lens: Array) -> tuple[Array, Array]:
    """Rotation and shift of a board from its points (n, 2), mm, seen at (n, 2), px, the distortion left aside."""
    return _placed(_centred(homography(flat, seen), lens[2:4]), lens[:2])


def homography(flat: Array, seen: Array) -> Array:
    """Matrix (3, 3) from points of a plane (n, 2) to their pictures (n, 2), by the direct linear transform."""
    to_flat, to_seen = _normalising(flat), _normalising(seen)
    a, b = _apply(to_flat, flat), _apply(to_seen, seen)
    one = np.column_stack([a, np.ones(len(a))])
    zero = np.zeros_like(one)
    rows = np.vstack([np.hstack([one, zero, -b[:, :1] * one]), np.hstack([zero, one, -b[:, 1:] * one])])
    inner = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3)
    return np.asarray(np.linalg.inv(to_seen) @ inner @ to_flat)


def _normalising(points: Array) -> Array:
    """Similarity that puts points about 0 with unit spread."""
    middle, spread = points.mean(axis=0), max(float(points.std()), 1e-12)
    return np.array([[1 / spread, 0, -middle[0] / spread], [0, 1 / spread, -middle[1] / spread], [0, 0, 1]])


def _apply(matrix: Array, points: Array) -> Array:
    found = points @ matrix[:2, :2].T + matrix[:2, 2]
    return np.asarray(found)


def _centred(matrix: Array, centre: Array) -> Array:
    shift = np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, 1]])
    found = shift @ matrix
    return np.asarray(found / np.linalg.norm(found))


def _focal_lengths(centred: Sequence[Array], size: Size) -> Array:
    """Both focal lengths, alike where the poses do not tell them apart, within bounds."""
    rows = np.concatenate([_zhang_rows(h) for h in centred])
    low, high = (bound * max(size) for bound in _FOCAL_BOUNDS)
    for columns in (rows[:, :2], rows[:, :2].sum(axis=1, keepdims=True)):
        inverse_squares = np.linalg.lstsq(columns, -rows[:, 2], rcond=None)[0]
        if (inverse_squares > 0).all():
            focal = np.broadcast_to(1 / np.sqrt(inverse_squares), (2,)).copy()
            if ((focal > low) & (focal < high)).all() and 1 / 3 < focal[0] / focal[1] < 3:
                return focal
    return np.full(2, float(np.clip(1.5 * max(size), low, high)))


def _zhang_rows(h: Array) -> Array:
    """Two constraints of a pose, linear in 1 / fx^2 and 1 / fy^2: its axes are at right angles and of one length."""
    h = h / np.linalg.norm(h[:, :2])
    return np.stack([h[:, 0] * h[:, 1], h[:, 0] ** 2 - h[:, 1] ** 2])


def _placed(centred: Array, focal: Array) -> tuple[Array, Array]:
    """Rotation and shift of the board from its homography."""
    ideal = centred / np.array([focal[0], focal[1], 1.0])[:, None]
    ideal = ideal / np.sqrt(np.linalg.norm(ideal[:, 0]) * np.linalg.norm(ideal[:, 1]))
    ideal = ideal if ideal[2, 2] > 0 else -ideal
    rough = np.column_stack([ideal[:, 0], ideal[:, 1], np.cross(ideal[:, 0], ideal[:, 1])])
    left, _, right = np.linalg.svd(rough)
    return left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right, ideal[:, 2]


def projector_start(
    points: Sequence[Array], poses: Sequence[BoardPose], size: Size, aspect: float
) -> tuple[tuple[Array, Array, Array], list[int]]:
    """Return the projector's lens without distortion, its rotation and shift, and which poses agree on it.

    Parameters
    ----------
    points
        The boards' points in the camera's frame, (n, 3) mm, pose by pose.
    poses
        What the projector has of them.
    size
        Its frame's (width, height), px.
    aspect
        Focal length along the rows over that along the columns, fy / fx, where one axis alone is known.
    """
    everything = np.concatenate(
        [p[np.isfinite(pose.projector_px).any(axis=1)] for p, pose in zip(points, poses, strict=True)]
    )
    middle, spread = everything.mean(axis=0), max(float(everything.std()), 1e-9)
    unit = [(p - middle) / spread for p in points]
    known = [axis for axis in (0, 1) if any(pose.in_projector[:, axis].any() for pose in poses)]
    if not known:
        raise FitError("no pose holds a coordinate of the projector; nothing tells where its light goes")
    if len(known) == 2:
        sums = [_dlt(p, pose, (0, 1), size) for p, pose in zip(unit, poses, strict=True)]
        matrix, kept = _best_matrix(sums, (0, 1))
        lens, rotation, shift = _taken_apart(matrix, size)
    else:
        axis = known[0]
        sums = [_dlt(p, pose, (axis,), size) for p, pose in zip(unit, poses, strict=True)]
        matrix, kept = _best_matrix(sums, (axis,))
        ahead = np.median((everything - middle) / spread @ matrix[2, :3]) + matrix[2, 3]
        lens, rotation, shift = _taken_apart_one_axis(matrix * (1 if ahead > 0 else -1), axis, size, aspect)
    shift = spread * shift - rotation @ middle
    lit = everything @ rotation.T + shift
    if np.median(lit[:, 2]) < 0:
        raise FitError(
            "by its coordinates the projector looks away from the boards: one of its axes is mirrored (a phase that "
            "falls and was taken to rise), or the poses are too alike to tell"
        )
    return (lens, rotation, shift), kept


def recentred(lens: Array, rotation: Array, shift: Array, size: Size) -> tuple[Array, Array, Array]:
    """Return the projector with its principal point in its frame's middle, turned so that it lights the same places.

    A distortion that the matrix does not know shows as a principal point far outside, from which no steps lead back.
    """
    middle = (np.array(size) - 1) / 2
    ray = np.append((lens[2:4] - middle) / lens[:2], 0.0)
    turn = np.array([-ray[1], ray[0], 0.0])
    swing = turn_matrix(turn / max(float(np.linalg.norm(turn)), 1e-12) * math.atan(float(np.linalg.norm(turn))))
    return np.concatenate([lens[:2], middle, lens[4:]]), swing @ rotation, swing @ shift


def _dlt(points: Array, pose: BoardPose, axes: tuple[int, ...], size: Size) -> Array:
    """Normal matrix (12, 12) of a pose's equations for the projector's 3 x 4 matrix, coordinates from -1 to 1."""
    total = np.zeros((12, 12))
    one = np.column_stack([points, np.ones(len(points))])
    for axis in axes:
        known = pose.in_projector[:, axis]
        place = (pose.projector_px[known, axis] - (size[axis] - 1) / 2) / (max(size) / 2)
        rows = np.zeros((int(known.sum()), 12))
        rows[:, 4 * axis : 4 * axis + 4], rows[:, 8:] = one[known], -place[:, None] * one[known]
        total += rows.T @ rows
    return total


def _best_matrix(sums: Sequence[Array], axes: tuple[int, ...]) -> tuple[Array, list[int]]:
    """Matrix (3, 4) by the poses that agree on one: while the squares fall steeply without a pose, it is left out."""
    used = [*range(0, 4 * len(axes)), *range(8, 12)] if axes != (1,) else [*range(4, 12)]
    kept = list(range(len(sums)))
    least = max(3, math.ceil((1 - _MOST_WRONG) * len(sums)))
    square = [one[np.ix_(used, used)] for one in sums]
    while len(kept) > least:
        total = sum((square[k] for k in kept), np.zeros((len(used),) * 2))
        now = max(float(np.linalg.eigvalsh(total)[0]), 0.0)
        without = [max(float(np.linalg.eigvalsh(total - square[k])[0]), 1e-300) for k in kept]
        if now < _WRONG_POSE * min(without):
            break
        kept.pop(int(np.argmin(without)))
    total = sum((square[k] for k in kept), np.zeros((len(used),) * 2))
    found = np.zeros(12)
    found[used] = np.linalg.eigh(total)[1][:, 0]
    matrix = found.reshape(3, 4)
    return np.asarray(matrix / np.linalg.norm(matrix[2, :3])), kept


def _taken_apart(matrix: Array, size: Size) -> tuple[Array, Array, Array]:
    """Split a projection matrix into lens, rotation and shift (R. Hartley and A. Zisserman, 2nd ed. 2003, 6.2.4)."""
    matrix = matrix * (1 if np.linalg.det(matrix[:, :3]) > 0 else -1)
    third = matrix[2, :3]
    principal = matrix[:2, :3] @ third
    second = matrix[1, :3] - principal[1] * third
    fy = float(np.linalg.norm(second))
    second = second / fy
    first = np.cross(second, third)
    fx = float(matrix[0, :3] @ first)
    rotation = np.stack([first, second, third])
    skew = float(matrix[0, :3] @ second)
    core = np.array([[fx, skew, principal[0]], [0, fy, principal[1]], [0, 0, 1]])
    shift = np.linalg.solve(core, matrix[:, 3])
    return _lens(np.array([fx, fy]), principal, size), rotation, shift


def _taken_apart_one_axis(matrix: Array, axis: int, size: Size, aspect: float) -> tuple[Array, Array, Array]:
    """The same where one coordinate is known: the other's focal length and centre are taken, not found."""
    third, along = matrix[2, :3], matrix[axis, :3]
    centre = float(along @ third)
    along = along - centre * third
    focal = float(np.linalg.norm(along))
    along = along / focal
    across = np.cross(third, along) if axis == 0 else np.cross(along, third)
    rotation = np.stack([along, across, third] if axis == 0 else [across, along, third])
    shift = np.zeros(3)
    shift[axis], shift[2] = (matrix[axis, 3] - centre * matrix[2, 3]) / focal, matrix[2, 3]
    focals = np.array([focal, focal * aspect] if axis == 0 else [focal / aspect, focal])
    principal = np.array([centre, 0.0] if axis == 0 else [0.0, centre])
    return _lens(focals, principal, size), rotation, shift


def _lens(focal: Array, principal: Array, size: Size) -> Array:
    half, middle = max(size) / 2, (np.array(size) - 1) / 2
    return np.concatenate([focal * half, principal * half + middle * np.array([1.0, 1.0]), np.zeros(5)])
