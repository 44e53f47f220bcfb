"""From a board's poses to a calibrated rig of camera and inverse camera, its covariance and each pose's residuals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import Lens
from fringecal.errors import FitError
from fringecal.projector.board_rig.board_form import BoardForm, board_form
from fringecal.projector.board_rig.board_poses import MIN_POSE_POINTS, BoardPose, BoardStatement
from fringecal.projector.board_rig.board_problem import (
    CAMERA,
    PROJECTOR,
    RIG,
    SHIFT_OF,
    BoardData,
    BoardState,
    board_data,
    placed_points,
    residuals,
    subset,
)
from fringecal.projector.board_rig.board_solve import Expected, Solution, balanced, minimise, solve
from fringecal.projector.board_rig.board_start import camera_start, projector_start, recentred
from fringecal.projector.board_rig.rig_value import BOARD_RIG_NAMES, BoardRig

Array = NDArray[np.float64]
Size = tuple[int, int]

MIN_POSES = 3
"""Poses of a board: two hardly tell focal length from distance."""

_DO = f"; capture at least {MIN_POSES} poses, tilted 20 to 40 degrees to different sides"
_ON_A_LINE = 1e-3  # width over length of a pose's points
_TERM_AT_CORNER = 0.1
"""Standard deviation expected of each term of a distortion, as a share of the radius at the picture's corner: no
objective of a projector or of a measuring camera bends by more, and it holds a term of which boards tell nothing."""
_START_STEPS = 12  # from each start of the projector, for each set of terms: to tell the better one
_LATER_TERMS = ((5, 6, 7, 8), (6, 7))
"""Terms of the projector's lens that are held while the others are looked for: k2, k3 and the tangential ones, beside a
free principal point, lead astray from afar."""
_GOOD_START_PX = 0.5  # rms of a coordinate, from which on a start needs no other beside it
_START_ENOUGH = 1e-2  # relative fall of the camera's own sum of squares: it only leads to the projector's matrix
_FOLLOWS = 0.7  # a u that is still this share of what was expected: the data said nothing
_ORDERS = {4: 2, 5: 4, 6: 1, 7: 1, 8: 6}  # power of the radius by which each term's share of the radius grows


@dataclass(frozen=True)
class PoseFit:
    """What the fit says of one pose.

    Parameters
    ----------
    name
        As stated, or its number.
    rotation, shift_mm
        Of the board in the camera's frame.
    points_mm
        The board's points there, (n, 3).
    camera_residual_px, projector_residual_px
        Seen minus modelled, (n, 2), 0 where nothing was seen.
    used
        (n, 4): column and row in the camera, in the projector.
    camera_s_px, projector_s_px
        Standard deviation of one coordinate, geometric mean of both axes, by which the pose's points were weighed.
    """

    name: str
    rotation: Array
    shift_mm: Array
    points_mm: Array
    camera_residual_px: Array
    projector_residual_px: Array
    used: NDArray[np.bool_]
    camera_s_px: float
    projector_s_px: float

    @property
    def camera_rms_px(self) -> float:
        """Root mean square length of the residuals in the camera."""
        return _rms(self.camera_residual_px, self.used[:, :2])

    @property
    def projector_rms_px(self) -> float:
        """Root mean square length of the residuals in the projector."""
        return _rms(self.projector_residual_px, self.used[:, 2:])

    @property
    def tilt_deg(self) -> float:
        """Angle of the board's normal to the camera's axis."""
        return math.degrees(math.acos(min(1.0, abs(float(self.rotation[2, 2])))))

    @property
    def distance_mm(self) -> float:
        """Distance of the board's middle from the camera's centre."""
        return float(np.linalg.norm(self.points_mm.mean(axis=0)))


@dataclass(frozen=True)
class BoardRigFit:
    """A calibrated rig with what its trust rests on.

    Parameters
    ----------
    rig
        The calibration.
    poses
        One for each pose that was given.
    form
        The board's form as it was parametrised; its values stand in `rig.board_values`.
    solution
        The least squares' own result.
    data
        Its observations.
    expected
        What was expected of the shared parameters before.
    """

    rig: BoardRig
    poses: tuple[PoseFit, ...]
    form: BoardForm
    solution: Solution
    data: BoardData
    expected: Expected

    @property
    def stereo_rms_px(self) -> float:
        """Root mean square length of all residuals of both pictures, as OpenCV's stereoCalibrate states it."""
        rest = np.vstack([p.camera_residual_px for p in self.poses] + [p.projector_residual_px for p in self.poses])
        used = np.vstack([p.used[:, :2] for p in self.poses] + [p.used[:, 2:] for p in self.poses])
        return _rms(rest, used)


