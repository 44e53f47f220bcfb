"""Uncertainty budgets: what each influence contributes, the largest first."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from fringecal.uncertainty.estimates import Estimate

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class BudgetRow:
    """One influence: its standard uncertainty, its sensitivity, and what it adds to the result.

    `contribution` is ``|c u|`` in the result's unit. `percent` is its share of the variance; with
    correlated inputs the covariance terms are shared equally, and a share may be negative.
    """

    label: str
    value: float
    u: float
    unit: str
    dof: float
    sensitivity: float
    contribution: float
    percent: float


@dataclass(frozen=True)
class Budget:
    """A result with its influences, sorted by their share of the variance."""

    result: Estimate
    rows: tuple[BudgetRow, ...]

    def table(self) -> "pd.DataFrame":
        """Return the rows as a table."""
        import pandas as pd

        return pd.DataFrame([vars(row) for row in self.rows])


def budget(
    result: Estimate,
    inputs: Sequence[Estimate],
    sensitivities: ArrayLike,
    *,
    covariance: ArrayLike | None = None,
) -> Budget:
    """Sort the contributions of inputs to a result.

    Parameters
    ----------
    result
        The result, with its combined standard uncertainty.
    inputs
        n labelled inputs.
    sensitivities
        (n,) partial derivatives of the result, unit of the result per unit of the input.
    covariance
        (n, n) covariance of the inputs; their own `u`, uncorrelated, when omitted.

    Examples
    --------
    >>> strip = Estimate(3.0, 0.03, unit="mm", label="strip height")
    >>> shift = Estimate(3.6, 0.04, unit="mm", label="fringe shift")
    >>> both = budget(Estimate(6.6, 0.05, unit="mm"), [strip, shift], [1.0, 1.0])
    >>> [(row.label, round(row.percent)) for row in both.rows]
    [('fringe shift', 64), ('strip height', 36)]
    """
    c = np.asarray(sensitivities, float)
    u = np.array([item.u for item in inputs])
    matrix = np.diag(u**2) if covariance is None else np.asarray(covariance, float)
    u = np.sqrt(np.diag(matrix))
    share = c * (matrix @ c)
    total = float(share.sum())
    percent = 100 * share / total if total > 0 else np.zeros_like(c)
    rows = [
        BudgetRow(item.label, item.value, float(ui), item.unit, item.dof, float(ci), float(abs(ci) * ui), float(p))
        for item, ui, ci, p in zip(inputs, u, c, percent, strict=True)
    ]
    return Budget(result, tuple(sorted(rows, key=lambda row: -row.percent)))
