"""From points in the camera's frame to heights over a plate that the same rig has measured."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import NearestNDInterpolator

from fringecal.errors import FitError
from fringecal.numerics import robust_sd
from fringecal.projector import BoardRig, rig_points
from fringecal.reconstruct.volume.volume_map import VolumeMap

Array = NDArray[np.float64]

_SAMPLE = 4000  # pixels of the plate that its plane is fitted to: three numbers are known to a sixtieth of the noise
_NODES = 1500  # pixels at which u is computed: it changes by a percent from one to the next
_CUT = 4.0  # robust standard deviations from the plane beyond which a point is dust or beside the plate
_ROUNDS = 4
_LEAST = 200  # points of a plane: fewer are a speck of it


@dataclass(frozen=True)
class PlateFrame:
    """The plate's frame in the camera's: z = 0 on the plate, z toward the camera, x along the picture's columns.

    Parameters
    ----------
    rotation
        (3, 3), rows are its axes in the camera's frame.
    origin_mm
        (3,), the plate point under the image centre.
    by_rig
        (3, 24): change of the plane's height, slope along x and slope along y by the rig's parameters.
    scatter_mm
        Robust standard deviation of the plate's points about their plane.
    """

    rotation: Array
    origin_mm: Array
    by_rig: Array
    scatter_mm: float

    def points(self, camera_mm: Array) -> Array:
        """Points (..., 3) of the camera's frame in the plate's."""
        return np.asarray((camera_mm - self.origin_mm) @ self.rotation.T)


@dataclass(frozen=True)
class PlateHeights:
    """Heights over a plate: maps (H, W), mm in the plate's frame, NaN where masked; `u_z` is combined."""

    x: Array
    y: Array
    z: Array
    u_z: Array
    mask: NDArray[np.bool_]


def plate_frame(rig: BoardRig, volume: VolumeMap, place_px: Array) -> PlateFrame:
    """Fit a plane to a measured plate, and put the plate's frame on it.

    Parameters
    ----------
    rig
        The calibration.
    volume
        Points of the plate.
    place_px
        The projector's coordinates that they come from, (2, H, W), px, NaN where not known.

    Raises
    ------
    FitError
        Too little of a plate is measured, or it is seen edge on.
    """
    rows, columns = _some(volume.mask, _SAMPLE)
    if rows.size < _LEAST:
        raise FitError(
            f"{rows.size} points of the bare plate are measured, {_LEAST} are needed; show more of it under the fringes"
        )
    points = np.stack([m[rows, columns] for m in (volume.x, volume.y, volume.z)], axis=1).astype(np.float64)
    normal, offset, near = _plane(points)
    rotation, origin = _axes(rig, normal, offset)
    seen = rig_points(
        rig, np.stack([columns, rows], axis=1).astype(np.float64)[near], place_px[:, rows, columns].T[near]
    )
    flat = (points[near] - origin) @ rotation.T
    terms = np.column_stack([np.ones(len(flat)), flat[:, :2]])
    by_rig = np.linalg.pinv(terms) @ np.einsum("i,nij->nj", rotation[2], seen.by_rig)
    return PlateFrame(rotation, origin, by_rig, robust_sd((points - origin) @ rotation[2]))


def heights_over(
    rig: BoardRig, frame: PlateFrame, volume: VolumeMap, place_px: Array, u_px: tuple[float, float]
) -> PlateHeights:
    """Return a measured surface in the plate's frame, with the u of its heights.

    Parameters
    ----------
    rig, frame
        The calibration, and where the plate is.
    volume, place_px
        Points of the surface, and the projector's coordinates that they come from, (2, H, W).
    u_px
        Standard uncertainty of each coordinate by its phase, px.

    Notes
    -----
    What the rig's error does to plate and surface alike falls out of a height: its change by each parameter is that of
    the point along the normal, less that of the plate's plane there.
    """
    points = frame.points(np.stack([volume.x, volume.y, volume.z], axis=-1).astype(np.float64))
    rows, columns = _some(volume.mask, _NODES)
    if not rows.size:
        raise FitError("no pixel of the capture has a point inside the calibrated volume")
    seen = rig_points(
        rig,
        np.stack([columns, rows], axis=1).astype(np.float64),
        place_px[:, rows, columns].T,
        projector_u_px=np.array(u_px)[None, :].repeat(rows.size, axis=0),
    )
    flat = points[rows, columns]
    terms = np.column_stack([np.ones(len(flat)), flat[:, :2]])
    by_rig = np.einsum("i,nij->nj", frame.rotation[2], seen.by_rig) - terms @ frame.by_rig
    common = np.einsum("ni,ij,nj->n", by_rig, rig.covariance, by_rig)
    own = np.einsum("i,nij,j->n", frame.rotation[2], seen.random_mm2, frame.rotation[2])
    known = np.isfinite(common + own)
    if not known.any():
        raise FitError("no pixel of the capture has a point that the calibration states the uncertainty of")
    nodes = np.column_stack([rows, columns])[known]
    u = NearestNDInterpolator(nodes, np.sqrt(np.maximum(common + own, 0.0))[known])
    grid = np.indices(volume.mask.shape)
    masked = np.where(volume.mask, 1.0, np.nan)
    x, y, z = (points[..., k] * masked for k in range(3))
    return PlateHeights(x, y, z, u(*grid) * masked, volume.mask)


def _some(mask: NDArray[np.bool_], most: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of at most so many of the valid pixels, evenly."""
    step = max(1, math.ceil(math.sqrt(mask.sum() / most)))
    rows, columns = np.nonzero(mask[::step, ::step])
    return rows * step, columns * step


def _plane(points: Array) -> tuple[Array, float, NDArray[np.bool_]]:
    """Fit n X = d by total least squares to most points; n points to the camera."""
    near = np.ones(len(points), dtype=np.bool_)
    for _ in range(_ROUNDS):
        middle = points[near].mean(axis=0)
        normal = np.linalg.svd(points[near] - middle, full_matrices=False)[2][2]
        off = (points - middle) @ normal
        near = np.abs(off) < _CUT * max(robust_sd(off[near], about=0), 1e-9)
    normal = -normal * np.sign(normal @ middle)
    return normal, float(normal @ middle), near


def _axes(rig: BoardRig, normal: Array, offset: float) -> tuple[Array, Array]:
    """Return the plate's axes and origin as its frame is defined: under the image centre, x along the columns."""
    centre = np.array([(rig.camera.width_px - 1) / 2, (rig.camera.height_px - 1) / 2])
    rays = rig.camera.unproject(np.stack([centre, centre + (0.5, 0.0), centre - (0.5, 0.0)]))
    rays = np.column_stack([rays, np.ones(3)]) if rays.shape[1] == 2 else rays
    slope = rays @ normal
    if (slope >= 0).any():
        raise FitError("the plate is seen from behind or edge on; lay it before the camera")
    on_plate = rays * (offset / slope)[:, None]
    x = on_plate[1] - on_plate[2]
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal]), on_plate[0]
