"""Charts for setting up a projector: is each of its pixels shown as one, is it in focus, where do its edges fall."""

import numpy as np
from numpy.typing import NDArray

from fringecal.patterns.frame_drawing import Frame, Raster

_PITCHES_PX = (1, 2, 3, 4, 6, 8)  # lines of the focus chart: width of a line, px
_SPOKES = 36  # of a star: of 100 px radius its spokes are 1 px wide at 11 px from the middle
_CELLS = 8  # of the alignment chart, across: cells are squares
_CORNER = 1 / 8  # of the shorter side: patches of single pixels in the corners


def focus_chart(raster: Raster) -> Frame:
    """Draw lines of 1 to 8 px along both axes, patch by patch, and a star in each corner and the middle.

    In focus the finest patches show lines; where the picture is scaled they show beats.
    """
    height, width = raster.height_px, raster.width_px
    row, column = np.mgrid[:height, :width]
    patch_h, patch_w = max(1, height // 4), max(1, width // len(_PITCHES_PX))
    pitch = np.asarray(_PITCHES_PX)[np.minimum(column // patch_w, len(_PITCHES_PX) - 1)]
    upright = (column // pitch) % 2
    level = (row // pitch) % 2
    lit = np.where((row // patch_h) % 2, level, upright)
    for centre in _star_places(raster):
        lit = np.where(_disc(row, column, centre, min(height, width) // 10), _star(row, column, centre), lit)
    return raster.frame(raster.white * lit)


def alignment_chart(raster: Raster) -> Frame:
    """Draw a border of one pixel, squares, diagonals, a cross through the middle, and single pixels in the corners.

    All four border lines are seen only where nothing is cut off; corners that are evenly grey, and not
    patterned, are shown pixel by pixel.
    """
    height, width = raster.height_px, raster.width_px
    row, column = np.mgrid[:height, :width]
    cell = max(2, width // _CELLS)
    lit = (row % cell == 0) | (column % cell == 0)
    lit |= np.abs(row * (width - 1) - column * (height - 1)) < max(width, height) / 2
    lit |= np.abs(row * (width - 1) - (width - 1 - column) * (height - 1)) < max(width, height) / 2
    lit |= (row == height // 2) | (column == width // 2)
    lit |= (row == 0) | (row == height - 1) | (column == 0) | (column == width - 1)
    side = max(2, int(min(height, width) * _CORNER))
    corner = ((row < side) | (row >= height - side)) & ((column < side) | (column >= width - side))
    return raster.frame(raster.white * np.where(corner, (row + column) % 2, lit))


def _star_places(raster: Raster) -> list[tuple[int, int]]:
    height, width = raster.height_px, raster.width_px
    near, far = 1 / 8, 7 / 8
    places = [(near, near), (near, far), (0.5, 0.5), (far, near), (far, far)]
    return [(round(height * y), round(width * x)) for y, x in places]


def _disc(row: NDArray[np.intp], column: NDArray[np.intp], centre: tuple[int, int], radius: int) -> NDArray[np.bool_]:
    return np.asarray((row - centre[0]) ** 2 + (column - centre[1]) ** 2 < radius**2)


def _star(row: NDArray[np.intp], column: NDArray[np.intp], centre: tuple[int, int]) -> NDArray[np.intp]:
    angle = np.arctan2(row - centre[0], column - centre[1])
    return np.asarray(np.floor(angle / np.pi * _SPOKES).astype(np.intp) % 2)
