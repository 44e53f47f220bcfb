"""From a capture's fringes along the axes of a projector to the projector's pixel that lights each of the camera's."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import PhaseError, SessionError
from fringecal.numerics import TURN, wrap
from fringecal.phase import (
    Adapted,
    PhaseMap,
    RasterCoordinate,
    Waveform,
    orders_by_gray,
    raster_by_gray,
    raster_coordinate,
)
from fringecal.session import Capture, FringeAxis
from fringecal.workflows.shared.capture_phase import adapted_set, shortest_period, why_masked


@dataclass(frozen=True)
class AxisPhase:
    """Projector coordinates of a capture along one axis, and the corrected phase of its shortest fringes.

    `adapted` is None where phase maps stand in place of frames.
    """

    axis: str
    adapted: Adapted | None
    raster: RasterCoordinate


def raster_of_capture(
    capture: Capture, axis: str, *, like: RasterCoordinate | None = None, wave: Waveform | None = None
) -> AxisPhase:
    """Count the projector's pixels along one axis by a capture's fringes.

    Parameters
    ----------
    capture
        A capture that states its axes.
    axis
        "u" or "v".
    like
        What another capture of the same rig gave: its phase zeros are used, and the phase falls if it does there.
    wave
        Waveform as found on another capture.

    Raises
    ------
    SessionError
        The capture has no fringes along the axis.
    PhaseError
        The frames hold no phase, or contradict the stated periods.
    """
    if capture.maps:
        return AxisPhase(axis, None, _raster_of_stated(capture, axis, like))
    one = capture.along(axis)
    shortest = shortest_period(one)
    main = adapted_set(one, shortest, wave)
    if not main.map.valid.any():
        raise PhaseError(f"capture {capture.name!r}: no pixel carries fringes along {axis} ({why_masked(main.map)})")
    maps = [main.map if k == shortest else adapted_set(one, k, main.wave).map for k in range(len(one.periods))]
    lit = lit_by_projector(capture)
    try:
        raster = raster_of_maps(maps, one.axes[0], one.read_gray() if one.gray_paths else None, like=like)
    except PhaseError as error:
        raise PhaseError(f"capture {capture.name!r}, axis {axis}: {error}") from error
    return AxisPhase(axis, main, raster if lit is None else raster.within(lit))


def _raster_of_stated(capture: Capture, axis: str, like: RasterCoordinate | None) -> RasterCoordinate:
    """Count by maps that another program made: an absolute one as it is, or several wrapped ones together."""
    maps = [one for one in capture.maps if one.axis == axis]
    if not maps:
        known = ", ".join(capture.counted_axes)
        raise SessionError([f"capture {capture.name!r}: no map changes along {axis}, only along {known}"])
    lit = lit_by_projector(capture)
    counted = next((one for one in maps if one.absolute), None)
    if counted is not None:
        per_rad = counted.period_px / TURN
        px = (counted.phase_rad - counted.zero_rad) * per_rad * (-1 if counted.falls else 1)
        u_px = np.full(px.shape, counted.u_rad * per_rad, np.float32)
        raster = RasterCoordinate(px, u_px, counted.extent_px, np.inf, (counted.zero_rad,), counted.falls)
    else:
        phases = np.stack([wrap(one.phase_rad) for one in maps])
        sigmas = np.stack([np.full(one.phase_rad.shape, one.u_rad) for one in maps])
        zeros = [one.zero_rad for one in maps] if any(one.zero_rad for one in maps) or like is None else like.zeros_rad
        try:
            raster = raster_coordinate(
                phases,
                sigmas,
                [one.period_px for one in maps],
                maps[0].extent_px,
                zeros_rad=zeros if any(zeros) else None,
                falls=True if maps[0].falls else None,
            )
        except PhaseError as error:
            raise PhaseError(f"capture {capture.name!r}, axis {axis}: {error}") from error
    return raster if lit is None else raster.within(lit)


_LIT = 0.02  # of the white level, by which white must exceed black: less is what shadows scatter


def lit_by_projector(capture: Capture) -> NDArray[np.bool_] | None:
    """Mask what the projector lights, from the pictures lit evenly and not at all; None where they are not both there.

    A pixel that the white picture saturates is lit: its fringes, which are darker, may be sound.
    """
    white, black = capture.read_light("white"), capture.read_light("black")
    return None if white is None or black is None else white - black > _LIT * capture.white_level


def raster_of_maps(
    maps: Sequence[PhaseMap], axis: FringeAxis, gray: NDArray | None = None, *, like: RasterCoordinate | None = None
) -> RasterCoordinate:
    """Count the projector's pixels by the phase maps of all periods of one axis, or by a Gray code.

    Parameters
    ----------
    maps
        One for each period, in the order of `axis.periods_px`.
    axis
        What the session states of them.
    gray
        Gray-code frames, (N, H, W), the coarsest bit first.
    like
        What another capture of the same rig gave.

    Raises
    ------
    PhaseError
        The maps contradict the periods or the code.
    """
    if gray is not None:
        shortest = int(np.argmin(axis.periods_px))
        zero = axis.zeros_rad[shortest] if axis.zeros_rad else 0.0
        orders, sigma = orders_by_gray(maps[shortest], gray), maps[shortest].sigma
        return raster_by_gray(orders, sigma, axis.periods_px[shortest], axis.extent_px, zero_rad=zero)
    zeros = axis.zeros_rad or (() if like is None else like.zeros_rad)
    falls = like.falls if axis.falls is None and like is not None else axis.falls
    phases, sigmas = np.stack([one.phase for one in maps]), np.stack([one.sigma for one in maps])
    return raster_coordinate(phases, sigmas, axis.periods_px, axis.extent_px, zeros_rad=zeros or None, falls=falls)
