"""From maps of the projector's coordinates to points with their uncertainty, and what lies outside the volume."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import DTypeLike, NDArray

from fringecal.camera import Lens
from fringecal.errors import FitError
from fringecal.numerics import over_bands
from fringecal.projector import BoardRig, outside_limit_mm, rig_points
from fringecal.reconstruct.height_map import Reason
from fringecal.reconstruct.volume.volume_kernels import VolumeMaps, VolumeRig, VolumeUncertainty, points_in_rows

Array = NDArray[np.float64]
Map = NDArray[Any]

_DEGREES = (3, 7, 11, 15)  # of rays along a row, tried in turn
_RAY_TOLERANCE = 1e-8  # of a ray's slope: 0.01 um at a metre
_AROUND = 0.5  # of the boards' range of depth, on either side: beyond, no board says anything of a point
_NODES = (
    5,
    15,
    15,
)  # in depth, down and across the picture: a lens moves rays by up to the 7th power, so variances by the 14th
_DEPTH_STEP = 1e-3  # of the depth: far above rounding, far below the volume
_LEAST_U_PX = 1e-9  # so that exact coordinates can be weighed against one another
_EPIPOLAR_SIGMAS = 6.0  # across the epipolar line: of ten million pixels none is there by its noise


@dataclass(frozen=True)
class VolumeMap:
    """Points of all pixels in the camera's frame: x right, y down, z forward, mm; NaN where masked.

    Parameters
    ----------
    x, y, z
        Coordinates, (H, W).
    u_x, u_y, u_z
        Combined standard uncertainty of each, mm.
    reasons
        `Reason` bits, 0 where valid: `NO_PHASE` where a coordinate is NaN, `ORDER_UNDECIDED` where the second axis
        contradicts the first, `NO_RAY` where the rays do not meet before the rig, `OUT_OF_RANGE` outside the volume.
    """

    x: Map
    y: Map
    z: Map
    u_x: Map
    u_y: Map
    u_z: Map
    reasons: NDArray[np.uint8]

    @property
    def mask(self) -> NDArray[np.bool_]:
        """True where a point is valid."""
        return self.reasons == 0


def volume_points(
    rig: BoardRig,
    column_px: Map | None = None,
    row_px: Map | None = None,
    *,
    u_px: float | tuple[float, float] = 0.0,
    dtype: DTypeLike = np.float32,
    allocate: Callable[[tuple[int, ...], DTypeLike], Map] = np.empty,
) -> VolumeMap:
    """Triangulate every pixel.

    Parameters
    ----------
    rig
        The calibration.
    column_px, row_px
        The projector's coordinates at every pixel of the camera, (H, W), px, NaN where unknown: one of them or both.
    u_px
        Standard uncertainty of a pixel's coordinate by its phase, px: one number, or one for each.
    dtype
        Of the maps.
    allocate
        Makes the maps, 25 bytes a pixel in float32; may return `np.memmap`s.

    Raises
    ------
    FitError
        No coordinate, maps of another size than the camera's picture, or a lens that folds inside the picture.

    Notes
    -----
    The systematic part is sampled by `rig_points` over picture and depth and kept as a polynomial.
    """
    places, swapped = _places(rig, column_px, row_px)
    u = np.broadcast_to(np.asarray(u_px, float), (2,))
    shape = places[0].shape
    x, y, z, u_x, u_y, u_z = (allocate(shape, dtype) for _ in range(6))
    maps = VolumeMaps(x, y, z, u_x, u_y, u_z, np.zeros(shape, np.uint8))
    axes = (True, True) if len(places) == 2 else (not swapped, swapped)
    over_bands(points_in_rows, shape[0], places, _volume_rig(rig, swapped), _uncertainty(rig, axes, u), maps)
    return VolumeMap(*maps)


def _places(rig: BoardRig, column: Map | None, row: Map | None) -> tuple[tuple[Map, ...], bool]:
    """Maps that are given, and whether the rows stand alone."""
    places = tuple(np.ascontiguousarray(each) for each in (column, row) if each is not None)
    wanted = (rig.camera.height_px, rig.camera.width_px)
    if not places or any(each.shape != wanted for each in places):
        raise FitError(f"maps of the shapes {[each.shape for each in places]}; one or two of {wanted} are needed")
    return places, column is None


def _volume_rig(rig: BoardRig, swapped: bool) -> VolumeRig:
    """Return the rig as arrays; where rows alone are known, the projector's axes change places."""
    order, lens = ([1, 0, 2], [1, 0, 3, 2, 4, 5, 7, 6, 8]) if swapped else ([0, 1, 2], list(range(9)))
    return VolumeRig(
        ray_rows(rig.camera),
        np.linspace(-1.0, 1.0, rig.camera.width_px),
        np.ascontiguousarray(rig.rotation[order]),
        np.ascontiguousarray(rig.shift_mm[order]),
        np.ascontiguousarray(rig.projector.values[lens]),
    )


