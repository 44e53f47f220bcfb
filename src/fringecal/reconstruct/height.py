"""From an object's phase to x, y, z and u(z) in the plate frame."""

import enum
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate import Rays
from fringecal.phase.demodulate import PhaseMap
from fringecal.phase.regions import unwrap_regions
from fringecal.projection.calibration import RigCalibration
from fringecal.projection.models import height_model
from fringecal.reconstruct.levels import Levels, steps_at_levels
from fringecal.reconstruct.order import decide_pieces
from fringecal.reconstruct.sensitivity import Sensitivities, height_sensitivities

Array = NDArray[np.float64]


class Reason(enum.IntFlag):
    """Why a pixel has no height; 0 is a valid one. The low bits are those of the phase map."""

    NO_PHASE = 1
    ORDER_UNDECIDED = 2
    NO_RAY = 4
    OUT_OF_RANGE = 8


@dataclass(frozen=True)
class HeightMap:
    """A measured surface: one value per pixel, mm in the plate frame, NaN where masked.

    Parameters
    ----------
    x, y, z
        Coordinates in mm, shape (H, W).
    u_z
        Combined standard uncertainty of z in mm.
    u_random
        Its random part: independent from pixel to pixel.
    systematic
        Its systematic parts: the change of z by one standard uncertainty of each cause; what has the same sign
        everywhere counts fully in a mean.
    reasons
        `Reason` bits, 0 where valid.
    """

    x: Array
    y: Array
    z: Array
    u_z: Array
    u_random: Array
    systematic: Sensitivities
    reasons: NDArray[np.uint8]

    @property
    def sensitivities(self) -> NDArray[np.float32]:
        """Maps of the systematic parts, shape (K, H, W), 0 where masked."""
        return np.nan_to_num(self.systematic.maps(self.z))

    @property
    def mask(self) -> NDArray[np.bool_]:
        """True where the height is valid."""
        return self.reasons == 0

    def mean_uncertainty(self, weights: Array) -> float:
        """Return u of a weighted mean of z: systematic parts add up, random ones average out.

        `Cov = diag(u_r^2) + sum_k c_k c_k^T` (reference 4.5); weights are normalised to sum 1.
        """
        w = np.where(self.mask, weights, 0.0)
        w = w / w.sum()
        random = float(np.sum((w * np.where(self.mask, self.u_random, 0.0)) ** 2))
        common = np.array(
            [float(np.nansum(w * self.systematic.map(k, self.z))) for k in range(len(self.systematic.causes))]
        )
        return math.sqrt(random + float(common @ common))


@dataclass(frozen=True)
class ObjectPhase:
    """An object's absolute phase with its uncertainty, and which pixels lack it."""

    phase_rad: Array
    sigma_rad: Array
    reasons: NDArray[np.uint8]
    undecided_pieces: int


def absolute_phase(
    phase_map: PhaseMap,
    calibration: RigCalibration,
    rays: Rays,
    *,
    height_range_mm: tuple[float, float] | None = None,
    levels: Levels | None = None,
) -> ObjectPhase:
    """Unwrap an object's phase against the plate's and decide the order of each connected piece.

    Parameters
    ----------
    phase_map
        The object's wrapped phase, its sigma and mask.
    calibration
        The rig; its plate phase is the reference.
    rays
        All pixels' rays.
    height_range_mm
        Heights that the object can have, where known.
    levels
        Heights of an artefact's surfaces, where known: they decide the order of pieces that touch no plate.
    """
    plate = calibration.model.phase(rays.ax, rays.ay, 0.0)
    step = np.angle(np.exp(1j * (phase_map.phase - plate)))
    valid = phase_map.valid & np.isfinite(plate)
    unwrapped = unwrap_regions(step, valid)
    pieces = decide_pieces(
        unwrapped.phase,
        unwrapped.pieces,
        height_of=lambda step, pixels: _heights_at(calibration, rays, plate, step, pixels),
        height_range_mm=height_range_mm,
        tops_mm=levels.heights_mm if levels is not None and levels.top else (),
    )
    reasons = np.where(phase_map.valid, 0, int(Reason.NO_PHASE)).astype(np.uint8)
    reasons[~np.isfinite(plate)] |= int(Reason.NO_RAY)
    step = pieces.step_rad
    if levels is not None and not levels.top:
        known = steps_at_levels(unwrapped.phase, valid, _level_steps(calibration, rays, plate, levels))
        step = np.where(np.isfinite(known), known, step)
    reasons[(reasons == 0) & ~np.isfinite(step)] |= int(Reason.ORDER_UNDECIDED)
    sigma = np.hypot(phase_map.sigma.astype(float), calibration.excess_rad)
    return ObjectPhase(step + plate, sigma, reasons, len(pieces.undecided))


