"""Coarse candidates for grid crossings: extrema of the band-passed picture on the levels of a pyramid."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from fringecal.detect.grid.lattice import Lattice, grow_lattice

FloatArray = npt.NDArray[np.floating]

# One octave of line spacing per level: at 6 to 12 level pixels a Gaussian of 1.5 px keeps 29 to 73 % of
# the grid's fundamental and suppresses its harmonics, so a crossing is one clear extremum.
LEVEL_SIGMA_PX = 1.5
# The ground is what a Gaussian of this width leaves: half of a level's widest spacing.
BACKGROUND_SIGMA_PX = 6.0
# Shorter side of the coarsest level: three lines of the widest spacing.
COARSEST_LEVEL_PX = 40
# Extrema of a lattice, and crossings of a grid: three by three.
MIN_CROSSINGS = 9
# Ground and rms are taken from the level reduced by this: nothing finer survives in them. The rms is that over so many
# pixels of it squared, about 30 x 30 of the level.
REDUCED, RMS_PX = 4, 7
# An extremum must stand out of its surroundings by this part of their rms.
MIN_PROMINENCE = 0.4
# Rounding leaves ripples of this size on flat paper; they are no extrema.
MIN_RELATIVE_BAND = 1e-3
# Seeds that are grown before the largest lattice is taken: a cover or dirt may hide the best ones.
MAX_SEED_TRIES = 12
# A lattice of so many of a level's extrema is a grid or another regular pattern; finer ones lie within it.
SETTLED_PART = 0.4
# Strong extrema: this part of one of the strongest, whose rank leaves dirt aside; of no use where most are.
STRONG_PART = 0.3
STRONG_RANK = 60
MAX_STRONG = 0.5
# A window of this side shows whether a level holds a lattice of its own: one whose whole cells, of at most this
# spacing, fill this part of it.
WINDOW_PX = 384
LARGEST_SPACING_PX = 12.0
WINDOW_PART = 0.3
# Curvature of a flat top, grey levels, below which there is no vertex.
NO_CURVATURE = 1e-12


@dataclass(frozen=True)
class CoarseGrid:
    """A lattice of candidate crossings in full-resolution pixels, and the polarity it was found with."""

    lattice: Lattice
    sign: int


def coarse_grids(
    image: npt.NDArray[np.float32], *, signs: tuple[int, ...], keep_places: bool = False
) -> list[CoarseGrid]:
    """Grow lattices on every pyramid level and polarity, the largest first.

    Parameters
    ----------
    image
        Grey picture, float32, (H, W).
    signs
        Polarities to try: -1 for dark lines, +1 for light ones.
    keep_places
        Smooth the picture before every halving, so that thin lines keep their places within the pixels of all levels.
    """
    found: list[CoarseGrid] = []
    settled: FloatArray | None = None
    for level, factor in reversed(list(_pyramid(image, keep_places=keep_places))):
        if settled is not None and not _fine_lattice_near(level, settled / factor, signs):
            continue
        for sign, points in _extrema(level, signs):
            for lattice in _level_lattices(points):
                found.append(CoarseGrid(lattice.scaled(factor), sign))
                if lattice.member.size > SETTLED_PART * len(lattice.points):
                    settled = factor * np.median(lattice.points[lattice.member], axis=0)
    return sorted(found, key=lambda grid: -grid.lattice.member.size)


def _fine_lattice_near(level: npt.NDArray[np.float32], middle_px: FloatArray, signs: tuple[int, ...]) -> bool:
    """Whether a window of the level, in the middle of the grid found on coarser ones, is full of a lattice.

    A level's own lines are 6 to 12 of its pixels apart. Where the window shows fewer cells, the whole level
    would only repeat what is known.
    """
    if level.size <= 2 * WINDOW_PX**2:
        return True  # looking everywhere costs no more
    u, v = (int(max(0, x - WINDOW_PX / 2)) for x in middle_px)
    window = level[v : v + WINDOW_PX, u : u + WINDOW_PX]
    lattices = (lattice for _, points in _extrema(window, signs) for lattice in _level_lattices(points))
    most = max((lattice.whole_cells() for lattice in lattices), default=0)
    return most > WINDOW_PART * window.size / LARGEST_SPACING_PX**2


def _pyramid(image: npt.NDArray[np.float32], *, keep_places: bool) -> Iterator[tuple[npt.NDArray[np.float32], int]]:
    """Yield the picture averaged over 1, 2, 4 ... pixels, with the factor.

    Means of two put a thin line anywhere within a pixel to its middle, and lines whose spacing is a whole number of a
    level's pixels all to the same side; weights of 1, 3, 3, 1 keep their places, but leave weaker extrema.
    """
    level, factor = image, 1
    while min(level.shape) >= COARSEST_LEVEL_PX:
        yield level, factor
        height, width = level.shape[0] // 2, level.shape[1] // 2
        level = cv2.GaussianBlur(level, (3, 3), 0) if keep_places else level  # weights 1, 2, 1; then means of two
        level = cv2.resize(level[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
        factor *= 2


def _level_lattices(points: npt.NDArray[np.float64]) -> list[Lattice]:
    """Best lattices, in the level's own pixels, through all extrema (n, 3) and through those that stand out.

    A small sheet's crossings are lost among the noise of its surroundings, but they are stronger.
    """
    if len(points) < MIN_CROSSINGS:
        return []
    strong = points[:, 2] > STRONG_PART * np.sort(points[:, 2])[-STRONG_RANK:][0]
    sets = [points] if strong.mean() > MAX_STRONG else [points, points[strong]]
    lattices = [grow_lattice(some[:, :2], tries=MAX_SEED_TRIES) for some in sets if len(some) >= MIN_CROSSINGS]
    return [lattice for lattice in lattices if lattice is not None and lattice.member.size >= MIN_CROSSINGS]


def _extrema(level: npt.NDArray[np.float32], signs: tuple[int, ...]) -> Iterator[tuple[int, npt.NDArray[np.float64]]]:
    """Sub-pixel positions and strengths (n, 3) of the crossings' extrema: maxima of the signed band-passed level."""
    band = cv2.GaussianBlur(level, (0, 0), LEVEL_SIGMA_PX)
    band -= _background(band)
    limit = _rms(band)
    limit *= MIN_PROMINENCE
    limit += np.float32(MIN_RELATIVE_BAND * np.abs(band).max())
    for sign in signs:
        peak = _peaks(band if sign > 0 else -band, limit)
        row, column = np.nonzero(peak)
        du, dv = (_parabola(band, row, column, *way) for way in ((0, 1), (1, 0)))
        yield sign, np.stack([column + du, row + dv, sign * band[row, column]], axis=1)


