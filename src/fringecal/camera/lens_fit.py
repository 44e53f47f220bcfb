"""The full lens from several poses of a board: OpenCV's solve, its covariance, and what makes it trustworthy."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from fringecal.camera import mrcal_wall
from fringecal.camera.lens import (
    LENS_NAMES,
    Lens,
    projection_covariance_px,
    projection_difference_px,
    projection_uncertainty_px,
)
from fringecal.errors import FitError

Array = NDArray[np.float64]
Solver = Literal["auto", "mrcal", "opencv"]

MIN_VIEWS = 3
MIN_POINTS = 8
#: A focal length known worse than this was not determined by the views.
MAX_FOCAL_REL_U = 0.02
#: Least eigenvalue of the normal equations, scaled to a unit diagonal.
MIN_CONDITION = 1e-9
#: Halves of the views are solved apart when each has this many.
MIN_HALF = 4
OUTLIER_SIGMAS = 5.0


@dataclass(frozen=True)
class BoardView:
    """One picture of a board: its points (rows, columns, 2), px, NaN where hidden, and their spacing in mm."""

    points_px: Array
    spacing_mm: float


@dataclass(frozen=True)
class LensFit:
    """A lens with what its trust rests on.

    Parameters
    ----------
    lens
        The fitted lens and its covariance.
    solver
        ``"mrcal"`` or ``"opencv"``.
    rms_px
        Root mean square distance of seen from modelled points.
    points, outliers, dof
        Points used, points left out, and degrees of freedom.
    view_rms_px
        The same by view, (n,).
    board_warp_mm
        Bow of the board across its columns and rows (mrcal only, else None).
    uncertainty_px
        `projection_uncertainty_px` at `lens.pixels()`.
    halves_px
        Difference between the lenses of the odd and of the even views at the same pixels; None with
        fewer than four views in a half.
    inflation
        Factor on the lens's standard uncertainties: the halves differ by so much more than the scatter of
        the points explains (a bent board, blur, a lens with more terms); 1 if they do not.
    """

    lens: Lens
    solver: Literal["mrcal", "opencv"]
    rms_px: float
    points: int
    outliers: int
    dof: int
    view_rms_px: Array
    board_warp_mm: tuple[float, float] | None
    uncertainty_px: Array
    halves_px: Array | None
    inflation: float


@dataclass(frozen=True)
class _Way:
    """How to solve, as `fit_lens` was asked."""

    use_mrcal: bool
    radial_terms: int
    flat_board: bool


@dataclass(frozen=True)
class _Solved:
    lens: Lens
    residuals: tuple[Array, ...]
    outliers: int
    dof: int
    warp_mm: tuple[float, float] | None = None


def fit_lens(
    views: Sequence[BoardView],
    shape: tuple[int, int],
    *,
    solver: Solver = "auto",
    radial_terms: int = 2,
    flat_board: bool = False,
) -> LensFit:
    """Fit focal length, principal point and distortion to several poses of one board.

    Parameters
    ----------
    views
        The board in its poses, tilted to different sides.
    shape
        Image shape (rows, columns).
    solver
        ``"mrcal"`` also solves for the board's warp; ``"auto"`` takes it where it is installed, else OpenCV.
    radial_terms
        2, or 3 with k3 free too: beyond the outermost points the third one runs wild.
    flat_board
        Take the board as flat with mrcal too; OpenCV always does.

    Raises
    ------
    FitError
        Too few views or points, or views that do not determine the focal length: a board seen square-on
        fits any focal length equally well, with residuals as small as ever.

    Notes
    -----
    The covariance of the lens is that of the joint least squares over lens and poses, the poses
    eliminated; the variance of a point comes from the residuals.
    """
    _demand(views)
    if radial_terms not in (2, 3):
        raise FitError(f"{radial_terms} radial terms asked for; 2 or 3 are possible")
    use_mrcal = mrcal_wall.available() if solver == "auto" else solver == "mrcal"
    way = _Way(use_mrcal, radial_terms, flat_board)
    solved = _solve(views, shape, way)
    halves = _halves(views, shape, way)
    inflation = 1.0 if halves is None else _inflation(*halves)
    lens = replace(solved.lens, covariance=inflation**2 * solved.lens.covariance)
    _refuse_undetermined(lens.values, lens.covariance)
    rest = np.concatenate(solved.residuals)
    return LensFit(
        lens,
        "mrcal" if use_mrcal else "opencv",
        _rms(rest),
        len(rest),
        solved.outliers,
        solved.dof,
        np.array([_rms(each) for each in solved.residuals]),
        solved.warp_mm,
        projection_uncertainty_px(lens),
        None if halves is None else projection_difference_px(*halves),
        inflation,
    )


def _demand(views: Sequence[BoardView]) -> None:
    if len(views) < MIN_VIEWS:
        raise FitError(
            f"{len(views)} view(s) of a board: focal length and distance cannot be told apart from one square-on "
            f"grid, and hardly from two; photograph the board in at least {MIN_VIEWS} poses, tilted 20 to 40 degrees "
            "to different sides"
        )
    if len({view.spacing_mm for view in views}) > 1:
        raise FitError("the views are of boards with different spacings; calibrate with one board")
    for k, view in enumerate(views):
        count = int(np.isfinite(view.points_px[..., 0]).sum())
        if count < MIN_POINTS:
            raise FitError(f"view {k} holds {count} points of the board; {MIN_POINTS} are needed")


def _rms(residuals: Array) -> float:
    return float(np.sqrt(np.mean((residuals**2).sum(axis=1)))) if len(residuals) else 0.0


def _halves(views: Sequence[BoardView], shape: tuple[int, int], way: _Way) -> tuple[Lens, Lens] | None:
    """Lenses from the odd and from the even views, or None where they are too few or do not determine one."""
    if len(views) < 2 * MIN_HALF:
        return None
    try:
        first, second = (_solve(views[k::2], shape, way).lens for k in (0, 1))
    except FitError:
        return None
    return first, second


def _inflation(first: Lens, second: Lens) -> float:
    """Observed over expected rms difference of two lenses from different views, over the picture; at least 1."""
    expected = sum(np.trace(projection_covariance_px(lens), axis1=1, axis2=2) for lens in (first, second))
    # The median: at the corners, beyond all points, both are large and neither says anything.
    ratio = np.median(projection_difference_px(first, second) ** 2 / np.maximum(expected, 1e-12))
    return float(np.sqrt(max(1.0, ratio)))


def _solve(views: Sequence[BoardView], shape: tuple[int, int], way: _Way) -> _Solved:
    """Solve by OpenCV, drop outliers, solve again; on request hand that to mrcal as its start."""
    board, seen = zip(*(_listed(view) for view in views), strict=True)
    values, turns, shifts = _opencv(board, seen, shape, _first_focal(board, seen, shape), way.radial_terms)
    residuals = _residuals(values, turns, shifts, board, seen)
    limit = OUTLIER_SIGMAS * 1.4826 * np.median(np.abs(np.concatenate(residuals)))
    keep = [np.abs(each).max(axis=1) <= max(limit, 1e-6) for each in residuals]
    outliers = int(sum((~k).sum() for k in keep))
    if outliers:
        board = tuple(b[k] for b, k in zip(board, keep, strict=True))
        seen = tuple(s[k] for s, k in zip(seen, keep, strict=True))
        _demand([BoardView(s[None], 1.0) for s in seen])
        values, turns, shifts = _opencv(board, seen, shape, values, way.radial_terms)
        residuals = _residuals(values, turns, shifts, board, seen)
    covariance, dof = _covariance((turns, shifts), values, board, residuals, free=way.radial_terms + 6)
    _refuse_undetermined(values, covariance)
    lens = Lens(values, covariance, shape[1], shape[0])
    if not way.use_mrcal:
        return _Solved(lens, residuals, outliers, dof)
    poses = np.hstack([turns, shifts])
    found = mrcal_wall.solve(
        [view.points_px for view in views],
        views[0].spacing_mm,
        values[: 6 + way.radial_terms],
        poses,
        shape,
        flat_board=way.flat_board,
    )
    _refuse_undetermined(found.values, found.covariance)
    lens = Lens(found.values, found.covariance, shape[1], shape[0])
    return _Solved(lens, found.residuals, found.outliers, found.dof, found.warp_mm)


def _listed(view: BoardView) -> tuple[Array, Array]:
    """Points on the board (n, 3), mm, y down the rows, and in the picture (n, 2), px, of the seen ones."""
    row, column = np.nonzero(np.isfinite(view.points_px[..., 0]))
    board = view.spacing_mm * np.stack([column, row, np.zeros(len(row))], axis=1)
    return board.astype(float), view.points_px[row, column]


def _first_focal(board: Sequence[Array], seen: Sequence[Array], shape: tuple[int, int]) -> Array:
    """Start: OpenCV's closed form for the focal length, the principal point at the image centre."""
    start = cv2.initCameraMatrix2D(_single(board), _single(seen), (shape[1], shape[0]))
    focal = start[0, 0] if np.isfinite(start[0, 0]) and start[0, 0] > 0 else float(max(shape))
    focal = float(np.clip(focal, 0.3 * max(shape), 30.0 * max(shape)))
    return np.array([focal, focal, (shape[1] - 1) / 2, (shape[0] - 1) / 2, 0, 0, 0, 0, 0])


