"""Blocks of a few fringes in which the phase is smooth: what every frame really shows against its carrier.

Three frames determine three unknowns per pixel, so nothing can be checked in any one pixel. Over a few fringes
of a smooth surface it can: there the true phase is a low polynomial, the carrier, and each frame is a wave on it
whose phase, amplitude, background and harmonics are measured on their own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.phase.demodulate import PhaseMap
from fringecal.phase.period import FringePeriod, fringe_period
from fringecal.phase.unwrap import unwrap

BLOCK_FRINGES = 3.0
"""Length of a block in fringe periods: enough to part carrier, harmonics and shading."""

HARMONICS = (2, 3, 4)
"""Orders of the wave's harmonics that are measured."""

RIPPLE_ORDERS = (1, 2, 3, 4, 6)
"""Orders, against the fringes, of the ripple that is told from the carrier."""

_BLOCK_LIMITS_PX = (24, 1500)
_LEAST_ASPECT = 1 / 3  # along the fringes a block need not be as long as across them
_MAX_SAMPLES_ALONG = 64
_LEAST_VALID_SHARE = 0.7
_LEAST_CYCLES_IN_BLOCK = 1.8
_MAX_ROUGHNESS_RAD = 0.35


@dataclass(frozen=True)
class Block:
    """What the frames show in one block.

    Parameters
    ----------
    u_px, v_px
        Centre in the picture.
    signal
        Complex modulation of each frame on the carrier, `c_n + i s_n` of
        `a_n + c_n cos f - s_n sin f`, grey levels, (N,).
    background
        a_n, grey levels, (N,).
    harmonics
        The same as `signal` at the orders of `HARMONICS`, (3, N).
    ripple
        Complex amplitudes of the phase error at `RIPPLE_ORDERS`, rad: the error is
        `Re(r exp(-i k phase))`, (5,).
    rms
        Residual of the frames, rms, grey levels.
    noise
        The same without what all frames of a pixel share in proportion to their light, as texture is: noise, and
        whatever else differs from frame to frame, grey levels.
    """

    u_px: float
    v_px: float
    signal: NDArray[np.complex128]
    background: NDArray[np.float64]
    harmonics: NDArray[np.complex128]
    ripple: NDArray[np.complex128]
    rms: float
    noise: float


def measure_blocks(grey: NDArray, map_: PhaseMap, mask: ArrayLike | None = None) -> list[Block]:
    """Cut the picture into blocks and measure those in which the surface is smooth.

    Parameters
    ----------
    grey
        Frames, grey levels, (N, H, W).
    map_
        The same, demodulated.
    mask
        True where the surface is to be used, (H, W); by default wherever there is a phase.

    Raises
    ------
    PhaseError
        No pixel carries a phase.
    """
    valid = map_.valid if mask is None else map_.valid & np.asarray(mask, bool)
    if not valid.any():
        raise PhaseError("no pixel carries a phase, so no step can be measured: check exposure and stated steps")
    unwrapped = unwrap(map_.phase, valid)
    height, width = valid.shape
    rows, columns = _block_shape(fringe_period(map_.phase, valid), valid.shape)
    blocks = []
    for top in range(0, max(height - rows, 0) + 1, rows):
        for left in range(0, max(width - columns, 0) + 1, columns):
            window = _sampled(top, left, rows, columns)
            block = _measure_block(grey[:, *window], unwrapped.phase[window], unwrapped.pieces[window], window)
            if block is not None:
                blocks.append(block)
    return blocks


def _block_shape(period: FringePeriod, shape: tuple[int, ...]) -> tuple[int, int]:
    """Return rows and columns of a block: a few fringes across, less along them."""
    side = BLOCK_FRINGES * period.period_px
    direction = np.deg2rad(period.direction_deg)
    lengths = side * np.maximum(np.abs([np.sin(direction), np.cos(direction)]), _LEAST_ASPECT)
    least, most = _BLOCK_LIMITS_PX
    rows, columns = (int(np.clip(round(length), least, most)) for length in lengths)
    # Pictures a little shorter than a block are still worth a try.
    return min(rows, max(shape[0], 1)), min(columns, max(shape[1], 1))


