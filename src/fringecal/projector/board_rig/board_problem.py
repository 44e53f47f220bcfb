"""The equations of a board rig: residuals of all points with derivatives, and normal equations without the poses.

Shared parameters come in the order camera, projector, turn, shift (`BOARD_RIG_NAMES`), then the board's form; a pose
has six of its own, which the normal equations eliminate (Schur complement): time grows with the number of poses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import SeenPoints, lens_gradient
from fringecal.projector.board_rig.board_form import BoardForm
from fringecal.projector.board_rig.board_kernels import (
    WORK_ROWS,
    PointArrays,
    PoseWork,
    StateArrays,
    sum_equations,
    write_rows,
)
from fringecal.projector.board_rig.board_poses import BoardPose
from fringecal.projector.board_rig.rig_value import BOARD_RIG_NAMES, turn_matrix

Array = NDArray[np.float64]

POSE = 6  # parameters of a pose: a small turn of the board, rad, and a shift, mm
RIG = len(BOARD_RIG_NAMES)
CAMERA, PROJECTOR, TURN_OF, SHIFT_OF = slice(0, 9), slice(9, 18), slice(18, 21), slice(21, 24)


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

    @cached_property
    def pose_of(self) -> NDArray[np.intp]:
        """Number of each point's pose, (n,)."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))

    @cached_property
    def points(self) -> PointArrays:
        """The same for compiled loops."""
        rows = (self.board, self.lifts, np.hstack([self.camera, self.projector]))
        board, lifts, seen = (np.ascontiguousarray(each.T, float) for each in rows)
        return PointArrays(board, lifts, seen, self.coupled)

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

    @property
    def arrays(self) -> StateArrays:
        """The same for compiled loops."""
        values = (self.shared, self.rotation, self.pose_rotations, self.pose_shifts)
        return StateArrays(*(np.ascontiguousarray(a, float) for a in values))

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


@dataclass(frozen=True)
class Sums:
    """Normal equations before elimination, of either device (2) and each pose (p).

    `matrices` (2, p, m + 6, m + 6), `rights` (2, p, m + 6), `squares` (2, p).
    """

    matrices: Array
    rights: Array
    squares: Array

    def scaled(self, factors: Array) -> "Sums":
        """Return the sums with the weights of the squares times factors, (p, 2) of camera and projector."""
        by = factors.T
        return Sums(self.matrices * by[..., None, None], self.rights * by[..., None], self.squares * by)


@dataclass(frozen=True)
class Normal:
    """Normal equations of the shared parameters with the poses eliminated, and what gives the poses back.

    `sums` are those before elimination; `back` (p, 6, m + 1) the poses' answers to the shared parameters and to the
    residuals, `own` (p, 6, 6) the poses' own part.
    """

    matrix: Array
    right: Array
    squares: float
    sums: Sums
    own: Array
    back: Array

    def pose_steps(self, shared: Array) -> Array:
        """Steps of the poses (p, 6) that belong to a step of the shared parameters."""
        return np.asarray(self.back[..., -1] - self.back[..., :-1] @ shared)

    def joint_covariance(self, shared: Array) -> Array:
        """Covariance (p, m + 6, m + 6) of the shared parameters and each pose's, from that of the shared ones."""
        back = self.back[..., :-1]
        across = -shared @ back.transpose(0, 2, 1)
        own = np.linalg.inv(self.own) - back @ across
        top = np.concatenate([np.broadcast_to(shared, (len(back), *shared.shape)), across], axis=2)
        return np.concatenate([top, np.concatenate([across.transpose(0, 2, 1), own], axis=2)], axis=1)


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
    size = len(state.shared) + POSE
    rest, rows = np.zeros((len(data.board), 4)), np.zeros((len(data.board), 4, size))
    write_rows(data.starts, data.points, state.arrays, _work(size, data), rest, rows)
    return Rows(rest, rows)


def independent_residuals(state: BoardState, data: BoardData) -> Array:
    """Residuals (n, 4) of `observation_rows` alone, px."""
    size = len(state.shared) + POSE
    rest = np.zeros((len(data.board), 4))
    write_rows(data.starts, data.points, state.arrays, _work(size, data), rest, np.zeros((0, 4, size)))
    return rest


def _work(size: int, data: BoardData) -> PoseWork:
    most = int(np.diff(data.starts).max())
    return PoseWork(np.zeros((4, size, most)), np.zeros((4, most)), np.zeros((WORK_ROWS, most)))


def summed(state: BoardState, data: BoardData, weights: Array) -> Sums:
    """Sum equations times (n, 4) weights, device by device and pose by pose."""
    size, poses = len(state.shared) + POSE, len(data.starts) - 1
    sums = Sums(np.zeros((2, poses, size, size)), np.zeros((2, poses, size)), np.zeros((2, poses)))
    every = np.arange(size)
    chosen = (np.concatenate([every[CAMERA], every[RIG:]]), every if data.coupled.any() else every[PROJECTOR.start :])
    arrays = (chosen, sums.matrices, sums.rights, sums.squares)
    sum_equations(data.starts, data.points, state.arrays, _work(size, data), weights, *arrays)
    return sums


def without_poses(sums: Sums) -> Normal:
    """Eliminate the poses."""
    full, right = sums.matrices.sum(axis=0), sums.rights.sum(axis=0)
    m = full.shape[1] - POSE
    own, mixed = full[:, m:, m:], full[:, :m, m:]
    own = own + _least_weight(own)
    back = np.linalg.solve(own, np.concatenate([mixed.transpose(0, 2, 1), right[:, m:, None]], axis=2))
    gone = mixed.transpose(1, 0, 2).reshape(m, -1) @ back.reshape(-1, m + 1)
    matrix, reduced = full[:, :m, :m].sum(axis=0) - gone[:, :m], right[:, :m].sum(axis=0) - gone[:, m]
    return Normal(matrix, reduced, float(sums.squares.sum()), sums, own, back)


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
