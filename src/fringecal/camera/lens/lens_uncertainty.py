"""How well a lens is known over its picture, and by how much two lenses differ."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fringecal.camera.lens.brown_lens import LENS_NAMES, Lens, project
from fringecal.errors import FitError

Array = NDArray[np.float64]

# Steps of central differences: each moves a point by about 0.01 px or less, where a lens is linear, far above rounding.
_LENS_STEPS = np.array([1e-2, 1e-2, 1e-2, 1e-2, 1e-5, 1e-5, 1e-6, 1e-6, 1e-5])  # as `LENS_NAMES`: px, then no unit
_TURN_STEP_RAD = 1e-6
_SHIFT_STEP = 1e-6  # of the distance
_TURN_SCALE_RAD = 1e-3  # size of the turn between two lenses, for the solver: about a pixel


def projection_uncertainty_px(
    lens: Lens, pixels: Array | None = None, *, anchor_mm: Array | None = None, distance_mm: float = np.inf
) -> Array:
    """Standard uncertainty of where a point is seen, in the worse direction, px, (n,).

    NaN where no ray of the lens's model reaches; `projection_covariance_px` says how.
    """
    covariance = projection_covariance_px(lens, pixels, anchor_mm=anchor_mm, distance_mm=distance_mm)
    known = np.isfinite(covariance).all(axis=(1, 2))
    found = np.full(len(covariance), np.nan)
    found[known] = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance[known])[:, -1], 0.0))
    return found


def projection_covariance_px(
    lens: Lens, pixels: Array | None = None, *, anchor_mm: Array | None = None, distance_mm: float = np.inf
) -> Array:
    """Covariance (n, 2, 2) of where a point is seen, px^2.

    Parameters
    ----------
    lens
        The lens with its covariance.
    pixels
        Places (n, 2); all over the picture if left out.
    anchor_mm
        The points that the lens was fitted to, in the camera's frame (n, 3). Left out, a turn alone is taken
        out, evenly over the picture.
    distance_mm
        Distance of the point from the camera's centre; a finite one needs an anchor.

    Raises
    ------
    FitError
        A finite distance without an anchor, or one that is not positive.

    Notes
    -----
    A small move of the whole camera looks like a changed lens and is no error of it: of every change of the
    parameters, the move that fits it best is taken out first. With the points of the boards this is the
    cross-reprojection of mrcal's documentation ("uncertainty-cross-reprojection") with the points' own noise
    left aside; at infinity the shift of the move is not seen.
    """
    everywhere = lens.pixels()
    pixels = everywhere if pixels is None else pixels
    if not distance_mm > 0 or (anchor_mm is None and np.isfinite(distance_mm)):
        raise FitError(
            f"a distance of {distance_mm} mm: it must be positive, and a finite one needs the board's points"
        )
    rays = lens.unproject(pixels)
    seen = _finite(lens.unproject(everywhere)) if anchor_mm is None else anchor_mm
    moves = 3 if anchor_mm is None else 6
    tied = _move_gradient(lens, seen)[..., :moves].reshape(-1, moves)
    move_of = np.linalg.lstsq(tied, _lens_gradient(lens, seen).reshape(-1, len(LENS_NAMES)), rcond=None)[0]
    if np.isfinite(distance_mm):
        rays = rays * (distance_mm / np.linalg.norm(rays, axis=1, keepdims=True))
    moved = _move_gradient(lens, rays)
    if not np.isfinite(distance_mm):
        moved[..., 3:] = 0.0
    gradient = _lens_gradient(lens, rays) - moved[..., :moves] @ move_of
    covariance: Array = gradient @ lens.covariance @ gradient.transpose(0, 2, 1)
    return covariance


def _finite(rays: Array) -> Array:
    """Leave out the places that no ray of the model reaches."""
    return rays[np.isfinite(rays).all(axis=1)]


def _lens_gradient(lens: Lens, points: Array) -> Array:
    """Derivatives (n, 2, 9) of the pixels of points by the lens parameters."""
    columns = [
        (project(lens.values + step, points) - project(lens.values - step, points)) / (2 * step.sum())
        for step in np.diag(_LENS_STEPS)
    ]
    return np.stack(columns, axis=-1)


def _move_gradient(lens: Lens, points: Array) -> Array:
    """Derivatives (n, 2, 6) of the pixels of points by their small turn, rad, and shift, in units of points."""
    turns = [np.cross(axis, points) for axis in np.eye(3)]
    shifts = [np.broadcast_to(axis, points.shape) for axis in np.eye(3)]
    size = _SHIFT_STEP * float(np.median(np.linalg.norm(points, axis=1)))
    columns = [
        (lens.project(points + step * change) - lens.project(points - step * change)) / (2 * step)
        for step, change in [*((_TURN_STEP_RAD, t) for t in turns), *((size, s) for s in shifts)]
    ]
    return np.stack(columns, axis=-1)


def projection_difference_px(first: Lens, second: Lens) -> Array:
    """By how much two lenses differ, px, (n,), at pixels all over the picture, the best turn taken out."""
    pixels = first.pixels()
    rays = first.unproject(pixels)
    known = np.isfinite(rays).all(axis=1)

    def residual(turn: Array) -> Array:
        return (second.project(Rotation.from_rotvec(turn).apply(rays[known])) - pixels[known]).ravel()

    rest = least_squares(residual, np.zeros(3), x_scale=_TURN_SCALE_RAD).fun.reshape(-1, 2)
    apart = np.full(len(pixels), np.nan)
    apart[known] = np.hypot(rest[:, 0], rest[:, 1])
    return apart
