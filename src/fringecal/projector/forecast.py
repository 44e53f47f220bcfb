"""How uncertain a height will be anywhere in the field, and which cause is to blame: from the covariance alone."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.projector.height_models import height_changes
from fringecal.projector.rig_calibration import RigCalibration

Array = NDArray[np.float64]

_NODES = 9  # along each side of the picture: a forecast is as smooth over the field as the rig's few parameters
_RIM = 0.02  # share of a side left out at its ends, where an object's rim would lie


@dataclass(frozen=True)
class HeightForecast:
    """Standard uncertainty of one height over the field, before any object was measured.

    Parameters
    ----------
    z_mm
        The height.
    u_px, v_px
        Pixels at which it was asked, shape (n, n).
    labels
        Causes; one may stand more than once (independent parts of it).
    changes_mm
        What each does to the height there, shape (causes, n, n).
    noise_mm
        Standard uncertainty by the noise of a single pixel, shape (n, n); it averages out over areas.
    """

    z_mm: float
    u_px: Array
    v_px: Array
    labels: tuple[str, ...]
    changes_mm: Array
    noise_mm: Array

    @property
    def u_mm(self) -> Array:
        """Map of the systematic standard uncertainty, which no averaging takes away."""
        return np.sqrt(np.sum(self.changes_mm**2, axis=0))

    @property
    def rms_mm(self) -> float:
        """Root mean square of `u_mm` over the field."""
        return float(np.sqrt(np.mean(self.u_mm**2)))

    def causes(self) -> dict[str, float]:
        """Return what each cause contributes in mm, root mean square over the field, the largest first."""
        total: dict[str, float] = {}
        for label, change in zip(self.labels, self.changes_mm, strict=True):
            total[label] = math.hypot(total.get(label, 0.0), float(np.sqrt(np.mean(change**2))))
        return dict(sorted(total.items(), key=lambda item: -item[1]))

    @property
    def dominant(self) -> tuple[str, float]:
        """The largest cause, and its share of the variance over the field."""
        causes = self.causes()
        label = next(iter(causes), "")
        return label, causes[label] ** 2 / max(self.rms_mm**2, 1e-300) if label else 0.0


def forecast_height(
    calibration: RigCalibration, z_mm: float, *, noise_rad: float = 0.0, known_to_mm: float = math.inf
) -> HeightForecast:
    """Forecast the uncertainty of a height over the field.

    Parameters
    ----------
    calibration
        The rig with the modes of its uncertainty.
    z_mm
        The height above the plate.
    noise_rad
        Noise of the phase in one pixel.
    known_to_mm
        Greatest height that the rig was fitted to: above it, scatter of phase is called extrapolation.
    """
    camera = calibration.camera
    v, u = (np.rint(np.linspace(_RIM, 1 - _RIM, _NODES) * (n - 1)) for n in (camera.height_px, camera.width_px))
    uu, vv = np.meshgrid(u, v)
    rays = camera.rays(uu, vv)
    gx, gy, gz = calibration.model.gradient(*rays.at(z_mm), z_mm)
    noise = noise_rad / np.abs(gz + gx * rays.bx + gy * rays.by)
    beyond = f"extrapolation beyond {known_to_mm:g} mm"
    renamed = {"phase scatter": beyond} if z_mm > known_to_mm else {}
    labels = tuple(renamed.get(mode.label, mode.label) for mode in calibration.modes)
    return HeightForecast(z_mm, uu, vv, labels, height_changes(calibration, z_mm, uu, vv), noise)
