"""Lenses with more terms than Brown's: how far Brown's lens, which the rig's camera has, can follow them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fringecal.camera.lens import mrcal_wall
from fringecal.camera.lens.brown_lens import LENS_NAMES, Lens, project
from fringecal.camera.lens.bundle import camera_matrix
from fringecal.errors import FitError

Array = NDArray[np.float64]
RichModel = Literal["opencv8", "splined"]

RATIONAL = "LENSMODEL_OPENCV8"
#: A splined surface follows every wrong corner where few points hold it: so many views, coordinates for each unknown,
#: and share of the picture's cells with points must be there.
MIN_SPLINED_VIEWS = 10
MIN_SPLINED_EXCESS = 4.0
MIN_SPLINED_COVERAGE = 0.6
_KNOTS = 10  # across the picture
_SPLINE_MARGIN = 1.15  # of the field: a cubic needs a knot beyond the outermost point
_CELLS = (6, 8)  # down and across the picture, for its coverage: a board in one pose covers several
_SAMPLES = 20  # along either side of the picture: smooth beside the nine numbers of Brown's lens
_STEP_U = 1e-3  # of a derivative, in standard uncertainties of the value
_LEAST_SCALE = 1e-3  # of a distortion's term, for the solver: what a usual lens has of it
_TOLERANCE = 1e-14  # relative change at which the solver stops: to float64's last digits, so that two lenses compare
#: OpenCV's search for undistorted points: at most a hundred steps, and until they stand still.
_EXACT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-14)
_BROWN_STEP = 1e-6  # of a derivative by Brown's terms, in sizes of each


@dataclass(frozen=True)
class RichLens:
    """A lens of mrcal's kind: the model's name there, its values and covariance, and the picture's size."""

    model: str
    values: Array
    covariance: Array
    width_px: int
    height_px: int

    def project(self, rays: Array) -> Array:
        """Pixels (n, 2) of directions (n, 3) in the camera's frame: x right, y down, z forward."""
        return _projected(self.model, self.values, rays)

    def unproject(self, pixels: Array) -> Array:
        """Directions (n, 3) seen at pixels (n, 2)."""
        if self.model != RATIONAL:
            return mrcal_wall.unproject(self.model, self.values, pixels)
        matrix, terms = camera_matrix(self.values), self.values[4:]
        flat = cv2.undistortPoints(pixels, matrix, terms, criteria=_EXACT).reshape(-1, 2)
        return np.column_stack([flat, np.ones(len(pixels))])

    def gradient(self, rays: Array) -> Array:
        """Derivatives (n, 2, size) of the pixels by those values that are not exact, zero for the others."""
        steps = _STEP_U * np.sqrt(np.diag(self.covariance))
        columns = np.zeros((len(rays), 2, len(steps)))
        for k in np.flatnonzero(steps > 0):
            change = np.zeros(len(steps))
            change[k] = steps[k]
            after, before = (_projected(self.model, self.values + s * change, rays) for s in (1, -1))
            columns[..., k] = (after - before) / (2 * steps[k])
        return columns


@dataclass(frozen=True)
class BrownOf:
    """Brown's lens that follows another one best, and what is left between them at the given rays, px, (n,)."""

    lens: Lens
    left_px: Array


def _projected(model: str, values: Array, rays: Array) -> Array:
    if model != RATIONAL:
        return mrcal_wall.project(model, values, rays)
    pixels = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera_matrix(values), values[4:])[0]
    return np.asarray(pixels, dtype=float).reshape(-1, 2)


