"""The equations of a board rig: residuals of all points with derivatives, and normal equations without the poses.

Shared parameters come in the order camera, projector, turn, shift (`BOARD_RIG_NAMES`), then the board's form; a pose
has six of its own, which the normal equations eliminate (Schur complement): time grows with the number of poses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import SeenPoints, lens_gradient
from fringecal.projector.board_rig.board_form import BoardForm
from fringecal.projector.board_rig.board_poses import BoardPose
from fringecal.projector.board_rig.rig_value import BOARD_RIG_NAMES, cross_matrix, turn_matrix

Array = NDArray[np.float64]

POSE = 6  # parameters of a pose: a small turn of the board, rad, and a shift, mm
RIG = len(BOARD_RIG_NAMES)
CAMERA, PROJECTOR, TURN_OF, SHIFT_OF = slice(0, 9), slice(9, 18), slice(18, 21), slice(21, 24)
_LEAST_AREA = 1e-12  # of a point's image, relative: below it the board is seen edge-on and a corner has no place on it


@dataclass(frozen=True)
class BoardData:
    """Points of all poses in a row, pose by pose.

    `starts` (poses + 1,) bounds them; `camera` (n, 2) and `projector` (n, 2) px with 0 where unknown, `in_camera` and
    `in_projector` (n, 2) say where; `camera_u`, `projector_u` (n, 2) px, 1 where not stated; `coupled` (n,) where the
    projector's coordinate was read at the corner that the camera saw.
    """

    starts: NDArray[np.intp]
    board: Array
    lifts: Array
    camera: Array
    projector: Array
    in_camera: NDArray[np.bool_]
    in_projector: NDArray[np.bool_]
    camera_u: Array
    projector_u: Array
    coupled: NDArray[np.bool_]

    @property
    def pose_of(self) -> NDArray[np.intp]:
        """Number of each point's pose, (n,)."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))

    def slices(self) -> list[slice]:
        """Return each pose's part of the points."""
        return [slice(a, b) for a, b in zip(self.starts[:-1], self.starts[1:], strict=True)]


@dataclass(frozen=True)
class BoardState:
    """Values of all parameters: `shared` in order, the turn as `rotation`; of the poses (p, 3, 3) and shifts (p, 3)."""

    shared: Array
    rotation: Array
    pose_rotations: Array
    pose_shifts: Array

    def moved(self, shared: Array, poses: Array) -> "BoardState":
        """Return the state after a step in the shared parameters, (m,), and the poses', (p, 6)."""
        return BoardState(
            self.shared + shared,
            turn_matrix(shared[TURN_OF]) @ self.rotation,
            turn_matrix(poses[:, :3]) @ self.pose_rotations,
            self.pose_shifts + poses[:, 3:],
        )


@dataclass(frozen=True)
class Rows:
    """Observation equations: `rest` (n, 4), seen minus modelled, and their derivatives (n, 4, shared + 6).

    The four are column and row in the camera, then in the projector; where a projector's coordinate was read at the
    camera's corner, the corner's error is taken out of it, so that the four are independent.
    """

    rest: Array
    derivatives: Array

    def weighted(self, weights: Array) -> "Rows":
        """Return the equations times (n, 4) weights."""
        return Rows(self.rest * weights, self.derivatives * weights[..., None])


@dataclass(frozen=True)
class Normal:
    """Normal equations of the shared parameters with the poses eliminated, and what gives the poses back."""

    matrix: Array
    right: Array
    squares: float
    pose_matrices: Array
    pose_rights: Array
    mixed: Array

    def pose_steps(self, shared: Array) -> Array:
        """Steps of the poses (p, 6) that belong to a step of the shared parameters."""
        rest = self.pose_rights - self.mixed.transpose(0, 2, 1) @ shared
        return np.linalg.solve(self.pose_matrices, rest[..., None])[..., 0]


