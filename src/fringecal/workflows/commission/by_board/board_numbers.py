"""Numbers that a rig of camera and inverse camera is judged by: baseline, angles, tilts, and u where boards were."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fringecal.projector import BoardRig, BoardRigFit, RigPoints, rig_points
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
