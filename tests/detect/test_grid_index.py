"""What an index rests on, and lines of two weights."""

import numpy as np
import pytest

from fringecal.detect.grid.candidates import _along_lines, _largest_patch, choose_coarse
from fringecal.detect.grid.grid_search import find_grid
from fringecal.detect.grid.lattice import Lattice
from fringecal.detect.grid.line_weights import _split
from fringecal.detect.grid.seeds import CoarseGrid
from fringecal.detect.grid.tears import without_torn_islands
from fringecal.errors import DetectionError


def test_a_chain_of_points_carries_no_index():
    seen = np.zeros((2, 9, 20), dtype=bool)
    seen[:, :, :8] = seen[:, :, 13:] = True
    seen[0, 4, 8:13] = True  # edges in a row join the blocks of 9 x 8 and 9 x 7 nodes, but no cell does
    kept = _largest_patch(seen[0], seen[1])
    expected = np.zeros((9, 20), dtype=bool)
    expected[:, :8] = True
    assert (kept == expected).all()


def test_crossings_of_heavy_lines_with_light_ones(virtual_grid):
    light = virtual_grid(pitch_px=30, width_px=3, rotation_deg=4)
    heavy = virtual_grid(pitch_px=150, width_px=8, rotation_deg=4)
    ink = 1 - (1 - heavy.coverage()) * (1 - light.coverage())
    grid = find_grid(200 - 140 * ink + np.random.default_rng(0).normal(0, 1.5, ink.shape))
    slips, error = light.index_errors(grid)
    assert np.ptp(slips, axis=1).tolist() == [0, 0]
    p, q = (np.round(values) for values in light.to_plate(grid.u_px, grid.v_px))
    on_heavy = (p % 5 == 0) | (q % 5 == 0)
    assert on_heavy.sum() > 50
    # With one cross-section for both weights the light lines' ends touch the heavy ink: up to 1.7 px off.
    assert np.abs(error[on_heavy]).max() < 0.05


def test_a_lattice_counted_along_diagonals_is_turned_to_its_lines(virtual_grid):
    scene = virtual_grid(pitch_px=30, rotation_deg=5)
    row, column = np.mgrid[-6:7, -6:7]
    u, v = scene.to_pixel(column.ravel(), row.ravel())
    inside = (u > 5) & (u < 475) & (v > 5) & (v < 395)
    points = np.stack([u, v], axis=1)[inside]
    # A third direction at 45 degrees to the lines: each is (1, 1) of the true one.
    sheared = Lattice(points, np.arange(len(points)), (row + column).ravel()[inside] + 12, column.ravel()[inside] + 6)
    picture = scene.picture(noise=2.0).astype(np.float32)
    turned, present, _ = _along_lines(picture, CoarseGrid(sheared, -1))
    assert present > 0.95
    nodes = turned.lattice.nodes()
    step = np.nanmedian(np.hypot(*np.moveaxis(np.diff(nodes, axis=0), 2, 0)))
    # 30 px along the lines, 42 px along the diagonal.
    assert abs(step - 30) < 0.1


def test_what_lies_between_the_lines_is_no_grid(virtual_grid):
    scene = virtual_grid(pitch_px=38)
    row, column = np.mgrid[-4:4, -5:5] + 0.5
    u, v = scene.to_pixel(column, row)
    picture = scene.picture(noise=2.0).astype(np.float32)
    cells = Lattice(np.stack([u.ravel(), v.ravel()], axis=1), np.arange(80), *np.divmod(np.arange(80), 10))
    with pytest.raises(DetectionError, match="no line grid"):
        choose_coarse(picture, [CoarseGrid(cells, 1), CoarseGrid(cells, -1)])


def test_a_grid_goes_on_beyond_the_edge_of_a_shadow(virtual_grid):
    scene = virtual_grid(shape=(400, 520), pitch_px=16, rotation_deg=7)
    v, u = np.mgrid[:400, :520]
    # A ruler's width of the sheet is hidden along the edge; the shadow darkens all that lies beyond.
    side = u + 0.2 * v - 300
    picture = np.where(side < 0, scene.picture(), 0.5 * scene.picture())
    picture[np.abs(side) < 20] = 120
    grid = find_grid(picture + np.random.default_rng(1).normal(0, 1.5, picture.shape))
    slips, _ = scene.index_errors(grid)
    assert np.ptp(slips, axis=1).tolist() == [0, 0]
    beyond = grid.u_px + 0.2 * grid.v_px > 320
    # 240 x 400 px on either side hold 375 crossings, less those at the border; without a bridge one side has none.
    assert min(beyond.sum(), (~beyond).sum()) > 320


def test_a_small_sheet_among_noise(virtual_grid):
    scene = virtual_grid(shape=(500, 640), pitch_px=9.5, width_px=1.8, lines=(11, 11), rotation_deg=20)
    grid = find_grid(scene.picture(noise=3.0, quantise=True))
    assert len(grid.row) == 121
    slips, _ = scene.index_errors(grid)
    assert np.ptp(slips, axis=1).tolist() == [0, 0]


@pytest.mark.parametrize("stray", [0.01, 40.0])
def test_one_stray_width_does_not_hide_the_two_weights(stray):
    light, heavy = np.linspace(3.8, 4.2, 30), np.linspace(8.0, 8.4, 8)
    assert 4.3 < _split(np.concatenate([light, [stray], heavy])) < 7.9


def test_crossings_beyond_a_step_of_two_lines_are_left_out():
    v, u = np.mgrid[:12, :14] * 20.0
    nodes = np.stack([u, v], axis=-1)
    nodes[7:, 9:, 1] += 20.0  # there every row is one too high
    kept = np.isfinite(without_torn_islands(nodes)[..., 0])
    # The block hangs on the rest by steps of 40 px above it and by slanted ones of 28 px beside it.
    assert kept[:7].all()
    assert kept[:, :9].all()
    assert not kept[8:, 10:].any()


def test_a_smoothly_growing_step_is_no_tear():
    v, u = np.mgrid[:12, :14]
    nodes = np.stack([10.0 * 1.12**u, 20.0 * 1.1**v], axis=-1)
    assert np.array_equal(without_torn_islands(nodes), nodes)
