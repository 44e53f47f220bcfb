"""The camera seen from the plate: every pixel is a straight ray `X(z) = a + b z` in plate millimetres.

The plate frame is made by the camera itself: its origin is the plate point under the image centre, x runs
along +u there, y up in the picture, z toward the camera.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]

#: Parameters of the camera, in the order of every vector and covariance.
CAMERA_NAMES = (
    "scale_mm_per_px",  # plate millimetres per pixel on the principal ray, across the optical axis
    "aspect",  # scale along v over scale along u: 1 for square pixels
    "tilt_x_rad",  # the optical axis is tilted from the plate's normal toward +x ...
    "tilt_y_rad",  # ... and toward +y
    "k1",  # Brown's distortion in normalised coordinates, as in OpenCV
    "k2",
    "p1",
    "p2",
    "k3",
    "cu_px",  # principal point minus image centre
    "cv_px",
    "height_mm",  # entrance pupil above the plate; no meaning for a telecentric lens
)
_NEWTON_STEPS = 8  # at most; each doubles the number of right digits
_NEWTON_DONE = 1e-15  # of the length by which coordinates are normalised
_FOLD = 1e-3  # slope of the seen radius over the ideal one, below which the polynomial folds and no ray is seen
_STEP_U = 0.1  # of a derivative, in standard uncertainties of the parameter: within what is linear
#: Least steps of derivatives, in the order and units of `CAMERA_NAMES`: each moves a crossing by 0.001 px or less.
_LEAST_STEPS = np.array([1e-7, 1e-7, 1e-7, 1e-7, 1e-6, 1e-6, 1e-8, 1e-8, 1e-6, 1e-4, 1e-4, 1e-3])


@dataclass(frozen=True)
class Rays:
    """Straight lines `x = ax + bx z`, `y = ay + by z` in the plate frame; a in mm, b in mm per mm."""

    ax: Array
    ay: Array
    bx: Array
    by: Array

    def at(self, z_mm: ArrayLike) -> tuple[Array, Array]:
        """Return x and y in mm where the rays pass the height `z_mm`."""
        z = np.asarray(z_mm, dtype=float)
        return self.ax + self.bx * z, self.ay + self.by * z


@dataclass(frozen=True)
class PlateCamera:
    """A pinhole or telecentric camera posed on the plate, with the covariance of what is known of it.

    Parameters
    ----------
    parameters
        Values in the order of `CAMERA_NAMES`.
    covariance
        Their covariance; rows of parameters that are taken as exact are zero.
    width_px, height_px
        Size of the picture.
    telecentric
        True when all rays are parallel; Brown's radius is then normalised by the half diagonal in px.
    """

    parameters: Array
    covariance: Array
    width_px: int
    height_px: int
    telecentric: bool = False

    @classmethod
    def from_values(
        cls, values: Mapping[str, float], shape: tuple[int, int], *, telecentric: bool = False
    ) -> "PlateCamera":
        """Make an exactly known camera from named values; what is not named is 0 (aspect 1)."""
        unknown = set(values) - set(CAMERA_NAMES)
        if unknown:
            raise KeyError(f"no camera parameter is called {sorted(unknown)}; known: {CAMERA_NAMES}")
        defaults = dict.fromkeys(CAMERA_NAMES, 0.0) | {"aspect": 1.0} | dict(values)
        parameters = np.array([defaults[name] for name in CAMERA_NAMES])
        size = len(CAMERA_NAMES)
        return cls(parameters, np.zeros((size, size)), shape[1], shape[0], telecentric)

    def __getitem__(self, name: str) -> float:
        """Return one parameter by name."""
        return float(self.parameters[CAMERA_NAMES.index(name)])

    def replaced(self, parameters: Array, covariance: Array | None = None) -> "PlateCamera":
        """Return the same camera with other parameter values."""
        return replace(
            self,
            parameters=np.asarray(parameters, dtype=float),
            covariance=self.covariance if covariance is None else covariance,
        )

    @property
    def centre_px(self) -> tuple[float, float]:
        """Image centre (u, v) in px, the point that sees the plate frame's origin."""
        return (self.width_px - 1) / 2, (self.height_px - 1) / 2

    @property
    def focal_px(self) -> float:
        """Length in px by which image coordinates are normalised: focal length, or half diagonal."""
        if self.telecentric:
            return math.hypot(self.width_px, self.height_px) / 2
        return self["height_mm"] / _axis(self)[2] / self["scale_mm_per_px"]

    @property
    def position_mm(self) -> Array:
        """Entrance pupil (x, y, z) in mm; the unit vector to the camera when telecentric."""
        if self.telecentric:
            return _rotated(_axis(self)[None, :], *_frame_shift(self)[2:])[0]
        x0, y0, cosine, sine = _frame_shift(self)
        centre = _axis(self) * self["height_mm"] / _axis(self)[2] - np.array([x0, y0, 0.0])
        return _rotated(centre[None, :], cosine, sine)[0]

    @property
    def rotation(self) -> Array:
        """Rotation from the plate frame to the camera's (x right, y down, z forward), shape (3, 3)."""
        right, up, toward = (_rotated(a[None, :], *_frame_shift(self)[2:])[0] for a in _image_axes(self))
        return np.vstack([right, -up, -toward])

    def rays(self, u_px: ArrayLike, v_px: ArrayLike) -> Rays:
        """Return the rays of pixels; u and v broadcast."""
        ax, ay, bx, by = _principal_rays(self, *np.broadcast_arrays(np.asarray(u_px, float), v_px))
        x0, y0, cosine, sine = _frame_shift(self)
        ax, ay = cosine * (ax - x0) + sine * (ay - y0), cosine * (ay - y0) - sine * (ax - x0)
        return Rays(ax, ay, cosine * bx + sine * by, cosine * by - sine * bx)

    def pixel_rays(self) -> Rays:
        """Return the rays of all pixels as maps of the image's shape."""
        return self.rays(*np.meshgrid(np.arange(self.width_px), np.arange(self.height_px)))

    def project(self, x_mm: ArrayLike, y_mm: ArrayLike, z_mm: ArrayLike = 0.0) -> tuple[Array, Array]:
        """Return the pixel (u, v) at which a point of the plate frame is seen."""
        x0, y0, cosine, sine = _frame_shift(self)
        x, y, z = (np.asarray(c, dtype=float) for c in (x_mm, y_mm, z_mm))
        return _project_principal(self, cosine * x - sine * y + x0, sine * x + cosine * y + y0, z)

    def scale(self, direction: str) -> Estimate:
        """Return the scale in mm/px on the plate at the image centre.

        Parameters
        ----------
        direction
            ``"horizontal"`` along u, ``"vertical"`` along v, or ``"mean"`` of the two.
        """
        value, gradient = self._differentiated(lambda camera: local_scale(camera, direction))
        return Estimate(value, math.sqrt(gradient @ self.covariance @ gradient), "mm/px", f"scale, {direction}")

    def _differentiated(self, function) -> tuple[float, Array]:  # type: ignore[no-untyped-def]
        base = function(self)
        steps = parameter_steps(self)
        gradient = np.zeros(len(CAMERA_NAMES))
        for i in np.flatnonzero(np.diag(self.covariance) > 0):
            shifted = self.parameters.copy()
            shifted[i] += steps[i]
            gradient[i] = (function(self.replaced(shifted)) - base) / steps[i]
        return base, gradient


