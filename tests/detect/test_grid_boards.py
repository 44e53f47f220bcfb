"""Boards drawn by OpenCV or as closed forms, warped by known homographies."""

import cv2
import numpy as np
import pytest

from fringecal.camera.lens.board_views import board_view
from fringecal.detect.boards import find_charuco, find_chessboard, find_dots
from fringecal.errors import DetectionError, TargetError
from fringecal.targets import Dots, LineGrid, load_target
from fringecal.targets.geometry import asymmetric_dots_mm, board_points_mm

TILT = np.array([[0.9, 0.1, 40.0], [-0.08, 0.85, 60.0], [5e-5, 1e-4, 1.0]])


def tilted(picture, shape=(520, 700), noise=2.0):
    """The picture seen through TILT, blurred and noisy."""
    seen = cv2.warpPerspective(picture, TILT, (shape[1], shape[0]), flags=cv2.INTER_AREA, borderValue=235)
    grey = cv2.GaussianBlur(seen.astype(float), (0, 0), 0.7) + np.random.default_rng(0).normal(0, noise, shape)
    return np.clip(np.round(grey), 0, 255).astype(np.uint8)


def through_tilt(points):
    mapped = np.column_stack([points, np.ones(len(points))]) @ TILT.T
    return mapped[:, :2] / mapped[:, 2:]


def chessboard(columns, rows, square=50):
    v, u = np.mgrid[: (rows + 1) * square, : (columns + 1) * square]
    board = np.where((u // square + v // square) % 2, 235, 25).astype(np.uint8)
    return np.pad(board, square, constant_values=235)


def corners(columns, rows, square=50):
    row, column = (a.ravel() for a in np.mgrid[:rows, :columns])
    return np.column_stack([(column + 2) * square - 0.5, (row + 2) * square - 0.5])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float64])
def test_chessboard(dtype):
    picture = tilted(chessboard(8, 5)).astype(dtype) * (1 if dtype is np.uint8 else 17)
    found = find_chessboard(picture, 8, 5)
    expected = through_tilt(corners(8, 5)).reshape(5, 8, 2)
    error = min(np.abs(found - e).max() for e in (expected, expected[::-1, ::-1]))
    assert error < 0.15  # noise of 2 levels in 200, tilted squares of 45 px


def test_chessboard_of_other_counts_is_refused():
    with pytest.raises(DetectionError, match="7 x 6 inner corners"):
        find_chessboard(tilted(chessboard(8, 5)), 7, 6)


def dots(points, radius):
    v, u = np.mgrid[:440, :620]
    picture = np.full(u.shape, 235.0)
    for x, y in points:
        picture -= 210 * np.clip(radius + 0.5 - np.hypot(u - x, v - y), 0, 1)
    return picture


def test_symmetric_dots():
    row, column = (a.ravel() for a in np.mgrid[:6, :9])
    points = np.column_stack([60 + 60.0 * column, 60 + 60.0 * row])
    found = find_dots(tilted(dots(points, 12)), 9, 6).reshape(-1, 2)
    expected = through_tilt(points)
    assert min(np.abs(found - e).max() for e in (expected, expected[::-1])) < 0.3
    view = board_view(
        tilted(dots(points, 12)),
        Dots(
            name="d",
            certificate="c",
            columns=9,
            rows=6,
            pitch_mm={"value": 6, "u": 0},
            diameter_mm={"value": 2, "u": 0},
        ),
    )
    assert view.points_px.shape == (6, 9, 2)


@pytest.mark.parametrize("light", [False, True])
def test_asymmetric_dots_half_fill_a_square_grid(light):
    places = asymmetric_dots_mm(4, 11, 30.0)[:, :2] * [1, -1]
    points = places + [300, 215]
    picture = tilted(dots(points, 9))
    found = find_dots(255 - picture if light else picture, 4, 11, asymmetric=True)
    assert found.shape == (11, 8, 2)
    row, column = np.nonzero(np.isfinite(found[..., 0]))
    assert len(row) == 44
    index = np.column_stack([column, row]).astype(float)
    homography, _ = cv2.findHomography(index, found[row, column])
    assert np.linalg.det(homography) > 0  # not mirrored
    assert np.abs(cv2.perspectiveTransform(index[None], homography)[0] - found[row, column]).max() < 0.3
    nearest = np.min(np.linalg.norm(found[row, column][:, None] - through_tilt(points)[None], axis=2), axis=1)
    assert nearest.max() < 0.3


def test_charuco_with_a_part_hidden():
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((9, 6), 1.0, 0.7, known)
    picture = tilted(board.generateImage((630, 420), marginSize=0))
    picture[200:320, 300:480] = 120
    found = find_charuco(picture, (9, 6), marker_part=0.7, dictionary="DICT_4X4_50")
    assert found.shape == (5, 8, 2)
    hidden = np.isnan(found[..., 0])
    assert 3 < hidden.sum() < 25
    spacing = 70.0
    expected = through_tilt(board_points_mm(8, 5, spacing)[:, :2] * [1, -1] + [4.5 * spacing - 0.5, 3 * spacing - 0.5])
    error = np.abs(found - expected.reshape(5, 8, 2))[~hidden]
    # Corners beside the cover may be drawn to its edge; the lens fit leaves such ones out.
    assert np.median(error) < 0.2
    assert np.mean(error < 0.5) > 0.9


def test_no_board_is_refused():
    noise = np.random.default_rng(1).integers(0, 255, (300, 400)).astype(np.uint8)
    for search in (
        lambda: find_chessboard(noise, 9, 6),
        lambda: find_dots(noise, 9, 6),
        lambda: find_charuco(noise, (9, 6), marker_part=0.7, dictionary="DICT_4X4_50"),
        lambda: find_chessboard(np.zeros((300, 400, 3), np.uint8), 9, 6),
        lambda: find_chessboard(np.zeros((300, 400)), 9, 6),
    ):
        with pytest.raises(DetectionError):
            search()


def test_line_grid_is_a_board_too(virtual_grid):
    target = LineGrid(name="g", certificate="c", pitch_mm={"value": 10.0, "u": 0.01})
    view = board_view(virtual_grid(shape=(200, 240)).picture(), target)
    assert view.spacing_mm == 10.0
    assert np.isfinite(view.points_px).all()


def test_a_strip_is_no_board():
    with pytest.raises(TargetError, match="no board"):
        board_view(np.zeros((100, 100), np.uint8), load_target("glass-strips"))