def _single(arrays: Sequence[Array]) -> list[NDArray[np.float32]]:
    return [np.ascontiguousarray(each, dtype=np.float32) for each in arrays]


def _opencv(
    board: Sequence[Array], seen: Sequence[Array], shape: tuple[int, int], start: Array, radial_terms: int
) -> tuple[Array, Array, Array]:
    """Lens parameters, and turn (n, 3) and shift (n, 3), mm, of every view, by OpenCV's joint solve."""
    matrix = np.array([[start[0], 0, start[2]], [0, start[1], start[3]], [0, 0, 1]])
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-10)
    try:
        _, matrix, lens, turns, shifts = cv2.calibrateCamera(
            _single(board),
            _single(seen),
            (shape[1], shape[0]),
            matrix,
            start[4:].copy(),
            flags=cv2.CALIB_USE_INTRINSIC_GUESS | (0 if radial_terms > 2 else cv2.CALIB_FIX_K3),
            criteria=stop,
        )
    except cv2.error as error:
        raise FitError(
            f"OpenCV cannot solve for the lens ({error.err}); check that the views show one board"
        ) from error
    values = np.concatenate([matrix[[0, 1, 0, 1], [0, 1, 2, 2]], np.ravel(lens)[:5]])
    turn, shift = (np.asarray(each, dtype=np.float64).reshape(-1, 3) for each in (turns, shifts))
    return values.astype(np.float64), turn, shift


