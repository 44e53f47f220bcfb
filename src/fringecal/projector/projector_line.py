"""Where a rig model puts the projector, seen in the plane across the fringes at the plate's origin."""

import math

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import wrap
from fringecal.projector.rig_model import RigModel

Array = NDArray[np.float64]

_BEHIND = 4.0  # a height that is negative by more standard uncertainties than this is impossible
_LEAST_U_PER_MM = 2e-5  # of 1/height, 1/mm: no fit tells a projector 50 m away from collimated light
_LEAST_CHIRP = 0.02  # relative change of the pitch over the field below which light counts as collimated


def angle_at_origin(model: RigModel) -> float:
    """Return the projection angle at the plate's origin in rad, with the sign of phase along the fringe normal."""
    gx, gy, gz = model.gradient(0.0, 0.0, 0.0)
    return math.atan2(-float(gz), math.hypot(float(gx), float(gy)))


def _inverse_height(parameters: Array) -> tuple[float, float]:
    """Return 1/height of the projector's line and the tangent at the origin, across the fringes there.

    For a pinhole tan(theta) = (side - s) / height at s across the fringes; the inverse stays finite for
    collimated light.
    """
    n, n0, d = parameters[:3], parameters[3], parameters[4:]
    gradient = n[:2] - n0 * d[:2]
    length = math.hypot(*gradient)
    across = gradient / length
    tangent = -float(n[2] - n0 * d[2]) / length
    # The line: points s across and z up with n.X + n0 = 0 and d.X + 1 = 0.
    matrix = np.array([[float(n[:2] @ across), n[2]], [float(d[:2] @ across), d[2]]])
    determinant = float(np.linalg.det(matrix))
    # Cramer's rule for z = (d_s n0 - n_s) / determinant.
    return determinant / (float(matrix[1, 0]) * n0 - float(matrix[0, 0])), tangent


def line_in_profile(model: RigModel, covariance: Array) -> tuple[float, float, bool]:
    """Side and height of the projector's line; whether the height is negative beyond its uncertainty."""
    base, tangent = _inverse_height(model.parameters)
    gradient = np.zeros(2)
    for i, index in enumerate((2, 6)):
        step = math.sqrt(max(float(covariance[i, i]), 0.0))
        if step > 0:
            shifted = model.parameters.copy()
            shifted[index] += step
            gradient[i] = (_inverse_height(shifted)[0] - base) / step
    uncertainty = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
    behind = base < -_BEHIND * max(uncertainty, _LEAST_U_PER_MM)
    height = 1 / base if base else math.inf
    return tangent * height, height, behind


def off_axis_deg(model: RigModel, side_mm: float, height_mm: float, extent_mm: float) -> float:
    """Angle at the projector between its axis and the plate's origin, in the plane across the fringes.

    The denominator of the phase vanishes on the plane through the pupil that stands square to the axis: its
    gradient is the axis, and the plate alone gives two thirds of it. NaN where the pitch hardly changes over
    `extent_mm` of the plate: collimated light has no axis.
    """
    n, n0, d = model.parameters[:3], model.parameters[3], model.parameters[4:]
    gradient = n[:2] - n0 * d[:2]
    across = float(d[:2] @ gradient) / math.hypot(*gradient)
    if math.hypot(across, float(d[2])) * extent_mm < _LEAST_CHIRP or not math.isfinite(height_mm):
        return math.nan
    axis = math.atan2(across, float(d[2]))
    return math.degrees(float(wrap(math.atan2(-side_mm, -height_mm) - axis)))
