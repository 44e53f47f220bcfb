"""JCGM 101:2008, clause 9, and the strip-angle budget: closed forms and published intervals."""

import math

import numpy as np
import pytest

from fringecal.errors import FitError
from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.influences import Influence, Source
from fringecal.uncertainty.propagation import propagate, second_order
from fringecal.uncertainty.sampling.distributions import (
    Arcsine,
    CurvedTrapezoid,
    Normal,
    Rectangular,
    StudentT,
    draw_normal,
)
from fringecal.uncertainty.sampling.monte_carlo import (
    adaptive,
    numerical_tolerance,
    propagate_distributions,
    shortest_interval,
    symmetric_interval,
    validate_first_order,
)

ROOT3 = math.sqrt(3)


def total(*xs):
    return sum(xs)


def judged(value, u, model, inputs, *, digits, coverage=0.95, k=1.959964, seed=11, interval="symmetric"):
    """First order against Monte Carlo, the latter run to a fifth of the tolerance."""
    delta = numerical_tolerance(u, digits)

    def draw(rng, size):
        return model(*(item.draw(rng, size) for item in inputs))

    found = adaptive(draw, np.random.default_rng(seed), coverage=coverage, tolerance=delta / 5)
    return validate_first_order(value, k * u, found, tolerance=delta, interval=interval), found


def test_9_2_2_four_normals():
    check, found = judged(0, 2, total, [Normal(0, 1)] * 4, digits=2)
    assert found.u == pytest.approx(2, abs=0.01)
    assert found.symmetric == pytest.approx((-3.9199, 3.9199), abs=0.02)
    assert check.tolerance == 0.05
    assert check.valid


def test_9_2_3_four_rectangulars():
    check, found = judged(0, 2, total, [Rectangular(0, ROOT3)] * 4, digits=2)
    end = 2 * ROOT3 * (2 - (3 / 5) ** 0.25)
    assert end == pytest.approx(3.87941, abs=1e-5)
    assert found.symmetric == pytest.approx((-end, end), abs=0.02)  # twice the numerical tolerance asked for
    assert check.valid


def test_9_2_4_one_rectangular_dominates():
    check, found = judged(0, 10.1489, total, [Normal(0, 1)] * 3 + [Rectangular(0, 10 * ROOT3)], digits=2)
    assert found.u == pytest.approx(math.sqrt(103), abs=0.1)
    assert found.symmetric == pytest.approx((-17.0, 17.0), abs=0.15)
    assert check.tolerance == 0.5
    assert not check.valid
    assert check.d_high == pytest.approx(2.9, abs=0.15)


# 9.3, mass calibration: mg and kg/m3
MASS = (Normal(100_000.000, 0.050), Normal(1.234, 0.020), Rectangular(1.20, 0.10),
        Rectangular(8000.0, 1000.0), Rectangular(8000.0, 50.0))  # fmt: skip


def weighing(m_r, dm_r, rho_a, rho_w, rho_r):
    return (m_r + dm_r) * (1 + (rho_a - 1.2) * (1 / rho_w - 1 / rho_r)) - 100_000.0


def mass_estimates():
    values = [100_000.000, 1.234, 1.20, 8000.0, 8000.0]
    us = [0.050, 0.020, 0.10 / ROOT3, 1000.0 / ROOT3, 50.0 / ROOT3]
    return [Estimate(v, u) for v, u in zip(values, us, strict=True)]


def test_9_3_mass_first_order_fails():
    first = propagate(lambda x: weighing(*x), mass_estimates()).result
    assert (first.value, first.u) == (pytest.approx(1.2340, abs=1e-4), pytest.approx(0.0539, abs=5e-5))
    check, found = judged(first.value, first.u, weighing, MASS, digits=1)
    assert (found.value, found.u) == (pytest.approx(1.2340, abs=1e-3), pytest.approx(0.07548, abs=1e-3))
    assert found.symmetric == pytest.approx((1.0844, 1.3836), abs=2e-3)
    assert check.tolerance == 0.005
    assert not check.valid
    assert max(check.d_low, check.d_high) == pytest.approx(0.044, abs=0.002)


def test_9_3_mass_second_order_holds():
    more = second_order(lambda x: weighing(*x), mass_estimates())
    assert more.u == pytest.approx(0.0750, abs=5e-5)
    check, found = judged(more.value, more.u, weighing, MASS, digits=1, interval="shortest")
    assert found.shortest[1] - found.shortest[0] == pytest.approx(0.299, abs=0.002)
    assert check.valid