def fit_board_rig(
    poses: Sequence[BoardPose],
    camera_size: Size,
    projector_size: Size,
    *,
    board: BoardStatement | None = None,
    radial_terms: int = 3,
    warp_degree: int | None = None,
    projector_aspect: float = 1.0,
    equal_weights: bool = False,
) -> BoardRigFit:
    """Solve for camera, projector, poses and the board's form in one least squares.

    Parameters
    ----------
    poses
        The board in at least three poses, tilted to different sides.
    camera_size, projector_size
        (width, height) of the picture and of the projector's frame, px.
    board
        What is known of the board's scale, stretch and flatness; by default its lengths are exact and its warp open.
    radial_terms
        Of either lens: 2, or 3 with k3.
    warp_degree
        Degree of the board's warp, 0 for a flat one; by default 2, or 4 where a flatness is stated.
    projector_aspect
        fy / fx of the projector, taken where the fringes run along one axis alone; 2 for half-width diamond rasters.

    equal_weights
        Give all coordinates of both pictures one weight, as OpenCV does. By default each pose's points count in either
        picture by how much they scatter.

    Raises
    ------
    FitError
        Too few poses or points, or coordinates that no projector explains.

    Notes
    -----
    docs/theory/board-rig.md. Loss: squares up to five robust standard deviations, nothing beyond.
    """
    statement = board or BoardStatement()
    _demand(poses)
    form = board_form(poses, statement, warp_degree)
    data = board_data(poses, form)
    try:
        state, expected = _started(poses, data, form, (camera_size, projector_size, projector_aspect, radial_terms))
        if not equal_weights:
            state, data = balanced(state, data, expected)
        solution = solve(state, data, expected, equal=equal_weights)
    except np.linalg.LinAlgError as error:
        raise FitError(f"{len(poses)} poses leave the rig undetermined ({error}){_DO}") from error
    focal = solution.state.shared[[0, 1, 9, 10]]
    if not (np.isfinite(focal).all() and (focal > 0).all()):
        raise FitError(f"{len(poses)} poses leave the focal lengths undetermined{_DO}")
    return _value(poses, (camera_size, projector_size), form, (data, expected, solution))


def _demand(poses: Sequence[BoardPose]) -> None:
    if len(poses) < MIN_POSES:
        raise FitError(f"{len(poses)} pose(s) of the board: focal lengths and distances cannot be told apart{_DO}")
    for k, pose in enumerate(poses):
        seen = pose.board_mm[pose.in_camera, :2]
        if len(seen) < MIN_POSE_POINTS:
            raise FitError(
                f"pose {pose.name or k}: {len(seen)} points seen by the camera; {MIN_POSE_POINTS} are needed"
            )
        spread = np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)
        if spread[1] < _ON_A_LINE * spread[0]:
            raise FitError(f"pose {pose.name or k}: the points seen by the camera lie on one line of the board")


