"""The smallest change that a test sees, against the distributions themselves."""

import numpy as np
import pytest
from scipy import stats

from fringecal.uncertainty.detection_limit import least_seen, shift_seen


@pytest.mark.parametrize("threshold", [1.0, 1.96, 5.0])
@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_a_shift_lies_beyond_the_threshold_with_95_percent_at_least(threshold, share):
    """By the normal distribution, whatever share of the stated u is really at work."""
    shift, u = shift_seen(threshold, 1.0), max(share, 1e-9)
    seen = stats.norm.sf(threshold, shift, u) + stats.norm.cdf(-threshold, shift, u)
    assert seen >= 0.95 - 1e-12
    if share == 1.0:  # the other side of the threshold adds next to nothing
        assert seen == pytest.approx(0.95, abs=4e-4)


@pytest.mark.parametrize(("number", "chance"), [(1, 0.01), (2, 0.05), (19, 0.01)])
def test_a_change_is_seen_by_chi_squared_with_95_percent_at_least(number, chance):
    size = least_seen(number, chance)
    threshold = stats.chi2.isf(chance, number)
    seen = [stats.ncx2.sf(threshold / s, number, size / s) for s in np.linspace(0.02, 1.0, 25)]
    assert min(seen) >= 0.95 - 1e-6
    smaller = [stats.ncx2.sf(threshold / s, number, 0.9 * size / s) for s in np.linspace(0.02, 1.0, 25)]
    assert min(smaller) < 0.95
