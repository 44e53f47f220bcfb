"""Systematic uncertainty of a height map: how z moves with each influence, as smooth functions of (u, v, z).

The change of z under one standard uncertainty of an influence varies slowly over the field and with height, so it is
sampled on a coarse lattice and kept as a polynomial: exact to far better than an uncertainty needs, at a
hundredth of the time and memory of one full map for each.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from fringecal.projector import RigCalibration, height_changes
from fringecal.reconstruct.height_kernels import CONTINUED
from fringecal.uncertainty import Source

Array = NDArray[np.float64]

_NODES = 13  # lattice nodes along each picture axis: for eight terms, so that a deviation between nodes is fitted out
_DEGREE = 7  # of the polynomial along each picture axis: a lens bends by the third and the fifth power of the radius
_HEIGHTS = 6  # height levels, and one more than the degree in z: a change of z is nearly quadratic in z
_LEAST_RANGE_MM = 1.0  # between lowest and highest level: a narrower range would divide by nothing


@dataclass(frozen=True)
class Sensitivities:
    """Change of z in mm under one standard uncertainty of each influence, as a function of pixel and height.

    Parameters
    ----------
    sources
        Sources of the K components; one may stand more than once (principal axes of one covariance).
    dof
        Degrees of freedom of each component.
    coefficients
        Chebyshev coefficients, shape (K, degrees in z, degrees in v, degrees in u).
    variance_coefficients
        The same for the sum of all squares, shape (degrees in z, degrees in v, degrees in u).
    shape
        Image shape (rows, columns).
    z_range_mm
        Heights between which the polynomial was sampled.
    """

    sources: tuple[Source, ...]
    dof: tuple[float, ...]
    coefficients: Array
    variance_coefficients: Array
    shape: tuple[int, int]
    z_range_mm: tuple[float, float]

    def maps(self, z_mm: ArrayLike) -> NDArray[np.float32]:
        """Return one map for each component at heights z, shape (K, H, W); NaN where z is NaN."""
        z = np.asarray(z_mm, float)
        return np.stack([self.map(k, z) for k in range(len(self.sources))]).astype(np.float32)

    def map(self, component: int, z_mm: Array) -> Array:
        """Return the map of one component, by its number."""
        return self._evaluated(self.coefficients[component], z_mm)

    def variance(self, z_mm: ArrayLike) -> Array:
        """Return the systematic variance of z in mm^2 as a map."""
        return np.maximum(self._evaluated(self.variance_coefficients, np.asarray(z_mm, float)), 0.0)

    def _evaluated(self, coefficients: Array, z_mm: Array) -> Array:
        along_v, along_u = self._bases()
        height = self._unit_height(z_mm)
        value, slope = np.zeros(self.shape), np.zeros(self.shape)
        # Clenshaw's recurrence over the degrees in z, one map at a time.
        for level in coefficients[:0:-1]:
            value, slope = along_v @ level @ along_u.T + 2 * height * value - slope, value
        return along_v @ coefficients[0] @ along_u.T + height * value - slope

    def _unit_height(self, z: Array) -> Array:
        low, high = self.z_range_mm
        return np.clip((2 * z - low - high) / (high - low), -CONTINUED, CONTINUED)

    def _bases(self) -> tuple[Array, Array]:
        degree = self.coefficients.shape[2] - 1
        rows, columns = (np.linspace(-1, 1, n) for n in self.shape)
        along_v, along_u = chebyshev.chebvander(rows, degree), chebyshev.chebvander(columns, degree)
        return along_v.astype(np.float64), along_u.astype(np.float64)


def height_sensitivities(
    calibration: RigCalibration, z_range_mm: tuple[float, float], *, model: str = "projective"
) -> Sensitivities:
    """Sample how z moves under each component of the calibration's uncertainty.

    Parameters
    ----------
    calibration
        The rig with its uncertainty components.
    z_range_mm
        Lowest and highest height of interest; widened to 1 mm where it is narrower.
    model
        Name of a height model.
    """
    low, high = z_range_mm
    middle, half = (low + high) / 2, max(high - low, _LEAST_RANGE_MM) / 2
    shape = (calibration.camera.height_px, calibration.camera.width_px)
    v, u = (np.rint((1 - np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)) / 2 * (n - 1)) for n in shape)
    uu, vv = np.meshgrid(u, v)
    unit = np.cos(np.pi * (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS)
    samples = height_changes(calibration, (middle + half * unit)[:, None, None], uu, vv, model=model)
    places = (unit, 2 * v / (shape[0] - 1) - 1, 2 * u / (shape[1] - 1) - 1)
    return Sensitivities(
        sources=tuple(component.source for component in calibration.components),
        dof=tuple(component.dof for component in calibration.components),
        coefficients=_fitted(samples, *places),
        variance_coefficients=_fitted(np.sum(samples**2, axis=0, keepdims=True), *places)[0],
        shape=shape,
        z_range_mm=(middle - half, middle + half),
    )


def _fitted(samples: Array, s: Array, v: Array, u: Array) -> Array:
    """Least-squares Chebyshev coefficients of samples (K, levels, rows, columns)."""
    inverse_z = np.linalg.pinv(chebyshev.chebvander(s, _HEIGHTS - 1))
    inverse_v = np.linalg.pinv(chebyshev.chebvander(v, _DEGREE))
    inverse_u = np.linalg.pinv(chebyshev.chebvander(u, _DEGREE))
    return np.einsum("ai,bj,cl,kijl->kabc", inverse_z, inverse_v, inverse_u, samples, optimize=True)
