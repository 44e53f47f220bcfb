"""The full lens from several poses of a board: the solve, its cross-validation, and what is refused."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from fringecal.camera import mrcal_wall
from fringecal.camera.bundle import BoardPoints, Bundle, board_points, camera_matrix, placed, solve_bundle, undetermined
from fringecal.camera.lens import Lens
from fringecal.camera.lens_uncertainty import (
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
#: Halves of the views are solved apart when each has this many.
MIN_HALF = 4


@dataclass(frozen=True)
class BoardView:
    """One picture of a board: its points (rows, columns, 2), px, NaN where hidden, and their spacing in mm."""

    points_px: Array
    spacing_mm: float


@dataclass(frozen=True)
class ViewFit:
    """What the fit says of one picture of the board.

    Parameters
    ----------
    seen_px, residual_px
        Points that were used, and seen minus modelled, (n, 2).
    points_mm
        The same points in the camera's frame (n, 3): x right, y down, z forward.
    left_out_px
        Points taken for wrong corners (m, 2).
    """

    seen_px: Array
    residual_px: Array
    points_mm: Array
    left_out_px: Array

    @property
    def rms_px(self) -> float:
        """Root mean square distance of seen from modelled points."""
        return _rms(self.residual_px)

    @property
    def distance_mm(self) -> float:
        """Distance of the board's middle from the camera's centre."""
        return float(np.linalg.norm(self.points_mm.mean(axis=0)))

    @property
    def tilt_deg(self) -> float:
        """Angle of the board's normal to the optical axis."""
        normal = np.linalg.svd(self.points_mm - self.points_mm.mean(axis=0))[2][2]
        return float(np.degrees(np.arccos(min(1.0, abs(normal[2])))))


@dataclass(frozen=True)
class LensFit:
    """A lens with what its trust rests on.

    Parameters
    ----------
    lens
        The fitted lens and its covariance.
    solver
        ``"mrcal"`` or ``"opencv"``.
    views
        Points, residuals and poses by picture.
    dof
        Degrees of freedom.
    board_warp_mm
        Bow of the board across its columns and rows; None if it was taken as flat.
    halves_px
        Difference between the lenses of the odd and of the even views at `lens.pixels()`; None with
        fewer than four views in a half.
    inflation
        Factor on the lens's standard uncertainties: the halves differ by so much more than the scatter of
        the points explains (a bent board, blur, a lens with more terms); 1 if they do not.
    """

    lens: Lens
    solver: Literal["mrcal", "opencv"]
    views: tuple[ViewFit, ...]
    dof: int
    board_warp_mm: tuple[float, float] | None
    halves_px: Array | None
    inflation: float

    @property
    def rms_px(self) -> float:
        """Root mean square distance of seen from modelled points."""
        return _rms(np.concatenate([view.residual_px for view in self.views]))

    @property
    def points(self) -> int:
        """Points used."""
        return sum(len(view.seen_px) for view in self.views)

    @property
    def outliers(self) -> int:
        """Points left out as wrong corners."""
        return sum(len(view.left_out_px) for view in self.views)

    @property
    def distance_mm(self) -> float:
        """Mean distance of the boards."""
        return float(np.mean([view.distance_mm for view in self.views]))

    @property
    def uncertainty_px(self) -> Array:
        """Standard uncertainty of the projection at `lens.pixels()`, far away."""
        return projection_uncertainty_px(self.lens)

    def uncertainty_at_px(self, distance_mm: float, pixels: Array | None = None) -> Array:
        """Standard uncertainty of the projection of points at a distance from the camera's centre, px, (n,)."""
        anchor = np.concatenate([view.points_mm for view in self.views])
        return projection_uncertainty_px(self.lens, pixels, anchor_mm=anchor, distance_mm=distance_mm)


@dataclass(frozen=True)
class _Way:
    """How to solve, as `fit_lens` was asked."""

    use_mrcal: bool
    radial_terms: int
    flat_board: bool


