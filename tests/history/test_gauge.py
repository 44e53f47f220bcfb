"""Gauge studies against the AIAG manual's example, closed forms, and simulated studies of known variances."""

import numpy as np
import pytest

from fringecal.errors import HistoryError
from fringecal.history.gauge import anova_study, range_study
from fringecal.history.type_one import type_one_study

# AIAG MSA, 4th edition, figure III-B 15: three trials of each operator on ten parts
AIAG = {
    "A": [
        [0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36],
        [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
        [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31],
    ],
    "B": [
        [0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68],
        [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
        [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50],
    ],
    "C": [
        [0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49],
        [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
        [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16],
    ],
}


@pytest.fixture
def aiag():
    return np.array(list(AIAG.values())).transpose(2, 0, 1)


def test_range_method_of_the_manual(aiag):
    study = range_study(aiag)
    found = (study.repeatability, study.reproducibility, study.gauge, study.parts, study.total)
    # the manual rounds its constants to four digits
    assert found == pytest.approx((0.20188, 0.22963, 0.30575, 1.10456, 1.14610), abs=1.5e-4)
    assert (study.percent, study.categories) == pytest.approx((26.68, 5.09), abs=0.01)
    assert study.verdict == "conditional"


def test_anova_of_the_manual(aiag):
    study = anova_study(aiag)
    found = (study.repeatability, study.reproducibility, study.gauge, study.parts, study.total)
    assert found == pytest.approx((0.199933, 0.226838, 0.302372, 1.042327, 1.085300), abs=1e-6)
    assert (study.interaction_f, study.interaction_p) == pytest.approx((0.434, 0.974), abs=5e-4)
    assert (study.percent, study.categories) == pytest.approx((27.86, 4.86), abs=0.01)
    assert study.pooled
    assert study.percent_of_tolerance(6 * study.gauge) == pytest.approx(100)


def simulated(rng, parts=6, operators=3, trials=3, *, interaction=0.0):
    """A study of repeatability 1, operators 0.5, parts 4."""
    return (
        rng.normal(0, 4, (parts, 1, 1))
        + rng.normal(0, 0.5, (1, operators, 1))
        + rng.normal(0, interaction, (parts, operators, 1)) * (interaction > 0)
        + rng.normal(0, 1, (parts, operators, trials))
    )


def test_both_methods_find_the_variances_that_were_put_in():
    rng = np.random.default_rng(11)
    studies = [simulated(rng) for _ in range(300)]
    for method, bias in ((anova_study, 0.0), (range_study, 0.02)):
        variance = np.mean([method(x).repeatability ** 2 for x in studies])
        # relative scatter of a variance with 36 degrees of freedom is 0.24; of the mean of 300, 0.014
        assert variance == pytest.approx(1.0, abs=3 * 0.014 + bias)


def test_the_uncertainty_of_repeatability_is_its_scatter():
    rng = np.random.default_rng(12)
    studies = [anova_study(simulated(rng, interaction=1.0), pooling=1.0) for _ in range(300)]
    scatter = np.std([study.repeatability for study in studies])
    assert np.mean([study.u_repeatability for study in studies]) == pytest.approx(scatter, rel=0.13)  # 300 draws: 4 %


def test_an_interaction_is_kept_and_counts_as_reproducibility():
    rng = np.random.default_rng(13)
    study = anova_study(simulated(rng, parts=20, trials=4, interaction=3.0))
    assert not study.pooled
    assert study.reproducibility == pytest.approx(np.hypot(3.0, 0.5), rel=0.4)
    assert study.repeatability == pytest.approx(1.0, rel=0.2)


def test_one_operator_has_no_reproducibility():
    rng = np.random.default_rng(14)
    x = simulated(rng, parts=12, operators=1, trials=5)
    for study in (anova_study(x), range_study(x)):
        assert study.reproducibility == 0
        assert study.gauge == study.repeatability
    # closed form: mean variance within
    assert anova_study(x).repeatability == pytest.approx(np.sqrt(x.var(axis=2, ddof=1).mean()))


@pytest.mark.parametrize(
    ("readings", "what"),
    [
        (np.zeros((3, 3)), "parts x operators x trials"),
        (np.zeros((1, 3, 3)), "2 parts"),
        (np.zeros((3, 3, 1)), "2 trials"),
        (np.full((3, 3, 2), np.nan), "missing"),
        (np.zeros((3, 3, 2)), "do not differ"),
        (np.arange(3.0)[:, None, None] + np.zeros((3, 3, 2)), "do not differ"),
    ],
)
def test_studies_refuse_what_says_nothing(readings, what):
    for method in (range_study, anova_study):
        with pytest.raises(HistoryError, match=what):
            method(readings)


def with_moments(mean, sd, count):
    """Values of exactly this mean and standard deviation."""
    x = np.linspace(-1, 1, count)
    return mean + sd * x / x.std(ddof=1)


def test_type_one_of_the_example():
    """50 readings, mean 6.00134, s 0.000717422, reference 6.002, tolerance 0.06."""
    study = type_one_study(with_moments(6.00134, 0.000717422, 50), 6.002, 0.06)
    assert (study.cg, study.cgk, study.t) == pytest.approx((2.788, 2.481, -6.505), abs=1e-3)
    assert study.capable
    assert study.p < 1e-6  # the bias is significant although Cgk passes


def test_type_one_says_what_stands_against_the_gauge():
    few = type_one_study(with_moments(10.02, 0.01, 10), 10.0, 0.1, resolution=0.01)
    assert not few.capable
    assert [reason.split()[0] for reason in few.reasons] == ["Cg", "Cgk", "10", "the"]
    assert type_one_study(with_moments(10.0, 0.01, 25), 10.0, 1.0, spread=4.0).cg == pytest.approx(5.0)
    for readings, tolerance in (([1.0], 1.0), ([1.0, 1.0], 1.0), ([1.0, np.nan], 1.0), ([1.0, 2.0], 0.0)):
        with pytest.raises(HistoryError):
            type_one_study(readings, 1.0, tolerance)