def _started(
    poses: Sequence[BoardPose], data: BoardData, form: BoardForm, frames: tuple[Size, Size, float, int]
) -> tuple[BoardState, Expected]:
    """Closed forms, then the camera alone, then the projector's matrix from the boards as the camera sees them."""
    camera_size, projector_size, aspect, radial_terms = frames
    state, u = _camera_alone(poses, data, form, camera_size, radial_terms)
    points = placed_points(state, data)
    first, kept = projector_start([points[part] for part in data.slices()], poses, projector_size, aspect)
    agree = np.isin(data.pose_of, kept)
    weights = np.hstack([data.in_camera, data.in_projector]) * agree[:, None].astype(float)
    starts = [first, recentred(*first, projector_size)] if data.in_projector.any(axis=0).all() else [first]
    best = (math.inf, state, Expected(np.zeros(len(u)), u))
    for start in starts:
        best = min(best, _bent_from(state, u, (data, weights), start, (projector_size, radial_terms)), key=_first)
        if best[0] < _GOOD_START_PX**2 * weights.sum():
            break
    return best[1:]


def _first(one: tuple[float, BoardState, Expected]) -> float:
    return one[0]


def _bent_from(
    state: BoardState,
    u: Array,
    points: tuple[BoardData, Array],
    start: tuple[Array, Array, Array],
    frame: tuple[Size, int],
) -> tuple[float, BoardState, Expected]:
    """Go some steps from a start of the projector, its distortion term by term; return what is left of squares too."""
    (data, weights), (lens, rotation, shift) = points, start
    u, shared = u.copy(), state.shared.copy()
    u[PROJECTOR] = _lens_u(lens, *frame)
    shared[PROJECTOR], shared[SHIFT_OF] = lens, shift
    state = BoardState(shared, rotation, state.pose_rotations, state.pose_shifts)
    state, expected = _one_axis(Expected(np.zeros(len(u)), u), data, state, frame[0])
    squares = math.inf
    for terms in _LATER_TERMS:
        held = np.zeros(len(u), dtype=bool)
        held[[PROJECTOR.start + term for term in terms]] = True
        state, now = minimise(state, data, weights, expected.holding(held), steps=_START_STEPS, enough=_START_ENOUGH)
        squares = now.squares
    return squares, state, expected


def _camera_alone(
    poses: Sequence[BoardPose], data: BoardData, form: BoardForm, size: Size, radial_terms: int
) -> tuple[BoardState, Array]:
    """Solve for the camera and the poses of flat boards, and list what is expected of all parameters."""
    lens, rotations, shifts = camera_start(poses, size)
    shared = np.concatenate([lens, lens, np.zeros(6 + len(form.names))])
    u = np.concatenate([_lens_u(lens, size, radial_terms), np.full(RIG - 9, np.inf), form.expected_u])
    state = BoardState(shared, np.eye(3), rotations, shifts)
    weights = np.hstack([data.in_camera / data.camera_u, 0.0 * data.projector_u])
    alone = Expected(np.zeros(len(u)), u).holding(slice(9, len(u)))
    return minimise(state, data, weights, alone, enough=_START_ENOUGH)[0], u


def _lens_u(lens: Array, size: Size, radial_terms: int) -> Array:
    """Standard deviation expected of a lens: open, but for its terms; 0 where k3 is left out."""
    if radial_terms not in (2, 3):
        raise FitError(f"{radial_terms} radial terms asked for; 2 or 3 are possible")
    corner = math.hypot(size[0] / lens[0], size[1] / lens[1]) / 2
    u = np.full(9, np.inf)
    for term, order in _ORDERS.items():
        u[term] = _TERM_AT_CORNER / corner**order
    u[8] *= radial_terms == 3
    return u


def _one_axis(expected: Expected, data: BoardData, state: BoardState, size: Size) -> tuple[BoardState, Expected]:
    """Hold what a projector's single coordinate cannot tell, and expect the light to pass the frame's middle."""
    known = data.in_projector.any(axis=0)
    if known.all():
        return state, expected
    missing = 1 - int(np.flatnonzero(known)[0])
    mean, u, shared = expected.mean.copy(), expected.u.copy(), state.shared.copy()
    for name in (f"projector.f{'xy'[missing]}_px", f"projector.c{'xy'[missing]}_px"):
        u[BOARD_RIG_NAMES.index(name)] = 0.0
    lit = placed_points(state, data) @ state.rotation.T + shared[SHIFT_OF]
    at = SHIFT_OF.start + missing
    shared[at] = mean[at] = shared[at] - float(np.median(lit[:, missing]))
    u[at] = abs(float(np.median(lit[:, 2]))) * size[missing] / shared[PROJECTOR][missing] / math.sqrt(12)
    return replace(state, shared=shared), Expected(mean, u)


