"""What a picture without phase shifts shows: a board, a grid, dots, fringes, or nothing that is known."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringecal.detect import board_in, find_dot_grid, find_grid, stretched
from fringecal.errors import DetectionError, PhaseError
from fringecal.phase import carrier

Content = Literal["chessboard", "charuco", "line-grid", "dots", "fringes", "unknown"]


@dataclass(frozen=True)
class StillContent:
    """What was found, and in words how much of it."""

    content: Content
    words: str


def content_of(grey: NDArray[np.float32]) -> StillContent:
    """Look for markers, a line grid, a chessboard, dots and fringes, in this order.

    Parameters
    ----------
    grey
        Grey levels, (H, W).
    """
    small = stretched(grey)
    board = board_in(small)
    if board is not None and board.kind == "charuco":
        return StillContent(board.kind, board.words)
    if (lines := _lines(small)) is not None:
        return lines
    if board is not None:
        return StillContent(board.kind, board.words)
    for look in (_dots, _fringes):
        if (found := look(small)) is not None:
            return found
    return StillContent("unknown", "no board, grid or fringes")


def _lines(small: NDArray[np.uint8]) -> StillContent | None:
    try:
        grid = find_grid(small)
    except DetectionError:
        return None
    upright, lying = len(grid.family("vertical")), len(grid.family("horizontal"))
    return StillContent("line-grid", f"{upright} x {lying} lines")


def _dots(small: NDArray[np.uint8]) -> StillContent | None:
    try:
        grid = find_dot_grid(small)
    except DetectionError:
        return None
    return StillContent("dots", f"{grid.row.size} dots")


def _fringes(small: NDArray[np.uint8]) -> StillContent | None:
    try:
        found = carrier(small)
    except PhaseError:
        return None
    return StillContent("fringes", f"fringes of {found.period_px:.0f} px, in one picture")
