"""The worked cases of JCGM 100:2008, annex H, with the published numbers."""

import math

import GTC
import numpy as np
import pytest
import uncertainties

from fringecal.uncertainty.degrees_of_freedom import DofWarning, correlated_dof
from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.propagation import (
    jacobian,
    propagate,
    propagate_covariance,
    second_order,
)
from fringecal.uncertainty.repeatability import fit_line, one_way

R = 1 / math.sqrt(3)  # sd of a rectangular distribution of half width 1

# H.1, end gauge: label, value, u, dof; lengths in nm
H1 = (
    ("l_s", 50_000_623, 25, 18),
    ("d0", 215, 5.8, 24),
    ("d1", 0, 3.9, 5),
    ("d2", 0, 6.7, 8),
    ("alpha_s", 11.5e-6, 2e-6 * R, math.inf),
    ("theta_bar", -0.1, 0.2, math.inf),
    ("Delta", 0, 0.5 / math.sqrt(2), math.inf),
    ("dalpha", 0, 1e-6 * R, 50),
    ("dtheta", 0, 0.05 * R, 2),
)


def end_gauge(x):
    l_s, d0, d1, d2, alpha_s, theta_bar, delta, dalpha, dtheta = x
    return l_s + d0 + d1 + d2 - l_s * (dalpha * (theta_bar + delta) + alpha_s * dtheta) - 50_000_000


def h1_inputs():
    return [Estimate(value, u, label=label, dof=dof) for label, value, u, dof in H1]


def test_h1_end_gauge():
    result = propagate(end_gauge, h1_inputs(), unit="nm", label="l - l_nom")
    assert result.result.value == pytest.approx(838.0, abs=1e-6)
    assert result.result.u == pytest.approx(31.6639, abs=1e-4)  # printed to 1e-4
    assert result.result.dof == pytest.approx(16.752, abs=1e-3)


def test_h1_budget_is_sorted():
    budget = propagate(end_gauge, h1_inputs())
    named = [source.detail for source in budget.contributions()]
    assert named[:6] == ["l_s", "dtheta", "d2", "d0", "d1", "dalpha"]
    contributions = list(budget.contributions().values())
    assert contributions[:6] == pytest.approx([25, 16.6, 6.7, 5.8, 3.9, 2.89], abs=0.05)
    assert contributions[6:] == pytest.approx([0, 0, 0], abs=1e-6)
    assert sum(budget.percents().values()) == pytest.approx(100)
    assert list(budget.table()["source of uncertainty"]) == named


def test_h1_coverage_factor_truncated_and_interpolated():
    """The GUM truncates 16.75 to 16 and gets U99 = 93; tools that interpolate get 91.9: both are offered."""
    cut = propagate(end_gauge, h1_inputs(), dof_rule="truncated").result
    assert cut.dof == 16
    assert cut.expanded(0.99).k == pytest.approx(2.921, abs=5e-4)
    assert pytest.approx(92.5, abs=0.05) == cut.expanded(0.99).U
    smooth = propagate(end_gauge, h1_inputs()).result
    assert smooth.expanded(0.99).k == pytest.approx(2.904, abs=5e-4)
    assert pytest.approx(91.9, abs=0.1) == smooth.expanded(0.99).U
    with pytest.raises(ValueError, match="rule"):
        propagate(end_gauge, h1_inputs(), dof_rule="rounded")


def test_h1_second_order():
    """H.1.7: u grows to 34; Amendment 1:2026 says that the shift of the estimate vanishes here."""
    more = second_order(end_gauge, h1_inputs())
    assert more.u == pytest.approx(33.81, abs=0.005)
    assert more.shift == pytest.approx(0.0, abs=1e-3)


def test_h1_against_gtc_and_uncertainties():
    ours = propagate(end_gauge, h1_inputs()).result
    theirs = end_gauge([GTC.ureal(value, u, dof) for _, value, u, dof in H1])
    assert ours.u == pytest.approx(theirs.u, rel=1e-6)
    assert ours.dof == pytest.approx(theirs.df, rel=1e-6)
    other = end_gauge([uncertainties.ufloat(value, u) for _, value, u, _ in H1])
    assert ours.u == pytest.approx(other.std_dev, rel=1e-6)


# H.2, five simultaneous readings of V, I in mA, phase in rad
VOLT = (5.007, 4.994, 5.005, 4.990, 4.999)
MILLIAMPERE = (19.663, 19.639, 19.640, 19.685, 19.678)
PHASE = (1.0456, 1.0438, 1.0468, 1.0428, 1.0433)


def impedance(x):
    v, i, phase = x
    return np.array([v / i * np.cos(phase), v / i * np.sin(phase), v / i])


def h2_inputs():
    readings = np.array([VOLT, np.array(MILLIAMPERE) * 1e-3, PHASE])
    return readings.mean(axis=1), np.cov(readings) / 5


@pytest.mark.parametrize("method", ["central", "complex"])
def test_h2_impedance(method):
    values, covariance = propagate_covariance(impedance, *h2_inputs(), method=method)
    u = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(u, u)
    assert values == pytest.approx([127.73217, 219.84651, 254.25970], abs=6e-6)
    assert u == pytest.approx([0.071071, 0.295582, 0.236336], abs=1e-6)
    found = [correlation[0, 1], correlation[0, 2], correlation[1, 2]]
    assert found == pytest.approx([-0.58843, -0.48526, 0.99251], abs=1e-5)


