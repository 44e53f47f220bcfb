"""Dots and boards as others draw and enlarge them: polarity, specks, size, and ChArUco boards of early OpenCV."""

import cv2
import numpy as np
import pytest
from scipy import ndimage

from fringecal.detect import find_charuco, find_dot_grid, find_dots
from fringecal.errors import DetectionError


def drawn(pitch: float, diameter: float, *, size=(560, 700), light=False, seed=1, specks=0) -> np.ndarray:
    """Draw dots about the picture's middle, one of them at it; specks are smaller and of both kinds."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: size[0], : size[1]] - (np.array(size) // 2)[:, None, None]
    off = np.hypot(*[x - pitch * np.round(x / pitch) for x in (u, v)])
    ink = 1 / (1 + np.exp(2 * (off - diameter / 2)))
    dirt = np.zeros(size)
    dirt[rng.integers(0, size[0], specks), rng.integers(0, size[1], specks)] = rng.choice([-900.0, 900.0], specks)
    picture = 60 + 120 * (ink if light else 1 - ink) + ndimage.gaussian_filter(dirt, 1.2)
    return np.clip(picture + rng.normal(0, 2, size), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("light", [False, True])
@pytest.mark.parametrize("pitch", [24.0, 48.0, 96.0])
def test_dots_of_any_size_are_found_among_specks(pitch, light):
    """Every dot lies where it was drawn; more specks than dots do not decide which is which."""
    grid = find_dot_grid(drawn(pitch, 0.45 * pitch, light=light, specks=700))
    assert grid.polarity == ("light" if light else "dark")
    # A speck of 900 levels px^2 at the rim of a dot of 120 levels moves its centroid by 900 (d / 2) / (120 pi d^2 / 4).
    moved = 900 / 2 / (120 * np.pi / 4 * 0.45 * pitch)
    for found, middle in ((grid.u_px, 350), (grid.v_px, 280)):
        off = (found - middle) / pitch
        assert np.percentile(np.abs(off - np.round(off)), 90) * pitch < 4 * moved  # up to four specks on one
    assert len(grid.row) > 0.75 * (560 // pitch - 1) * (700 // pitch - 1)


def test_the_stated_polarity_is_obeyed():
    """Between dark dots that leave light squares free there are no light dots to be found."""
    picture = drawn(30.0, 13.0)
    assert find_dot_grid(picture, polarity="dark").polarity == "dark"
    with pytest.raises(DetectionError, match="dots"):
        find_dot_grid(picture, polarity="light")


@pytest.mark.parametrize("times", [1, 4, 8])
def test_boards_of_dots_are_found_however_large(times):
    """OpenCV's own limit, 5000 px^2, is passed by dots 20 px across enlarged fourfold."""
    small = np.full((240, 320), 255, np.uint8)
    for j, i in np.ndindex(5, 6):
        cv2.circle(small, (40 + 45 * i, 30 + 45 * j), 10, 0, -1)
    points = find_dots(cv2.resize(small, None, fx=times, fy=times, interpolation=cv2.INTER_LINEAR), 6, 5)
    expected = np.stack(np.meshgrid(40 + 45.0 * np.arange(6), 30 + 45.0 * np.arange(5)), axis=2)
    found = np.sort((points.reshape(-1, 2) + 0.5) / times - 0.5, axis=0)
    np.testing.assert_allclose(found, np.sort(expected.reshape(-1, 2), axis=0), atol=0.3)


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("squares", [(7, 6), (6, 8), (7, 5)])
def test_charuco_boards_of_early_opencv(squares, legacy):
    """OpenCV draws both patterns itself; the corners stand where the drawing has its squares."""
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard(squares, 1.0, 0.7, known)
    board.setLegacyPattern(legacy)
    picture = board.generateImage((80 * squares[0], 80 * squares[1]))
    points = find_charuco(picture, squares, marker_part=0.7, dictionary="DICT_4X4_50")
    expected = np.stack(np.meshgrid(*[80.0 * np.arange(1, n) - 0.5 for n in squares]), axis=2)
    np.testing.assert_allclose(points, expected, atol=0.3)
