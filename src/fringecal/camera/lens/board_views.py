"""A board's picture as a view for the lens fit: detection by what the target is."""

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.lens.lens_solve import BoardView
from fringecal.detect import find_charuco, find_chessboard, find_dots, find_grid
from fringecal.errors import TargetError
from fringecal.targets import Charuco, Chessboard, Dots, LineGrid, Target


def board_view(image: NDArray[np.generic], target: Target) -> BoardView:
    """Find a board in a picture.

    Parameters
    ----------
    image
        Grey picture (H, W).
    target
        A chessboard, ChArUco, dots or a line grid.

    Raises
    ------
    DetectionError
        The board is not in the picture.
    TargetError
        The target is no board.
    """
    if isinstance(target, Chessboard):
        return BoardView(find_chessboard(image, target.columns, target.rows), target.square_mm.value)
    if isinstance(target, Charuco):
        part = target.marker_mm.value / target.square_mm.value
        points = find_charuco(image, target.squares, marker_part=part, dictionary=target.dictionary)
        return BoardView(points, target.square_mm.value)
    if isinstance(target, Dots):
        points = find_dots(image, target.columns, target.rows, asymmetric=target.asymmetric)
        return BoardView(points, target.pitch_mm.value)
    if isinstance(target, LineGrid):
        return _grid_view(image, target)
    raise TargetError(f"a {target.kind} is no board for a camera; use a chessboard, ChArUco, dots or line grid")


def _grid_view(image: NDArray[np.generic], target: LineGrid) -> BoardView:
    found = find_grid(image, polarity=target.polarity)
    points = np.full((found.row.max() + 1, found.column.max() + 1, 2), np.nan)
    points[found.row, found.column] = np.stack([found.u_px, found.v_px], axis=1)
    return BoardView(points, target.pitch_mm.value)