def test_h2_dof_of_simultaneous_readings():
    mean, covariance = h2_inputs()
    inputs = [Estimate(m, math.sqrt(c), dof=4) for m, c in zip(mean, np.diag(covariance), strict=True)]
    result = propagate(lambda x: impedance(x)[0], inputs, covariance=covariance).result
    assert result.dof == pytest.approx(4)  # one set of five readings, as GTC finds
    v, i, phase = GTC.multiple_ureal([e.value for e in inputs], [e.u for e in inputs], 4)
    for a, b, c in ((v, i, covariance[0, 1]), (v, phase, covariance[0, 2]), (i, phase, covariance[1, 2])):
        GTC.set_correlation(c / (a.u * b.u), a, b)
    theirs = v / i * GTC.cos(phase)
    assert result.u == pytest.approx(theirs.u, rel=1e-6)
    assert result.dof == pytest.approx(theirs.df)


def test_correlated_inputs_of_different_dof_warn_and_never_become_infinite():
    covariance = [[1.0, 0.5], [0.5, 1.0]]
    with pytest.warns(DofWarning, match="smallest is taken"):
        assert correlated_dof([1.0, 1.0], covariance, [4, 9]) == pytest.approx(4)
    assert correlated_dof([1.0, 1.0], covariance, [math.inf, math.inf]) == math.inf


# H.3, thermometer
T = (21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511)
B = (-0.171, -0.169, -0.166, -0.159, -0.164, -0.165, -0.156, -0.157, -0.159, -0.161, -0.160)


def test_h3_calibration_line():
    line = fit_line(np.array(T) - 20, B)
    u1, u2 = np.sqrt(np.diag(line.covariance))
    assert (line.intercept, u1) == (pytest.approx(-0.171204, abs=1e-6), pytest.approx(0.002878, abs=1e-6))
    assert (line.slope, u2) == (pytest.approx(0.00218270, abs=1e-8), pytest.approx(0.00066794, abs=1e-8))
    assert line.covariance[0, 1] / (u1 * u2) == pytest.approx(-0.93043, abs=1e-5)
    assert line.residual_sd == pytest.approx(0.0034976, abs=1e-7)
    assert line.dof == 9
    inputs = [Estimate(line.intercept, u1, dof=9), Estimate(line.slope, u2, dof=9)]
    at_30 = propagate(lambda y: y[0] + y[1] * (30 - 20), inputs, covariance=line.covariance).result
    assert (at_30.value, at_30.u) == (pytest.approx(-0.149377, abs=1e-6), pytest.approx(0.004139, abs=1e-6))
    assert at_30.dof == pytest.approx(9)


def test_h3_with_a_common_systematic():
    """H.3.6 as the manual of GTC works it: a common error of 0.005 enters the intercept and not the slope."""
    line = fit_line(np.array(T) - 20, B)
    scatter = Estimate(line.intercept, math.sqrt(line.covariance[0, 0]), dof=9)
    both = propagate(lambda y: y[0] + y[1], [scatter, Estimate(0.0, 0.005)]).result
    assert both.u == pytest.approx(0.005769, abs=1e-6)
    assert both.dof == pytest.approx(145.4, abs=0.05)


def test_h5_analysis_of_variance():
    means = 10 + np.array([172, 116, 13, 144, 106, 31, 60, 125, 163, 41]) * 1e-6
    sds = np.array([60, 77, 111, 101, 67, 93, 80, 73, 88, 86]) * 1e-6
    found = one_way(means, sds, 5)
    assert found.mean == pytest.approx(10.0000971, abs=1e-8)
    in_uv = [1e6 * s for s in (found.sd_of_means, found.sd_from_means, found.sd_within, found.sd_between)]
    assert in_uv == pytest.approx([57.09, 127.66, 84.89, 42.64], abs=0.005)
    assert found.f == pytest.approx(2.2615, abs=5e-5)
    assert 0.025 < found.p_value < 0.05  # between F.95(9, 40) = 2.124 and F.975(9, 40) = 2.452
    assert (1e6 * found.u_mean, found.dof) == (pytest.approx(18.05, abs=0.005), 9)
    assert (1e6 * found.u_mean_pooled, found.dof_pooled) == (pytest.approx(13.32, abs=0.005), 49)


def test_derivatives_agree():
    def model(x):
        return np.exp(x[0]) * np.sin(x[1]) / x[2]

    exact = jacobian(model, [0.3, 1.1, 2.0], method="complex")
    e, s, c = math.exp(0.3), math.sin(1.1), math.cos(1.1)
    assert exact == pytest.approx([e * s / 2, e * c / 2, -e * s / 4], rel=1e-14)
    # central differences err by h^2 f''' / 6 with h = u / 100
    assert jacobian(model, [0.3, 1.1, 2.0], u=[0.01] * 3) == pytest.approx(exact, rel=1e-7)
    with pytest.raises(ValueError, match="method"):
        jacobian(model, [0.3, 1.1, 2.0], method="forward")


def test_second_order_of_a_product():
    """E[xy] = xy + cov(x, y), exactly."""
    inputs = [Estimate(2.0, 0.1), Estimate(3.0, 0.2)]
    covariance = [[0.01, 0.008], [0.008, 0.04]]
    assert second_order(lambda x: x[0] * x[1], inputs, covariance=covariance).shift == pytest.approx(0.008)


def test_wrong_covariance_is_refused():
    inputs = [Estimate(1.0, 0.1), Estimate(2.0, 0.1)]
    for wrong in (np.eye(3), [[1, 2], [3, 4]]):
        with pytest.raises(ValueError, match="symmetric covariance"):
            propagate(lambda x: x[0] + x[1], inputs, covariance=wrong)