@dataclass(frozen=True)
class _Solved:
    lens: Lens
    views: tuple[ViewFit, ...]
    bundle: Bundle


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
        ``"auto"`` takes mrcal where it is installed, else the bundle started by OpenCV.
    radial_terms
        2, or 3 with k3 free too: beyond the outermost points the third one runs wild.
    flat_board
        Take the board as flat. Otherwise its bow is solved for, where all views show all of one board.

    Raises
    ------
    FitError
        Too few views or points, or views that do not determine the focal length: a board seen square-on
        fits any focal length equally well, with residuals as small as ever.

    Notes
    -----
    The covariance of the lens is that of the joint least squares over lens, bow and poses, the last two
    eliminated; the variance of a point comes from the residuals.
    """
    _demand(views)
    if radial_terms not in (2, 3):
        raise FitError(f"{radial_terms} radial terms asked for; 2 or 3 are possible")
    use_mrcal = mrcal_wall.available() if solver == "auto" else solver == "mrcal"
    # A bow belongs to one board; views of differently cut grids do not share their points.
    one_board = len({view.points_px.shape for view in views}) == 1
    way = _Way(use_mrcal, radial_terms, flat_board or not one_board)
    solved = _solve(views, shape, way)
    halves = _halves(views, shape, way)
    inflation = 1.0 if halves is None else _inflation(*halves)
    lens = replace(solved.lens, covariance=inflation**2 * solved.lens.covariance)
    _refuse_undetermined(lens.values, lens.covariance)
    return LensFit(
        lens,
        "mrcal" if use_mrcal else "opencv",
        solved.views,
        solved.bundle.dof,
        solved.bundle.warp_mm,
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
        count = int(np.isfinite(view.points_px).all(axis=-1).sum())
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
    ratio = np.nanmedian(projection_difference_px(first, second) ** 2 / np.maximum(expected, 1e-12))
    return float(np.sqrt(max(1.0, ratio)))


def _solve(views: Sequence[BoardView], shape: tuple[int, int], way: _Way) -> _Solved:
    """Start by OpenCV and solve the bundle; on request hand that to mrcal as its start."""
    points = [board_points(view.points_px, view.spacing_mm) for view in views]
    bundle = solve_bundle(points, *_started(points, shape), radial_terms=way.radial_terms, bowed=not way.flat_board)
    _refuse_undetermined(bundle.values, bundle.covariance)
    if way.use_mrcal:
        seed = (bundle.values[: 6 + way.radial_terms], bundle.poses)
        pixels, spacing = [view.points_px for view in views], views[0].spacing_mm
        bundle = mrcal_wall.solve(pixels, spacing, *seed, shape, flat_board=way.flat_board)
        _refuse_undetermined(bundle.values, bundle.covariance)
    return _Solved(Lens(bundle.values, bundle.covariance, shape[1], shape[0]), _views_of(bundle, points), bundle)


def _views_of(bundle: Bundle, points: Sequence[BoardPoints]) -> tuple[ViewFit, ...]:
    parts = zip(points, bundle.poses, bundle.residuals, bundle.used, strict=True)
    return tuple(
        ViewFit(each.seen_px[used], rest[used], placed(each.kept(used), pose, bundle.warp_mm), each.seen_px[~used])
        for each, pose, rest, used in parts
    )


def _started(points: Sequence[BoardPoints], shape: tuple[int, int]) -> tuple[Array, Array]:
    """Lens and poses to start from: OpenCV's solve for a flat board, principal point from the image centre."""
    board, seen = [_single(each.board_mm) for each in points], [_single(each.seen_px) for each in points]
    size = (shape[1], shape[0])
    focal = cv2.initCameraMatrix2D(board, seen, size)[0, 0]
    focal = float(np.clip(focal if np.isfinite(focal) else max(shape), 0.3 * max(shape), 30.0 * max(shape)))
    matrix = camera_matrix(np.array([focal, focal, (shape[1] - 1) / 2, (shape[0] - 1) / 2]))
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3
    try:
        _, matrix, lens, turns, shifts = cv2.calibrateCamera(board, seen, size, matrix, np.zeros(5), flags=flags)
    except cv2.error as error:
        raise FitError(
            f"OpenCV cannot solve for the lens ({error.err}); check that the views show one board"
        ) from error
    values = np.concatenate([matrix[[0, 1, 0, 1], [0, 1, 2, 2]], np.ravel(lens)[:5]])
    return values, np.hstack([np.reshape(each, (-1, 3)) for each in (turns, shifts)])


def _single(array: Array) -> NDArray[np.float32]:
    return np.ascontiguousarray(array, dtype=np.float32)


def _refuse_undetermined(values: Array, covariance: Array) -> None:
    relative = float(np.sqrt(max(covariance[0, 0], 0.0)) / abs(values[0]))
    if not relative < MAX_FOCAL_REL_U:
        raise FitError(undetermined(f"{relative:.1%}"))
