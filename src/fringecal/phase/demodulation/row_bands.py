"""Large pictures a strip of rows at a time: memory for a strip, whatever the pictures' size."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.phase.demodulation.demodulate import PhaseMap, demodulate, least_modulation
from fringecal.phase.demodulation.noise import BAND_ROWS, MAX_SAMPLE_PIXELS, estimate_noise
from fringecal.phase.demodulation.schemes import Scheme, least_squares


def demodulate_strips(
    frames: Sequence[Any], phase_shifts_rad: ArrayLike | Scheme, *, rows: int = 512, white_level: float | None = None
) -> Iterator[tuple[slice, PhaseMap]]:
    """Demodulate frames that need not fit into memory.

    Parameters
    ----------
    frames
        N pictures, (H, W) each, that can be sliced by rows: arrays, `numpy.memmap`, a file's lazy reader.
    phase_shifts_rad
        Phase shifts delta_n in frame order, rad, (N,), or a `Scheme`.
    rows
        Rows of a strip.
    white_level
        Grey value of saturation, as for `demodulate`.

    Yields
    ------
    slice, PhaseMap
        The rows, and their phase map, whose buffers the next strip overwrites: write it away, or copy it. Noise
        and least modulation are those of the whole picture, from bands spread over it.

    Raises
    ------
    PhaseError
        Frames of different size, or not as many as phase shifts.

    Examples
    --------
    >>> pictures = [np.full((1000, 64), grey, np.uint8) for grey in (170, 95, 95)]
    >>> strips = demodulate_strips(pictures, np.deg2rad([0, 120, 240]), rows=400)
    >>> [(strip.start, map_.phase.shape[0]) for strip, map_ in strips]
    [(0, 400), (400, 400), (800, 200)]
    """
    scheme = phase_shifts_rad if isinstance(phase_shifts_rad, Scheme) else least_squares(phase_shifts_rad)
    shapes = {tuple(np.shape(frame)) for frame in frames}
    if len(shapes) != 1 or len(frames) != len(scheme.phase_shifts_rad) or rows < 1:
        raise PhaseError(
            f"found {len(frames)} frames of shapes {sorted(shapes)} for {len(scheme.phase_shifts_rad)} phase shifts, "
            f"bands of {rows} rows; needed: one frame per phase shift, all of one size, and 1 row or more"
        )
    bands = _bands(frames)
    noise = estimate_noise(bands, scheme, white_level=white_level)
    least = least_modulation(bands, scheme)
    buffers: PhaseMap | None = None
    for top in range(0, len(frames[0]), rows):
        part = np.stack([np.asarray(frame[top : top + rows]) for frame in frames])
        fits = buffers is not None and buffers.phase.shape == part.shape[1:]
        buffers = demodulate(
            part,
            scheme,
            white_level=white_level,
            noise=noise,
            min_modulation=least,
            out=buffers if fits else None,
        )
        yield slice(top, top + part.shape[1]), buffers


def _bands(frames: Sequence[Any]) -> NDArray:
    """Return bands of rows spread evenly over the frames, no more than a sample needs, (N, h, W)."""
    height, width = np.shape(frames[0])
    count = int(np.clip(MAX_SAMPLE_PIXELS // (BAND_ROWS * width), 1, max(height // BAND_ROWS, 1)))
    tops = np.linspace(0, max(height - BAND_ROWS, 0), count).astype(int)
    return np.stack([np.concatenate([np.asarray(frame[t : t + BAND_ROWS]) for t in tops]) for frame in frames])