def _matrix(values: Array) -> Array:
    return np.array([[values[0], 0, values[2]], [0, values[1], values[3]], [0, 0, 1]])


def _residuals(
    values: Array, turns: Array, shifts: Array, board: Sequence[Array], seen: Sequence[Array]
) -> tuple[Array, ...]:
    """Seen minus modelled, px, (n, 2) per view."""
    return tuple(
        points - cv2.projectPoints(places, turn, shift, _matrix(values), values[4:])[0].reshape(-1, 2)
        for places, points, turn, shift in zip(board, seen, turns, shifts, strict=True)
    )


def _covariance(
    poses: tuple[Array, Array], values: Array, board: Sequence[Array], residuals: Sequence[Array], *, free: int
) -> tuple[Array, int]:
    """Covariance of the first `free` lens parameters, poses eliminated (Schur complement); degrees of freedom."""
    normal = np.zeros((free, free))
    for places, turn, shift in zip(board, *poses, strict=True):
        jacobian = cv2.projectPoints(places, turn, shift, _matrix(values), values[4:])[1]
        pose, lens = jacobian[:, :6], jacobian[:, 6 : 6 + free]
        # Poses absorb all they can: what is left of the lens's columns is what this view says of the lens.
        rest = lens - pose @ np.linalg.lstsq(pose, lens, rcond=None)[0]
        normal += rest.T @ rest
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    unit = normal / np.outer(scale, scale)
    if np.linalg.eigvalsh(unit)[0] < MIN_CONDITION:
        raise FitError(_UNDETERMINED.format("not at all"))
    rest = np.concatenate(residuals)
    dof = max(1, rest.size - free - 6 * len(board))
    covariance = np.zeros((len(LENS_NAMES),) * 2)
    covariance[:free, :free] = np.linalg.inv(unit) / np.outer(scale, scale) * float((rest**2).sum()) / dof
    return covariance, dof


_UNDETERMINED = (
    "the views do not determine the focal length (known to {}): a board seen square-on fits any focal length, "
    "however small the residuals; photograph it tilted 20 to 40 degrees to different sides, also in the corners"
)


def _refuse_undetermined(values: Array, covariance: Array) -> None:
    relative = float(np.sqrt(max(covariance[0, 0], 0.0)) / abs(values[0]))
    if not relative < MAX_FOCAL_REL_U:
        raise FitError(_UNDETERMINED.format(f"{relative:.1%}"))