def parameter_steps(camera: PlateCamera) -> Array:
    """Return steps for numeric derivatives: each parameter's standard uncertainty, or a small floor."""
    return np.maximum(_STEP_U * np.sqrt(np.diag(camera.covariance)), _LEAST_STEPS)


def _axis(camera: PlateCamera) -> Array:
    """Unit vector from the plate to the camera along the optical axis."""
    vector = np.array([math.tan(camera["tilt_x_rad"]), math.tan(camera["tilt_y_rad"]), 1.0])
    return vector / np.linalg.norm(vector)


def _image_axes(camera: PlateCamera) -> tuple[Array, Array, Array]:
    """Return unit vectors right, up and toward the camera, with `right` seen along +x on the plate."""
    toward = _axis(camera)
    right = np.array([1.0, 0.0, 0.0]) - toward[0] * toward
    right /= np.linalg.norm(right)
    return right, np.cross(toward, right), toward


def _principal_rays(camera: PlateCamera, u: Array, v: Array) -> tuple[Array, Array, Array, Array]:
    """Rays in the frame whose origin is where the optical axis meets the plate."""
    xn, yn = undistort(camera, u, v)
    right, up, toward = _image_axes(camera)
    if camera.telecentric:
        unit = camera.focal_px * camera["scale_mm_per_px"]
        point = [unit * (xn * right[i] - yn * up[i]) for i in range(3)]
        bx, by = toward[0] / toward[2], toward[1] / toward[2]
        ones = np.ones_like(xn)
        return point[0] - bx * point[2], point[1] - by * point[2], bx * ones, by * ones
    height = camera["height_mm"]
    direction = [xn * right[i] - yn * up[i] - toward[i] for i in range(3)]
    bx, by = direction[0] / direction[2], direction[1] / direction[2]
    x_centre, y_centre = toward[:2] * height / toward[2]
    return x_centre - bx * height, y_centre - by * height, bx, by