def brown_of(rich: RichLens, rays: Array, *, start: Array, radial_terms: int = 3) -> BrownOf:
    """Fit Brown's lens to another one over the directions that its boards showed.

    Parameters
    ----------
    rich
        The lens to follow.
    rays
        Directions (n, 3): those of the boards' points.
    start
        Brown's values to start from, in the order of `LENS_NAMES`.
    radial_terms
        2, or 3 with k3 free too.

    Notes
    -----
    A turn of the whole camera is free: it is no part of a lens. The covariance is that of the other lens,
    carried over to first order; what is left between the two is given beside it.
    """
    seen, free = rich.project(rays), radial_terms + 6
    scale = np.concatenate([np.maximum(np.abs(start[:free]), _LEAST_SCALE), np.ones(3)])

    def residual(vector: Array) -> Array:
        values = np.pad(vector[:free], (0, len(LENS_NAMES) - free))
        return (project(values, Rotation.from_rotvec(vector[free:]).apply(rays)) - seen).ravel()

    begin = np.concatenate([start[:free], np.zeros(3)])
    solved = least_squares(residual, begin, x_scale=scale, xtol=_TOLERANCE, ftol=_TOLERANCE)
    gradient = np.stack(
        [
            (residual(solved.x + step) - residual(solved.x - step)) / (2 * step.sum())
            for step in np.diag(_BROWN_STEP * scale)
        ],
        axis=1,
    )
    carried = np.linalg.lstsq(gradient, rich.gradient(rays).reshape(len(gradient), -1), rcond=None)[0][:free]
    covariance = np.zeros((len(LENS_NAMES),) * 2)
    covariance[:free, :free] = carried @ rich.covariance @ carried.T
    values = np.pad(solved.x[:free], (0, len(LENS_NAMES) - free))
    lens = Lens(values, covariance, rich.width_px, rich.height_px)
    return BrownOf(lens, np.hypot(*solved.fun.reshape(-1, 2).T))


def brown_over_picture(rich: RichLens) -> BrownOf:
    """Brown's lens that follows another one best over the whole picture, as a file states it."""
    u, v = np.meshgrid(np.linspace(0, rich.width_px - 1, _SAMPLES), np.linspace(0, rich.height_px - 1, _SAMPLES))
    rays = rich.unproject(np.column_stack([u.ravel(), v.ravel()]))
    return brown_of(rich, rays[np.isfinite(rays).all(axis=1)], start=np.pad(rich.values[:4], (0, 5)))


def rich_start(model: RichModel, brown: Lens) -> tuple[str, Array]:
    """Give mrcal's name of a model, and its values nearest to Brown's."""
    if model == "opencv8":
        return RATIONAL, np.concatenate([brown.values, np.zeros(3)])
    name, knots = _splined_name(brown)
    return name, np.concatenate([brown.values[:4], np.zeros(2 * knots)])


def _splined_name(brown: Lens) -> tuple[str, int]:
    """Name a splined model whose surface spans the field, and count its control points."""
    middle = brown["cy_px"]
    edges = brown.unproject(np.array([[0.0, middle], [brown.width_px - 1.0, middle]]))
    widest = float(np.nanmax(np.abs(np.arctan(edges[:, 0])))) if np.isfinite(edges).any() else math.pi / 4
    degrees = math.ceil(2 * _SPLINE_MARGIN * math.degrees(widest))
    down = math.ceil(_KNOTS * brown.height_px / brown.width_px) + 1
    return f"LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx={_KNOTS}_Ny={down}_fov_x_deg={degrees}", _KNOTS * down


def demand_for_splines(seen_px: Sequence[Array], brown: Lens) -> None:
    """Refuse a splined model where the points cannot hold it.

    Raises
    ------
    FitError
        Too few views, too few points for its parameters, or large parts of the picture without points.
    """
    views, points = len(seen_px), np.concatenate(seen_px)
    unknowns = 2 * _splined_name(brown)[1] + 6 * views
    share = coverage(points, (brown.height_px, brown.width_px))
    faults = []
    if views < MIN_SPLINED_VIEWS:
        faults.append(f"{views} views, {MIN_SPLINED_VIEWS} are needed")
    if points.size < MIN_SPLINED_EXCESS * unknowns:
        faults.append(f"{points.size} coordinates for {unknowns} unknowns, {MIN_SPLINED_EXCESS:g} each are needed")
    if share < MIN_SPLINED_COVERAGE:
        faults.append(f"points in {share:.0%} of the picture, {MIN_SPLINED_COVERAGE:.0%} are needed")
    if faults:
        raise FitError(
            f"a splined lens is not determined: {'; '.join(faults)}. Photograph the board in more poses, also in the "
            "corners, or fit Brown's lens"
        )


def coverage(points_px: Array, shape: tuple[int, int]) -> float:
    """Share of the picture's cells (6 x 8) that hold points.

    Examples
    --------
    >>> coverage(np.array([[0.0, 0.0], [79.0, 59.0], [79.0, 58.0]]), (60, 80)) == 2 / 48
    True
    """
    cells = [
        np.clip((points_px[:, axis] + 0.5) * count / side, 0, count - 1).astype(int)
        for axis, count, side in ((1, _CELLS[0], shape[0]), (0, _CELLS[1], shape[1]))
    ]
    return len(np.unique(cells[0] * _CELLS[1] + cells[1])) / (_CELLS[0] * _CELLS[1])
