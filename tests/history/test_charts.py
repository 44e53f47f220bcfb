"""Control charts against the NIST/SEMATECH e-Handbook, and their run lengths against Markov chains."""

import numpy as np
import pytest
from scipy import stats

from fringecal.errors import HistoryError
from fringecal.history.charts import (
    Baseline,
    baseline_of,
    cusum_chart,
    ewma_chart,
    individuals_chart,
)
from fringecal.history.constants import MOVING_RANGE, c4, range_moments
from fringecal.history.run_lengths import cusum_run_length, ewma_run_length, shewhart_run_length

# e-Handbook 6.3.2.4
EWMA_VALUES = [
    52.0, 47.0, 53.0, 49.3, 50.1, 47.0, 51.0, 50.1, 51.2, 50.5,
    49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1,
]  # fmt: skip
EWMA_PRINTED = [
    50.60, 49.52, 50.56, 50.18, 50.16, 49.21, 49.75, 49.85, 50.26, 50.33,
    50.11, 49.36, 49.52, 50.05, 49.38, 49.92, 50.73, 51.23, 51.94, 51.99,
]  # fmt: skip
# e-Handbook 6.3.2.3: target 325, k = 0.3175, h = 4.1959 in the unit of the values
CUSUM_VALUES = [
    324.925, 324.675, 324.725, 324.350, 325.350, 325.225, 324.125, 324.525, 325.225, 324.600,
    324.625, 325.150, 328.325, 327.250, 327.825, 328.500, 326.675, 327.775, 326.875, 328.350,
]  # fmt: skip
SLACK, LIMIT = 0.3175, 4.1959


def test_ewma_of_the_handbook():
    chart = ewma_chart(EWMA_VALUES, Baseline(50.0, 2.0539), weight=0.3, width=3.0, settled=True)
    np.testing.assert_allclose(chart.statistic, EWMA_PRINTED, atol=0.0051)  # printed to two decimals
    assert chart.upper[0] == pytest.approx(52.5884, abs=5e-5)
    assert chart.lower[0] == pytest.approx(47.4116, abs=5e-5)
    assert chart.signals == ()


def test_exact_limits_of_an_ewma_start_at_those_of_its_first_value():
    chart = ewma_chart(EWMA_VALUES, Baseline(50.0, 2.0), weight=0.25, width=3.0)
    assert chart.upper[0] == pytest.approx(50 + 3 * 2 * 0.25)  # Var z_1 = weight^2 sigma^2
    assert chart.upper[-1] == pytest.approx(50 + 6 * np.sqrt(0.25 / 1.75), rel=1e-4)


def test_cusum_of_the_handbook():
    sigma = 0.635  # the handbook's k is half of it
    chart = cusum_chart(CUSUM_VALUES, Baseline(325.0, sigma), slack=SLACK / sigma, limit=LIMIT / sigma)
    assert chart.statistic[[12, 13, 19]] == pytest.approx([3.01, 4.94, 19.04], abs=0.0051)
    assert chart.upper[0] == pytest.approx(LIMIT)
    assert chart.first_signal == 13
    assert chart.alarm
    assert -chart.second[:5] == pytest.approx([0.0, 0.0075, 0.0, 0.3325, 0.0], abs=1e-9)  # by hand


def test_a_fall_signals_as_a_rise_does():
    mirrored = 650.0 - np.array(CUSUM_VALUES)
    rise, fall = (cusum_chart(x, Baseline(325.0, 0.635)) for x in (CUSUM_VALUES, mirrored))
    np.testing.assert_allclose(fall.second, -rise.statistic, atol=1e-9)
    assert fall.signals == rise.signals


def test_individuals_by_hand():
    values = [10.0, 12.0, 11.0, 13.0, 12.0, 11.0, 30.0]
    baseline = baseline_of(values, size=6)
    mean_range = (2 + 1 + 2 + 1 + 1) / 5
    chart = individuals_chart(values, baseline)
    # 3 / d2 = 2.65868 of two values
    assert chart.upper[0] == pytest.approx(11.5 + 2.65868 * mean_range, abs=1e-5)
    assert chart.lower[0] == pytest.approx(11.5 - 2.65868 * mean_range, abs=1e-5)
    assert chart.signals == (6,)


def test_constants_of_the_tables():
    assert 3 / MOVING_RANGE.d2 == pytest.approx(2.65868, abs=5e-6)
    table = {2: 0.797885, 3: 0.886227, 4: 0.921318, 5: 0.939986, 10: 0.972659}
    assert {n: c4(n) for n in table} == pytest.approx(table, abs=5e-7)
    # ASTM MNL 7, table 49
    for size, d2, d3 in ((2, 1.128, 0.853), (3, 1.693, 0.888), (5, 2.326, 0.864), (10, 3.078, 0.797)):
        assert range_moments(size) == pytest.approx((d2, d3), abs=5.1e-4)
    assert range_moments(3).d2 == pytest.approx(3 / np.sqrt(np.pi), abs=1e-9)  # closed form