def _project_principal(camera: PlateCamera, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    right, up, toward = _image_axes(camera)
    if camera.telecentric:
        unit = camera.focal_px * camera["scale_mm_per_px"]
        xn = (x * right[0] + y * right[1] + z * right[2]) / unit
        yn = -(x * up[0] + y * up[1] + z * up[2]) / unit
    else:
        centre = toward * camera["height_mm"] / toward[2]
        dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
        depth = -(dx * toward[0] + dy * toward[1] + dz * toward[2])
        xn = (dx * right[0] + dy * right[1] + dz * right[2]) / depth
        yn = -(dx * up[0] + dy * up[1] + dz * up[2]) / depth
    xd, yd = _distort(camera, xn, yn)
    u0, v0 = camera.centre_px
    focal = camera.focal_px
    return u0 + camera["cu_px"] + focal * xd, v0 + camera["cv_px"] + focal / camera["aspect"] * yd


def _distort(camera: PlateCamera, xn: Array, yn: Array) -> tuple[Array, Array]:
    """Brown's model, OpenCV's order of terms."""
    k1, k2, p1, p2, k3 = camera.parameters[4:9]
    r2 = xn * xn + yn * yn
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = xn * radial + 2 * p1 * xn * yn + p2 * (r2 + 2 * xn * xn)
    yd = yn * radial + p1 * (r2 + 2 * yn * yn) + 2 * p2 * xn * yn
    return xd, yd


def undistort(camera: PlateCamera, u: Array, v: Array) -> tuple[Array, Array]:
    """Return normalised, undistorted image coordinates of pixels.

    Newton's method on the radius, the small tangential terms by substitution; pixels beyond the fold of
    the radial polynomial come back as NaN, because no ray of the model reaches them.
    """
    u0, v0 = camera.centre_px
    xd = (u - u0 - camera["cu_px"]) / camera.focal_px
    yd = (v - v0 - camera["cv_px"]) * camera["aspect"] / camera.focal_px
    k1, k2, p1, p2, k3 = camera.parameters[4:9]
    if not np.any(camera.parameters[4:9]):
        return xd, yd
    xn, yn = _undistort_radial(xd, yd, k1, k2, k3)
    if p1 or p2:
        for _ in range(_NEWTON_STEPS):
            r2 = xn * xn + yn * yn
            tx = 2 * p1 * xn * yn + p2 * (r2 + 2 * xn * xn)
            ty = p1 * (r2 + 2 * yn * yn) + 2 * p2 * xn * yn
            xn, yn = _undistort_radial(xd - tx, yd - ty, k1, k2, k3)
    return xn, yn


def _undistort_radial(xd: Array, yd: Array, k1: float, k2: float, k3: float) -> tuple[Array, Array]:
    rd = np.hypot(xd, yd)
    r = rd.copy()
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            r2 = r * r
            value = r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) - rd
            slope = 1 + r2 * (3 * k1 + r2 * (5 * k2 + 7 * r2 * k3))
            step = value / np.where(slope > _FOLD, slope, np.nan)
            r = r - step
            if not np.any(np.abs(step) > _NEWTON_DONE):
                break
        ratio = np.where(rd > 0, r / rd, 1.0)
    return xd * ratio, yd * ratio


def _frame_shift(camera: PlateCamera) -> tuple[float, float, float, float]:
    """Return origin and turn (x0, y0, cos, sin) of the plate frame in the frame of the principal ray."""
    if not (camera["cu_px"] or camera["cv_px"] or camera["p1"] or camera["p2"]):
        return 0.0, 0.0, 1.0, 0.0
    u0, v0 = camera.centre_px
    ax, ay, _, _ = _principal_rays(camera, np.array([u0, u0 + 0.5, u0 - 0.5]), np.full(3, v0))
    dx, dy = ax[1] - ax[2], ay[1] - ay[2]
    length = math.hypot(dx, dy)
    return float(ax[0]), float(ay[0]), dx / length, dy / length


def _rotated(points: Array, cosine: float, sine: float) -> Array:
    x, y = points[:, 0], points[:, 1]
    return np.column_stack([cosine * x + sine * y, cosine * y - sine * x, points[:, 2]])


def local_scale(camera: PlateCamera, direction: str) -> float:
    """Return the value of `PlateCamera.scale` alone, mm/px, without its uncertainty.

    Examples
    --------
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, (480, 640))
    >>> round(local_scale(camera, "mean"), 6)
    0.8
    """
    u0, v0 = camera.centre_px
    rays = camera.rays(np.array([u0 + 0.5, u0 - 0.5, u0, u0]), np.array([v0, v0, v0 + 0.5, v0 - 0.5]))
    horizontal = math.hypot(rays.ax[0] - rays.ax[1], rays.ay[0] - rays.ay[1])
    vertical = math.hypot(rays.ax[2] - rays.ax[3], rays.ay[2] - rays.ay[3])
    return {"horizontal": horizontal, "vertical": vertical, "mean": (horizontal + vertical) / 2}[direction]
