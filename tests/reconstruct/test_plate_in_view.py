"""The plate beside an object: its height, rise and scatter, told from surfaces of which they are known."""

import numpy as np
import pytest

from fringecal.reconstruct import HeightMap, visible_plate
from fringecal.reconstruct.sensitivity import Sensitivities

SHAPE = (120, 160)
NOISE_MM = 0.02


def surface(height_mm=0.0, rise_mm=0.0, ripple_mm=0.0, *, plate_share=0.7, seed=0):
    """A plate that rises along x and ripples along y, with a box of 12 mm on the rest of the picture."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    noise = NOISE_MM * np.random.default_rng(seed).standard_normal(SHAPE)
    z = height_mm + rise_mm * (u / (SHAPE[1] - 1) - 0.5) + ripple_mm * np.sin(v) + noise
    z[:, int(plate_share * SHAPE[1]) :] += 12.0
    known = np.full(SHAPE, NOISE_MM)
    none = Sensitivities((), (), np.zeros((0, 2, 2, 2)), np.zeros((2, 2, 2)), SHAPE, (0.0, 12.0))
    return HeightMap(u - 80, 60 - v, z, known, known, none, np.zeros(SHAPE, np.uint8))


def test_a_plate_where_it_was_is_told_so():
    plate = visible_plate(surface(), 1.0)
    assert abs(plate.offset_mm) < 4 * NOISE_MM / np.sqrt(plate.pixels)
    assert plate.rise_mm == 0.0
    assert plate.scatter_ratio == pytest.approx(1.0, abs=0.03)


def test_a_raised_plate_is_off_by_its_height():
    assert visible_plate(surface(0.5), 1.0).offset_mm == pytest.approx(0.5, abs=0.002)


def test_a_tilted_plate_rises_over_what_is_seen_of_it():
    plate = visible_plate(surface(rise_mm=0.6), 1.0)
    assert plate.rise_mm == pytest.approx(0.7 * 0.6 - 4 * NOISE_MM, abs=0.01)


def test_a_rippled_plate_scatters_by_more_than_noise():
    plate = visible_plate(surface(ripple_mm=0.1), 1.0)
    # A sine's mean square is half of its amplitude's square, and noise adds its own.
    assert plate.scatter_ratio == pytest.approx(np.sqrt(0.1**2 / 2 / NOISE_MM**2 + 1), rel=0.05)


def test_a_scrap_of_plate_says_nothing():
    assert visible_plate(surface(plate_share=0.01), 1.0) is None
