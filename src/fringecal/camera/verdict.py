"""Is there lens distortion? The verdict from the camera fitted on the plate, with its detection limit."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

from fringecal.camera.plate import CAMERA_NAMES, PlateCamera
from fringecal.camera.plate_fit import CameraFit
from fringecal.uncertainty.estimates import Estimate

Array = NDArray[np.float64]
Verdict = Literal["none", "barrel", "pincushion"]

_SIGNIFICANCE = 0.05
_POWER = 0.95  # share of distortions at the detection limit that the test finds


@dataclass(frozen=True)
class DistortionVerdict:
    """Radial distortion of a camera as displacement in the picture.

    Parameters
    ----------
    verdict
        "barrel" when points move toward the centre, "pincushion" when they move outward, "none" when the
        displacement is not significant at 5 %.
    max_px
        Size of the largest displacement over the crossings seen, px; the verdict says which way.
    detection_limit_px
        Displacement that would be found in 95 % of cases.
    p_value
        Probability of so large a displacement without any distortion.
    radius_px
        Distance from the image centre at which `max_px` holds.
    """

    verdict: Verdict
    max_px: Estimate
    detection_limit_px: float
    p_value: float
    radius_px: float


def distortion_verdict(fit: CameraFit, points_px: Array) -> DistortionVerdict:
    """Test the fitted radial distortion at the outermost crossing.

    The two-sided test of a normal estimate; the detection limit is `(z(1 - a/2) + z(power)) u`. Significance
    needs the crossings' scatter only: what is common to all crossings (pitch, camera height) bends no line.

    Parameters
    ----------
    fit
        The camera fitted to the grid.
    points_px
        Crossings (u, v) in px, shape (n, 2).
    """
    camera = fit.camera
    offset = points_px - np.array(camera.centre_px)
    outermost = offset[np.argmax(np.hypot(*offset.T))]
    value = radial_displacement_px(camera, outermost)
    gradient = np.zeros(len(CAMERA_NAMES))
    for i in (CAMERA_NAMES.index(name) for name in ("k1", "k2", "k3")):
        if camera.covariance[i, i] > 0:
            moved = camera.parameters.copy()
            step = math.sqrt(camera.covariance[i, i])
            moved[i] += step
            gradient[i] = (radial_displacement_px(camera.replaced(moved), outermost) - value) / step
    stated = sum((np.outer(e, e) for e in fit.causes.values()), np.zeros_like(camera.covariance))
    u = math.sqrt(max(0.0, float(gradient @ (camera.covariance - stated) @ gradient)))
    p_value = float(2 * special.stdtr(fit.dof, -abs(value) / u)) if u > 0 else 1.0
    found: Verdict = "none"
    if p_value < _SIGNIFICANCE:
        found = "barrel" if value < 0 else "pincushion"
    limit = float(special.ndtri(1 - _SIGNIFICANCE / 2) + special.ndtri(_POWER)) * u
    maximum = Estimate(abs(value), u, "px", "largest displacement", fit.dof)
    return DistortionVerdict(found, maximum, limit, p_value, float(np.hypot(*outermost)))


def radial_displacement_px(camera: PlateCamera, offset_px: Array) -> float:
    """Return by how much the lens moves a point at `offset_px` from the centre outward, in px."""
    radius = float(np.hypot(*offset_px)) / camera.focal_px
    r2 = radius * radius
    k1, k2, k3 = camera["k1"], camera["k2"], camera["k3"]
    return camera.focal_px * radius * r2 * (k1 + r2 * (k2 + r2 * k3))
