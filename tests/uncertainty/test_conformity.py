"""JCGM 106 and ISO 14253-1: published probabilities, guard bands and risks."""

import math

import numpy as np
import pytest
from scipy import stats

from fringecal.errors import FitError
from fringecal.uncertainty.conformity import conformance_probability, decide, global_risks, guard_band


def test_conformance_probabilities():
    assert conformance_probability(-5.47, 0.05, upper=-5.40) == pytest.approx(0.9192, abs=5e-5)
    assert conformance_probability(13.6, 1.8, lower=12.5, upper=16.3) == pytest.approx(0.6626, abs=5e-5)
    assert conformance_probability(1.0, 0.0, lower=0.5, upper=1.0) == 1.0


@pytest.mark.parametrize(
    ("width", "guard"),
    [
        (math.inf, 1.6449),
        (8.0, 1.6449),
        (6.0, 1.6449),
        (5.0, 1.6488),
        (4.5, 1.6677),
        (4.0, 1.7962),
        (3.92, 1.9539),
    ],
)
def test_exact_guard_band(width, guard):
    # at 3.92 the zone has all but closed: its edge moves by 0.03 for 1e-4 of width, hence 1e-3 there
    assert guard_band(1.0, tolerance=width) == pytest.approx(guard, abs=1e-3 if width == 3.92 else 6e-5)
    assert guard_band(0.2, tolerance=0.2 * width) == pytest.approx(0.2 * guard, abs=3e-4)


def test_no_acceptance_zone():
    with pytest.raises(FitError, match="no acceptance zone"):
        guard_band(1.0, tolerance=3.9)
    assert decide(0.0, 1.0, lower=-1.9, upper=1.9).outcome == "conditionalPass"
    assert conformance_probability(4 - 1.645, 1.0, lower=0.0, upper=4.0) == pytest.approx(0.94075, abs=1e-5)


@pytest.mark.parametrize(
    ("y", "outcome"),
    [(0.0, "pass"), (0.82, "pass"), (0.85, "conditionalPass"), (1.0, "conditionalPass"),
     (1.1, "conditionalFail"), (1.17, "fail"), (-1.17, "fail"), (-0.85, "conditionalPass")],
)  # fmt: skip
def test_four_outcomes(y, outcome):
    """u = 0.1, limits of +-1: guard bands end at 0.8355 and 1.1645."""
    assert decide(y, 0.1, lower=-1.0, upper=1.0).outcome == outcome


def test_wide_u_never_passes_and_never_claims_to_fail_inside():
    assert decide(0.0, 100.0, lower=-1.0, upper=1.0).outcome == "conditionalPass"


@pytest.mark.parametrize(
    ("guard", "consumer", "producer"),
    [
        (0.0, 0.0189422, 0.0372078),
        (0.02, 0.00988, 0.06903),
        (0.04, 0.0043341, 0.1146566),
        (0.08, 0.00047, 0.24767),
    ],
)
def test_global_risks(guard, consumer, producer):
    risks = global_risks(1500.0, 0.12, 0.04, lower=1499.8, upper=1500.2, guard=guard)
    digits = 1e-7 if guard in (0.0, 0.04) else 6e-6  # as printed
    assert risks.consumer == pytest.approx(consumer, abs=digits)
    assert risks.producer == pytest.approx(producer, abs=digits)


def test_unconditional_and_conditional_risk_differ():
    risks = global_risks(1500.0, 0.12, 0.04, lower=1499.8, upper=1500.2)
    rng = np.random.default_rng(4)
    true = rng.normal(1500.0, 0.12, 2_000_000)
    accepted = np.abs(true + rng.normal(0, 0.04, true.size) - 1500) < 0.2
    bad = np.abs(true - 1500) > 0.2
    assert risks.consumer == pytest.approx(np.mean(accepted & bad), abs=3e-4)  # 3 sd of the share
    assert risks.consumer_of_accepted == pytest.approx(np.mean(bad[accepted]), abs=3.5e-4)


def test_specific_risk_at_a_guard_of_two_u():
    """ILAC-G8, w = U: 2.28 % at the acceptance limit."""
    assert 1 - conformance_probability(1.0 - 0.2, 0.1, upper=1.0) == pytest.approx(stats.norm.sf(2.0))
    assert stats.norm.sf(2.0) == pytest.approx(0.0228, abs=5e-5)


def test_nonsense_is_refused():
    for wrong in (
        {"u": -1.0, "upper": 1.0},
        {"u": math.nan, "upper": 1.0},
        {"u": 1.0, "lower": 2.0, "upper": 1.0},
    ):
        with pytest.raises(ValueError, match="lower < upper"):
            conformance_probability(0.0, **wrong)
