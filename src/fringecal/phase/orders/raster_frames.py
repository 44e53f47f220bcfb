"""From the frames of nested periods to a coordinate of the projector in one pass, for pictures of many megapixels."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import over_bands
from fringecal.phase.demodulation.demodulate import least_modulation
from fringecal.phase.demodulation.noise import Noise, estimate_noise
from fringecal.phase.demodulation.schemes import Scheme, least_squares
from fringecal.phase.orders.raster_coordinate import RasterCoordinate
from fringecal.phase.orders.raster_kernels import PeriodArrays, coordinates_in_rows

_WHOLE = 1 - 1e-9  # of the projector that the longest period must span: rounding


def raster_of_frames(
    sets: Sequence[ArrayLike],
    phase_shifts_rad: ArrayLike | Scheme,
    periods_px: Sequence[float],
    extent_px: float,
    *,
    zeros_rad: Sequence[float] | None = None,
    falls: bool = False,
    noise: Noise | None = None,
    white_level: float | None = None,
) -> RasterCoordinate:
    """Count projector pixels by frames of periods of which the longest spans the projector.

    Parameters
    ----------
    sets
        Frames of each period, (N, H, W) of one type: uint8, uint16, or others, which are read as float32.
    phase_shifts_rad
        Phase shifts delta_n of every set, rad, (N,), or a `Scheme`.
    periods_px
        Fringe period of each set, px of the projector, in any order.
    extent_px
        Pixels of the projector along the axis.
    zeros_rad
        Phase of each period at the first pixel, rad; 0 by default.
    falls
        Whether the phase falls along the axis.
    noise
        The camera's noise; by default estimated from the frames of the shortest period.
    white_level
        Grey value of saturation; by default the largest of an integer type.

    Notes
    -----
    Each period takes the order nearest to the coordinate of the longer ones. A pixel has none where the longer ones
    leave 4.5 standard uncertainties more than half a fringe, or disagree by 0.4 of one, and where a frame is saturated
    or the modulation is below what `demodulate` believes. Zeros that are not known, waves that are not cosines and
    periods that only meet by their beats: `demodulate_adapted` and `raster_coordinate`.

    Raises
    ------
    PhaseError
        Sets that do not fit one another, or a longest period that does not span the projector.
    """
    order = np.argsort(-np.asarray(periods_px, float), kind="stable")
    scheme = phase_shifts_rad if isinstance(phase_shifts_rad, Scheme) else least_squares(phase_shifts_rad)
    frames = _demanded(sets, scheme, periods_px, extent_px)
    zeros = np.zeros(len(frames)) if zeros_rad is None else np.asarray(zeros_rad, float)
    found = estimate_noise(frames[int(order[-1])], scheme) if noise is None else noise
    px, u_px = np.empty(frames[0].shape[1:]), np.empty(frames[0].shape[1:], np.float32)
    periods = _arrays(
        [frames[k] for k in order], scheme, np.asarray(periods_px, float)[order], zeros[order], white_level
    )
    rules = tuple(np.float32(x) for x in (-1 if falls else 1, (extent_px - 1) / 2, found.gain, found.read_sigma**2))
    over_bands(coordinates_in_rows, px.shape[0], tuple(frames[k] for k in order), periods, rules, px, u_px)
    longest = float(max(periods_px))
    return RasterCoordinate(px, u_px, extent_px, longest, tuple(float(z) for z in zeros), falls)


def _demanded(
    sets: Sequence[ArrayLike], scheme: Scheme, periods_px: Sequence[float], extent_px: float
) -> list[NDArray[np.generic]]:
    """Return the frames as contiguous arrays of one type that kernels take."""
    frames = [np.asarray(each) for each in sets]
    wanted = (len(scheme.phase_shifts_rad), *frames[0].shape[1:]) if frames else ()
    if len(frames) != len(periods_px) or any(f.shape != wanted or f.dtype != frames[0].dtype for f in frames):
        raise PhaseError(
            f"{len(periods_px)} periods and frames of the shapes {[f.shape for f in frames]}; needed is one set of "
            f"{len(scheme.phase_shifts_rad)} frames for each, all of one size and type"
        )
    if max(periods_px) < _WHOLE * extent_px:
        raise PhaseError(
            f"the longest period of {max(periods_px):g} px repeats within the projector's {extent_px:g} px; use "
            "raster_coordinate, which counts by beats, or add a longer period"
        )
    kept = frames[0].dtype in (np.uint8, np.uint16)
    return [np.ascontiguousarray(f if kept else f.astype(np.float32)) for f in frames]


def _arrays(
    frames: Sequence[NDArray[Any]], scheme: Scheme, periods: NDArray[Any], zeros: NDArray[Any], white: float | None
) -> PeriodArrays:
    """Return what the kernels need of each period."""
    n, top = len(frames), np.inf if white is None else np.nextafter(np.float32(white), np.float32(-np.inf))
    if white is None and np.issubdtype(frames[0].dtype, np.integer):
        top = float(np.iinfo(frames[0].dtype).max) - 1
    single = np.float32
    return PeriodArrays(
        np.repeat(scheme.weights.astype(single)[None], n, axis=0),
        periods.astype(single),
        zeros.astype(single),
        np.array([least_modulation(f, scheme) for f in frames], single),
        np.full(n, top, single),
        np.full(n, float((scheme.weights[1:] ** 2).sum() / 2), single),
    )