def _value(
    poses: Sequence[BoardPose], sizes: tuple[Size, Size], form: BoardForm, problem: tuple[BoardData, Expected, Solution]
) -> BoardRigFit:
    """Put the solution into values that others use."""
    data, expected, solution = problem
    state, rest = solution.state, residuals(solution.state, data)
    points, covariance = placed_points(state, data), _with_scale(solution, form)
    rig = BoardRig(
        Lens(state.shared[CAMERA], covariance[CAMERA, CAMERA], *sizes[0]),
        Lens(state.shared[PROJECTOR], covariance[PROJECTOR, PROJECTOR], *sizes[1]),
        state.rotation,
        state.shared[SHIFT_OF],
        covariance[:RIG, :RIG],
        min(solution.dof),
        _rms(rest[:, :2], solution.used[:, :2]),
        _rms(rest[:, 2:], solution.used[:, 2:]),
        *_scatter(solution.s_px, data),
        tuple(axis for axis, known in zip("uv", data.in_projector.any(axis=0), strict=True) if known),
        _undetermined(expected, covariance, form),
        form.names,
        state.shared[RIG:],
        covariance[RIG:, RIG:],
        points[solution.used.any(axis=1)],
    )
    return BoardRigFit(rig, _pose_fits(poses, data, solution), form, solution, data, expected)


def _scatter(s: Array, data: BoardData) -> tuple[float, float]:
    """Standard deviation of a coordinate in either device, px: median over poses, geometric mean over axes."""
    stated = (data.camera_u[data.in_camera], data.projector_u[data.in_projector])
    camera, projector = (float(np.median(s[:, k]) * np.exp(np.log(stated[k]).mean())) for k in (0, 1))
    return camera, projector


def _with_scale(solution: Solution, form: BoardForm) -> Array:
    """Covariance of the shared parameters with the print's scale: one error of all lengths."""
    along = np.zeros(len(solution.state.shared))
    along[SHIFT_OF], along[RIG] = solution.state.shared[SHIFT_OF], 1.0
    return np.asarray(solution.covariance + form.pitch_u_rel**2 * np.outer(along, along))


def _pose_fits(poses: Sequence[BoardPose], data: BoardData, solution: Solution) -> tuple[PoseFit, ...]:
    """Say of each pose where it is and what is left of its points."""
    state, rest = solution.state, residuals(solution.state, data)
    points = placed_points(state, data)
    return tuple(
        PoseFit(
            pose.name or str(k),
            state.pose_rotations[k],
            state.pose_shifts[k],
            points[part],
            rest[part, :2],
            rest[part, 2:],
            solution.used[part],
            *_scatter(solution.s_px[k : k + 1], subset(data, [k])),
        )
        for k, (pose, part) in enumerate(zip(poses, data.slices(), strict=True))
    )


def _undetermined(expected: Expected, covariance: Array, form: BoardForm) -> tuple[str, ...]:
    """Names of parameters that were held or are known no better than was expected of them before."""
    names = (*BOARD_RIG_NAMES, *form.names)
    follows = np.sqrt(np.maximum(np.diag(covariance), 0.0)) > _FOLLOWS * expected.u
    exact = np.zeros(len(names), dtype=bool)
    exact[RIG] = form.pitch_u_rel == 0
    exact[RIG + 1] = form.stretch_u_rel == 0
    return tuple(name for name, open_ in zip(names, (follows | ~expected.free) & ~exact, strict=True) if open_)


def _rms(residual_px: Array, used: NDArray[np.bool_]) -> float:
    """Root mean square length over points of which some coordinate was used."""
    any_used = used.any(axis=1)
    squares = np.where(used, residual_px**2, 0.0).sum(axis=1)
    return float(np.sqrt(squares[any_used].mean())) if any_used.any() else 0.0
