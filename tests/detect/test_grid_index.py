"""What an index rests on, and lines of two weights."""

import numpy as np

from fringecal.detect.grid import find_grid
from fringecal.detect.grid_check import _largest_patch


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