def _peaks(band: npt.NDArray[np.float32], limit: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Pixels above the limit that no neighbour exceeds, the border left out."""
    peak: npt.NDArray[np.bool_] = band >= cv2.dilate(band, np.ones((3, 3), np.uint8))
    peak &= band > limit
    peak[[0, -1], :] = False
    peak[:, [0, -1]] = False
    return peak


def _background(smooth: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Blur by BACKGROUND_SIGMA_PX, at a quarter of the resolution."""
    return _enlarged(cv2.GaussianBlur(_reduced(smooth), (0, 0), BACKGROUND_SIGMA_PX / REDUCED), smooth)


def _rms(band: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Root mean square of the band over about 30 x 30 pixels."""
    return _enlarged(np.sqrt(np.maximum(cv2.blur(_reduced(band * band), (RMS_PX, RMS_PX)), 0)), band)


def _reduced(level: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    height, width = level.shape
    return cv2.resize(level, (-(-width // REDUCED), -(-height // REDUCED)), interpolation=cv2.INTER_AREA)


def _enlarged(small: npt.NDArray[np.float32], like: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    return cv2.resize(small, (like.shape[1], like.shape[0]), interpolation=cv2.INTER_LINEAR)


def _parabola(
    band: FloatArray, row: npt.NDArray[np.intp], column: npt.NDArray[np.intp], down: int, right: int
) -> npt.NDArray[np.float64]:
    """Vertex of the parabola through an extremum and its two neighbours, px, within half a pixel."""
    here = band[row, column].astype(float)
    before = band[row - down, column - right].astype(float)
    after = band[row + down, column + right].astype(float)
    curvature = 2 * here - before - after
    # A minimum has both signs turned, so the vertex is the same; a flat top stays where it is.
    steep = np.where(np.abs(curvature) > NO_CURVATURE, curvature, np.inf)
    return np.clip(0.5 * (after - before) / steep, -0.5, 0.5)
