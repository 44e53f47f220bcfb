"""Specks on and beside dots, markers beside corners: what is not the board moves none of its points."""

import cv2
import numpy as np
import pytest

from fringecal.detect import find_charuco, find_dot_grid, refined_corners

COLUMNS, ROWS, PITCH = 12, 9, 24.0
FINER = 4


def board_of_dots(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Dark dots seen with perspective, by area; and their true centres, those of the drawn discs' images."""
    to_picture = np.array([[PITCH, 1.5, 30.3], [-1.2, PITCH, 28.6], [2e-4, 1e-4, 1.0]])
    v, u = (np.mgrid[: 260 * FINER, : 340 * FINER] + 0.5) / FINER - 0.5
    x, y, w = np.tensordot(np.linalg.inv(to_picture), np.stack([u, v, np.ones_like(u)]), 1)
    col, row = x / w, y / w
    inside = (np.rint(col) >= 0) & (np.rint(col) < COLUMNS) & (np.rint(row) >= 0) & (np.rint(row) < ROWS)
    disc = inside & (np.hypot(col - np.rint(col), row - np.rint(row)) < radius / PITCH)
    light = cv2.GaussianBlur(210.0 - 150.0 * disc, (0, 0), 0.7 * FINER)
    at = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), -1).reshape(-1, 2)
    true = np.column_stack([at, np.ones(len(at))]) @ to_picture.T
    return light.reshape(260, FINER, 340, FINER).mean(axis=(1, 3)), true[:, :2] / true[:, 2:]


def off(found, true: np.ndarray) -> np.ndarray:
    """Distance of every found dot from the nearest true one, px."""
    return np.hypot(found.u_px[:, None] - true[:, 0], found.v_px[:, None] - true[:, 1]).min(axis=1)


@pytest.mark.parametrize("radius", [4.0, 8.0])
def test_a_speck_at_a_dots_rim_does_not_move_it(radius: float) -> None:
    picture, true = board_of_dots(radius)
    rng = np.random.default_rng(5)
    touched = rng.choice(len(true), len(true) // 3, replace=False)
    centroid_moves = []
    for k in touched:
        turn = rng.uniform(0, 2 * np.pi)
        u, v = np.rint(true[k] + (radius + 0.5) * np.array([np.cos(turn), np.sin(turn)])).astype(int)
        depth = -90.0 if radius < 5 else -140.0
        picture[v : v + 2, u : u + 2] += depth
        centroid_moves.append(abs(depth) * 4 * radius / (150 * np.pi * radius**2))
    seen = np.clip(np.rint(picture + rng.normal(0, 1, picture.shape)), 0, 255).astype(np.uint8)
    found = find_dot_grid(seen)
    assert np.mean(centroid_moves) > 0.14  # px, by which centroids are moved: speck's moment over the dot's
    assert len(found.u_px) >= 0.97 * len(true)
    # Of two dozen rays four are hidden; noise of 1 in 150 grey levels moves each of the others by some 0.02 px.
    assert off(found, true).max() < 0.1
    assert found.sigma_px.max() > found.sigma_px.min()  # of a hidden part the outline tells less


def test_dots_at_the_rim_of_a_board_in_perspective_stay() -> None:
    """Where rows bend by perspective alone, no dot is dirt: all that were drawn are found, corners too."""
    picture, true = board_of_dots(6.0)
    found = find_dot_grid(np.rint(picture).astype(np.uint8))
    assert len(found.u_px) == len(true)
    assert off(found, true).max() < 0.03


def test_markers_do_not_draw_the_corners_of_their_board() -> None:
    squares, side = (8, 6), 32
    board = cv2.aruco.CharucoBoard(squares, 1.0, 0.72, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    sheet = board.generateImage((squares[0] * side * 4, squares[1] * side * 4)).astype(float)
    sheet = cv2.GaussianBlur(np.pad(sheet, 4 * side, constant_values=255), (0, 0), 3.0)
    seen = 20 + 0.7 * sheet.reshape(sheet.shape[0] // 4, 4, -1, 4).mean(axis=(1, 3))
    seen += np.random.default_rng(1).normal(0, 1, seen.shape)
    corners = find_charuco(np.rint(seen).astype(np.uint8), squares, marker_part=0.72, dictionary="DICT_4X4_50")
    v, u = np.mgrid[: squares[1] - 1, : squares[0] - 1]
    true = np.stack([u, v], axis=-1) * side + 2 * side - 0.5
    assert np.isfinite(corners).all()
    assert np.abs(refined_corners(seen, corners, marker_part=0.72) - true).max() < 0.1
    # A window that takes in markers, whose edges begin 0.14 squares from each corner, is drawn to them.
    assert np.abs(refined_corners(seen, corners) - true).max() > 0.2
