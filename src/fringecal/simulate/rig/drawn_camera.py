"""The camera of a virtual rig: from pixel to ray and back, lens included."""

from typing import NamedTuple

import numpy as np

from fringecal.errors import FringecalError
from fringecal.simulate.rig.rig_spec import CameraSpec
from fringecal.simulate.tracing.compiled import compiled

type Two = tuple[float, float]
type Three = tuple[float, float, float]
type Five = tuple[float, float, float, float, float]

# Newton's steps that undo a lens, and the change, relative to the focal length, after which they are done: rounding.
NEWTON_STEPS = 30
NEWTON_DONE = 1e-14
# Rounds in which the focal length is made to give the stated scale, and the relative error after which it does.
SCALE_ROUNDS, SCALE_DONE = 50, 1e-13
DIFFERENCE_PX = 0.01  # half the length over which derivatives at the image centre are taken
UNFOLDED_PX = 1e-6  # within which a corner must come back where it was


class Camera(NamedTuple):
    """A camera ready for tracing; lengths in mm.

    `axes` has the camera's right, down and forward directions as columns, in the plate frame. Tuples
    rather than arrays: compiled code counts references to arrays, which costs more than a ray.
    Normalised coordinates are (pixel - principal point) / `norm_px`; for a telecentric lens
    `norm_mm` turns them into millimetres across the beam.
    """

    telecentric: bool
    norm_px: float
    norm_mm: float
    centre_px: Two
    lens: Five
    axes: tuple[Three, Three, Three]
    position: Three


@compiled
def distort(x: float, y: float, lens: Five) -> tuple[float, float]:
    """Brown's model in OpenCV's order k1, k2, p1, p2, k3: where the lens images direction (x, y, 1)."""
    k1, k2, p1, p2, k3 = lens[0], lens[1], lens[2], lens[3], lens[4]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    x_lens = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    y_lens = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return x_lens, y_lens


@compiled
def undistort(x_lens: float, y_lens: float, lens: Five) -> tuple[float, float]:
    """Invert `distort` by Newton's method, to about 1e-14 in normalised coordinates."""
    k1, k2, p1, p2, k3 = lens[0], lens[1], lens[2], lens[3], lens[4]
    x, y = x_lens, y_lens
    if k1 == 0 and k2 == 0 and p1 == 0 and p2 == 0 and k3 == 0:
        return x, y
    for _ in range(NEWTON_STEPS):
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
        x_now, y_now = distort(x, y, lens)
        dx, dy = x_now - x_lens, y_now - y_lens
        xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
        xy = x * y * slope + 2 * p1 * x + 2 * p2 * y
        yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
        det = xx * yy - xy * xy
        x -= (yy * dx - xy * dy) / det
        y -= (xx * dy - xy * dx) / det
        if abs(dx) + abs(dy) < NEWTON_DONE:
            break
    return x, y


@compiled
def ray(camera: Camera, u: float, v: float) -> tuple[float, float, float, float]:
    """Ray of pixel (u, v): the points (ax + bx z, ay + by z, z) of the plate frame, in mm."""
    x, y = undistort(
        (u - camera.centre_px[0]) / camera.norm_px, (v - camera.centre_px[1]) / camera.norm_px, camera.lens
    )
    r, c = camera.axes, camera.position
    if camera.telecentric:
        x, y = x * camera.norm_mm, y * camera.norm_mm
        bx, by = r[0][2] / r[2][2], r[1][2] / r[2][2]
        ox = c[0] + r[0][0] * x + r[0][1] * y
        oy = c[1] + r[1][0] * x + r[1][1] * y
        oz = c[2] + r[2][0] * x + r[2][1] * y
    else:
        dz = r[2][0] * x + r[2][1] * y + r[2][2]
        bx = (r[0][0] * x + r[0][1] * y + r[0][2]) / dz
        by = (r[1][0] * x + r[1][1] * y + r[1][2]) / dz
        ox, oy, oz = c[0], c[1], c[2]
    return ox - bx * oz, oy - by * oz, bx, by


def project(camera: Camera, points_mm: np.ndarray) -> np.ndarray:
    """Picture coordinates (u, v) of points of the plate frame, shape (n, 3) -> (n, 2)."""
    x, y, z = ((points_mm - np.array(camera.position)) @ np.array(camera.axes)).T
    depth = camera.norm_mm if camera.telecentric else z
    normalised = np.array([distort(*pair, camera.lens) for pair in zip(x / depth, y / depth, strict=True)])
    return normalised.reshape(-1, 2) * camera.norm_px + camera.centre_px


