"""How uncertain a height will be anywhere in the field, and which influence dominates: from the covariance alone."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.projector.height_models import height_changes
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.uncertainty import Influence, Source, UncertaintyComponent, contributions

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
    components
        Uncertainty components: the change of the height there under each, mm, shape (n, n).
    noise_mm
        Standard uncertainty by the noise of a single pixel, shape (n, n); it averages out over areas.
    """

    z_mm: float
    u_px: Array
    v_px: Array
    components: tuple[UncertaintyComponent, ...]
    noise_mm: Array

    @property
    def u_mm(self) -> Array:
        """Map of the systematic standard uncertainty, which no averaging takes away."""
        return np.sqrt(sum((c.effect**2 for c in self.components), np.zeros(self.u_px.shape)))

    @property
    def rms_mm(self) -> float:
        """Root mean square of `u_mm` over the field."""
        return float(np.sqrt(np.mean(self.u_mm**2)))

    def contributions_mm(self) -> dict[Source, float]:
        """Return what each source contributes in mm, root mean square over the field, the largest first."""
        return contributions(replace(c, effect=np.sqrt(np.mean(c.effect**2))) for c in self.components)

    @property
    def dominant(self) -> tuple[Source, float] | None:
        """The source that contributes most, and its share of the variance over the field; None without any."""
        for source, u_mm in self.contributions_mm().items():
            return source, u_mm**2 / max(self.rms_mm**2, 1e-300)
        return None


def forecast_height(
    calibration: RigCalibration, z_mm: float, *, noise_rad: float = 0.0, known_to_mm: float = math.inf
) -> HeightForecast:
    """Forecast the uncertainty of a height over the field.

    Parameters
    ----------
    calibration
        The rig with its uncertainty components.
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
    changes = height_changes(calibration, z_mm, uu, vv)
    pairs = zip(calibration.components, changes, strict=True)
    components = tuple(replace(component, effect=change) for component, change in pairs)
    if z_mm > known_to_mm:
        components = tuple(_extrapolated(component, known_to_mm) for component in components)
    return HeightForecast(z_mm, uu, vv, components, noise)


def _extrapolated(component: UncertaintyComponent, known_to_mm: float) -> UncertaintyComponent:
    """Name for what it is what scatter of the phase does beyond the heights that the rig was fitted to."""
    if component.influence is not Influence.PHASE_SCATTER:
        return component
    return replace(component, influence=Influence.EXTRAPOLATION, detail=f"{known_to_mm:g} mm")