def _sampled(top: int, left: int, rows: int, columns: int) -> tuple[slice, slice]:
    """Return the window of a block, thinned where it is large: long fringes need no dense samples."""
    step_v, step_u = (-(-length // _MAX_SAMPLES_ALONG) for length in (rows, columns))
    return slice(top, top + rows, step_v), slice(left, left + columns, step_u)


def _measure_block(grey: NDArray, phase: NDArray, pieces: NDArray, window: tuple[slice, slice]) -> Block | None:
    """Measure all frames of one block against its smooth phase; None where the block is not smooth."""
    largest = np.bincount(pieces[pieces > 0]).argmax() if (pieces > 0).any() else 0
    use = pieces == largest
    if largest == 0 or use.mean() < _LEAST_VALID_SHARE:
        return None
    rows, columns = np.nonzero(use)
    x = (columns - columns.mean()) / phase.shape[1]
    y = (rows - rows.mean()) / phase.shape[0]
    quadratic = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    carrier, ripple, roughness = _carrier(quadratic, phase[use])
    if roughness > _MAX_ROUGHNESS_RAD or np.ptp(carrier) < 2 * np.pi * _LEAST_CYCLES_IN_BLOCK:
        return None
    u = window[1].start + columns.mean() * window[1].step
    v = window[0].start + rows.mean() * window[0].step
    return _fit_frames(grey[:, use].astype(np.float64), carrier, quadratic, ripple, (float(u), float(v)))


def _carrier(quadratic: NDArray, phase: NDArray) -> tuple[NDArray, NDArray[np.complex128], float]:
    """Fit a quadratic and a ripple together; return the quadratic, the ripple's amplitudes and the rms left."""
    waves = [f(k * phase) for k in RIPPLE_ORDERS for f in (np.cos, np.sin)]
    basis = np.column_stack([quadratic, *waves])
    # Normal equations: few well-scaled columns, thousands of rows; a trace keeps them regular.
    normal = basis.T @ basis
    normal[np.diag_indices_from(normal)] *= 1 + 1e-9
    coefficients = np.linalg.solve(normal, basis.T @ phase)
    left = phase - basis @ coefficients
    pairs = coefficients[quadratic.shape[1] :].reshape(-1, 2)
    return quadratic @ coefficients[: quadratic.shape[1]], pairs @ [1, 1j], float(np.sqrt(np.mean(left**2)))


def _fit_frames(
    grey: NDArray, carrier: NDArray, quadratic: NDArray, ripple: NDArray, centre: tuple[float, float]
) -> Block:
    """Fit every frame of a block by shading, carrier with a slope, and harmonics."""
    slopes = quadratic[:, :3]
    waves = [f(k * carrier) for k in HARMONICS for f in (np.cos, lambda x: -np.sin(x))]
    basis = np.concatenate(
        [quadratic, slopes * np.cos(carrier)[:, None], slopes * -np.sin(carrier)[:, None], np.column_stack(waves)],
        axis=1,
    )
    coefficients = np.linalg.solve(basis.T @ basis, basis.T @ grey.T)
    residual = grey.T - basis @ coefficients
    signal = coefficients[6] + 1j * coefficients[9]
    harmonics = coefficients[12::2] + 1j * coefficients[13::2]
    return Block(*centre, signal, coefficients[0], harmonics, ripple, _rms(residual), _noise(residual, grey.T))


def _rms(residual: NDArray) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def _noise(residual: NDArray, grey: NDArray) -> float:
    """Return the rms residual without texture: in each pixel (row) the part in proportion to its light."""
    n = grey.shape[1]
    texture = (residual * grey).sum(axis=1) / np.maximum((grey * grey).sum(axis=1), 1e-12)
    return _rms(residual - texture[:, None] * grey) * float(np.sqrt(n / (n - 1)))
