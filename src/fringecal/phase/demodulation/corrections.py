"""Corrections by what the frames show: drifting brightness, and phase shifts that change over the field."""

from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from fringecal.numerics import over_bands
from fringecal.phase.demodulation.demodulate import PhaseMap
from fringecal.phase.demodulation.phase_shifts import PhaseShiftEstimate
from fringecal.phase.demodulation.schemes import Scheme, least_squares

_ITERATIONS = 3  # the error falls by the square of the phase shift's error each time: 5 deg to below 1e-5 rad


def equalise(found: PhaseShiftEstimate, *, phase_shifts_rad: ArrayLike | None = None) -> Scheme:
    """Return the scheme that demodulates frames of different brightness as if the lamp had not drifted.

    Parameters
    ----------
    found
        Phase shifts, gains and offsets, best measured on the same frames.
    phase_shifts_rad
        Phase shifts to use, rad, (N,); by default those found.

    Notes
    -----
    Frame n is taken as `background_n A + gain_n B cos(phi + delta_n) + offset_n`. Gain and background act alike on
    bright and on dark parts; what is added everywhere alike (a raised black level) is the offset. Which of the two
    a background is, is read from how it changes over the picture.
    """
    return least_squares(
        found.phase_shifts_rad if phase_shifts_rad is None else phase_shifts_rad,
        name="equalised",
        gains=found.gain_per_frame,
        offsets=found.offset_per_frame,
        backgrounds=found.background_per_frame,
    )


def correct_phase_shifts(map_: PhaseMap, scheme: Scheme, gradient_rad_px: ArrayLike) -> PhaseMap:
    """Correct a change of the phase shifts that is linear over the field.

    Parameters
    ----------
    map_
        A set demodulated with phase shifts that are right in the middle of the picture.
    scheme
        The scheme used.
    gradient_rad_px
        Change of each phase shift along u and v, rad/px, (N, 2), such as `PhaseShiftEstimate.gradient_rad_px`.

    Returns
    -------
    PhaseMap
        The same with the phase corrected.

    Notes
    -----
    The scheme's answer to frames with the pixel's own phase shifts is computed for a phase, compared with the phase
    found, and the phase moved by the difference, three times.
    """
    gradient = np.asarray(gradient_rad_px, np.float64)
    rows = np.column_stack([np.asarray(scheme.phase_shifts_rad), gradient, scheme.weights[1:].T])
    gains: NDArray = np.asarray(scheme.gains or np.ones(len(rows)))
    moved = np.empty_like(map_.phase)
    over_bands(_move, len(moved), map_.phase, rows, gains, moved)
    return replace(map_, phase=moved)


@njit(nogil=True, cache=True)
def _move(first, last, phase, rows, gains, result):  # type: ignore[no-untyped-def]
    """Correct some rows; `rows` (N, 5) holds phase shift, slope along u, along v, and both weights."""
    height, width = phase.shape
    for i in range(first, last):
        for j in range(width):
            found = np.float64(phase[i, j])
            true = found
            for _ in range(_ITERATIONS if np.isfinite(found) else 0):
                c, s = 0.0, 0.0
                for n in range(rows.shape[0]):
                    step = rows[n, 0] + rows[n, 1] * (j - (width - 1) / 2) + rows[n, 2] * (i - (height - 1) / 2)
                    wave = gains[n] * np.cos(true + step)
                    c += rows[n, 3] * wave
                    s += rows[n, 4] * wave
                error = np.arctan2(s, c) - found
                true -= error - 2 * np.pi * np.rint(error / (2 * np.pi))
            wrapped = np.float32(true - 2 * np.pi * np.ceil(true / (2 * np.pi) - 0.5))
            result[i, j] = np.float32(np.pi) if wrapped <= -np.float32(np.pi) else wrapped
