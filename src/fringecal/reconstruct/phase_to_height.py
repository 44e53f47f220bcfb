"""From an object's phase to x, y, z and u(z) in the plate frame."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from fringecal.numerics import over_bands
from fringecal.phase import PhaseMap
from fringecal.projector import RigCalibration, height_model
from fringecal.reconstruct.height_kernels import Maps, surface_rows
from fringecal.reconstruct.height_map import HeightMap, Reason
from fringecal.reconstruct.object_phase import ObjectPhase, absolute_phase
from fringecal.reconstruct.row_rays import rig_rows, uncertainty_rows
from fringecal.reconstruct.sensitivity import Sensitivities, height_sensitivities
from fringecal.uncertainty import uncertainty_with_bias

Array = NDArray[np.float64]
HeightRange = tuple[float, float] | None
Allocate = Callable[[tuple[int, ...], DTypeLike], NDArray[Any]]
"""Returns an array of a shape and a type, as `np.empty` does."""

_SAMPLE = 300  # rows and columns of the sample that says between which heights a surface lies
_TAIL = 0.001  # share of the sample at either end that may be wrong pixels, whose heights are anything
_SLOPE_STEP_RAD = 1e-3  # for dz/dphi by differences: far above rounding, and no model bends over it


def reconstruct_height(
    phase_map: PhaseMap,
    calibration: RigCalibration,
    *,
    model: str = "projective",
    height_range_mm: HeightRange = None,
    allocate: Allocate = np.empty,
) -> HeightMap:
    """Return the surface of an object from its phase, as float32 maps.

    Parameters
    ----------
    phase_map
        Demodulated frames of the object.
    calibration
        The calibrated rig.
    model
        Name of a height model; see `height_model`.
    height_range_mm
        Heights that the object can have: helps to decide pieces that touch no plate, masks what lies outside.
    allocate
        Makes the five maps, 20 bytes a pixel. They are written once, row by row: for pictures that memory does not
        hold it may return `np.memmap`s, as the buffers of `demodulate(out=...)` may be: 33 of 50 bytes a pixel stay.
    """
    phase = absolute_phase(phase_map, calibration, height_range_mm=height_range_mm)
    return height_of_phase(
        phase, calibration, model=model, height_range_mm=height_range_mm, dtype=np.float32, allocate=allocate
    )


def height_of_phase(
    phase: ObjectPhase,
    calibration: RigCalibration,
    *,
    model: str = "projective",
    height_range_mm: HeightRange = None,
    dtype: DTypeLike = np.float64,
    allocate: Allocate = np.empty,
) -> HeightMap:
    """Return the surface from absolute phase: the second half of `reconstruct_height`.

    Parameters
    ----------
    phase
        The object's phase over the plate's.
    calibration, model, height_range_mm, allocate
        As for `reconstruct_height`.
    dtype
        Type of the maps: float32 halves the memory and rounds coordinates below 512 mm by 0.03 um at most.

    Examples
    --------
    >>> from fringecal.camera import PlateCamera
    >>> from fringecal.projector import RigModel
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, (5, 7))
    >>> rig = RigCalibration(camera, RigModel(np.array([0.5, 0, 0.5, 0, 0, 0, 0]), np.full(3, np.inf)), ())
    >>> shape = (5, 7)
    >>> step = ObjectPhase(np.full(shape, 1.0), np.full(shape, 0.01, np.float32), np.zeros(shape, np.uint8), 0)
    >>> surface = height_of_phase(step, rig)  # a radian is 2 mm in the middle, where sight is vertical
    >>> round(float(surface.z[2, 3]), 6), round(float(surface.u_z[2, 3]), 6)
    (2.0, 0.02)
    """
    systematic = height_sensitivities(calibration, _range_of(phase, calibration, model), model=model)
    rows = rig_rows(calibration) if model == "projective" else None
    if rows is None:
        return _by_maps(phase, calibration, systematic, model, height_range_mm)
    shape = phase.difference_rad.shape
    x, y, z, u_z, u_random = (allocate(shape, dtype) for _ in range(5))
    maps = Maps(x, y, z, u_z, u_random, phase.reasons.copy())
    uncertainty = uncertainty_rows(systematic, calibration.excess_rad, height_range_mm)
    over_bands(surface_rows, shape[0], phase.difference_rad, phase.sigma_rad, rows, uncertainty, maps)
    return HeightMap(x, y, z, u_z, u_random, systematic, maps.reasons)


def _by_maps(
    phase: ObjectPhase, calibration: RigCalibration, systematic: Sensitivities, model: str, heights_mm: HeightRange
) -> HeightMap:
    """Compute the surface with any height model, one whole map after the other.

    Another model than the calibrated one errs by its difference from that one, which stands in u(z) as a known bias.
    """
    rays = calibration.camera.pixel_rays()
    absolute = phase.difference_rad + calibration.model.phase(rays.ax, rays.ay, 0.0)
    # One call for all three: a law that is fitted at every pixel is fitted once.
    steps = np.array([0.0, _SLOPE_STEP_RAD, -_SLOPE_STEP_RAD]).reshape(3, 1, 1)
    z, above, below = height_model(calibration, model).height(absolute + steps, rays)
    reasons = phase.reasons.copy()
    if heights_mm is not None:
        reasons[((z < heights_mm[0]) | (z > heights_mm[1])) & (reasons == 0)] = int(Reason.OUT_OF_RANGE)
    reasons[(reasons == 0) & ~np.isfinite(z)] = int(Reason.NO_RAY)
    z = np.where(reasons == 0, z, np.nan)
    slope = (above - below) / (2 * _SLOPE_STEP_RAD)
    random = np.abs(slope) * np.hypot(phase.sigma_rad.astype(float), calibration.excess_rad)
    x, y = rays.at(z)
    random = np.where(reasons == 0, random, np.nan)
    combined = np.sqrt(random**2 + systematic.variance(z))
    if model == "projective":
        return HeightMap(x, y, z, combined, random, systematic, reasons)
    bias = z - calibration.model.height(absolute, rays)
    return HeightMap(x, y, z, uncertainty_with_bias(combined, bias), random, systematic, reasons, bias)


def _range_of(phase: ObjectPhase, calibration: RigCalibration, model: str) -> tuple[float, float]:
    """Heights between which nearly all of a surface lies, from a sparse sample."""
    v, u = (np.arange(0, n, max(1, n // _SAMPLE)) for n in phase.difference_rad.shape)
    step = phase.difference_rad[np.ix_(v, u)]
    rays = calibration.camera.rays(*np.meshgrid(u, v))
    z = height_model(calibration, model).height(step + calibration.model.phase(rays.ax, rays.ay, 0.0), rays)
    known = z[np.isfinite(z)]
    if known.size == 0:
        return 0.0, 1.0
    low, high = np.quantile(known, [_TAIL, 1 - _TAIL])
    return float(low), float(high)


__all__ = ["HeightMap", "ObjectPhase", "Reason", "absolute_phase", "height_of_phase", "reconstruct_height"]
