"""Rig and uncertainty as polynomials along every picture row: a handful of multiplications for each pixel.

Rays need Newton's method on the lens's distortion, systematic uncertainty a sum over its components; along a row both
are smooth, and the kernels of `fringecal.reconstruct.height_kernels` evaluate them by Horner's rule.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.projector import PlateResidual, RigCalibration
from fringecal.reconstruct.height_kernels import Rig, UncertaintyRows
from fringecal.reconstruct.height_map import Reason
from fringecal.reconstruct.sensitivity import Sensitivities

Array = NDArray[np.float64]

_DEGREES = (3, 7, 11, 15)  # tried in turn; beyond, powers of the position lose digits
_ROUNDING = 1e-12  # mm and slopes: for a camera whose rays are parallel, whose slopes are 0
_TOLERANCE = 1e-7  # of the largest coordinate: 0.03 um on a plate of 300 mm


@dataclass(frozen=True)
class RowRays:
    """Rays of all pixels: `sum_k coefficients[v, i, k] t^k` with t from -1 to 1 along row v.

    Parameters
    ----------
    coefficients
        Shape (H, 4, degree + 1); i counts ax, ay (mm), bx, by (mm per mm).
    width_px
        Length of a row.
    """

    coefficients: Array
    width_px: int

    @property
    def position(self) -> Array:
        """Position t of every column."""
        return np.linspace(-1.0, 1.0, self.width_px)


def row_rays(camera: PlateCamera) -> RowRays | None:
    """Fit polynomials to a camera's rays along every row, or return None where they do not hold.

    The degree grows until the rays half-way between the nodes are met to 1e-7 of the largest coordinate. None: a
    lens whose distortion folds back inside the picture, or is too strong for degree 15.
    """
    for degree in _DEGREES:
        found = _fitted(camera, degree)
        if found is None or _holds(camera, found):
            return found
    return None


def _fitted(camera: PlateCamera, degree: int) -> RowRays | None:
    nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    values = _rays_at(camera, nodes)
    if not np.isfinite(values).all():
        return None
    series = np.linalg.inv(chebyshev.chebvander(nodes, degree))
    return RowRays(np.ascontiguousarray(values @ (_powers(degree) @ series).T), camera.width_px)


def _powers(degree: int) -> Array:
    """Matrix that turns Chebyshev coefficients into those of powers."""
    powers = np.zeros((degree + 1, degree + 1))
    for k, unit in enumerate(np.eye(degree + 1)):
        power = chebyshev.cheb2poly(unit)
        powers[: power.size, k] = power
    return powers


def _rays_at(camera: PlateCamera, t: Array) -> Array:
    """Exact rays at positions t of every row, shape (H, 4, positions)."""
    u = (t + 1) / 2 * (camera.width_px - 1)
    rays = camera.rays(*np.meshgrid(u, np.arange(camera.height_px)))
    return np.stack([rays.ax, rays.ay, rays.bx, rays.by], axis=1)


def _holds(camera: PlateCamera, rows: RowRays) -> bool:
    degree = rows.coefficients.shape[2] - 1
    between = np.cos(np.pi * np.arange(degree + 2) / (degree + 1))
    exact = _rays_at(camera, between)
    found = rows.coefficients @ np.vander(between, degree + 1, increasing=True).T
    return bool(np.all(np.abs(found - exact) <= _TOLERANCE * np.abs(exact).max(axis=(0, 2))[None, :, None] + _ROUNDING))


def rig_rows(calibration: RigCalibration) -> Rig | None:
    """Return a rig as the arrays that the kernels take, None where its rays are no polynomials along rows."""
    rows = row_rays(calibration.camera)
    if rows is None:
        return None
    model = calibration.model
    return Rig(
        rows.coefficients,
        rows.position,
        np.asarray(model.parameters, float),
        np.asarray(model.projector_mm, float),
        _residual_powers(model.residual),
        np.array(model.residual.box, float),
    )


def _residual_powers(residual: PlateResidual) -> Array:
    """Coefficients of the plate residual by powers of both scaled plate coordinates; empty if there is none."""
    if not np.any(residual.coefficients):
        return np.zeros((0, 0))
    powers = _powers(residual.degree)
    return np.ascontiguousarray(powers @ residual.grid @ powers.T)


def uncertainty_rows(
    systematic: Sensitivities, excess_rad: float, height_range_mm: tuple[float, float] | None
) -> UncertaintyRows:
    """Return the systematic uncertainty as the arrays that the kernels take.

    Parameters
    ----------
    systematic
        Sensitivities of the height.
    excess_rad
        Random phase error beyond every pixel's own, rad.
    height_range_mm
        Heights beyond which a pixel is masked; None masks none.
    """
    low, high = height_range_mm or (-np.inf, np.inf)
    z_low, z_high = systematic.z_range_mm
    return UncertaintyRows(
        _variance_rows(systematic),
        (z_low + z_high) / 2,
        (z_high - z_low) / 2,
        float(excess_rad),
        float(low),
        float(high),
        np.array([Reason.ORDER_UNDECIDED, Reason.NO_RAY, Reason.OUT_OF_RANGE], np.uint8),
    )


def _variance_rows(systematic: Sensitivities) -> Array:
    """Systematic variance by row, power of the scaled height, power of the position along the row."""
    coefficients = systematic.variance_coefficients
    levels, along_v, along_u = coefficients.shape
    rows = chebyshev.chebvander(np.linspace(-1, 1, systematic.shape[0]), along_v - 1)
    by_power = np.einsum("pa,abc,qc->pbq", _powers(levels - 1), coefficients, _powers(along_u - 1))
    return np.ascontiguousarray(np.einsum("hb,pbq->hpq", rows, by_power))
