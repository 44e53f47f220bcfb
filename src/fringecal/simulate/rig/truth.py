"""The truth about a virtual rig: scale, angles, distortion, positions and its seven numbers."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from fringecal.simulate.rig.drawn_camera import Camera, build_camera, distort, project, scales_at_centre
from fringecal.simulate.rig.drawn_projector import Projector, build_projector, phase_at, phase_gradient, rational_form
from fringecal.simulate.rig.rig_spec import RigSpec


@dataclass(frozen=True)
class Truth:
    """What commissioning a rig should find.

    Parameters
    ----------
    scale_h, scale_v
        mm/px on the plate at the image centre, along u and v.
    angle_origin_deg
        Projection angle at the plate's origin, from the normal, across the local fringe.
    apparent_angle_origin_deg
        The angle that a fringe break on a low strip shows there to this camera.
    rig_parameters
        n, n0, d of phi = (n.X + n0) / (d.X + 1); exact without projector distortion.
    camera_mm, projector_mm
        Entrance pupil and projection pupil in the plate frame; for a telecentric camera a point on
        its axis.
    distortion_at_corner_px
        Displacement by the lens at the picture's corner farthest from the principal point.
    """

    scale_h: float
    scale_v: float
    angle_origin_deg: float
    apparent_angle_origin_deg: float
    rig_parameters: tuple[float, ...]
    camera_mm: tuple[float, float, float]
    projector_mm: tuple[float, float, float]
    distortion_at_corner_px: float


def truth_of(rig: RigSpec) -> Truth:
    """Compute the truth about a rig from its own numbers.

    Examples
    --------
    >>> from fringecal.simulate.rig.rig_files import load_rig
    >>> truth = truth_of(load_rig("thesis"))
    >>> f"{truth.scale_h:.4f} mm/px, {truth.angle_origin_deg:.2f} deg"
    '0.7340 mm/px, 50.71 deg'
    """
    camera, projector = build_camera(rig.camera), build_projector(rig.projector)
    scale_h, scale_v = scales_at_centre(camera, rig.camera)
    origin = np.zeros((1, 2))
    size = np.array([rig.camera.width_px, rig.camera.height_px])
    corners = np.array([(u, v) for u in (0, size[0] - 1) for v in (0, size[1] - 1)], float)
    return Truth(
        scale_h,
        scale_v,
        float(projection_angle_deg(rig, origin)[0]),
        float(apparent_angle_deg(rig, origin)[0]),
        tuple(rational_form(projector).tolist()),
        camera.position,
        projector.position,
        float(max(lens_shift_px(camera, corner) for corner in corners)),
    )


def projection_angle_deg(rig: RigSpec, points_mm: np.ndarray) -> np.ndarray:
    """Projection angle from the plate's normal, across the local fringe, at points (x, y) of the plate.

    ``tan(angle) = -(dphi/dz) / |grad_xy phi|``: positive where phase rises toward the projector.

    Parameters
    ----------
    points_mm
        Shape (n, 2), mm.

    Returns
    -------
    angles
        Shape (n,), degrees.
    """
    gradients = _gradients(build_projector(rig.projector), points_mm)
    return np.degrees(np.arctan2(-gradients[:, 2], np.hypot(gradients[:, 0], gradients[:, 1])))


def apparent_angle_deg(rig: RigSpec, points_mm: np.ndarray) -> np.ndarray:
    """Angle that the break of a fringe shows to the camera, in the limit of a low strip.

    A pixel's ray leaves the plate point along (bx, by, 1), so phase changes along it by
    ``dphi/dz + b . grad_xy phi``: the projector's angle and the camera's own, in one.
    """
    camera, projector = build_camera(rig.camera), build_projector(rig.projector)
    gradients = _gradients(projector, points_mm)
    b = np.array([ray_slope(camera, point) for point in np.asarray(points_mm, float)])
    along_ray = gradients[:, 2] + np.sum(b * gradients[:, :2], axis=1)
    return np.degrees(np.arctan2(-along_ray, np.hypot(gradients[:, 0], gradients[:, 1])))


def lens_shift_px(camera: Camera, pixel: Iterable[float]) -> float:
    """How far the lens moves what would be imaged at `pixel` without distortion, in px."""
    ideal = (np.array(list(pixel)) - np.array(camera.centre_px)) / camera.norm_px
    return float(np.hypot(*(np.array(distort(*ideal, camera.lens)) - ideal)) * camera.norm_px)


def lens_shift_at_point_px(rig: RigSpec, point_mm: tuple[float, float]) -> float:
    """Displacement by the lens of the picture of a plate point, in px."""
    camera = build_camera(rig.camera)
    straight = camera._replace(lens=(0.0, 0.0, 0.0, 0.0, 0.0))
    point = np.array([[*point_mm, 0.0]])
    return float(np.hypot(*(project(camera, point) - project(straight, point))[0]))


def ray_slope(camera: Camera, point_mm: np.ndarray) -> tuple[float, float]:
    """Slope (bx, by) of the line of sight through a point (x, y) of the plate."""
    if camera.telecentric:
        along = [row[2] for row in camera.axes]
    else:
        along = [camera.position[0] - point_mm[0], camera.position[1] - point_mm[1], camera.position[2]]
    return along[0] / along[2], along[1] / along[2]


def plate_phase(rig: RigSpec, points_mm: np.ndarray) -> np.ndarray:
    """Unwrapped phase in rad at points of the plate frame, shape (n, 3) -> (n,)."""
    projector = build_projector(rig.projector)
    return np.array([phase_at(projector, *point) for point in np.asarray(points_mm, float)])


def _gradients(projector: Projector, points_mm: np.ndarray) -> np.ndarray:
    points = np.asarray(points_mm, float).reshape(-1, 2)
    return np.array([phase_gradient(projector, np.array([*point, 0.0])) for point in points]).reshape(-1, 3)
