"""A sample of a capture's pixels beside the plate's phase, and which of them show the plate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import RectBivariateSpline

from fringecal.numerics import wrap
from fringecal.phase import PhaseMap
from fringecal.projector import RigCalibration

Array = NDArray[np.float64]

NEAR_RAD = 0.9
"""Phase off the plate's within which plate is looked for: a seventh of a fringe, so that a plate 1 mm off is seen."""

_SAMPLES = 40_000  # pixels: of a picture of 12 megapixels every seventeenth row and column
_NODES = (41, 31)  # across and down, at which the plate's phase is computed; splines of degree 5 do the rest
_DEGREE = 5
_RAISE_MM = 0.5  # for the phase's change with height, by differences
_BINS = 60  # of a fringe, 6 deg each
_LEAST_SHARE = 0.02  # of the sample: less plate is a scrap beside an object


@dataclass(frozen=True)
class PlateSample:
    """Every so many rows and columns of a capture.

    Parameters
    ----------
    u_px, v_px
        Columns (w,) and rows (h,) of the sample.
    step_rad
        Phase less the plate's, wrapped, rad, (h, w); NaN where there is none.
    sigma_rad
        Its random standard uncertainty, what the plate leaves beyond the model included, rad, (h, w).
    plate_rad
        The plate's phase by the calibration, rad, (h, w).
    along_u, along_v, along_z
        Its change by one pixel along a row and a column, rad/px, and by height, rad/mm, (h, w).
    plate
        Pixels that look like plate, (h, w).
    offset_rad
        Phase off the plate's at which they lie: 0, or where the largest level part of the picture lies if no plate is
        seen at 0, rad.
    """

    u_px: NDArray[np.intp]
    v_px: NDArray[np.intp]
    step_rad: Array
    sigma_rad: Array
    plate_rad: Array
    along_u: Array
    along_v: Array
    along_z: Array
    plate: NDArray[np.bool_]
    offset_rad: float = 0.0

    @property
    def place(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Index of the sample in a map of the whole picture."""
        return np.ix_(self.v_px, self.u_px)  # type: ignore[return-value]

    @property
    def seen(self) -> bool:
        """Whether there is plate enough to be compared."""
        return self.offset_rad == 0 and bool(self.plate.mean() >= _LEAST_SHARE)


def plate_sample(phase_map: PhaseMap, calibration: RigCalibration) -> PlateSample:
    """Sample a capture beside the plate's phase.

    Parameters
    ----------
    phase_map
        The capture.
    calibration
        The rig, whose model gives the plate's phase.
    """
    u, v = sample_places(phase_map.phase.shape)
    place = np.ix_(v, u)
    plate, along_u, along_v, along_z = _plate_phase(calibration, u, v)
    step = np.asarray(wrap(phase_map.phase[place] - plate))
    sigma = np.hypot(phase_map.sigma[place], calibration.excess_rad)
    looks, offset = largest_near(step, NEAR_RAD), 0.0
    if looks.mean() < _LEAST_SHARE and np.isfinite(step).any():
        offset = _usual(step[np.isfinite(step)])
        looks = largest_near(wrap(step - offset), NEAR_RAD)
    return PlateSample(u, v, step, sigma, plate, along_u, along_v, along_z, looks, offset)


def sample_places(shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return columns and rows of the sample, as far from one end of the picture as from the other."""
    stride = max(1, int(np.sqrt(shape[0] * shape[1] / _SAMPLES)))
    across, down = (np.arange((length - 1) % stride // 2, length, stride) for length in shape[::-1])
    return across, down


def largest_near(step_rad: Array, near_rad: float) -> NDArray[np.bool_]:
    """Return the largest connected part of what lies near the plate's phase, its rim of one sample left out."""
    near = np.abs(np.nan_to_num(step_rad, nan=np.inf)) < near_rad
    parts, number = ndimage.label(ndimage.binary_erosion(near, np.ones((3, 3), bool)))
    if number == 0:
        return np.zeros_like(near)
    return np.asarray(parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:])))


def _usual(step_rad: Array) -> float:
    """Return the phase off the plate's that most of the picture has, rad."""
    counts, edges = np.histogram(step_rad, _BINS, (-np.pi, np.pi))
    near = counts + np.roll(counts, 1) + np.roll(counts, -1)
    top = (edges[int(np.argmax(near))] + edges[int(np.argmax(near)) + 1]) / 2
    around = wrap(step_rad - top)
    return float(wrap(top + np.median(around[np.abs(around) < 3 * np.pi / _BINS])))


def plate_phase(calibration: RigCalibration) -> RectBivariateSpline:
    """Return the bare plate's phase by the calibration, rad, as a function of rows and columns."""
    camera = calibration.camera
    at_u = np.linspace(0, camera.width_px - 1, _NODES[0])
    at_v = np.linspace(0, camera.height_px - 1, _NODES[1])
    rays = camera.rays(*np.meshgrid(at_u, at_v))
    return RectBivariateSpline(at_v, at_u, calibration.model.phase(*rays.at(0.0), 0.0), kx=_DEGREE, ky=_DEGREE)


def _plate_phase(calibration: RigCalibration, u: NDArray[np.intp], v: NDArray[np.intp]) -> tuple[Array, ...]:
    """Return the plate's phase on the sample, its changes by a pixel along rows and columns, and by height."""
    camera = calibration.camera
    at_u = np.linspace(0, camera.width_px - 1, _NODES[0])
    at_v = np.linspace(0, camera.height_px - 1, _NODES[1])
    rays = camera.rays(*np.meshgrid(at_u, at_v))
    low, high = (calibration.model.phase(*rays.at(z), z) for z in (-_RAISE_MM, _RAISE_MM))
    flat = plate_phase(calibration)
    by_height = RectBivariateSpline(at_v, at_u, (high - low) / (2 * _RAISE_MM))
    return flat(v, u), flat(v, u, dy=1), flat(v, u, dx=1), by_height(v, u)
