"""From a capture's fringes along the axes of a projector to the projector's pixel that lights each of the camera's."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import PhaseError, SessionError
from fringecal.numerics import TURN, wrap
from fringecal.phase import (
    Adapted,
    PhaseMap,
    RasterCoordinate,
    Waveform,
    demodulate,
    orders_by_gray,
    raster_by_gray,
    raster_coordinate,
    raster_of_frames,
)
from fringecal.session import Capture, FringeAxis
from fringecal.workflows.shared.capture_phase import adapted_set, frames_of, shortest_period, why_masked


@dataclass(frozen=True)
class AxisPhase:
    """Projector coordinates of a capture along one axis, and the corrected phase of its shortest fringes.

    `adapted` is None where phase maps stand in place of frames.
    """

    axis: str
    adapted: Adapted | None
    raster: RasterCoordinate


def raster_of_capture(
    capture: Capture,
    axis: str,
    *,
    like: RasterCoordinate | None = None,
    wave: Waveform | None = None,
    dark: bool = True,
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
    dark
        Whether pixels count that are too dark to be numbered without their neighbours.

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
    lit = lit_by_projector(capture)
    try:
        raster = _by_steps(one, main, like, lit) if goes_by_steps(one, main) else None
        if raster is None or (dark and _open_share(raster, main, lit) > _MOST_OPEN):
            raster = _by_maps(one, main, like, lit)
    except PhaseError as error:
        raise PhaseError(f"capture {capture.name!r}, axis {axis}: {error}") from error
    return AxisPhase(axis, main, raster if lit is None else raster.within(lit))


def _open_share(raster: RasterCoordinate, main: Adapted, lit: NDArray[np.bool_] | None) -> float:
    """Return the share of the pixels that carry a phase, and are lit, whose coordinate is open."""
    seen = main.map.valid if lit is None else main.map.valid & lit
    return float(np.mean(~np.isfinite(raster.px[seen]))) if seen.any() else 0.0


def goes_by_steps(capture: Capture, main: Adapted) -> bool:
    """Tell whether `raster_of_frames` counts along a capture's only axis: nested periods, and frames as stated."""
    axis = capture.axes[0]
    nested = len(axis.periods_px) > 1 and max(axis.periods_px) >= axis.extent_px
    bends = main.wave is not None and main.wave.matters(main.scheme)
    return nested and not (capture.gray_paths or capture.repeat > 1 or main.undone or bends)


def _by_maps(
    one: Capture, main: Adapted, like: RasterCoordinate | None, lit: NDArray[np.bool_] | None
) -> RasterCoordinate:
    """Count by the phase maps of all periods, each with what its frames show to differ from what is stated."""
    shortest = shortest_period(one)
    maps = [main.map if k == shortest else adapted_set(one, k, main.wave).map for k in range(len(one.periods))]
    # What the projector does not reach carries noise alone, and asks its neighbours for nothing.
    maps = [each if lit is None else _within(each, lit) for each in maps]
    return raster_of_maps(maps, one.axes[0], one.read_gray() if one.gray_paths else None, like=like)


def _within(each: PhaseMap, lit: NDArray[np.bool_]) -> PhaseMap:
    return replace(each, phase=np.where(lit, each.phase, np.float32(np.nan)))


def _by_steps(
    one: Capture, main: Adapted, like: RasterCoordinate | None, lit: NDArray[np.bool_] | None
) -> RasterCoordinate:
    """Count from period to period in one pass; zeros and direction that are not known are read on some pixels."""
    axis, sets = one.axes[0], [frames_of(one, period=k) for k in range(len(one.periods))]
    known = _constants(one, main, sets, like, lit)
    found = raster_of_frames(
        sets,
        main.scheme,
        axis.periods_px,
        axis.extent_px,
        zeros_rad=known.zeros_rad,
        falls=known.falls,
        noise=main.map.noise,
        white_level=one.white_level,
    )
    per_rad = np.float32(min(axis.periods_px) / TURN)
    return replace(found, u_px=main.map.sigma * per_rad).within(main.map.valid)


def _constants(
    one: Capture,
    main: Adapted,
    sets: Sequence[NDArray[np.generic]],
    like: RasterCoordinate | None,
    lit: NDArray[np.bool_] | None,
) -> RasterCoordinate:
    """Count on a thinned picture, for the zeros and the direction that hold for all of it."""
    step = max(1, int(np.sqrt(main.map.phase.size / _SAMPLE)))
    few = [
        demodulate(frames[:, ::step, ::step], main.scheme, white_level=one.white_level, noise=main.map.noise)
        for frames in sets
    ]
    few = few if lit is None else [_within(each, lit[::step, ::step]) for each in few]
    return raster_of_maps(few, one.axes[0], like=like)


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


_SAMPLE = 160_000  # pixels that the periods' zeros are read on: to a four-hundredth of the noise of one
_MOST_OPEN = 0.005  # of the pixels with a phase that may stay open: edges and glare; more are a dark surface
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