def board_data(poses: Sequence[BoardPose], form: BoardForm) -> BoardData:
    """Put the points of all poses in one row."""
    board = np.concatenate([pose.board_mm for pose in poses]).astype(float)
    camera, projector = (np.concatenate([getattr(p, f"{d}_px") for p in poses]) for d in ("camera", "projector"))
    in_camera = np.repeat(np.isfinite(camera).all(axis=1)[:, None], 2, axis=1)
    coupled = np.concatenate([np.full(len(pose.board_mm), pose.read_at_camera) for pose in poses])
    in_projector = np.isfinite(projector) & (in_camera | ~coupled[:, None])
    return BoardData(
        np.cumsum([0, *(len(pose.board_mm) for pose in poses)]),
        board,
        form.lifts(board),
        np.where(in_camera, camera, 0.0),
        np.where(in_projector, projector, 0.0),
        in_camera,
        in_projector,
        np.concatenate([_spread_u(pose.camera_u_px, pose) for pose in poses]),
        np.concatenate([_spread_u(pose.projector_u_px, pose) for pose in poses]),
        coupled,
    )


def _spread_u(u_px: float | Array, pose: BoardPose) -> Array:
    """Stated uncertainties as (n, 2); 1 where none is stated."""
    stated = np.asarray(u_px, float)
    stated = stated[:, None] if stated.ndim == 1 else stated
    full = np.broadcast_to(stated, (len(pose.board_mm), 2))
    return np.where(np.isfinite(full), full, 1.0)


def placed_points(state: BoardState, data: BoardData) -> Array:
    """Points of the boards in the camera's frame, (n, 3), mm."""
    k = data.pose_of
    return np.einsum("nij,nj->ni", state.pose_rotations[k], _formed(state, data)) + state.pose_shifts[k]


def _formed(state: BoardState, data: BoardData) -> Array:
    scale, stretch = state.shared[RIG : RIG + 2]
    lift = data.lifts @ state.shared[RIG + 2 :]
    factors = np.array([1 + scale + stretch / 2, 1 + scale - stretch / 2, 1.0])
    return np.asarray(data.board * factors + np.stack([0 * lift, 0 * lift, lift], axis=1))


def residuals(state: BoardState, data: BoardData) -> Array:
    """Seen minus modelled in both pictures, (n, 4) px, 0 where nothing was seen."""
    camera, projector = _both(state, placed_points(state, data))
    rest = np.hstack([data.camera - camera.pixels, data.projector - projector.pixels])
    return np.where(np.hstack([data.in_camera, data.in_projector]), rest, 0.0)


def _both(state: BoardState, points: Array) -> tuple[SeenPoints, SeenPoints]:
    """What either device has of points in the camera's frame."""
    lit = points @ state.rotation.T + state.shared[SHIFT_OF]
    return lens_gradient(state.shared[CAMERA], points), lens_gradient(state.shared[PROJECTOR], lit)


def observation_rows(state: BoardState, data: BoardData) -> Rows:
    """Set up the observation equations of all points, px."""
    k, m = data.pose_of, len(state.shared)
    turned = np.einsum("nij,nj->ni", state.pose_rotations[k], _formed(state, data))
    points = turned + state.pose_shifts[k]
    camera, projector = _both(state, points)
    on_camera = projector.by_point @ state.rotation
    by_board = _board_moves(state, data)
    by_pose = np.concatenate([-cross_matrix(turned), np.broadcast_to(np.eye(3), (len(k), 3, 3))], axis=2)
    found = np.zeros((len(k), 4, m + POSE))
    found[:, :2, CAMERA], found[:, 2:, PROJECTOR] = camera.by_lens, projector.by_lens
    found[:, 2:, TURN_OF] = projector.by_point @ -cross_matrix(points @ state.rotation.T)
    found[:, 2:, SHIFT_OF] = projector.by_point
    for rows, by_point in ((slice(0, 2), camera.by_point), (slice(2, 4), on_camera)):
        found[:, rows, RIG:m] = by_point @ by_board
        found[:, rows, m:] = by_point @ by_pose
    rest = np.hstack([data.camera - camera.pixels, data.projector - projector.pixels])
    return _without_corner_errors(Rows(rest, found), data, camera.by_point, on_camera, state.pose_rotations[k])


