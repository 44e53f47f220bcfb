"""An object's phase over the plate's: unwrapped region by region, each piece's order decided by evidence."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.phase.demodulate import PhaseMap
from fringecal.phase.regions import unwrap_regions
from fringecal.projection.calibration import RigCalibration
from fringecal.reconstruct.height_map import Reason
from fringecal.reconstruct.kernels import steps_over_plate
from fringecal.reconstruct.levels import Levels, steps_at_levels
from fringecal.reconstruct.order import decide_pieces
from fringecal.reconstruct.row_rays import rig_rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ObjectPhase:
    """An object's absolute phase minus the plate's with its uncertainty, and which pixels lack it.

    Parameters
    ----------
    step_rad
        Phase over the plate's at the same pixel, rad, (H, W); NaN where it is not known.
    sigma_rad
        Its random standard uncertainty, rad, (H, W).
    reasons
        `Reason` bits, 0 where known.
    undecided_pieces
        Number of connected pieces whose order is open.
    """

    step_rad: NDArray[np.floating]
    sigma_rad: NDArray[np.floating]
    reasons: NDArray[np.uint8]
    undecided_pieces: int


def absolute_phase(
    phase_map: PhaseMap,
    calibration: RigCalibration,
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
    height_range_mm
        Heights that the object can have, where known.
    levels
        Heights of an artefact's surfaces, where known: they decide the order of pieces that touch no plate.
    """
    wrapped = _wrapped_step(phase_map, calibration)
    valid = np.isfinite(wrapped)
    reasons = np.where(phase_map.valid, 0, int(Reason.NO_PHASE)).astype(np.uint8)
    reasons[phase_map.valid & ~valid] = int(Reason.NO_RAY)
    unwrapped = unwrap_regions(wrapped, valid)
    known = None
    if levels is not None and not levels.top:
        known = steps_at_levels(unwrapped.phase.copy(), valid, _level_steps(calibration, levels))
    pieces = decide_pieces(
        unwrapped.phase,
        unwrapped.pieces,
        height_of=lambda step, pixels: _heights_at(calibration, step, pixels),
        height_range_mm=height_range_mm,
        tops_mm=levels.heights_mm if levels is not None and levels.top else (),
    )
    step = pieces.step_rad if known is None else np.where(np.isfinite(known), known, pieces.step_rad)
    reasons[(reasons == 0) & ~np.isfinite(step)] = int(Reason.ORDER_UNDECIDED)
    sigma = phase_map.sigma
    return ObjectPhase(step, sigma, reasons, len(pieces.undecided))


def _wrapped_step(phase_map: PhaseMap, calibration: RigCalibration) -> NDArray[np.float32]:
    """Phase minus the plate's modulo 2 pi, NaN where either is missing."""
    rows = rig_rows(calibration)
    if rows is None:
        rays = calibration.camera.pixel_rays()
        step = np.angle(np.exp(1j * (phase_map.phase - calibration.model.phase(rays.ax, rays.ay, 0.0))))
        return np.where(phase_map.valid, step, np.nan).astype(np.float32)
    wrapped = np.empty(phase_map.phase.shape, np.float32)
    steps_over_plate(phase_map.phase, phase_map.reasons, rows, wrapped)
    return wrapped


def _level_steps(calibration: RigCalibration, levels: Levels) -> Array:
    """Phase over the plate's that each level would show at every pixel, (levels, H, W)."""
    rays = calibration.camera.pixel_rays()
    plate = calibration.model.phase(rays.ax, rays.ay, 0.0)
    return np.stack([calibration.model.phase(*rays.at(z), np.full(plate.shape, z)) - plate for z in levels.heights_mm])


def _heights_at(calibration: RigCalibration, step_rad: Array, pixels: NDArray[np.intp]) -> Array:
    """Heights of phase steps over the plate at some pixels."""
    v, u = np.divmod(pixels, calibration.camera.width_px)
    rays = calibration.camera.rays(u, v)
    return calibration.model.height(step_rad + calibration.model.phase(rays.ax, rays.ay, 0.0), rays)
