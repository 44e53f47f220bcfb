"""An object's phase over the plate's: unwrapped region by region, each one's order decided by evidence."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import TURN, over_bands, wrap
from fringecal.phase import PhaseMap, Regions, Unwrapped, pieces_in_cycles, smooth_regions
from fringecal.phase import Reason as NoPhase
from fringecal.projector import RigCalibration
from fringecal.reconstruct.height_kernels import steps_over_plate
from fringecal.reconstruct.height_map import Reason
from fringecal.reconstruct.orders.cycles import step_in_cycle
from fringecal.reconstruct.orders.decided_regions import DecidedRegions, decide_regions
from fringecal.reconstruct.orders.epipolar_lines import epipolar_lines
from fringecal.reconstruct.orders.mixed_pixels import beside_breaks, beside_edges
from fringecal.reconstruct.orders.piece_orders import add_turns, decide_pieces, order_by_height, pixels_of
from fringecal.reconstruct.orders.sinking import DEEPEST_RAD
from fringecal.reconstruct.row_rays import rig_rows

Array = NDArray[np.float64]

_NONE, _NO_PHASE, _NO_RAY = np.uint8(0), np.uint8(Reason.NO_PHASE), np.uint8(Reason.NO_RAY)
_UNDECIDED, _SHADOW = np.uint8(Reason.ORDER_UNDECIDED), np.uint8(Reason.SHADOW)
_UNLIT = np.uint8(NoPhase.DARK | NoPhase.LOW_MODULATION | NoPhase.MISFIT)  # noise fits no sine
_DIM = np.uint8(NoPhase.DARK | NoPhase.LOW_MODULATION)
_SAMPLE_PX = 9  # every so many pixels say what u(phi) is typical


@dataclass(frozen=True)
class ObjectPhase:
    """An object's absolute phase minus the plate's with its uncertainty, and which pixels lack it.

    Parameters
    ----------
    difference_rad
        Phase over the plate's at the same pixel, rad, (H, W); NaN where it is not known.
    sigma_rad
        Its random standard uncertainty, rad, (H, W).
    reasons
        `Reason` bits, 0 where known.
    undecided_pieces
        Number of connected pieces whose order is open.
    """

    difference_rad: NDArray[np.floating]
    sigma_rad: NDArray[np.floating]
    reasons: NDArray[np.uint8]
    undecided_pieces: int


def absolute_phase(
    phase_map: PhaseMap,
    calibration: RigCalibration,
    *,
    height_range_mm: tuple[float, float] | None = None,
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

    Notes
    -----
    With one period, a region's order follows from the plate, from how regions follow one another along epipolar lines
    (`fringecal.reconstruct.orders.region_orders`), or from a border along which it meets one that is decided. Orders
    that further periods give are known up to their cycle: the step over the plate is unwrapped in cycles then,
    instead of in fringes, and a piece that touches no plate is taken to lie less than a cycle above it.
    """
    wrapped = _wrapped_step(phase_map, calibration)
    valid, reasons = np.isfinite(wrapped), np.empty(wrapped.shape, np.uint8)
    over_bands(_why_not, len(reasons), phase_map.reasons, valid, reasons)
    if (in_cycle := step_in_cycle(phase_map, calibration)) is not None and phase_map.orders is not None:
        step, open_pieces = _by_cycle(in_cycle, phase_map.orders.cycle, calibration, height_range_mm)
        reasons[(reasons == 0) & beside_breaks(step, phase_map.modulation)] = int(Reason.EDGE)
    elif (regions := smooth_regions(wrapped, valid)) is not None:
        step, open_pieces = _by_evidence(phase_map, regions, calibration, height_range_mm, reasons)
    else:
        step, open_pieces = np.full(wrapped.shape, np.nan), 1
    over_bands(_mask_open, len(step), step, reasons)
    return ObjectPhase(step, phase_map.sigma, reasons, open_pieces)


@njit(nogil=True, cache=True)
def _why_not(first, last, without_phase, has_step, reasons):  # type: ignore[no-untyped-def]
    """Write why pixels of some rows have no wrapped step, 0 where they have one."""
    for v in range(first, last):
        for u in range(reasons.shape[1]):
            why = without_phase[v, u]
            if has_step[v, u]:
                reasons[v, u] = _NONE
            elif why == 0:
                reasons[v, u] = _NO_RAY
            else:
                reasons[v, u] = _SHADOW if why & _DIM and not why & ~_UNLIT else _NO_PHASE


@njit(nogil=True, cache=True)
def _mask_open(first, last, step, reasons):  # type: ignore[no-untyped-def]
    """Mask the step of some rows where there is a reason to, and give what has no order its own."""
    for v in range(first, last):
        for u in range(reasons.shape[1]):
            if reasons[v, u] != _NONE:
                step[v, u] = np.nan
            elif not np.isfinite(step[v, u]):
                reasons[v, u], step[v, u] = _UNDECIDED, np.nan


def _by_cycle(
    in_cycle: NDArray[np.float32],
    cycle: int,
    calibration: RigCalibration,
    height_range_mm: tuple[float, float] | None,
) -> tuple[Array, int]:
    """Return the step of phases that further periods tell apart up to their cycle, and how many pieces stay open."""
    unwrapped = _in_cycles(in_cycle, cycle)
    pieces = decide_pieces(
        unwrapped.phase,
        unwrapped.pieces,
        height_of=lambda step, pixels: _heights_at(calibration, step, pixels),
        height_range_mm=height_range_mm,
        fringes_per_turn=cycle,
        rising=_rising(calibration),
        range_turns=_range_turns(calibration, height_range_mm, cycle),
    )
    return pieces.difference_rad, len(pieces.undecided)


