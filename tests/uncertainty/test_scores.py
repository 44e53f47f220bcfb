"""En and zeta scores by hand, with k from the published t table, and effective degrees of freedom."""

import math

import pytest

from fringecal.uncertainty import Estimate, coverage_factor, effective_dof, en_score
from fringecal.uncertainty.scores import zeta_score

# JCGM 100:2008, table G.2, p = 95 %.
T_95 = {1: 12.71, 2: 4.30, 3: 3.18, 5: 2.57, 8: 2.31, 10: 2.23, 20: 2.09, 50: 2.01, math.inf: 1.960}


@pytest.mark.parametrize(("dof", "k"), T_95.items())
def test_coverage_factor_is_that_of_the_table(dof, k):
    assert coverage_factor(dof) == pytest.approx(k, abs=0.0051)
    assert Estimate(0.0, 1.0, dof=dof).interval_95 == pytest.approx((-k, k), abs=0.0051)


@pytest.mark.parametrize(
    ("found", "reference", "en"),
    [
        # U = 2.571 x 0.010 against U = 1.960 x 0.005: 0.03 / sqrt(0.02571^2 + 0.00980^2)
        (Estimate(20.03, 0.010, dof=5), Estimate(20.0, 0.005), 1.0904),
        # both of few degrees of freedom: U = 2.571 x 0.010 and 4.303 x 0.005
        (Estimate(20.03, 0.010, dof=5), Estimate(20.0, 0.005, dof=2), 0.8948),
        # known exactly on both sides: -0.03 / (1.960 x sqrt(0.010^2 + 0.005^2))
        (Estimate(19.97, 0.010), Estimate(20.0, 0.005), -1.3690),
        # a difference that holds both uncertainties already: 0.03 / (2.571 x 0.010)
        (Estimate(0.03, 0.010, dof=5), None, 1.1669),
        # one side without uncertainty
        (Estimate(20.03, 0.0), Estimate(20.0, 0.010, dof=5), 1.1669),
    ],
)
def test_en_by_hand(found, reference, en):
    assert en_score(found, reference) == pytest.approx(en, abs=2e-4)


def test_en_one_is_a_difference_as_large_as_its_expanded_uncertainty():
    one = Estimate(0.0, 0.3, dof=7)
    assert en_score(Estimate(one.expanded().U, one.u, dof=7)) == pytest.approx(1.0)


def test_zeta_is_by_standard_uncertainties():
    assert zeta_score(Estimate(100.10, 0.025, dof=3), Estimate(100.02, 0.015)) == pytest.approx(2.744, abs=1e-3)


def test_a_score_needs_an_uncertainty():
    with pytest.raises(ValueError, match="uncertainty greater than 0"):
        en_score(Estimate(1.0, 0.0), Estimate(2.0, 0.0))


def test_effective_dof_of_the_end_gauge():
    # JCGM 100:2008, H.1.6: contributions in nm as printed there; the sum gives 16.7.
    assert effective_dof([25, 9.7, 2.9, 16.6], [18, 25.6, 50, 2]) == pytest.approx(16.7, abs=0.1)


def test_effective_dof_at_its_limits():
    assert effective_dof([1.0, 2.0], math.inf) == math.inf
    assert effective_dof([-3.0, 0.0], [7, 1]) == pytest.approx(7)  # one contribution alone keeps its own
    assert effective_dof([1.0] * 10, 4) == pytest.approx(40)  # n equal contributions: n times theirs
    assert effective_dof([3.0, 4.0], [5, 10], rule="truncated") == 14
    assert effective_dof([], []) == math.inf
    with pytest.raises(ValueError, match="rule"):
        effective_dof([1.0], [1], rule="rounded")