@pytest.mark.parametrize(
    ("x1", "mean", "sd", "width"),
    [(0.0, 50, 50, 149.79), (0.010, 150, 111.80, 366.0), (0.050, 2550, 502.49, 1955.0)],
)
def test_9_4_comparison_loss(x1, mean, sd, width):
    """Y / u^2 is noncentral chi-square; in units of 1e-6. First order says u = 2 x1 u and 0 at x1 = 0."""

    def draw(rng, size):
        return 1e6 * (rng.normal(x1, 0.005, size) ** 2 + rng.normal(0, 0.005, size) ** 2)

    found = adaptive(draw, np.random.default_rng(9), digits=2)
    assert found.value == pytest.approx(mean, abs=2 * found.tolerance)
    assert found.u == pytest.approx(sd, abs=2 * found.tolerance)
    assert found.shortest[1] - found.shortest[0] == pytest.approx(width, abs=4 * found.tolerance)
    first = propagate(lambda x: 1e6 * (x[0] ** 2 + x[1] ** 2), [Estimate(x1, 0.005), Estimate(0.0, 0.005)])
    assert first.result.u == pytest.approx(1e6 * 2 * x1 * 0.005, abs=1e-6)
    more = second_order(lambda x: 1e6 * (x[0] ** 2 + x[1] ** 2), [Estimate(x1, 0.005), Estimate(0.0, 0.005)])
    assert (more.value, more.u) == (pytest.approx(mean), pytest.approx(sd, abs=0.01))  # exact for a quadratic


@pytest.mark.parametrize(("x1", "sd", "width"), [(0.0, 67.3, 185), (0.010, 120.5, 384), (0.050, 504.5, 1929)])
def test_9_4_correlated(x1, sd, width):
    covariance = 0.005**2 * np.array([[1, 0.9], [0.9, 1]])

    def draw(rng, size):
        return 1e6 * (draw_normal([x1, 0], covariance, rng, size) ** 2).sum(axis=0)

    found = adaptive(draw, np.random.default_rng(9), digits=2)
    u = 0.005
    assert sd == pytest.approx(1e6 * math.sqrt(4 * u**4 * (1 + 0.81) + 4 * u**2 * x1**2), abs=0.06)
    assert found.u == pytest.approx(sd, abs=2 * found.tolerance)
    assert found.shortest[1] - found.shortest[0] == pytest.approx(width, abs=4 * found.tolerance + 1)


def test_9_5_gauge_block():
    inputs = (StudentT(50_000_623, 25, 18), StudentT(215, 6, 24), StudentT(0, 4, 5), StudentT(0, 7, 8),
              Rectangular(11.5e-6, 2e-6), Normal(-0.1, 0.2), Arcsine(0, 0.5),
              CurvedTrapezoid(0, 1e-6, 0.1e-6), CurvedTrapezoid(0, 0.05, 0.025))  # fmt: skip

    def gauge(l_s, d, d1, d2, alpha_s, theta, delta, dalpha, dtheta):
        return l_s + d + d1 + d2 - l_s * (dalpha * (theta + delta) + alpha_s * dtheta) - 50_000_000

    rng = np.random.default_rng(2)
    found = propagate_distributions(gauge, inputs, rng, coverage=0.99, digits=2)
    assert found.value == pytest.approx(838.0, abs=0.5)
    assert found.u == pytest.approx(35.8, abs=0.5)
    assert found.shortest[1] - found.shortest[0] == pytest.approx(931.4 - 744.1, abs=1.5)
    assert found.symmetric == pytest.approx((744.4, 931.7), abs=1.0)


# the seed rig's strip angle: break in px, scale, strip height, pitch, phase; reference values per case
CASES = {
    "one edge": (0.5 / ROOT3, 1.63, 5.8, "break", 99),
    "24 edges of half a pixel": (0.5 / ROOT3 / math.sqrt(24), 0.35, 1.3, "break", 83),
    "24 edges of a tenth": (0.1 / ROOT3 / math.sqrt(24), 0.14, 0.59, "strip", 43),
}
BREAK_PX = 3.665 / 0.734
PHASE_RAD = 2 * math.pi * 1.2
U_PHASE_RAD = math.sqrt(2) * math.sqrt(2 / 3) / 50  # object minus plate, three steps, B / sigma = 50


def height(x):
    break_px, scale, strip, pitch, phase = x
    return pitch * phase / (2 * np.pi) * strip / (break_px * scale)


