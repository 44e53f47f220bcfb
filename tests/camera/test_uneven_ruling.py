"""Lines off their places are no lens; a lens on such a sheet is found by the bending of its lines."""

import numpy as np
import pytest

from fringecal.camera import examine_distortion
from fringecal.detect import grid_of_crossings

SHAPE = (1000, 1400)
PITCH_PX, SIGMA_PX = 48.0, 0.03


def seen(rng, *, off_px=0.0, lens_px=0.0, wave_px=0.0):
    """Crossings of 26 x 18 lines; offsets wander from line to line, the lens moves the outermost by `lens_px`."""
    row, column = np.mgrid[:18, :26]
    walks = [np.cumsum(rng.normal(0, off_px / 2, count)) for count in (26, 18)]
    u = (column - 12.5) * PITCH_PX + walks[0][column] + wave_px * np.sin(0.7 * row + column)
    v = (row - 8.5) * PITCH_PX + walks[1][row]
    moved = 1 + lens_px * (u**2 + v**2) / np.hypot(u, v).max() ** 3
    u, v = (np.ravel(at * moved + rng.normal(0, SIGMA_PX, at.shape)) for at in (u, v))
    return grid_of_crossings(row.ravel(), column.ravel(), u + 699.5, v + 499.5, shape=SHAPE, sigma_px=SIGMA_PX)


@pytest.mark.parametrize("off_px", [0.1, 1.0, 4.0])
def test_an_uneven_sheet_is_no_lens(off_px):
    """At 5 % per sheet, two false lenses in four come once in 70 times."""
    tests = [examine_distortion(seen(np.random.default_rng(seed), off_px=off_px)) for seed in range(4)]
    assert sum(test.verdict != "none" for test in tests) <= 1
    for test in tests:
        # What pose and lens cannot take of the walk; a walk's smooth part they can.
        assert 0.05 * off_px < test.irregular_px < 4 * off_px


@pytest.mark.parametrize("lens_px", [-3.0, 0.6])
def test_a_lens_is_found_by_the_bending_of_lines(lens_px):
    """Lines off by 2 px hide 0.6 px by places; their bending shows it, with its size."""
    for seed in range(2):
        test = examine_distortion(seen(np.random.default_rng(100 + seed), off_px=2.0, lens_px=lens_px))
        assert test.verdict == ("barrel" if lens_px < 0 else "pincushion")
        assert test.detection_limit_px < 0.6
        assert test.max_px.value == pytest.approx(abs(lens_px), abs=5 * test.max_px.u + 0.02 * abs(lens_px))


def test_an_even_sheet_keeps_the_test_by_places():
    test = examine_distortion(seen(np.random.default_rng(7)))
    assert test.irregular_px == 0.0
    assert test.verdict == "none"
    assert test.detection_limit_px < 0.05  # 468 crossings of 0.03 px


def test_a_wavy_sheet_is_no_lens():
    """Waves of 0.5 px bend the lines, each part another way."""
    test = examine_distortion(seen(np.random.default_rng(8), off_px=1.0, wave_px=0.5))
    assert test.verdict == "none"