def scales_at_centre(camera: Camera, spec: CameraSpec) -> tuple[float, float]:
    """Scale on the plate along u and v at the image centre, in mm/px: lengths of dX/du and dX/dv."""
    along_u, along_v = _derivatives(camera, spec)
    return float(np.hypot(*along_u)), float(np.hypot(*along_v))


def build_camera(spec: CameraSpec) -> Camera:
    """Place the camera in the plate frame, whose origin and x axis its own picture defines."""
    if spec.kind == "telecentric":
        return _framed(_telecentric(spec), spec)
    focal_px = spec.height_mm / spec.scale_mm_per_px
    for _ in range(SCALE_ROUNDS):
        camera = _framed(_pinhole(spec, focal_px), spec)
        ratio = np.mean(scales_at_centre(camera, spec)) / spec.scale_mm_per_px
        if abs(ratio - 1) < SCALE_DONE:
            break
        focal_px *= ratio
    _refuse_folded(camera, spec)
    return camera


def _pinhole(spec: CameraSpec, focal_px: float) -> Camera:
    return Camera(False, focal_px, 1.0, _principal_point(spec), spec.distortion, *_pose(spec))


def _telecentric(spec: CameraSpec) -> Camera:
    half_px = 0.5 * float(np.hypot(spec.width_px, spec.height_px))
    camera = Camera(True, half_px, half_px, _principal_point(spec), spec.distortion, *_pose(spec))
    unit_mm = float(np.mean(scales_at_centre(camera, spec)))
    return camera._replace(norm_mm=half_px * spec.scale_mm_per_px / unit_mm)


def image_centre(spec: CameraSpec) -> Two:
    """Picture coordinates (u, v) of the image centre in px."""
    return (spec.width_px - 1) / 2, (spec.height_px - 1) / 2


def _principal_point(spec: CameraSpec) -> Two:
    (u, v), (du, dv) = image_centre(spec), spec.principal_offset_px
    return u + du, v + dv


def _pose(spec: CameraSpec) -> tuple[tuple[Three, Three, Three], Three]:
    slope = np.tan(np.radians(spec.tilt_deg))
    position = spec.height_mm * np.array([slope[0], slope[1], 1.0])
    forward = -position / np.linalg.norm(position)
    right = np.array([1.0, 0.0, 0.0]) - forward[0] * forward
    right /= np.linalg.norm(right)
    return _rows(np.column_stack([right, np.cross(forward, right), forward])), _three(position)


def _derivatives(camera: Camera, spec: CameraSpec) -> tuple[np.ndarray, np.ndarray]:
    # Central differences over 0.02 px: their error, (0.01 px)^2 times the third derivative, is
    # below 1e-10 of the scale for any lens that images the field without folding it.
    u, v = image_centre(spec)
    h = DIFFERENCE_PX
    du = np.subtract(ray(camera, u + h, v)[:2], ray(camera, u - h, v)[:2]) / (2 * h)
    dv = np.subtract(ray(camera, u, v + h)[:2], ray(camera, u, v - h)[:2]) / (2 * h)
    return du, dv


def _framed(camera: Camera, spec: CameraSpec) -> Camera:
    """Turn and move the plate frame to where the picture says it is."""
    origin = np.array([*ray(camera, *image_centre(spec))[:2], 0.0])
    along_u, _ = _derivatives(camera, spec)
    c, s = along_u / np.hypot(*along_u)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return camera._replace(
        axes=_rows(turn @ np.array(camera.axes)), position=_three(turn @ (np.array(camera.position) - origin))
    )


def _three(vector: np.ndarray) -> Three:
    x, y, z = vector.tolist()
    return x, y, z


def _rows(matrix: np.ndarray) -> tuple[Three, Three, Three]:
    return _three(matrix[0]), _three(matrix[1]), _three(matrix[2])


def _refuse_folded(camera: Camera, spec: CameraSpec) -> None:
    corners = np.array([(u, v) for u in (0, spec.width_px - 1) for v in (0, spec.height_px - 1)], float)
    seen = [ray(camera, *corner) for corner in corners]
    back = project(camera, np.array([(ax, ay, 0.0) for ax, ay, _, _ in seen]))
    if not np.allclose(back, corners, atol=UNFOLDED_PX):
        raise FringecalError(
            f"camera distortion {spec.distortion} folds the picture's corners over; "
            "use smaller coefficients or a longer focal length"
        )