def test_the_scatter_of_sigma_is_as_stated():
    rng = np.random.default_rng(5)
    sigmas = [baseline_of(rng.normal(size=20)).sigma for _ in range(4000)]
    stated = baseline_of(rng.normal(size=20)).u_sigma_relative
    # a large-sample formula, 3 % of chance in 4000 draws and about 3 % of theory at 20 values
    assert np.std(sigmas) == pytest.approx(stated, rel=0.06)
    assert np.mean(sigmas) == pytest.approx(1.0, abs=0.015)


def markov_run_length(step, states):
    """Average run length of a chain from its transition probabilities between cells that are in control."""
    return np.linalg.solve(np.eye(states) - step, np.ones(states))


def markov_ewma(shift, weight, width, cells=301):
    half = width * np.sqrt(weight / (2 - weight))
    edges = np.linspace(-half, half, cells + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    reach = stats.norm.cdf((edges - (1 - weight) * middle[:, None]) / weight - shift)
    return markov_run_length(np.diff(reach, axis=1), cells)[cells // 2]


def markov_cusum(shift, slack, limit, cells=300):
    """Brook and Evans 1972: the cell of 0 gathers everything below it."""
    w = 2 * limit / (2 * cells - 1)
    i, j = np.arange(cells)[:, None], np.arange(cells)
    edge = stats.norm.cdf((j - i) * w + w / 2 + slack - shift)
    step = np.column_stack([edge[:, 0], np.diff(edge, axis=1)])
    return markov_run_length(step, cells)[0]


@pytest.mark.parametrize(
    ("weight", "width", "printed"), [(0.1, 2.814, (498, 10.3)), (0.2, 2.962, (499, 10.5)), (0.4, 3.054, (500, 14.3))]
)
def test_run_lengths_of_ewma(weight, width, printed):
    """Printed values come from a chain of cells that is 4e-3 coarse in control; Lucas and Saccucci 1990 give 500."""
    for shift, value in zip((0.0, 1.0), printed, strict=True):
        found = ewma_run_length(shift, weight=weight, width=width)
        assert found == pytest.approx(value, rel=4e-3 if shift == 0 else 5e-3)
        assert shift or found == pytest.approx(500, abs=0.5)
        assert found == pytest.approx(markov_ewma(shift, weight, width), rel=2e-3)


@pytest.mark.parametrize(("limit", "printed"), [(4.0, (167.7, 8.38)), (5.0, (465.4, 10.38)), (4.77, (368.5, 9.92))])
def test_run_lengths_of_cusum(limit, printed):
    for shift, value, digit in zip((0.0, 1.0), printed, (0.07, 0.0051), strict=True):  # rounded, from a chain
        found = cusum_run_length(shift, limit=limit)
        assert found == pytest.approx(value, abs=digit)
        sides = [markov_cusum(side, 0.5, limit) for side in (shift, -shift)]
        assert found == pytest.approx(1 / sum(1 / side for side in sides), rel=2e-3)


def test_run_lengths_of_single_values():
    assert shewhart_run_length() == pytest.approx(370.4, abs=0.05)
    assert shewhart_run_length(1.0) == pytest.approx(43.9, abs=0.05)


def test_the_charts_run_as_long_as_computed():
    """Drawn series with a shift of one sigma: mean run within 4 standard errors."""
    rng = np.random.default_rng(3)
    series = rng.normal(1.0, 1.0, size=(400, 150))
    for chart, expected in (
        (lambda x: ewma_chart(x, Baseline(0.0, 1.0), settled=True), ewma_run_length(1.0)),
        (lambda x: cusum_chart(x, Baseline(0.0, 1.0)), cusum_run_length(1.0)),
    ):
        runs = np.array([chart(x).first_signal + 1 for x in series])
        assert abs(runs.mean() - expected) < 4 * runs.std() / np.sqrt(len(runs))


@pytest.mark.parametrize("values", [[], [1.0, np.nan, 2.0], [[1.0, 2.0]]])
def test_charts_refuse_what_is_no_series(values):
    with pytest.raises(HistoryError, match="finite values"):
        individuals_chart(values, Baseline(0.0, 1.0))


def test_baselines_refuse_too_little_and_no_scatter():
    with pytest.raises(HistoryError, match="6 values at least, found 3"):
        baseline_of([1.0, 2.0, 3.0])
    with pytest.raises(HistoryError, match="all equal"):
        baseline_of([0.734] * 8)
    with pytest.raises(HistoryError, match="weight"):
        ewma_chart([1.0], Baseline(0.0, 1.0), weight=0.0)
