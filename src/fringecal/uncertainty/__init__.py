"""Estimates, propagation, Monte Carlo and conformity: what is known, and how well."""

from fringecal.uncertainty.budget import Budget, BudgetRow, budget
from fringecal.uncertainty.conformity import (
    Decision,
    conformance_probability,
    decide,
    en_score,
    global_risks,
    guard_band,
    zeta_score,
)
from fringecal.uncertainty.estimates import Estimate, Expanded
from fringecal.uncertainty.monte_carlo import (
    MonteCarlo,
    adaptive,
    propagate_distributions,
    validate_first_order,
)
from fringecal.uncertainty.propagation import jacobian, propagate, propagate_covariance, second_order
from fringecal.uncertainty.systematic import combined_map, linear_uncertainty, mean_uncertainty

__all__ = [
    "Budget",
    "BudgetRow",
    "Decision",
    "Estimate",
    "Expanded",
    "MonteCarlo",
    "adaptive",
    "budget",
    "combined_map",
    "conformance_probability",
    "decide",
    "en_score",
    "global_risks",
    "guard_band",
    "jacobian",
    "linear_uncertainty",
    "mean_uncertainty",
    "propagate",
    "propagate_covariance",
    "propagate_distributions",
    "second_order",
    "validate_first_order",
    "zeta_score",
]
