"""What drawing in whole grey values, and a response that is not undone, leave in the phase."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.patterns.frame_drawing import Axis, Raster, fringe_frame
from fringecal.patterns.projector_response import Response

Array = NDArray[np.float64]

_ROWS = 64  # over which dithering is averaged: a camera's pixel sees one or two, its fit of a plate's fringe many
_MOST_PX = 4096  # along the fringes: a period that is not whole meets all its places by then


@dataclass(frozen=True)
class Ripple:
    """Error of the phase that is drawn, rad: root mean square and largest over the picture."""

    rms_rad: float
    most_rad: float


def drawn_ripple(
    raster: Raster,
    period_px: float,
    shifts_rad: Sequence[float],
    *,
    true_response: Response | None = None,
    contrast: float = 1.0,
    dithered: bool = False,
) -> Ripple:
    """Error of the phase when a projector of a response shows the frames that are drawn for it.

    Parameters
    ----------
    raster
        The projector as the frames are drawn for it.
    period_px, shifts_rad
        Of the set.
    true_response
        How the projector's light really follows grey values; by default as `raster` takes it.
    contrast, dithered
        As for `fringecal.patterns.fringe_frame`; dithered frames are averaged along the fringe.

    Notes
    -----
    The phase is that of least squares over evenly weighted frames, `atan2(-b, a)` with a, b the solution of
    `I_n = A + a cos(shift_n) + b sin(shift_n)`.
    """
    line = replace(raster, width_px=min(raster.width_px, _MOST_PX), height_px=_ROWS if dithered else 1)
    response = true_response if true_response is not None else raster.response
    axis: Axis = "u"
    frames = [
        _light(fringe_frame(line, axis, period_px, shift, contrast=contrast, dithered=dithered), line, response)
        for shift in shifts_rad
    ]
    phase = _phase(np.array(frames), np.asarray(shifts_rad, float))
    wanted = 2 * np.pi * np.arange(line.width_px) / period_px
    error = np.angle(np.exp(1j * (phase - wanted)))
    error -= np.angle(np.mean(np.exp(1j * error)))
    return Ripple(math.sqrt(float(np.mean(error**2))), float(np.abs(error).max()))


def _light(frame: NDArray[np.generic], raster: Raster, response: Response | None) -> Array:
    """Light along the axis that a projector shows for a frame, averaged across."""
    grey = frame.astype(float) / float(raster.frame(np.array(raster.white)))
    shown = grey if response is None else response.shown(grey)
    return np.asarray(shown.mean(axis=0))


def _phase(frames: Array, shifts_rad: Array) -> Array:
    design = np.column_stack([np.ones_like(shifts_rad), np.cos(shifts_rad), np.sin(shifts_rad)])
    _, a, b = np.linalg.lstsq(design, frames, rcond=None)[0]
    return np.asarray(np.arctan2(-b, a))
