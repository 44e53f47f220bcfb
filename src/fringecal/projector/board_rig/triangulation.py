"""Points in space from a camera's pixels and the projector's coordinates, with what each error does to them."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.camera import LENS_NAMES, lens_gradient
from fringecal.errors import FitError
from fringecal.projector.board_rig.rig_value import BOARD_RIG_NAMES, BoardRig, cross_matrix

Array = NDArray[np.float64]

_LENS = len(LENS_NAMES)
_ROUNDS = 12  # of Newton's method in the depth; from a start without distortion it takes four
_SETTLED_PX = 1e-9  # in the projector: far below any phase's scatter
_OUTSIDE = 2.0
"""Times the largest u among the boards' own points, from which on a point counts as outside: what is said there rests
on the model's continuation more than on boards."""


@dataclass(frozen=True)
class RigPoints:
    """Points with their uncertainty, in the camera's frame.

    Parameters
    ----------
    points_mm
        (n, 3): x right, y down, z forward; NaN where the rays do not meet before the rig.
    by_rig
        (n, 3, 24): change under a unit of each parameter (`BOARD_RIG_NAMES`); mm over the parameter's unit.
    random_mm2
        (n, 3, 3): covariance by the pixel's and the phase's own errors, which other points do not share.
    covariance_mm2
        (n, 3, 3): both together; between points `by_rig` is shared.
    epipolar_px, epipolar_u_px
        (n,): distance of the projector's second coordinate from the plane of rays that the first allows, px, and its
        standard uncertainty; NaN where one coordinate is known. A wrong fringe order shows in it.
    """

    points_mm: Array
    by_rig: Array
    random_mm2: Array
    covariance_mm2: Array
    epipolar_px: Array
    epipolar_u_px: Array

    @property
    def u_mm(self) -> Array:
        """Standard uncertainty of x, y and z, (n, 3)."""
        return np.sqrt(np.einsum("nii->ni", self.covariance_mm2))

    def joint_covariance(self, rig: BoardRig) -> Array:
        """Covariance (3 n, 3 n) of all coordinates together, point by point, mm^2."""
        flat = self.by_rig.reshape(-1, len(BOARD_RIG_NAMES))
        found = flat @ rig.covariance @ flat.T
        for k, block in enumerate(self.random_mm2):
            found[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += block
        return np.asarray(found)


def rig_points(
    rig: BoardRig,
    camera_px: Array,
    projector_px: Array,
    *,
    projector_u_px: ArrayLike = 0.0,
    camera_u_px: float = 0.0,
) -> RigPoints:
    """Triangulate.

    Parameters
    ----------
    rig
        The calibration.
    camera_px
        Pixels (n, 2) of the camera.
    projector_px
        What lights them (n, 2), px of the projector; NaN where a coordinate is not known, one is enough.
    projector_u_px
        Standard uncertainty of each coordinate: a number, (n,) or (n, 2).
    camera_u_px
        Standard uncertainty of the pixels themselves: 0 where phase is read at a pixel's centre.

    Raises
    ------
    FitError
        Arrays that do not fit one another.

    Notes
    -----
    The point lies on the camera's ray, X = z d, at the depth z at which the projector's coordinate is the given one;
    of two coordinates the weighted least squares decide. Errors to first order (docs/theory/board-rig.md).
    """
    if camera_px.shape != projector_px.shape or camera_px.ndim != 2 or camera_px.shape[1] != 2:
        raise FitError(f"pixels of the shapes {camera_px.shape} and {projector_px.shape}; both must be (n, 2)")
    u_px = np.broadcast_to(_columns(projector_u_px), projector_px.shape)
    known = np.isfinite(projector_px)
    weights = np.where(known, 1.0, 0.0) * _relative_weights(u_px)
    rays = rig.camera.unproject(camera_px)
    depth = _depths(rig, rays, np.where(known, projector_px, 0.0), weights)
    noise = _Noise(weights, known, u_px, camera_u_px)
    return _with_errors(rig, rays, depth, np.where(known, projector_px, 0.0), noise)


def _columns(u_px: ArrayLike) -> Array:
    found = np.asarray(u_px, float)
    return found[:, None] if found.ndim == 1 else found


def _relative_weights(u_px: Array) -> Array:
    """One over each u, the larger of a point's two scaled to 1: where both are 0, alike."""
    least = np.maximum(u_px.min(axis=1, keepdims=True), 1e-12)
    return least / np.maximum(u_px, least)


def _depths(rig: BoardRig, rays: Array, place: Array, weights: Array) -> Array:
    """Depths along the rays by Gauss and Newton's method, (n,)."""
    depth = _first_depths(rig, rays, place, weights)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        for _ in range(_ROUNDS):
            seen = lens_gradient(rig.projector.values, rig.in_projector(depth[:, None] * rays))
            slope = np.einsum("nij,nj->ni", seen.by_point, rays @ rig.rotation.T) * weights
            rest = (place - seen.pixels) * weights
            step = (slope * rest).sum(axis=1) / (slope**2).sum(axis=1)
            depth = depth + np.clip(step, -0.5 * np.abs(depth), 0.5 * np.abs(depth))
            if not np.nanmax(np.abs(step) * np.sqrt((slope**2).sum(axis=1)), initial=0.0) > _SETTLED_PX:
                break
    return np.where(depth > 0, depth, np.nan)


def _first_depths(rig: BoardRig, rays: Array, place: Array, weights: Array) -> Array:
    """Depths as one coordinate tells them without the projector's distortion: that which the depth moves most."""
    across = rig.rotation @ rays.T  # (3, n)
    moves = np.abs(across[:2].T * rig.shift_mm[2] - across[2][:, None] * rig.shift_mm[:2])
    axis = np.argmax(weights * moves * rig.projector.values[:2], axis=1)
    rows = np.arange(len(rays))
    ideal = (place - rig.projector.values[2:4]) / rig.projector.values[:2]
    turned = rays @ rig.rotation.T
    at = ideal[rows, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        return (rig.shift_mm[axis] - at * rig.shift_mm[2]) / (at * turned[:, 2] - turned[rows, axis])


class _Noise(NamedTuple):
    """Relative weights (n, 2), which coordinates are known, their u in px, and the u of the camera's pixels in px."""

    weights: Array
    known: NDArray[np.bool_]
    u_px: Array
    camera_u_px: float


class _Effects(NamedTuple):
    """What an error moves: the ray's direction (n, 3, m), and the projector's place of a held point (n, 2, m)."""

    direction: Array
    place: Array


class _Lines(NamedTuple):
    """Rays (n, 3), depths (n,), and derivatives of the projector's place by the point (n, 2, 3) and by depth (n, 2)."""

    rays: Array
    depth: Array
    by_point: Array
    along: Array

    def place_moves(self, effects: _Effects) -> Array:
        """Moves (n, 2, m) of the projector's place at constant depth."""
        return np.asarray(effects.place + self.by_point @ (self.depth[:, None, None] * effects.direction))

    def point_moves(self, effects: _Effects, pull: Array) -> Array:
        """Moves (n, 3, m) of the points; `pull` (n, 2) is the depth's change by the projector's place."""
        back = np.einsum("ni,nim->nm", pull, self.place_moves(effects))
        return np.asarray(self.depth[:, None, None] * effects.direction - self.rays[:, :, None] * back[:, None, :])


def _with_errors(rig: BoardRig, rays: Array, depth: Array, place: Array, noise: _Noise) -> RigPoints:
    points = depth[:, None] * rays
    seen = lens_gradient(rig.projector.values, rig.in_projector(points))
    by_point = seen.by_point @ rig.rotation
    lines = _Lines(rays, depth, by_point, np.einsum("nij,nj->ni", by_point, rays))
    with np.errstate(invalid="ignore", divide="ignore"):
        heavy = (lines.along * noise.weights) ** 2
        pull = lines.along * noise.weights**2 / heavy.sum(axis=1, keepdims=True)
    of_pixel, of_rig = _camera_effects(rig, rays)
    of_rig.place[..., _LENS : 2 * _LENS] = seen.by_lens
    of_rig.place[..., 2 * _LENS : 2 * _LENS + 3] = seen.by_point @ -cross_matrix(points @ rig.rotation.T)
    of_rig.place[..., 2 * _LENS + 3 :] = seen.by_point
    by_rig, by_pixel = lines.point_moves(of_rig, pull), noise.camera_u_px * lines.point_moves(of_pixel, pull)
    by_phase = rays[:, :, None] * (pull * np.where(noise.known, noise.u_px, 0.0))[:, None, :]
    random = by_phase @ by_phase.transpose(0, 2, 1) + by_pixel @ by_pixel.transpose(0, 2, 1)
    covariance = random + by_rig @ rig.covariance @ by_rig.transpose(0, 2, 1)
    epipolar = _epipolar(rig, lines, place - seen.pixels, of_rig, noise)
    return RigPoints(points, by_rig, random, covariance, *epipolar)


def _camera_effects(rig: BoardRig, rays: Array) -> tuple[_Effects, _Effects]:
    """What the pixel's own error does, and what the camera's parameters do, the projector's left at 0."""
    looked = lens_gradient(rig.camera.values, rays)
    slope = looked.by_point[:, :, :2]
    by_pixel = np.linalg.inv(np.where(np.isfinite(slope), slope, np.eye(2)))
    of_pixel = _Effects(np.zeros((len(rays), 3, 2)), np.zeros((len(rays), 2, 2)))
    of_pixel.direction[:, :2] = by_pixel
    size = len(BOARD_RIG_NAMES)
    of_rig = _Effects(np.zeros((len(rays), 3, size)), np.zeros((len(rays), 2, size)))
    of_rig.direction[:, :2, :_LENS] = -by_pixel @ looked.by_lens
    return of_pixel, of_rig


def _epipolar(rig: BoardRig, lines: _Lines, rest: Array, of_rig: _Effects, noise: _Noise) -> tuple[Array, Array]:
    """Distance across the line on which a ray's points lie in the projector, and its u, px."""
    along = lines.along
    with np.errstate(invalid="ignore", divide="ignore"):
        across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    change = np.einsum("ni,nim->nm", across, lines.place_moves(of_rig))
    own = ((across * noise.u_px) ** 2).sum(axis=1)
    variance = np.einsum("nm,ml,nl->n", change, rig.covariance, change) + own
    both = noise.known.all(axis=1)
    found = (across * rest).sum(axis=1), np.sqrt(np.maximum(variance, 0.0))
    return np.where(both, found[0], math.nan), np.where(both, found[1], math.nan)


def outside_volume(rig: BoardRig, points: RigPoints) -> NDArray[np.bool_]:
    """Where points are too uncertain to count as inside the calibrated volume, (n,).

    The rig's own part of a point's u (root of the sum over x, y and z) is more than twice the largest one among the
    places where boards were.
    """
    return _size(points.by_rig, rig) > outside_limit_mm(rig)


def outside_limit_mm(rig: BoardRig) -> float:
    """Uncertainty of a point, by the rig's parameters, from which on it is outside, mm; infinite without a volume."""
    if not len(rig.volume_mm):
        return math.inf
    place = np.where([axis in rig.axes for axis in "uv"], rig.project(rig.volume_mm), np.nan)
    points = rig_points(rig, rig.camera.project(rig.volume_mm), place)
    return _OUTSIDE * float(np.nanmax(_size(points.by_rig, rig)))


def _size(by_rig: Array, rig: BoardRig) -> Array:
    return np.sqrt(np.einsum("nij,jk,nik->n", by_rig, rig.covariance, by_rig))
