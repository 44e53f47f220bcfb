"""Charts that judge each value by those before it: their false alarms, and what they find."""

import numpy as np
import pytest
from scipy import stats

from fringecal.errors import HistoryError
from fringecal.history.charts import Baseline, cusum_chart, ewma_chart
from fringecal.history.self_starting import FIRST, self_starting_deviates, self_starting_individuals

STANDARD = Baseline(0.0, 1.0)
SHORT, MANY = 15, 3000


@pytest.fixture(scope="module")
def deviates():
    """Of 3000 quantities in control with a centre and a sigma of their own, 15 records each."""
    rng = np.random.default_rng(12)
    drawn = rng.normal(size=(MANY, SHORT)) * rng.lognormal(size=(MANY, 1)) + rng.normal(size=(MANY, 1))
    return np.array([self_starting_deviates(row) for row in drawn])[:, FIRST:]


def test_deviates_are_normal_and_independent_from_the_third_record_on(deviates):
    """The theorem that the method rests on; the smallest of 13 p-values is below 0.001 in 1 of 77 cases."""
    assert min(stats.kstest(column, "norm").pvalue for column in deviates.T) > 1e-3
    correlation = np.corrcoef(deviates.T)
    assert np.abs(correlation[np.triu_indices(SHORT - FIRST, 1)]).max() < 4.2 / np.sqrt(MANY)


def test_false_alarms_are_as_promised(deviates):
    """Of 39,000 single values 0.27 % are beyond 3 sigma; sums and averages as often as with known centre and sigma."""
    promised = 2 * stats.norm.sf(3) * deviates.size
    assert (np.abs(deviates) > 3).sum() == pytest.approx(promised, abs=3 * np.sqrt(promised))
    known = np.random.default_rng(13).normal(size=deviates.shape)
    for make in (ewma_chart, cusum_chart):
        ours, theirs = (sum(bool(make(row, STANDARD).signals) for row in rows) for rows in (deviates, known))
        assert ours == pytest.approx(theirs, abs=4 * np.sqrt(theirs))


def test_a_shift_is_found_by_the_sums():
    """3 sigma after 20 records: with known centre a CUSUM takes 2.2 records; here ten in nine of ten cases at most."""
    rng = np.random.default_rng(14)
    drawn = rng.normal(size=(200, 30)) + 3.0 * (np.arange(30) >= 20)
    found = [cusum_chart(self_starting_deviates(row), STANDARD).signals for row in drawn]
    assert np.mean([bool(set(one) & set(range(20, 30))) for one in found]) > 0.9


def test_limits_of_single_values_are_those_of_their_deviates():
    values = np.random.default_rng(15).normal(5, 2, 40)
    chart, deviates = self_starting_individuals(values), self_starting_deviates(values)
    assert set(chart.signals) == set(np.flatnonzero(np.abs(deviates) > 3))
    inside = (chart.lower[FIRST:] <= values[FIRST:]) & (values[FIRST:] <= chart.upper[FIRST:])
    np.testing.assert_array_equal(inside, np.abs(deviates[FIRST:]) <= 3)


def test_a_stated_number_of_records_judges_all_others():
    values = np.append(np.random.default_rng(16).normal(size=10), [3.0, 3.0, 3.0, 3.0])
    by_all, by_ten = self_starting_deviates(values), self_starting_deviates(values, size=10)
    assert by_ten[10] == pytest.approx(by_all[10])
    assert np.ptp(by_ten[10:]) == 0  # the same value against the same ten
    assert by_all[13] < by_all[10]


def test_too_few_or_equal_values_are_refused():
    for values, message in (([1.0, 2.0, 1.0], "6 records"), ([1.0] * 9, "all equal")):
        with pytest.raises(HistoryError, match=message):
            self_starting_deviates(values)
