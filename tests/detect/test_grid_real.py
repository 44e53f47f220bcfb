"""The grid detector on photographs, against numbers that another program found."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from fringecal.camera.distortion.distortion_test import examine_distortion
from fringecal.camera.distortion.straightness import family_rms_px
from fringecal.detect.grid.grid_search import find_grid

DATA = Path(__file__).parents[1] / "data" / "discorpy_grids"


def read(name):
    return cv2.imread(str(DATA / name), cv2.IMREAD_GRAYSCALE)


@pytest.fixture(scope="module")
def ruled():
    return find_grid(read("line_pattern_01.jpg"))


def crossings(grid):
    nodes = np.full((grid.row.max() + 1, grid.column.max() + 1, 2), np.nan)
    nodes[grid.row, grid.column] = np.stack([grid.u_px, grid.v_px], axis=1)
    return nodes


def test_ruled_grid_all_lines(ruled):
    # discorpy finds 34 + 40; the ones cut by the picture's border count for neither program.
    assert (len(ruled.family("horizontal")), len(ruled.family("vertical"))) == (34, 40)
    assert len(ruled.row) == 34 * 40


def test_ruled_grid_line_distance(ruled):
    nodes = crossings(ruled)
    inner = (np.abs(nodes[..., 0] - 1279.5) < 0.15 * 2560) & (np.abs(nodes[..., 1] - 1079.5) < 0.15 * 2160)
    rows = np.diff(nodes[..., 1], axis=0)[inner[1:] & inner[:-1]]
    columns = np.diff(nodes[..., 0], axis=1)[inner[:, 1:] & inner[:, :-1]]
    # discorpy's 62.27 and 62.29 in the middle 30 %, without its shrinkage by (N - 1) / N.
    assert np.median(rows) == pytest.approx(62.27 * 2160 / 2159, abs=0.02)
    assert np.median(columns) == pytest.approx(62.29 * 2560 / 2559, abs=0.03)


def test_ruled_grid_straightness(ruled):
    test = examine_distortion(ruled, centre="free")
    before, after = test.straightness_before, test.straightness_after
    # discorpy: 0.69 / 0.58 px before, 0.15 / 0.08 px after a correction with five terms.
    assert family_rms_px(before, "horizontal") == pytest.approx(0.69, abs=0.03)
    assert family_rms_px(before, "vertical") == pytest.approx(0.58, abs=0.03)
    assert family_rms_px(after, "horizontal") < 0.15
    assert family_rms_px(after, "vertical") < 0.09


def test_photograph_with_very_strong_barrel():
    grid = find_grid(read("GoPro8_line_grid_halfsize.jpg"))
    # Counted by eye in the picture: 29 horizontal and 39 vertical lines.
    assert (len(grid.family("horizontal")), len(grid.family("vertical"))) == (29, 39)
    assert len(grid.row) > 0.97 * 29 * 39
    nodes = crossings(grid)
    for axis, component in ((0, 1), (1, 0)):
        steps = np.diff(nodes[..., component], axis=axis)
        bend = np.abs(np.diff(steps, axis=axis))
        # A slipped index changes a step by one spacing; a smooth lens by a few per cent.
        assert np.nanmax(bend) < 0.2 * np.nanmedian(steps)
