"""Numbers that a rig of camera and inverse camera is judged by: baseline, angles, tilts, and u where boards were."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import Lens
from fringecal.projector import BoardRig, BoardRigFit, RigPoints, outside_limit_mm, rig_points
from fringecal.report import DepthSection
from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]

_STEP = 1e-3  # of a parameter's u, over which derivatives are taken: far above rounding, far below curvature


def derived(rig: BoardRig, of: Callable[[BoardRig], float], unit: str, label: str) -> Estimate:
    """Return what follows from a rig's parameters, with its standard uncertainty to first order."""
    u = np.sqrt(np.maximum(np.diag(rig.covariance), 0.0))
    slope, value = np.zeros(len(u)), of(rig)
    for k in np.flatnonzero(u > 0):
        change = np.zeros(len(u))
        change[k] = _STEP * u[k]
        slope[k] = (of(rig.moved(change)) - of(rig.moved(-change))) / (2 * _STEP * u[k])
    return Estimate(value, math.sqrt(max(float(slope @ rig.covariance @ slope), 0.0)), unit, label, rig.dof)


def baseline(rig: BoardRig) -> Estimate:
    """Return the distance of the two centres, mm."""
    return derived(rig, lambda one: one.baseline_mm, "mm", "baseline")


def triangulation_angle(rig: BoardRig) -> Estimate:
    """Return the angle at which rays of camera and projector meet in the middle of the boards' places, deg."""
    middle = rig.volume_mm.mean(axis=0)

    def angle(one: BoardRig) -> float:
        away = middle - one.centre_mm
        return math.degrees(
            math.acos(float(middle @ away) / (float(np.linalg.norm(middle)) * float(np.linalg.norm(away))))
        )

    return derived(rig, angle, "deg", "triangulation angle")


def span_of_tilts_deg(fit: BoardRigFit) -> float:
    """Return the largest angle between the normals of two poses, deg."""
    normals = np.array([pose.rotation[:, 2] for pose in fit.poses])
    return math.degrees(math.acos(float(np.clip((normals @ normals.T).min(), -1, 1))))


_SECTION = 60  # points of a section along its depth: u changes by less than a tenth from one to the next
_BEYOND = 0.5  # of the boards' extent in depth, that a section reaches before and behind them


def depth_section(rig: BoardRig) -> DepthSection:
    """Return u of points in the plane of the camera's x and z, through the middle of the boards' places."""
    low, high = rig.volume_mm.min(axis=0), rig.volume_mm.max(axis=0)
    more = _BEYOND * (high - low)
    z = np.linspace(max(low[2] - more[2], 0.1 * low[2]), high[2] + more[2], _SECTION)
    x = np.linspace(low[0] - more[0], high[0] + more[0], _SECTION)
    grid = np.stack(np.meshgrid(x, [(low[1] + high[1]) / 2], z, indexing="ij"), axis=-1).reshape(-1, 3)
    seen, lit = rig.camera.project(grid), rig.project(grid)
    reached = _inside(seen, rig.camera) & _inside(lit, rig.projector)
    u = np.full(len(grid), np.nan)
    place = np.where([axis in rig.axes for axis in "uv"], lit[reached], np.nan)
    u[reached] = u_of_points_mm(rig_points(rig, seen[reached], place))
    edges = np.stack([_edges(rig.camera, z[-1]), (_edges(rig.projector, z[-1]) - rig.shift_mm) @ rig.rotation])
    return DepthSection(
        x, z, u.reshape(len(x), len(z)), outside_limit_mm(rig), rig.volume_mm, rig.centre_mm, edges,
        rig.baseline_mm, triangulation_angle(rig).value,
    )  # fmt: skip


def _inside(pixels: Array, lens: Lens) -> NDArray[np.bool_]:
    return ((pixels > -0.5) & (pixels < np.array([lens.width_px, lens.height_px]) - 0.5)).all(axis=1)


def _edges(lens: Lens, depth_mm: float) -> Array:
    """Ends of the rays at the left and right edge of a picture, in the middle of its height, (2, 3)."""
    middle = (lens.height_px - 1) / 2
    rays = lens.unproject(np.array([[0.0, middle], [lens.width_px - 1.0, middle]]))
    return np.asarray(rays / rays[:, 2:] * depth_mm)


def points_of_boards(rig: BoardRig) -> RigPoints:
    """Measure the places where boards were with the rig itself, without noise of their own."""
    place = rig.project(rig.volume_mm)
    for k, axis in enumerate("uv"):
        if axis not in rig.axes:
            place[:, k] = np.nan
    return rig_points(rig, rig.camera.project(rig.volume_mm), place)


def u_of_points_mm(points: RigPoints) -> Array:
    """Return the root of the sum of the variances of x, y and z, mm, (n,)."""
    return np.sqrt(np.einsum("nii->n", points.covariance_mm2))