def _board_moves(state: BoardState, data: BoardData) -> Array:
    """Moves (n, 3, 2 + terms) of the points in the camera's frame under the parameters of the board's form."""
    flat = data.board * [1.0, 1.0, 0.0]
    along = np.stack([flat, flat * [0.5, -0.5, 0.0]], axis=2)
    up = np.zeros((len(flat), 3, data.lifts.shape[1]))
    up[:, 2] = data.lifts
    return np.asarray(state.pose_rotations[data.pose_of] @ np.concatenate([along, up], axis=2))


def _without_corner_errors(rows: Rows, data: BoardData, in_camera: Array, in_projector: Array, turns: Array) -> Rows:
    """Take the camera's residual, as it moves the place where the phase is read, out of the projector's."""
    camera, projector = in_camera @ turns[..., :2], in_projector @ turns[..., :2]
    a, b, c, d = camera[:, 0, 0], camera[:, 0, 1], camera[:, 1, 0], camera[:, 1, 1]
    area = a * d - b * c
    usable = data.coupled & (np.abs(area) > _LEAST_AREA * (a * a + b * b + c * c + d * d))
    inverse = np.stack([np.stack([d, -b], -1), np.stack([-c, a], -1)], axis=1)
    ratio = np.where(usable, 1 / np.where(usable, area, 1.0), 0.0)
    carried = -(projector @ inverse) * ratio[:, None, None]
    rest, derivatives = rows.rest.copy(), rows.derivatives.copy()
    rest[:, 2:] += np.einsum("nij,nj->ni", carried, rest[:, :2])
    derivatives[:, 2:] += carried @ derivatives[:, :2]
    return Rows(rest, derivatives)


def normal_equations(rows: Rows, data: BoardData) -> Normal:
    """Sum weighted equations pose by pose and eliminate the poses."""
    m = rows.derivatives.shape[2] - POSE
    parts = [_pose_sums(rows, part) for part in data.slices()]
    full, right = np.stack([p[0] for p in parts]), np.stack([p[1] for p in parts])
    own, mixed = full[:, m:, m:], full[:, :m, m:]
    own = own + _least_weight(own)
    back = np.linalg.solve(own, np.concatenate([mixed.transpose(0, 2, 1), right[:, m:, None]], axis=2))
    matrix = (full[:, :m, :m] - mixed @ back[..., :-1]).sum(axis=0)
    reduced = (right[:, :m] - (mixed @ back[..., -1:])[..., 0]).sum(axis=0)
    return Normal(matrix, reduced, float((rows.rest**2).sum()), own, right[:, m:], mixed)


def _pose_sums(rows: Rows, part: slice) -> tuple[Array, Array]:
    flat = rows.derivatives[part].reshape(-1, rows.derivatives.shape[2])
    return flat.T @ flat, flat.T @ rows.rest[part].ravel()


def _least_weight(own: Array) -> Array:
    """A trace of weight on each pose's numbers, for a pose that lost all its points: it stays where it is."""
    sizes = np.einsum("pii->pi", own)
    return np.asarray(np.eye(POSE) * np.maximum(1e-12 * sizes, 1e-12)[:, None, :])


def subset(data: BoardData, poses: Sequence[int]) -> BoardData:
    """Return the points of some poses."""
    numbers = np.concatenate([np.arange(data.starts[k], data.starts[k + 1]) for k in poses])
    counts = np.diff(data.starts)[list(poses)]
    arrays = {name: getattr(data, name)[numbers] for name in BoardData.__dataclass_fields__ if name != "starts"}
    return replace(data, starts=np.concatenate([[0], np.cumsum(counts)]), **arrays)
