"""Coarse candidates for grid crossings: extrema of the band-passed picture on the levels of a pyramid."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from fringecal.detect.grid_lattice import Lattice, grow_lattice

FloatArray = npt.NDArray[np.floating]

# One octave of line spacing per level: at 6 to 12 level pixels a Gaussian of 1.5 px keeps 29 to 73 % of
# the grid's fundamental and suppresses its harmonics, so a crossing is one clear extremum.
LEVEL_SIGMA_PX = 1.5
BACKGROUND_SIGMA_PX = 6.0
COARSEST_LEVEL_PX = 40
MIN_CROSSINGS = 9
# An extremum must stand out of its surroundings by this part of their rms.
MIN_PROMINENCE = 0.4
# Rounding leaves ripples of this size on flat paper; they are no extrema.
MIN_RELATIVE_BAND = 1e-3
MAX_SEED_TRIES = 12


@dataclass(frozen=True)
class CoarseGrid:
    """A lattice of candidate crossings in full-resolution pixels, and the polarity it was found with."""

    lattice: Lattice
    sign: int


def coarse_grids(image: npt.NDArray[np.float32], *, signs: tuple[int, ...]) -> list[CoarseGrid]:
    """Grow lattices on every pyramid level and polarity, the largest first.

    Parameters
    ----------
    image
        Grey picture, float32, (H, W).
    signs
        Polarities to try: -1 for dark lines, +1 for light ones.
    """
    found = [
        CoarseGrid(lattice, sign)
        for level, factor in _pyramid(image)
        for sign in signs
        if (lattice := _level_lattice(level, factor, sign)) is not None
    ]
    return sorted(found, key=lambda grid: -grid.lattice.column.size)


def _pyramid(image: npt.NDArray[np.float32]) -> Iterator[tuple[npt.NDArray[np.float32], int]]:
    """Yield the picture averaged over 1, 2, 4 ... pixels, with the factor."""
    level, factor = image, 1
    while min(level.shape) >= COARSEST_LEVEL_PX:
        yield level, factor
        height, width = level.shape[0] // 2, level.shape[1] // 2
        level = cv2.resize(level[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
        factor *= 2


def _level_lattice(level: npt.NDArray[np.float32], factor: int, sign: int) -> Lattice | None:
    """Best lattice through the extrema of one level, in full-resolution pixels."""
    points = _extrema(level, sign)
    if len(points) < MIN_CROSSINGS:
        return None
    lattice = grow_lattice(points, tries=MAX_SEED_TRIES)
    if lattice is None or lattice.column.size < MIN_CROSSINGS:
        return None
    # Centre of the level pixel i is (i + 1/2) * factor - 1/2 in full-resolution pixels.
    return lattice.scaled(factor)


def _extrema(level: npt.NDArray[np.float32], sign: int) -> npt.NDArray[np.float64]:
    """Sub-pixel positions (n, 2) of the crossings' extrema: maxima of the signed band-passed level."""
    smooth = cv2.GaussianBlur(level, (0, 0), LEVEL_SIGMA_PX)
    band = np.float32(sign) * (smooth - cv2.GaussianBlur(smooth, (0, 0), BACKGROUND_SIGMA_PX))
    rms = np.sqrt(np.maximum(cv2.blur(band * band, (31, 31)), 0))
    floor = np.float32(MIN_RELATIVE_BAND * band.max())
    peak = (band >= cv2.dilate(band, np.ones((3, 3), np.uint8))) & (band > MIN_PROMINENCE * rms + floor)
    peak[[0, -1], :] = False
    peak[:, [0, -1]] = False
    row, column = np.nonzero(peak)
    return np.stack([column + _parabola(band, row, column, 0, 1), row + _parabola(band, row, column, 1, 0)], axis=1)


def _parabola(
    band: FloatArray, row: npt.NDArray[np.intp], column: npt.NDArray[np.intp], down: int, right: int
) -> npt.NDArray[np.float64]:
    """Vertex of the parabola through an extremum and its two neighbours, px, within half a pixel."""
    here = band[row, column].astype(float)
    before = band[row - down, column - right].astype(float)
    after = band[row + down, column + right].astype(float)
    curvature = np.maximum(2 * here - before - after, 1e-12)
    return np.clip(0.5 * (after - before) / curvature, -0.5, 0.5)
