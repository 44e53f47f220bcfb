"""Small computations that all rooms share, against closed forms."""

import numpy as np
import pytest
from numpy.polynomial import legendre, polynomial
from scipy import stats

from fringecal.numerics import (
    MAD_TO_SD,
    MEDIAN_TO_MEAN,
    by_powers,
    median_and_u,
    powers_up_to,
    products_up_to,
    robust_sd,
    wrap,
)


def test_the_factor_of_the_median_absolute_deviation_is_the_normal_distributions():
    assert pytest.approx(1 / stats.norm.ppf(0.75), rel=2e-6) == MAD_TO_SD  # as it is printed, to five digits


def test_wrapping_leaves_the_same_angle_within_half_a_turn():
    phase = np.random.default_rng(1).uniform(-100, 100, 1000)
    wrapped = wrap(phase)
    assert np.abs(wrapped).max() <= np.pi
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * phase), atol=1e-12)
    in_three = wrap(phase, 6 * np.pi)
    assert np.abs(in_three).max() <= 3 * np.pi
    np.testing.assert_allclose(np.exp(1j * in_three / 3), np.exp(1j * phase / 3), atol=1e-12)
    assert np.isnan(wrap(np.nan))
    assert wrap(np.zeros((2, 3))).shape == (2, 3)


def test_the_robust_standard_deviation_is_that_of_normal_quantiles():
    """Quantiles at (k + 1/2) / n of a normal distribution have its median absolute deviation but for 1 / n."""
    values = stats.norm.ppf((np.arange(10_000) + 0.5) / 10_000, loc=5.0, scale=2.0)
    assert robust_sd(values) == pytest.approx(2.0, rel=1e-3)
    assert robust_sd(values - 5.0, about=0) == pytest.approx(2.0, rel=1e-3)


def test_what_is_wrong_or_missing_does_not_move_the_robust_standard_deviation():
    values = np.arange(-10.0, 11.0)
    wrong = np.append(values, [np.nan, np.inf])
    assert robust_sd(wrong) == robust_sd(values)
    wrong[0], wrong[20] = -1e6, 1e6  # two of 21, one on each side
    assert robust_sd(wrong) == robust_sd(values)
    assert robust_sd([]) == 0.0
    assert robust_sd([np.nan]) == 0.0


def test_the_uncertainty_of_a_median_is_the_scatter_of_medians():
    """Of 101 normal values; over 20 000 repeats the scatter itself is known to 0.5 %, the spread biased by 1 %."""
    values = np.random.default_rng(2).normal(size=(101, 20_000))
    median, u = median_and_u(values)
    np.testing.assert_array_equal(median, np.median(values, axis=0))
    assert np.mean(u) == pytest.approx(np.std(median), rel=0.03)
    assert pytest.approx(1.2533, abs=5e-5) == MEDIAN_TO_MEAN


@pytest.mark.parametrize("degree", [0, 1, 4])
def test_terms_times_coefficients_are_the_polynomial_of_numpy(degree):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-1, 1, (2, 7, 5))
    coefficients = rng.normal(size=len(powers_up_to(degree)))
    assert coefficients.size == (degree + 1) * (degree + 2) // 2
    grid = by_powers(coefficients, degree)
    for vander, value in ((legendre.legvander, legendre.legval2d), (polynomial.polyvander, polynomial.polyval2d)):
        terms = products_up_to(vander(x, degree), vander(y, degree))
        assert terms.shape == (7, 5, coefficients.size)
        np.testing.assert_allclose(terms @ coefficients, value(x, y, grid), rtol=1e-12, atol=1e-14)
