"""What 3 x 3 filters leave of noise and take of form, against closed forms."""

import numpy as np
import pytest

from fringecal.reconstruct.filter_effects import DRAWS, effect_of_filter
from fringecal.verification import filtered

SHAPE = (120, 150)
SIGMA = 0.02
NORMAL_MEDIAN_OF_NINE = 0.4075  # standard deviation of the median of nine standard normal values (order statistics)


def effect_on(z, name):
    rng = np.random.default_rng(5)
    noises = [SIGMA * rng.standard_normal(SHAPE) for _ in range(DRAWS)]
    noisy = z + SIGMA * rng.standard_normal(SHAPE)
    return effect_of_filter(noisy, noises, lambda v: filtered(v, name), lambda v: filtered(v, "mean"))


@pytest.mark.parametrize(("name", "left"), [("mean", 1 / 3), ("median", NORMAL_MEDIAN_OF_NINE)])
def test_noise_left_on_a_level_surface(name, left):
    found = effect_on(np.zeros(SHAPE), name).noise_left(np.full(SHAPE, SIGMA))
    assert np.median(found[10:-10, 10:-10]) == pytest.approx(left * SIGMA, rel=0.05)


def test_a_median_on_a_steep_slope_leaves_that_of_three():
    # The ramp decides which column the median comes from; 0.67 is the same of three normal values.
    slope = np.arange(SHAPE[1]) * np.ones(SHAPE)
    found = effect_on(slope, "median").noise_left(np.full(SHAPE, SIGMA))
    assert np.median(found[10:-10, 10:-10]) == pytest.approx(0.6698 * SIGMA, rel=0.05)


def test_a_mean_takes_two_thirds_of_a_pixels_fall_off_a_ridge():
    ridge = -np.abs(np.arange(SHAPE[1]) - 75.0) * np.ones(SHAPE)
    bias = effect_on(ridge, "mean").bias
    assert np.median(bias[10:-10, 75]) == pytest.approx(2 / 3, abs=3 * SIGMA)
    assert np.median(bias[10:-10, 20:60]) < SIGMA / 3
