"""What is no line grid is refused, and the message says what was seen."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from fringecal.detect.grid.grid_search import find_grid
from fringecal.errors import DetectionError

DATA = Path(__file__).parents[1] / "data" / "discorpy_grids"


def noise():
    return np.random.default_rng(0).normal(128, 20, (300, 400))


def brick_wall():
    picture = np.full((300, 400), 160.0)
    picture[::25] = picture[1::25] = 90
    for row in range(12):
        columns = np.arange(25 * (row % 2), 400, 50)
        for shift in (0, 1):
            picture[25 * row : 25 * row + 25, np.minimum(columns + shift, 399)] = 90
    return picture + np.random.default_rng(1).normal(0, 2, picture.shape)


def fringes():
    return 128 + 80 * np.cos(np.arange(400) / 3.0)[None, :] * np.ones((300, 1))


def blank_paper():
    v, u = np.mgrid[:300, :400]
    return 200 - 0.1 * u + 0.05 * v + np.random.default_rng(2).normal(0, 1.5, (300, 400))


@pytest.mark.parametrize("scene", [noise, brick_wall, fringes, blank_paper])
def test_no_grid(scene):
    with pytest.raises(DetectionError, match="no (line )?grid found"):
        find_grid(scene())


def test_chessboard_is_named():
    v, u = np.mgrid[:300, :400]
    board = np.where((u // 30 + v // 30) % 2, 220.0, 40.0)
    with pytest.raises(DetectionError, match="chessboard"):
        find_grid(cv2.GaussianBlur(board, (0, 0), 0.8) + np.random.default_rng(4).normal(0, 2, board.shape))


def test_fringes_on_an_object_are_no_chessboard():
    picture = cv2.imread(str(DATA.parent / "fpp_tools_lens" / "lens_orig_000.jpg"), cv2.IMREAD_GRAYSCALE)
    with pytest.raises(DetectionError, match="stripes or fringes"):
        find_grid(picture)


def test_dots_are_named():
    with pytest.raises(DetectionError, match="dots"):
        find_grid(cv2.imread(str(DATA / "dot_pattern_05_crop.png"), cv2.IMREAD_GRAYSCALE))


@pytest.mark.parametrize(
    ("picture", "reason"),
    [
        (np.zeros((300, 400), np.uint8), "same brightness everywhere"),
        (np.zeros((300, 400, 3), np.uint8), "grey picture"),
        (np.zeros((10, 400), np.uint8), "too small"),
        (np.full((300, 400), np.nan), "NaN"),
        (np.zeros((0, 0)), "too small"),
    ],
)
def test_unusable_pictures(picture, reason):
    with pytest.raises(DetectionError, match=reason):
        find_grid(picture)


def steep_view(turn_deg):
    """A sheet that leans by 80 deg before a pinhole of 800 px, lines 30 px apart; and pixel -> pitches on it."""
    lean, turn = np.radians(80), np.radians(turn_deg)

    def to_sheet(u, v):
        x, y = (u - 259.5) / 800, (v - 199.5) / 800
        depth = np.cos(lean) / np.maximum(np.cos(lean) - y * np.sin(lean), 1e-3)
        along, across = x * depth / 0.0375, (y * depth * np.cos(lean) + (depth - 1) * np.sin(lean)) / 0.0375
        return np.cos(turn) * along + np.sin(turn) * across + 0.3, np.cos(turn) * across - np.sin(turn) * along + 0.4

    v, u = np.mgrid[:2000, :2600] / 5 - 0.4
    p, q = to_sheet(u, v)
    ink = np.minimum(np.abs(p - np.round(p)), np.abs(q - np.round(q))) < 0.06
    paper = 200 - 140 * cv2.resize(ink.astype(float), (520, 400), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(paper, (0, 0), 0.7) + np.random.default_rng(5).normal(0, 2, paper.shape), to_sheet


def test_grid_seen_at_eighty_degrees_is_refused():
    with pytest.raises(DetectionError, match="no (line )?grid found"):
        find_grid(steep_view(0)[0])


def test_what_is_indexed_of_a_grid_turned_and_seen_at_eighty_degrees_has_not_slipped():
    picture, to_sheet = steep_view(35)
    grid = find_grid(picture)
    p, q = (np.round(place) for place in to_sheet(grid.u_px, grid.v_px))
    # Columns run along p or q, either way; the rows along the other.
    slips = [np.ptp([a - grid.column, b - grid.row], axis=1).sum() for a, b in ((p, q), (q, -p), (-p, -q), (-q, p))]
    assert min(slips) == 0
