"""A raster projector and a camera of a virtual rig, seen from the flat of one capture."""

from typing import NamedTuple

import numpy as np

from fringecal.simulate.rig.drawn_camera import Camera, Five, Three, Two, distort
from fringecal.simulate.rig.raster_spec import RasterCaptureSpec, RasterRigSpec
from fringecal.simulate.tracing.compiled import compiled

FACING = np.diag([1.0, -1.0, -1.0])  # a flat that faces the camera: its x right, its y up, its z toward the camera
ALONG_X = 0.9  # cosine against x from which the projector counts as looking along it
DIAMOND_ASPECT = 0.5  # rows of a diamond raster are half a column apart


class RasterProjector(NamedTuple):
    """A raster projector ready for tracing; lengths in mm.

    `axes` has the raster's right, down and forward directions as rows, in the flat's frame.
    """

    position: Three
    axes: tuple[Three, Three, Three]
    focal_px: Two
    centre_px: Two
    lens: Five
    frame: tuple[Three, Three, Three]


@compiled
def raster_point(projector: RasterProjector, x: float, y: float, z: float) -> tuple[float, float]:
    """Column and row of the frame that light a point of the flat's frame, px, 0 at the centre of the first."""
    s, e = projector.position, projector.axes
    dx, dy, dz = x - s[0], y - s[1], z - s[2]
    depth = e[2][0] * dx + e[2][1] * dy + e[2][2] * dz
    if depth <= 0:
        return np.nan, np.nan
    p = (e[0][0] * dx + e[0][1] * dy + e[0][2] * dz) / depth
    q = (e[1][0] * dx + e[1][1] * dy + e[1][2] * dz) / depth
    p, q = distort(p, q, projector.lens)
    p, q = projector.focal_px[0] * p + projector.centre_px[0], projector.focal_px[1] * q + projector.centre_px[1]
    f = projector.frame
    over = f[2][0] * p + f[2][1] * q + f[2][2]
    return (f[0][0] * p + f[0][1] * q + f[0][2]) / over, (f[1][0] * p + f[1][1] * q + f[1][2]) / over


def flat_pose(capture: RasterCaptureSpec) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation (3, 3) and shift (3,), mm, from the flat's frame to the camera's."""
    x, y, z = np.radians(capture.turn_deg)
    turn = _about(2, z) @ _about(1, y) @ _about(0, x)
    return turn @ FACING, np.array(capture.position_mm)


def projector_pose(rig: RasterRigSpec) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation (3, 3) and shift (3,), mm, from the camera's frame to the projector's."""
    spec = rig.projector
    position = np.array(spec.position_mm)
    forward = np.array(spec.aim_mm) - position
    forward /= np.linalg.norm(forward)
    helper = np.eye(3)[int(abs(forward[0]) > ALONG_X)]
    right = helper - (helper @ forward) * forward
    right /= np.linalg.norm(right)
    level = np.stack([right, np.cross(forward, right), forward])
    rotation = _about(2, np.radians(spec.roll_deg)) @ level
    return rotation, -rotation @ position


def focal_lengths_px(rig: RasterRigSpec) -> Two:
    """Focal lengths of the projector in columns and in rows."""
    spec = rig.projector
    aspect = DIAMOND_ASPECT if spec.diamond else spec.pixel_aspect
    return spec.focal_px, spec.focal_px / aspect


def centre_px(rig: RasterRigSpec) -> Two:
    """Where the projector's axis passes its raster, px."""
    spec = rig.projector
    return spec.centre_px or ((spec.columns - 1) / 2, (spec.rows - 1) / 2)


def seen_from(rig: RasterRigSpec, capture: RasterCaptureSpec) -> tuple[Camera, RasterProjector]:
    """Build camera and projector in the frame of a capture's flat."""
    rotation, shift = flat_pose(capture)
    spec = rig.camera
    centre = (
        (spec.width_px - 1) / 2 + spec.principal_offset_px[0],
        (spec.height_px - 1) / 2 + spec.principal_offset_px[1],
    )
    axes, position = rotation.T, -rotation.T @ shift
    camera = Camera(False, spec.focal_px, 1.0, centre, spec.distortion, _rows(axes), _three(position))
    turn, moved = projector_pose(rig)
    place = rotation.T @ (-turn.T @ moved - shift)
    projector = RasterProjector(
        _three(place),
        _rows(turn @ rotation),
        focal_lengths_px(rig),
        centre_px(rig),
        rig.projector.distortion,
        _rows(np.reshape(rig.projector.frame, (3, 3))),
    )
    return camera, projector


def _about(axis: int, angle_rad: float) -> np.ndarray:
    """Rotation about one axis, right-handed."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    i, j = [k for k in range(3) if k != axis]
    turn, sign = np.eye(3), -1.0 if axis == 1 else 1.0
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -sign * s, sign * s, c
    return turn


def _three(vector: np.ndarray) -> Three:
    x, y, z = vector.tolist()
    return x, y, z


def _rows(matrix: np.ndarray) -> tuple[Three, Three, Three]:
    return _three(matrix[0]), _three(matrix[1]), _three(matrix[2])