def ray_rows(lens: Lens) -> Array:
    """Coefficients (H, 2, degree + 1) of the slopes x / z and y / z of a camera's rays along every row.

    Powers of the position from -1 to 1; the degree grows until the rays between the nodes are met.

    Raises
    ------
    FitError
        The lens folds inside the picture, or no polynomial of degree 15 follows it.
    """
    for degree in _DEGREES:
        nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        between = np.cos(np.pi * np.arange(degree + 2) / (degree + 1))
        series = np.linalg.inv(chebyshev.chebvander(nodes, degree))
        rows = np.moveaxis(_slopes(lens, nodes), 1, 2) @ (_powers(degree) @ series).T
        exact = np.moveaxis(_slopes(lens, between), 1, 2)
        if np.abs(rows @ np.vander(between, degree + 1, increasing=True).T - exact).max() < _RAY_TOLERANCE:
            return np.ascontiguousarray(rows)
    raise FitError("the camera's distortion folds inside the picture: no ray belongs to some pixels; calibrate it anew")


def _slopes(lens: Lens, t: Array) -> Array:
    """Slopes (H, positions, 2) of the rays at positions along every row."""
    u, v = np.meshgrid((t + 1) / 2 * (lens.width_px - 1), np.arange(lens.height_px))
    return lens.unproject(np.column_stack([u.ravel(), v.ravel()]))[:, :2].reshape(*u.shape, 2)


def _powers(degree: int) -> Array:
    """Matrix that turns Chebyshev coefficients into those of powers."""
    return np.stack([np.pad(p := chebyshev.cheb2poly(e), (0, degree + 1 - len(p))) for e in np.eye(degree + 1)], axis=1)


def _uncertainty(rig: BoardRig, axes: tuple[bool, bool], u_px: Array) -> VolumeUncertainty:
    """Return systematic variances and limits as arrays; `axes` says which coordinates are known."""
    middle, half = _depth_range(rig)
    variance, epipolar_u = _sampled(rig, axes, u_px, middle + half * _nodes(_NODES[0]))
    by_powers = variance
    for axis, count in enumerate(_NODES):
        to_powers = _powers(count - 1) @ np.linalg.inv(chebyshev.chebvander(_nodes(count), count - 1))
        by_powers = np.moveaxis(np.tensordot(to_powers, by_powers, axes=(1, axis + 1)), 0, axis + 1)
    rows = np.vander(np.linspace(-1, 1, rig.camera.height_px), _NODES[1], increasing=True)
    flags = np.array([Reason.NO_PHASE, Reason.ORDER_UNDECIDED, Reason.NO_RAY, Reason.OUT_OF_RANGE], np.uint8)
    return VolumeUncertainty(
        np.ascontiguousarray(np.einsum("hb,apbq->ahpq", rows, by_powers)),
        middle,
        half,
        outside_limit_mm(rig) ** 2,
        np.maximum(u_px if axes[0] else u_px[::-1], _LEAST_U_PX),
        _EPIPOLAR_SIGMAS * epipolar_u if all(axes) else math.inf,
        flags,
    )


def _nodes(count: int) -> Array:
    return np.cos(np.pi * (np.arange(count) + 0.5) / count)


def _depth_range(rig: BoardRig) -> tuple[float, float]:
    """Middle and half of the depths between which points are sampled: where boards were, and somewhat around."""
    if not len(rig.volume_mm):
        return 0.55 * rig.baseline_mm * 10, 0.45 * rig.baseline_mm * 10
    low, high = rig.volume_mm[:, 2].min(), rig.volume_mm[:, 2].max()
    half = max(float(high - low), 0.02 * float(high)) * (0.5 + _AROUND)
    middle = float(high + low) / 2
    return middle, min(half, 0.9 * middle)


def _sampled(rig: BoardRig, axes: tuple[bool, bool], u_px: Array, depths: Array) -> tuple[Array, float]:
    """Systematic variances (3, depths, down, across) at the nodes, mm^2, and the largest u across the line, px."""
    down, across = ((size - 1) / 2 * (1 + _nodes(n)) for size, n in
                    zip((rig.camera.height_px, rig.camera.width_px), _NODES[1:], strict=True))  # fmt: skip
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = rig.camera.unproject(pixels)
    points = (depths[:, None, None] * rays).reshape(-1, 3)
    places = np.where(axes, rig.project(points), np.nan)
    found = rig_points(rig, np.tile(pixels, (len(depths), 1)), places, projector_u_px=u_px[None])
    systematic = found.covariance_mm2 - found.random_mm2
    _demand_depth(rig, points, np.array(axes))
    variance = np.nan_to_num(np.einsum("nii->in", systematic)).reshape(3, *_NODES)
    return variance, float(np.nanmax(found.epipolar_u_px, initial=0.0))


def _demand_depth(rig: BoardRig, points: Array, axes: NDArray[np.bool_]) -> None:
    """Refuse a coordinate that a point's depth does not move: its fringes run along the epipolar lines."""
    moves = (rig.project((1 + _DEPTH_STEP) * points) - rig.project(points))[:, axes]
    if moves.shape[1] == 1 and not (np.all(moves > 0) or np.all(moves < 0)):
        raise FitError(
            "the projector's coordinate does not change with the depth somewhere in the picture: its fringes run along "
            "the line from camera to projector; project fringes across it"
        )


__all__ = ["VolumeMap", "ray_rows", "volume_points"]
