"""A lens without its pose: focal length, principal point and Brown's distortion, with their covariance."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fringecal.uncertainty.estimates import Estimate

Array = NDArray[np.float64]

#: Parameters in the order of every vector and covariance; OpenCV's and mrcal's OPENCV5.
LENS_NAMES = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
_UNITS = ("px", "px", "px", "px", "", "", "", "", "")
_STEPS = np.array([1e-2, 1e-2, 1e-2, 1e-2, 1e-5, 1e-5, 1e-6, 1e-6, 1e-5])
_MAP_POINTS = 24
_UNPROJECT_STEPS = 30


@dataclass(frozen=True)
class Lens:
    """A pinhole with Brown's distortion.

    Parameters
    ----------
    values
        In the order of `LENS_NAMES`.
    covariance
        Of the values; rows of what is taken as exact are zero.
    width_px, height_px
        Size of the picture.
    covariance_known
        False when the values come from a file that states no uncertainty.
    """

    values: Array
    covariance: Array
    width_px: int
    height_px: int
    covariance_known: bool = True

    def __getitem__(self, name: str) -> float:
        """Return one parameter by name."""
        return float(self.values[LENS_NAMES.index(name)])

    def estimate(self, name: str) -> Estimate:
        """Return one parameter with its standard uncertainty."""
        i = LENS_NAMES.index(name)
        return Estimate(float(self.values[i]), math.sqrt(self.covariance[i, i]), _UNITS[i], name)

    def project(self, rays: Array) -> Array:
        """Pixels (n, 2) of directions (n, 3) in the camera's frame: x right, y down, z forward.

        Examples
        --------
        >>> lens = Lens(np.array([800.0, 800, 320, 240, -0.1, 0, 0, 0, 0]), np.zeros((9, 9)), 641, 481)
        >>> lens.project(np.array([[0.1, 0.0, 1.0]])).round(3).tolist()
        [[399.92, 240.0]]
        """
        return project(self.values, rays)

    def unproject(self, pixels: Array) -> Array:
        """Directions (n, 3), z = 1, in which pixels (n, 2) look; the inverse of `project` by iteration."""
        fx, fy, cx, cy = self.values[:4]
        seen = (pixels - [cx, cy]) / [fx, fy]
        ideal = seen.copy()
        for _ in range(_UNPROJECT_STEPS):
            ideal += seen - _distorted(self.values, ideal)
        return np.column_stack([ideal, np.ones(len(ideal))])

    def pixels(self) -> Array:
        """Pixels (n, 2) spread evenly over the picture."""
        u = np.linspace(0, self.width_px - 1, _MAP_POINTS)
        v = np.linspace(0, self.height_px - 1, round(_MAP_POINTS * self.height_px / self.width_px))
        return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def project(values: Array, rays: Array) -> Array:
    """Pixels (n, 2) of directions (n, 3) by a vector of lens parameters."""
    fx, fy, cx, cy = values[:4]
    return _distorted(values, rays[:, :2] / rays[:, 2:]) * [fx, fy] + [cx, cy]


def _distorted(values: Array, ideal: Array) -> Array:
    k1, k2, p1, p2, k3 = values[4:]
    x, y = ideal.T
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.column_stack([xd, yd])


def projection_uncertainty_px(lens: Lens, pixels: Array | None = None) -> Array:
    """Standard uncertainty of where a far point is seen, in the worse direction, px, (n,).

    `projection_covariance_px` says how.
    """
    return np.sqrt(np.maximum(np.linalg.eigvalsh(projection_covariance_px(lens, pixels))[:, -1], 0.0))


def projection_covariance_px(lens: Lens, pixels: Array | None = None) -> Array:
    """Covariance (n, 2, 2) of where a far point is seen, px^2.

    Parameters
    ----------
    lens
        The lens with its covariance.
    pixels
        Places (n, 2); all over the picture if left out.

    Notes
    -----
    A small turn of the whole camera looks like a shifted principal point and is no error of the lens: of
    every change of the parameters, the turn that fits it best over the picture is taken out first (as
    mrcal's projection uncertainty at infinity does).
    """
    everywhere = lens.pixels()
    pixels = everywhere if pixels is None else pixels
    absorbed = np.linalg.pinv(_turn_gradient(lens, everywhere).reshape(-1, 3))
    turn_of = absorbed @ _lens_gradient(lens, everywhere).reshape(-1, len(LENS_NAMES))
    gradient = _lens_gradient(lens, pixels) - _turn_gradient(lens, pixels) @ turn_of
    covariance: Array = gradient @ lens.covariance @ gradient.transpose(0, 2, 1)
    return covariance


def _lens_gradient(lens: Lens, pixels: Array) -> Array:
    """Derivatives (n, 2, 9) of the pixels by the lens parameters."""
    rays = lens.unproject(pixels)
    columns = [
        (project(lens.values + step, rays) - project(lens.values - step, rays)) / (2 * step.sum())
        for step in np.diag(_STEPS)
    ]
    return np.stack(columns, axis=-1)


def _turn_gradient(lens: Lens, pixels: Array) -> Array:
    """Derivatives (n, 2, 3) of the pixels by a small turn of the camera, rad."""
    rays, size = lens.unproject(pixels), 1e-6
    turned = [Rotation.from_rotvec(axis).apply(rays) for axis in size * np.eye(3)]
    return np.stack([(lens.project(moved) - lens.project(rays)) / size for moved in turned], axis=-1)


def projection_difference_px(first: Lens, second: Lens) -> Array:
    """By how much two lenses differ, px, (n,), at pixels all over the picture, the best turn taken out."""
    pixels = first.pixels()
    rays = first.unproject(pixels)

    def misfit(turn: Array) -> Array:
        return (second.project(Rotation.from_rotvec(turn).apply(rays)) - pixels).ravel()

    rest = least_squares(misfit, np.zeros(3), x_scale=1e-3).fun.reshape(-1, 2)
    return np.hypot(rest[:, 0], rest[:, 1])