def _level_steps(calibration: RigCalibration, rays: Rays, plate: Array, levels: Levels) -> Array:
    """Phase over the plate's that each level would show at every pixel, (levels, H, W)."""
    return np.stack([calibration.model.phase(*rays.at(z), np.full(plate.shape, z)) - plate for z in levels.heights_mm])


def _heights_at(
    calibration: RigCalibration, rays: Rays, plate: Array, step_rad: Array, pixels: NDArray[np.intp]
) -> Array:
    """Heights of phase steps over the plate at some pixels."""
    chosen = Rays(*(np.ravel(part)[pixels] for part in (rays.ax, rays.ay, rays.bx, rays.by)))
    return height_model(calibration).height(step_rad + plate.ravel()[pixels], chosen)


def reconstruct_height(
    phase_map: PhaseMap,
    calibration: RigCalibration,
    *,
    model: str = "projective",
    height_range_mm: tuple[float, float] | None = None,
) -> HeightMap:
    """Return the surface of an object from its phase.

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
    """
    rays = calibration.camera.pixel_rays()
    phase = absolute_phase(phase_map, calibration, rays, height_range_mm=height_range_mm)
    return height_of_phase(phase, calibration, rays, model=model, height_range_mm=height_range_mm)


def height_of_phase(
    phase: ObjectPhase,
    calibration: RigCalibration,
    rays: Rays,
    *,
    model: str = "projective",
    height_range_mm: tuple[float, float] | None = None,
) -> HeightMap:
    """Return the surface from absolute phase: the second half of `reconstruct_height`."""
    z = height_model(calibration, model).height(phase.phase_rad, rays)
    reasons = phase.reasons.copy()
    if height_range_mm is not None:
        outside = (z < height_range_mm[0]) | (z > height_range_mm[1])
        reasons[outside & (reasons == 0)] |= int(Reason.OUT_OF_RANGE)
    reasons[(reasons == 0) & ~np.isfinite(z)] |= int(Reason.NO_RAY)
    z = np.where(reasons == 0, z, np.nan)
    random = np.abs(_slope(calibration, phase, rays, model)) * phase.sigma_rad
    systematic = height_sensitivities(calibration, _range_of(z), model=model)
    u_z = np.sqrt(random**2 + systematic.variance(z))
    x, y = rays.at(z)
    return HeightMap(x, y, z, u_z, np.where(reasons == 0, random, np.nan), systematic, reasons)


def _range_of(z: Array) -> tuple[float, float]:
    """Heights between which nearly all of a surface lies."""
    known = z[np.isfinite(z)]
    if known.size == 0:
        return 0.0, 1.0
    low, high = np.quantile(known[:: max(1, known.size // 100_000)], [0.001, 0.999])
    return float(low), float(high)


def _slope(calibration: RigCalibration, phase: ObjectPhase, rays: Rays, model: str) -> Array:
    """dz/dphi in mm/rad by a small step."""
    step = 1e-3
    height = height_model(calibration, model).height
    return (height(phase.phase_rad + step, rays) - height(phase.phase_rad - step, rays)) / (2 * step)
