"""The check of first order: components drawn at random through a quantity, against what they combine to."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.uncertainty.budgets import Budget
from fringecal.uncertainty.components import UncertaintyComponent
from fringecal.uncertainty.estimates import COVERAGE
from fringecal.uncertainty.influences import Source
from fringecal.uncertainty.sampling.monte_carlo import (
    MonteCarlo,
    Validation,
    numerical_tolerance,
    summarise_draws,
    validate_first_order,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FirstOrderCheck:
    """A budget by first order, the same components drawn at random, and whether both give the same interval.

    The Monte Carlo decides only where its own `tolerance` is well below the validation's: a fifth of it
    (JCGM 101:2008, 8.2); with fewer draws a difference of both together is still chance.
    """

    budget: Budget
    monte_carlo: MonteCarlo
    validation: Validation

    @property
    def u_ratio(self) -> float:
        """Standard uncertainty by first order over that of the draws."""
        return self.budget.result.u / self.monte_carlo.u


def draw_deviates(components: Sequence[UncertaintyComponent], rng: np.random.Generator, size: int) -> Floats:
    """Draw by how many standard uncertainties each component is off.

    Normal where a component's degrees of freedom are infinite, Student's t where they are finite: scaled and shifted
    t-distribution (JCGM 101:2008, 6.4.9). Components of one source and equal degrees of freedom are principal axes of
    one covariance matrix, known from one scatter: together they follow a multivariate t-distribution (JCGM 102:2011).

    Parameters
    ----------
    components
        n components.
    rng
        Seeded by the caller.
    size
        Number of draws.

    Returns
    -------
    (size, n); each column has spread 1, larger by `sqrt(dof / (dof - 2))` where dof are finite.

    Examples
    --------
    >>> from fringecal.uncertainty.influences import Influence
    >>> strip = UncertaintyComponent(Influence.STRIP_HEIGHT, 0.005)
    >>> draw_deviates([strip], np.random.default_rng(1), 3).round(2).tolist()
    [[0.35], [0.82], [0.33]]
    """
    deviates = rng.standard_normal((size, len(components)))
    groups: dict[tuple[Source, float], list[int]] = {}
    for place, component in enumerate(components):
        groups.setdefault((component.source, component.dof), []).append(place)
    for (_, dof), places in groups.items():
        if math.isfinite(dof):
            deviates[:, places] /= np.sqrt(rng.chisquare(dof, size) / dof)[:, None]
    return deviates


def check_first_order(
    budget: Budget, drawn: ArrayLike, *, coverage: float = COVERAGE, digits: int = 1
) -> FirstOrderCheck:
    """Hold a budget's coverage interval against that of draws through the model itself (JCGM 101:2008, clause 8).

    Parameters
    ----------
    budget
        The result by first order.
    drawn
        (M,) results of the model for the same components drawn at random; see `draw_deviates`.
    coverage
        Coverage probability of both intervals.
    digits
        Significant digits of u that both must agree in.

    Raises
    ------
    FitError
        Draws that are not finite.
    ValueError
        A result without uncertainty.
    """
    result, found = budget.result, summarise_draws(drawn, coverage=coverage)
    tolerance = numerical_tolerance(result.u, digits)
    expanded = result.expanded(coverage).U
    return FirstOrderCheck(budget, found, validate_first_order(result.value, expanded, found, tolerance=tolerance))
