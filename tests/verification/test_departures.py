"""Departures of pixels beside their uncertainty: normal noise passes, ripples and single wrong pixels do not."""

import numpy as np
import pytest
from scipy import stats

from fringecal.verification import departures_of
from fringecal.verification.forms.departures import largest_of_normal


def test_the_largest_of_many_normal_values() -> None:
    """P(max |x| < k) = (2 Phi(k) - 1)^n, the order statistic of independent values."""
    for number in (1, 100, 100_000):
        k = largest_of_normal(number)
        assert (2 * stats.norm.cdf(k) - 1) ** number == pytest.approx(0.99, abs=1e-9)


def test_noise_as_stated_has_a_ratio_of_one() -> None:
    noise = 0.02 * np.random.default_rng(1).standard_normal(20_000)
    found = departures_of(noise, 0.02)
    assert found.ratio == pytest.approx(1.0, abs=4 / np.sqrt(2 * 20_000))
    assert found.largest_ratio < 1.1 * found.allowed_ratio


def test_a_ripple_whose_mean_is_nought_shows() -> None:
    ripple = 0.1 * np.sin(np.arange(20_000))
    found = departures_of(ripple, 0.02)
    assert abs(ripple.mean()) < 1e-4
    assert found.ratio == pytest.approx(0.1 / np.sqrt(2) / 0.02, rel=1e-3)
