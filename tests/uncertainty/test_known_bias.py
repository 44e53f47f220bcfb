"""Standard uncertainty with a bias that stays in the result."""

import numpy as np
import pytest
from scipy.stats import norm

from fringecal.uncertainty import uncertainty_with_bias

K = norm.ppf(0.975)


def test_without_bias_nothing_changes():
    np.testing.assert_allclose(uncertainty_with_bias([0.1, 2.0], 0.0), [0.1, 2.0], rtol=1e-6)


@pytest.mark.parametrize("ratio", [0.2, 0.7, 1.0, 2.5, 3.5, 40.0])
def test_the_interval_holds_the_truth_with_95_percent(ratio):
    half = K * float(uncertainty_with_bias(2.0, -2.0 * ratio))
    held = norm.cdf(half, 2.0 * ratio, 2.0) - norm.cdf(-half, 2.0 * ratio, 2.0)
    assert held == pytest.approx(0.95, abs=2e-5)


def test_an_exact_result_with_a_bias_has_that_bias_as_its_half_width():
    assert K * float(uncertainty_with_bias(0.0, 0.3)) == pytest.approx(0.3)


def test_what_is_unknown_stays_unknown():
    assert np.isnan(uncertainty_with_bias([np.nan], [0.1])).all()
