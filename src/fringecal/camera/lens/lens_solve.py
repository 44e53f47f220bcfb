"""One solve of a lens from board views: OpenCV's start, the bundle, and mrcal where it is asked for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from fringecal.camera.lens import mrcal_wall
from fringecal.camera.lens.brown_lens import LENS_NAMES, Lens
from fringecal.camera.lens.bundle import (
    BoardPoints,
    Bundle,
    board_points,
    camera_matrix,
    placed,
    solve_bundle,
    undetermined,
)
from fringecal.camera.lens.mrcal_wall import MrcalSolution
from fringecal.camera.lens.rich_lens import RichLens, RichModel, brown_of, demand_for_splines, rich_start
from fringecal.errors import FitError

Array = NDArray[np.float64]
Model = Literal["brown"] | RichModel

#: A focal length known worse than this, relative, was not determined by the views. A larger limit would let boards
#: through that are hardly tilted, a smaller one refuse few poses in large noise whose u says truly what they are worth.
MAX_FOCAL_REL_U = 0.02
#: Corners of real pictures scatter by this much at least, px.
LEAST_SCATTER_PX = 0.02
#: Bounds of a first focal length, in lengths of the picture's longer side: fields of 118 deg and of 2 deg.
_FOCAL_BOUNDS = (0.3, 30.0)


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
    def shown(self) -> int:
        """Points that the picture shows, used or not."""
        return len(self.seen_px) + len(self.left_out_px)

    @property
    def rms_px(self) -> float:
        """Root mean square distance of seen from modelled points."""
        return rms_px(self.residual_px)

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
class Way:
    """How to solve, as `fit_lens` was asked."""

    use_mrcal: bool
    model: Model
    radial_terms: int
    flat_board: bool


@dataclass(frozen=True)
class SolvedLens:
    """A lens, what it leaves of every view, and the richer lens that it follows, if any."""

    lens: Lens
    views: tuple[ViewFit, ...]
    bundle: Bundle
    rich: RichLens | None = None
    left_px: Array | None = None


def solve_lens(views: Sequence[BoardView], shape: tuple[int, int], way: Way) -> SolvedLens:
    """Start by OpenCV and solve the bundle; on request hand that to mrcal as its start."""
    points = [board_points(view.points_px, view.spacing_mm) for view in views]
    bundle = solve_bundle(points, *_started(points, shape), radial_terms=way.radial_terms, warped=not way.flat_board)
    refuse_undetermined(bundle.values, bundle.covariance, scatter_px=_scatter_px(bundle))
    lens = Lens(bundle.values, bundle.covariance, shape[1], shape[0])
    if way.model != "brown":
        return _rich(views, lens, bundle, way)
    if way.use_mrcal:
        name = f"LENSMODEL_OPENCV{way.radial_terms + 2}"
        found = _by_mrcal(views, bundle, shape, (name, bundle.values[: way.radial_terms + 6]), way)
        missing = (0, len(LENS_NAMES) - len(found.values))
        lens = Lens(np.pad(found.values, missing), np.pad(found.covariance, missing), shape[1], shape[0])
        bundle = _taken_over(bundle, found, views)
        refuse_undetermined(lens.values, lens.covariance)
    return SolvedLens(lens, _views_of(bundle, points), bundle)


def _by_mrcal(
    views: Sequence[BoardView], bundle: Bundle, shape: tuple[int, int], start: tuple[str, Array], way: Way
) -> MrcalSolution:
    """Solve by mrcal with the points that the bundle kept."""
    shown = []
    for view, used in zip(views, bundle.used, strict=True):
        points = view.points_px.copy()
        known = np.isfinite(points).all(axis=-1)
        points[known] = np.where(used[:, None], points[known], np.nan)
        shown.append(points)
    model, values = start
    seed = (values, bundle.poses)
    return mrcal_wall.solve(shown, views[0].spacing_mm, seed, shape, model=model, warped=not way.flat_board)


def _taken_over(bundle: Bundle, found: MrcalSolution, views: Sequence[BoardView]) -> Bundle:
    """Put mrcal's poses, warp and residuals in the place of the bundle's own."""
    pairs = zip(found.residuals, views, strict=True)
    residuals = tuple(rest[np.isfinite(view.points_px).all(axis=-1)] for rest, view in pairs)
    return replace(bundle, poses=found.poses, warp_mm=found.warp_mm, residuals=residuals, dof=found.dof)


def _rich(views: Sequence[BoardView], brown: Lens, bundle: Bundle, way: Way) -> SolvedLens:
    """Solve for a lens of more terms, and for Brown's lens that follows it."""
    assert way.model != "brown"
    points = [board_points(view.points_px, view.spacing_mm) for view in views]
    if way.model == "splined":
        demand_for_splines([each.kept(k).seen_px for each, k in zip(points, bundle.used, strict=True)], brown)
    shape = (brown.height_px, brown.width_px)
    start = rich_start(way.model, brown)
    found = _by_mrcal(views, bundle, shape, start, way)
    rich = RichLens(start[0], found.values, found.covariance, shape[1], shape[0])
    seen = _views_of(_taken_over(bundle, found, views), points)
    rays = np.concatenate([view.points_mm for view in seen])
    follower = brown_of(rich, rays, start=brown.values)
    refuse_undetermined(follower.lens.values, follower.lens.covariance)
    return SolvedLens(follower.lens, seen, _taken_over(bundle, found, views), rich, follower.left_px)


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
    shortest, longest = (bound * max(shape) for bound in _FOCAL_BOUNDS)
    focal = float(np.clip(focal if np.isfinite(focal) else max(shape), shortest, longest))
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


def refuse_undetermined(values: Array, covariance: Array, *, scatter_px: float = math.inf) -> None:
    """Refuse a focal length that is known too badly to be one.

    Points that scatter by less than any picture's do, as drawn ones, are judged as if they did scatter so.
    """
    least = max(1.0, LEAST_SCATTER_PX / max(scatter_px, 1e-12))
    relative = float(least * np.sqrt(max(covariance[0, 0], 0.0)) / abs(values[0]))
    if not relative < MAX_FOCAL_REL_U:
        raise FitError(undetermined(f"{relative:.1%}"))


def _scatter_px(bundle: Bundle) -> float:
    """Standard deviation of one coordinate of a point."""
    rest = [each[used] for each, used in zip(bundle.residuals, bundle.used, strict=True)]
    return float(np.sqrt((np.concatenate(rest) ** 2).sum() / bundle.dof))


def rms_px(residuals: Array) -> float:
    """Root mean square length of residuals (n, 2)."""
    return float(np.sqrt(np.mean((residuals**2).sum(axis=1)))) if len(residuals) else 0.0
