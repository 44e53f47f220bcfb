"""What neighbouring crossings share, against moving averages whose autocorrelation is known."""

import numpy as np
import pytest

from fringecal.camera.distortion.crossing_scatter import shared_scatter


def crossings(share, seed, turn_deg=0.0):
    """Errors across each line: (e[k] + share e[k + 1]), independent between lines and families."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:40, :50]
    down, right = rng.normal(0, 0.05, (2, 41, 51))
    across_vertical = down[:40, :50] + share * down[1:, :50]
    across_horizontal = right[:40, :50] + share * right[:40, 1:]
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turn = np.array([[c, s], [-s, c]])
    points = np.stack([column.ravel(), row.ravel()], axis=1) * 20.0 @ turn
    residual = np.stack([across_vertical.ravel(), across_horizontal.ravel()], axis=1) @ turn
    return row.ravel(), column.ravel(), points, residual


@pytest.mark.parametrize("turn_deg", [0.0, 35.0])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_moving_average(share, turn_deg):
    # Autocorrelation of e[k] + s e[k + 1] at lag 1 is s / (1 + s^2), else 0.
    expected = 1 + 2 * share / (1 + share**2)
    found = np.mean([shared_scatter(*crossings(share, seed, turn_deg)) for seed in range(6)])
    # Three lags of 2000 pairs each in two families: 0.05 for one grid.
    assert found == pytest.approx(expected, abs=0.1)


def test_gaps_and_perfect_crossings():
    row, column, points, residual = crossings(1.0, 0)
    residual[::7] = np.nan
    assert shared_scatter(row, column, points, residual) == pytest.approx(2.0, abs=0.25)
    assert shared_scatter(row, column, points, np.zeros_like(residual)) == 1.0
