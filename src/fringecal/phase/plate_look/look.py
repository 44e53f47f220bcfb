"""What the bare plate of a calibration looks like: light and contrast over the field, and pieces of its texture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.phase.demodulation.demodulate import PhaseMap
from fringecal.phase.plate_look.neighbours import neighbour_scatter
from fringecal.phase.plate_look.texture import LEAST_SHARE, texture_of

Array = NDArray[np.float64]

TILE_PX = 40
"""Side of a piece of texture: some fringes, so that what fringes leave in the background can be told from texture."""

_TILES = (7, 5)  # across and down: 56 000 pixels, beside most objects
_CELLS = (16, 12)  # of the maps of light: light and contrast change over tens of pixels and more


@dataclass(frozen=True)
class PlateLook:
    """The bare plate as its calibration saw it.

    Parameters
    ----------
    shape
        Height and width of the picture, px.
    background, modulation
        Medians over cells of the picture, grey levels, (12, 16); NaN where nothing was seen.
    corners_px
        Column and row of the first pixel of every piece of texture, (T, 2).
    texture
        Background of these pieces less what varies smoothly and what the fringes leave in it, grey levels,
        (T, 40, 40); NaN where nothing was seen.
    noise_levels
        Standard deviation of the noise in `texture`, grey levels.
    phase_shifts_rad
        Phase shifts that the frames had, rad, (N,); empty where not kept.
    neighbour_scatter
        Scatter of neighbours' phases over what their noise says (`neighbour_scatter`); NaN where not kept.
    """

    shape: tuple[int, int]
    background: Array
    modulation: Array
    corners_px: NDArray[np.intp]
    texture: NDArray[np.float32]
    noise_levels: float
    phase_shifts_rad: tuple[float, ...] = ()
    neighbour_scatter: float = float("nan")

    @classmethod
    def of(cls, seen: PhaseMap) -> "PlateLook":
        """Take what the phase map of the bare plate shows.

        The background is the mean of the frames, and its noise `u(phi) B / sqrt 2`: with N equal phase shifts
        `u(phi) = sqrt(2/N) sigma / B`.

        Parameters
        ----------
        seen
            The bare plate.
        """
        corners, pieces = [], []
        for u, v in _corners(seen.phase.shape):
            place = np.s_[v : v + TILE_PX, u : u + TILE_PX]
            piece = texture_of(seen.background[place], seen.phase[place])
            if np.isfinite(piece).mean() >= LEAST_SHARE:
                corners.append((u, v))
                pieces.append(piece)
        few = np.s_[:: max(1, seen.phase.shape[0] // 200), :: max(1, seen.phase.shape[1] // 200)]
        return cls(
            seen.phase.shape,
            cells_of(seen.background, seen.valid),
            cells_of(seen.modulation, seen.valid),
            np.array(corners, np.intp).reshape(-1, 2),
            np.array(pieces, np.float32).reshape(-1, TILE_PX, TILE_PX),
            float(np.nanmedian(seen.sigma[few] * seen.modulation[few])) / 2**0.5,
            neighbour_scatter=neighbour_scatter(seen)[0],
        )


def cells_of(values: NDArray[np.floating], valid: NDArray[np.bool_]) -> Array:
    """Return medians of a map over the cells of `PlateLook.background`, NaN where nothing is valid."""
    step = [max(1, length // (4 * cells)) for length, cells in zip(values.shape, _CELLS[::-1], strict=True)]
    sample = np.where(valid[:: step[0], :: step[1]], values[:: step[0], :: step[1]], np.nan).astype(float)
    down, across = (
        np.arange(length) * cells // length for length, cells in zip(sample.shape, _CELLS[::-1], strict=True)
    )
    cell = (down[:, None] * _CELLS[0] + across[None, :]).ravel()
    known = np.isfinite(sample.ravel())
    found = np.full(_CELLS[0] * _CELLS[1], np.nan)
    order = np.argsort(cell[known], kind="stable")
    numbers, starts = np.unique(cell[known][order], return_index=True)
    for number, part in zip(numbers, np.split(sample.ravel()[known][order], starts[1:]), strict=True):
        found[number] = np.median(part)
    return found.reshape(_CELLS[::-1])


def _corners(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Return where pieces of texture are taken: evenly over the picture; none of a picture that is too small."""
    places = []
    for length, number in zip(shape[::-1], _TILES, strict=True):
        number = min(number, length // TILE_PX)
        pitch = length / max(number, 1)
        places.append([int(pitch * (k + 0.5) - TILE_PX / 2) for k in range(number)])
    return [(u, v) for v in places[1] for u in places[0]]