def _by_evidence(
    phase_map: PhaseMap,
    regions: Regions,
    calibration: RigCalibration,
    height_range_mm: tuple[float, float] | None,
    reasons: NDArray[np.uint8],
) -> tuple[Array, int]:
    """Return the step of one period by what decides each region's order, and how many regions stay open."""
    sample = np.s_[::_SAMPLE_PX, ::_SAMPLE_PX]
    sigma = phase_map.sigma[sample][phase_map.valid[sample]]
    found = decide_regions(
        regions,
        phase_map.modulation,
        phase_map.background,
        epipolar_lines(calibration),
        _plate_phase(calibration),
        float(np.median(sigma)) if sigma.size else 0.0,
        deepest_rad=_deepest_rad(calibration, height_range_mm),
    )
    orders = found.orders
    if height_range_mm is not None:
        orders = _orders_in_range(found, calibration, height_range_mm)
    step = np.empty(reasons.shape)
    over_bands(add_turns, len(step), found.regions.values, found.regions.labels, TURN * orders, step)
    reasons[(reasons == 0) & beside_edges(step, found.regions, phase_map.modulation)] = int(Reason.EDGE)
    return step, int(np.isnan(orders[1:]).sum())


def _deepest_rad(calibration: RigCalibration, height_range_mm: tuple[float, float] | None) -> float:
    """Return the step of the lowest that an object can be, rad: the plate, unless less is stated."""
    if height_range_mm is None or not -np.inf < height_range_mm[0] < 0:
        return DEEPEST_RAD
    return DEEPEST_RAD - 2 * abs(float(_steps_at_centre(calibration, (height_range_mm[0],))[0]))


def _plate_phase(calibration: RigCalibration) -> Callable[[Array, Array], Array]:
    """Return the plate's phase as a function of the place in the picture."""

    def at(u: Array, v: Array) -> Array:
        rays = calibration.camera.rays(u, v)
        return calibration.model.phase(rays.ax, rays.ay, 0.0)

    return at


def _orders_in_range(found: DecidedRegions, calibration: RigCalibration, height_range_mm: tuple[float, float]) -> Array:
    """Decide what is open by the heights that are stated, among the orders that evidence leaves."""
    orders = found.orders.copy()
    open_regions = np.flatnonzero(np.isnan(orders[1:])) + 1
    values, labels = found.regions.values, found.regions.labels
    for region, pixels in pixels_of(labels, open_regions.tolist()):
        if pixels.size:
            order = order_by_height(
                values, pixels, TURN, lambda step, at: _heights_at(calibration, step, at), height_range_mm
            )
            if order is not None and found.leaves(region, order):
                orders[region] = order
    return orders


def _in_cycles(difference_rad: NDArray[np.float32], cycle: int) -> Unwrapped:
    """Find what is connected; pixels beside edges belong to no piece and keep their step."""
    found = pieces_in_cycles(difference_rad, cycle)
    return Unwrapped(np.where(found.pieces > 0, found.phase, difference_rad), found.pieces)


def _steps_at_centre(calibration: RigCalibration, heights_mm: tuple[float, ...]) -> Array:
    """Return the phase over the plate's of what stands so high in the middle of the picture, rad."""
    u, v = (np.array([c]) for c in calibration.camera.centre_px)
    rays = calibration.camera.rays(u, v)
    z = np.array(heights_mm)
    x, y = rays.at(z)
    return calibration.model.phase(x, y, z) - calibration.model.phase(rays.ax, rays.ay, 0.0)


def _rising(calibration: RigCalibration) -> int:
    """Return the sign of the phase difference of what stands on the plate."""
    return int(np.sign(_steps_at_centre(calibration, (1.0,))[0]))


def _range_turns(
    calibration: RigCalibration, height_range_mm: tuple[float, float] | None, cycle: int
) -> tuple[float, float]:
    """Return in how many cycles over the plate the stated heights lie; an end that is not stated is the plate's."""
    if height_range_mm is None:
        return 0.0, 0.0
    stated = tuple(height if np.isfinite(height) else 0.0 for height in height_range_mm)
    low, high = _rising(calibration) * _steps_at_centre(calibration, stated) / (2 * np.pi * cycle)
    return float(low), float(high)


def _wrapped_step(phase_map: PhaseMap, calibration: RigCalibration) -> NDArray[np.float32]:
    """Phase minus the plate's modulo 2 pi, NaN where either is missing."""
    rows = rig_rows(calibration)
    if rows is None:
        rays = calibration.camera.pixel_rays()
        step = wrap(phase_map.phase - calibration.model.phase(rays.ax, rays.ay, 0.0))
        return np.where(phase_map.valid, step, np.nan).astype(np.float32)
    wrapped = np.empty(phase_map.phase.shape, np.float32)
    over_bands(steps_over_plate, len(wrapped), phase_map.phase, phase_map.reasons, rows, wrapped)
    return wrapped


def _heights_at(calibration: RigCalibration, difference_rad: Array, pixels: NDArray[np.intp]) -> Array:
    """Heights of phase differences to the plate at some pixels."""
    v, u = np.divmod(pixels, calibration.camera.width_px)
    rays = calibration.camera.rays(u, v)
    return calibration.model.height(difference_rad + calibration.model.phase(rays.ax, rays.ay, 0.0), rays)