def strip_inputs(u_break):
    return [
        Estimate(BREAK_PX, u_break, label="break"),
        Estimate(0.734, 0.002 * 0.734, label="scale"),
        Estimate(3.0, 0.02 / ROOT3, label="strip"),
        Estimate(10.0, 0.01, label="pitch"),
        Estimate(PHASE_RAD, U_PHASE_RAD, label="phase"),
    ]


@pytest.mark.parametrize("case", CASES)
def test_strip_angle_budget(case):
    u_break, u_theta_deg, percent, label, share = CASES[case]
    result = propagate(height, strip_inputs(u_break))
    assert result.result.value == pytest.approx(9.823, abs=5e-4)
    assert 100 * result.result.u / result.result.value == pytest.approx(percent, rel=0.02)  # printed to 2 digits
    largest, percent = next(iter(result.percents().items()))
    assert largest == Source(Influence.INPUT, label)
    assert percent == pytest.approx(share, abs=2)
    angle = propagate(lambda x: np.degrees(np.arctan(x[0] * x[1] / x[2])), strip_inputs(u_break)[:3]).result
    assert angle.value == pytest.approx(50.7, abs=0.01)
    assert angle.u == pytest.approx(u_theta_deg, rel=0.02)


@pytest.mark.parametrize(
    ("break_distribution", "u_break", "valid"),
    [
        (Rectangular(BREAK_PX, 0.5), 0.5 / ROOT3, False),
        (Normal(BREAK_PX, 0.5 / ROOT3 / math.sqrt(24)), 0.5 / ROOT3 / math.sqrt(24), True),
        (Normal(BREAK_PX, 0.1 / ROOT3 / math.sqrt(24)), 0.1 / ROOT3 / math.sqrt(24), True),
    ],
    ids=list(CASES),
)
def test_strip_angle_first_order_against_monte_carlo(break_distribution, u_break, valid):
    first = propagate(height, strip_inputs(u_break)).result
    inputs = [break_distribution, Normal(0.734, 0.002 * 0.734), Rectangular(3.0, 0.02), Normal(10.0, 0.01),
              Normal(PHASE_RAD, U_PHASE_RAD)]  # fmt: skip
    check, _ = judged(first.value, first.u, lambda *x: height(x), inputs, digits=1)
    assert check.valid == valid
    if not valid:
        assert (check.d_low, check.d_high) == (pytest.approx(0.258, abs=0.01), pytest.approx(0.080, abs=0.01))


def test_strip_angle_second_order_shift():
    """Amendment 1:2026: +33 um for a single edge, some tenths of a micrometre at most for the best case."""
    assert 1e3 * second_order(height, strip_inputs(0.5 / ROOT3)).shift == pytest.approx(33, abs=0.5)
    best = second_order(height, strip_inputs(0.1 / ROOT3 / math.sqrt(24)))
    # h (u_rel(break)^2 + u_rel(scale)^2), the two inputs in the denominator: 55 nm and 39 nm, below 0.2 um
    relative = 0.1 / ROOT3 / math.sqrt(24) / BREAK_PX
    assert best.shift == pytest.approx(9.823 * (relative**2 + 0.002**2), rel=1e-3)


def test_intervals_of_a_known_sample():
    values = np.arange(1, 101.0) ** 2
    assert shortest_interval(values, 0.9) == (1.0, 91.0**2)
    assert symmetric_interval(values, 0.9) == (6.0**2, 96.0**2)


def test_numerical_tolerance_of_published_u():
    assert [numerical_tolerance(u, d) for u, d in ((2.0, 2), (2.0, 1), (10.1489, 2), (0.0755, 1), (0.0755, 2))] == (
        pytest.approx([0.05, 0.5, 0.5, 0.005, 0.0005])
    )
    with pytest.raises(ValueError, match="greater than 0"):
        numerical_tolerance(0.0)


def test_same_seed_same_result():
    first, second = (propagate_distributions(total, [Normal(0, 1)] * 2, np.random.default_rng(5), digits=1)
                     for _ in range(2))  # fmt: skip
    assert first == second


def test_failure_is_said():
    rng = np.random.default_rng(0)
    with pytest.raises(FitError, match="not finite"):
        propagate_distributions(lambda a: np.log(np.where(a > 0, a, np.nan)), [Normal(0, 1)], rng)
    with pytest.raises(FitError, match="not stable"):
        adaptive(lambda g, n: g.standard_cauchy(n), rng, max_trials=200_000)
