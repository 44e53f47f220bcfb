"""A lens without its pose: focal length, principal point and Brown's distortion, with their covariance."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]

#: Parameters in the order of every vector and covariance; OpenCV's and mrcal's OPENCV5.
LENS_NAMES = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
_UNITS = ("px", "px", "px", "px", "", "", "", "", "")
_MAP_POINTS = 24  # across the picture: maps of a lens are smooth
_UNPROJECT_STEPS = 60  # each leaves the share by which the lens bends: of a half, which is near the fold, 1e-18
_UNPROJECTED_PX = 1e-3  # a pixel that is missed by more is seen by no ray of the model: far below any corner's scatter


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
        """Directions (n, 3), z = 1, in which pixels (n, 2) look; the inverse of `project` by iteration.

        NaN for pixels beyond the fold of the radial polynomial: no ray of the model reaches them.
        """
        fx, fy, cx, cy = self.values[:4]
        seen = (pixels - [cx, cy]) / [fx, fy]
        ideal = seen.copy()
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(_UNPROJECT_STEPS):
                ideal += seen - _distorted(self.values, ideal)
            missed = np.abs(_distorted(self.values, ideal) - seen).max(axis=1) * fx
        ideal[~(missed < _UNPROJECTED_PX)] = np.nan
        return np.column_stack([ideal, np.ones(len(ideal))])

    @property
    def map_shape(self) -> tuple[int, int]:
        """Rows and columns of `pixels`."""
        return max(2, round(_MAP_POINTS * self.height_px / self.width_px)), _MAP_POINTS

    def pixels(self) -> Array:
        """Pixels (n, 2) spread evenly over the picture, row by row as `map_shape` says."""
        rows, columns = self.map_shape
        u, v = np.linspace(0, self.width_px - 1, columns), np.linspace(0, self.height_px - 1, rows)
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
