"""The full lens from several poses of a board: the solve, its cross-validation, and what is refused."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.lens import mrcal_wall
from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.lens.lens_solve import (
    BoardView,
    Model,
    SolvedLens,
    ViewFit,
    Way,
    refuse_undetermined,
    rms_px,
    solve_lens,
)
from fringecal.camera.lens.lens_uncertainty import (
    projection_covariance_px,
    projection_difference_px,
    projection_uncertainty_px,
)
from fringecal.camera.lens.rich_lens import RichLens
from fringecal.errors import FitError

Array = NDArray[np.float64]
Solver = Literal["auto", "mrcal", "opencv"]

#: Poses: two hardly tell focal length from distance, and of three none can be left out.
MIN_VIEWS = 3
#: Points of a view: sixteen coordinates for the six numbers of its pose, so that it says something of the lens too.
MIN_POINTS = 8
#: Halves of the views are solved apart when each has this many: one more than a lens needs.
MIN_HALF = 4
#: Share of a view's points that must agree with the others' lens; of a wrong board or a zoomed lens hardly any do.
_LEAST_AGREEING = 0.5


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
        Points, residuals and poses of the views that were used, in their order.
    dof
        Degrees of freedom.
    board_warp_mm
        Bow of the board across its columns and rows; None if it was taken as flat.
    halves_px
        Difference between the lenses of the odd and of the even views at `lens.pixels()`; None with
        fewer than four views in a half.
    inflation
        Factor on the lens's standard uncertainties: the halves differ by so much more than the scatter of
        the points explains (a warped board, blur, a lens with more terms); 1 if they do not. It also holds
        what Brown's lens leaves of a richer one.
    rich
        The lens with more terms, if one was asked for.
    left_px
        Distance between it and Brown's lens at the boards' points, px, (n,).
    dropped
        Numbers of the views that were left out: most of their points disagree with one board and one lens.
    """

    lens: Lens
    solver: Literal["mrcal", "opencv"]
    views: tuple[ViewFit, ...]
    dof: int
    board_warp_mm: tuple[float, float] | None
    halves_px: Array | None
    inflation: float
    rich: RichLens | None = None
    left_px: Array | None = None
    dropped: tuple[int, ...] = ()

    @property
    def rms_px(self) -> float:
        """Root mean square distance of seen from modelled points."""
        return rms_px(np.concatenate([view.residual_px for view in self.views]))

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


def fit_lens(
    views: Sequence[BoardView],
    shape: tuple[int, int],
    *,
    solver: Solver = "auto",
    model: Model = "brown",
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
    model
        ``"brown"``; or ``"opencv8"`` (rational terms) or ``"splined"``, both by mrcal: the lens is then Brown's
        that follows it best where the boards were, with what is left between them in its uncertainty.
    radial_terms
        Of Brown's lens: 2, or 3 with k3 free too: beyond the outermost points the third one runs wild.
    flat_board
        Take the board as flat. Otherwise its warp is solved for, where all views show all of one board.

    Raises
    ------
    FitError
        Too few views or points, or views that do not determine the focal length: a board seen square-on
        fits any focal length equally well, with residuals as small as ever.

    Notes
    -----
    The covariance of the lens is that of the joint least squares over lens, warp and poses, the last two
    eliminated; the variance of a point comes from the residuals.
    """
    _demand(views)
    if radial_terms not in (2, 3):
        raise FitError(f"{radial_terms} radial terms asked for; 2 or 3 are possible")
    if model != "brown" and (solver == "opencv" or not mrcal_wall.available()):
        raise FitError(f"the model {model} is solved by mrcal alone; install fringecal[mrcal], or fit Brown's lens")
    use_mrcal = mrcal_wall.available() if solver == "auto" else solver == "mrcal"
    # A warp belongs to one board; views of differently cut grids do not share their points.
    one_board = len({view.points_px.shape for view in views}) == 1
    way = Way(use_mrcal, model, radial_terms, flat_board or not one_board)
    solved, dropped = _without_disagreeing_views(views, shape, way)
    halves = _halves([view for k, view in enumerate(views) if k not in dropped], shape, way)
    inflation = math.hypot(1.0 if halves is None else _inflation(*halves), _left_over(solved))
    lens = replace(solved.lens, covariance=inflation**2 * solved.lens.covariance)
    refuse_undetermined(lens.values, lens.covariance)
    return LensFit(
        lens,
        "mrcal" if use_mrcal else "opencv",
        solved.views,
        solved.bundle.dof,
        solved.bundle.warp_mm,
        None if halves is None else projection_difference_px(*halves),
        inflation,
        solved.rich,
        solved.left_px,
        dropped,
    )


def _demand(views: Sequence[BoardView]) -> None:
    if len(views) < MIN_VIEWS:
        raise FitError(
            f"{len(views)} view(s) of a board: focal length and distance cannot be distinguished from one square-on "
            f"grid, and hardly from two; photograph the board in at least {MIN_VIEWS} poses, tilted 20 to 40 degrees "
            "to different sides"
        )
    if len({view.spacing_mm for view in views}) > 1:
        raise FitError("the views are of boards with different spacings; calibrate with one board")
    for k, view in enumerate(views):
        count = int(np.isfinite(view.points_px).all(axis=-1).sum())
        if count < MIN_POINTS:
            raise FitError(f"view {k} holds {count} points of the board; {MIN_POINTS} are needed")


def _without_disagreeing_views(
    views: Sequence[BoardView], shape: tuple[int, int], way: Way
) -> tuple[SolvedLens, tuple[int, ...]]:
    """Solve, leave out the views of which less than half agrees with the rest, and solve again."""
    solved = solve_lens(views, shape, way)
    dropped = tuple(
        k for k, view in enumerate(solved.views) if len(view.seen_px) < max(MIN_POINTS, _LEAST_AGREEING * view.shown)
    )
    if not dropped:
        return solved, ()
    rest = [view for k, view in enumerate(views) if k not in dropped]
    if len(rest) < MIN_VIEWS:
        raise FitError(
            f"{len(dropped)} of {len(views)} views disagree with the others about the lens; check that all show one "
            "board, in focus, by one camera whose zoom was not touched"
        )
    return solve_lens(rest, shape, way), dropped


def _halves(views: Sequence[BoardView], shape: tuple[int, int], way: Way) -> tuple[Lens, Lens] | None:
    """Lenses from the odd and from the even views, or None where they are too few or do not determine one."""
    if len(views) < 2 * MIN_HALF:
        return None
    try:
        first, second = (solve_lens(views[k::2], shape, way).lens for k in (0, 1))
    except FitError:
        return None
    return first, second


def _inflation(first: Lens, second: Lens) -> float:
    """Observed over expected rms difference of two lenses from different views, over the picture; at least 1."""
    expected = sum(np.trace(projection_covariance_px(lens), axis1=1, axis2=2) for lens in (first, second))
    # The median: at the corners, beyond all points, both are large and neither says anything.
    ratio = np.nanmedian(projection_difference_px(first, second) ** 2 / np.maximum(expected, 1e-12))
    return float(np.sqrt(max(1.0, ratio)))


def _left_over(solved: SolvedLens) -> float:
    """Distance of Brown's lens from the richer one in standard uncertainties, at the boards' points, rms."""
    if solved.left_px is None:
        return 0.0
    seen = np.concatenate([view.seen_px for view in solved.views])
    expected = np.trace(projection_covariance_px(solved.lens, seen), axis1=1, axis2=2)
    return float(np.sqrt(np.mean(solved.left_px**2) / np.median(expected)))
