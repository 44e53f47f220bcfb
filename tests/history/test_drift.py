"""Drift and intervals: closed forms, coverage by simulation, and refusals."""

import numpy as np
import pytest

from fringecal.errors import HistoryError
from fringecal.history.drift import YEAR_DAYS, drift_of, jumps_of
from fringecal.history.due import LONGEST_DAYS, chart_interval, due_of, staircase

DAYS = np.arange(24) * YEAR_DAYS / 12


def test_a_line_without_scatter():
    drift = drift_of(DAYS[::-1], (5.0 + 0.12 * DAYS / YEAR_DAYS)[::-1], unit="mm")
    assert (drift.rate.value, drift.rate.unit) == (pytest.approx(0.12), "mm/year")
    assert drift.level.value == pytest.approx(5.0 + 0.12 * 23 / 12)
    assert drift.at(1.0).value == pytest.approx(5.0 + 0.12 * 35 / 12)


def test_stated_uncertainties_hold_over_many_histories():
    """95 % intervals of rate and forecast over 300 drawn histories; 3 binomial standard errors are 3.8 %."""
    rng = np.random.default_rng(21)
    hits = np.zeros((300, 2))
    alarms = 0
    for hit in hits:
        drift = drift_of(DAYS, 1.0 + 0.3 * DAYS / YEAR_DAYS + rng.normal(0, 0.1, DAYS.size))
        forecast, future = drift.at(0.5), 1.0 + 0.3 * (23 / 12 + 0.5) + rng.normal(0, 0.1)
        hit[:] = [e.interval_95[0] < x < e.interval_95[1] for e, x in ((drift.rate, 0.3), (forecast, future))]
        alarms += not drift.steady
    assert hits.mean(axis=0) == pytest.approx([0.95, 0.95], abs=0.038)
    assert alarms <= 8  # at most 1 % are expected: 3 with a standard error of 1.7


def test_a_step_is_no_drift():
    x = np.where(np.arange(24) < 12, 0.0, 1.0) + np.random.default_rng(2).normal(0, 0.05, 24)
    drift = drift_of(DAYS, x)
    assert drift.significant
    assert not drift.steady
    with pytest.raises(HistoryError, match="steps"):
        chart_interval(drift, 5.0)


def test_staircase_settles_at_the_reliability_that_was_asked_for():
    """Nine audits within and one beyond bring the interval back: R = 0.9."""
    inside, outside = [0.1] * 9, [1.5]
    assert staircase(200.0, inside + outside).days == pytest.approx(200.0)
    assert staircase(200.0, [0.9, 1.0]).days == 200.0
    assert staircase(200.0, [0.1] * 100).days == LONGEST_DAYS
    assert "1 went beyond" in staircase(200.0, inside + outside).reason
    for days, ratios in ((0.0, [0.1]), (10.0, []), (10.0, [np.nan])):
        with pytest.raises(HistoryError):
            staircase(days, ratios)


def test_chart_interval_of_a_line_without_scatter():
    """0.12 a year from 0.0 at day 0: the limit 0.30 is reached after 2.5 years, 7/12 after the last audit."""
    scatter = 1e-9 * np.array([1, -1] * 12)  # a line without any has no uncertainty at all
    drift = drift_of(DAYS, 0.12 * DAYS / YEAR_DAYS + scatter)
    assert chart_interval(drift, 0.30).days == pytest.approx((2.5 - 23 / 12) * YEAR_DAYS, rel=1e-6)
    assert chart_interval(drift, 0.40, reference=0.10).days == pytest.approx(
        (0.5 / 0.12 - 23 / 12) * YEAR_DAYS, rel=0.2
    )
    assert chart_interval(drift, 0.2).days == 0.0


def test_no_interval_is_longer_than_what_is_known():
    drift = drift_of(DAYS, np.random.default_rng(4).normal(0, 0.01, 24))
    found = chart_interval(drift, 1.0)
    assert found.days == pytest.approx(DAYS[-1])
    assert "reach back" in found.reason


def test_scatter_shortens_the_interval():
    rng = np.random.default_rng(5)
    noise = rng.normal(0, 1, 24)
    rough, fine = (chart_interval(drift_of(DAYS, 0.1 * DAYS / YEAR_DAYS + s * noise), 0.3).days for s in (0.02, 0.002))
    assert rough < fine


def test_too_little_is_refused():
    for days, values in (([0, 1, 2], [1, 2, 3]), ([5, 5, 5, 5], [1, 2, 3, 4])):
        with pytest.raises(HistoryError, match="4 records"):
            drift_of(days, values)
    with pytest.raises(HistoryError, match="limit"):
        chart_interval(drift_of(DAYS, np.sin(DAYS)), 0.0)


def test_parts_share_a_rate_and_nothing_else():
    """Two sawteeth of 0.12 a year, the second set to zero by a calibration: the rate is that of both."""
    parts = np.repeat([0, 1], 12)
    scatter = 1e-9 * np.array([1, -1] * 12)
    sawtooth = 0.12 * (DAYS - np.where(parts, DAYS[12], 0.0)) / YEAR_DAYS + scatter
    drift = drift_of(DAYS, sawtooth, parts=parts)
    assert drift.rate.value == pytest.approx(0.12)
    assert drift.level.value == pytest.approx(0.12 * 11 / 12)
    assert drift.level.dof == 24 - 3
    assert drift.span_years == pytest.approx(11 / 12)
    assert abs(drift_of(DAYS, sawtooth).rate.value) < 0.06  # one line through both teeth is nearly level


def test_jumps_are_found_where_they_are_and_rarely_where_none_are():
    """Of 200 steady histories at most 1 % have one by chance: 2 expected, standard error 1.4."""
    rng = np.random.default_rng(31)
    assert sum(bool(jumps_of(DAYS, rng.normal(0, 1, 24))) for _ in range(200)) <= 6
    found = [jumps_of(DAYS, rng.normal(0, 1, 24) + 6 * (np.arange(24) >= 9)) for _ in range(20)]
    assert all(9 in one or 8 in one or 10 in one for one in found)
    assert sum(one == (9,) for one in found) >= 17


def test_a_steady_rig_keeps_its_interval_however_much_it_scatters():
    """A rate that is not significant shortens nothing, though its forecast reaches the limit at once."""
    rng = np.random.default_rng(6)
    for _ in range(50):
        values = rng.normal(0, 0.3, 7)
        days = 30.0 * np.arange(7)
        drift = drift_of(days, values)
        due = due_of(days, values, 1.0, drift)
        if not drift.significant and abs(values[-1]) <= 1:
            assert due.days >= 30.0


def test_a_record_beyond_the_limit_is_due_now_and_says_by_how_much():
    values = np.array([0.1, 0.0, 0.1, 0.0, 0.41])
    due = due_of(30 * np.arange(5), values, 0.3, drift_of(30 * np.arange(5), values, unit="%"))
    assert (due.days, due.method) == (0.0, "beyond the limit")
    assert "+0.410 % at the last record, limit 0.3 %" in due.reason


def test_a_jump_leaves_the_usual_interval_at_most():
    values = np.where(np.arange(24) < 12, 0.0, 0.5) + np.random.default_rng(2).normal(0, 0.05, 24)
    due = due_of(DAYS, values, 1.0, drift_of(DAYS, values, parts=np.repeat([0, 1], 12)), jumps=1)
    assert due.days == pytest.approx(YEAR_DAYS / 12)
    assert "1 jump" in due.reason
