"""Uncertainty budgets: a result, and the components that its uncertainty combines."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.uncertainty.components import UncertaintyComponent, contributions
from fringecal.uncertainty.degrees_of_freedom import correlated_dof, effective_dof
from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.influences import Source

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Budget:
    """A result with its uncertainty components, each as its change of the result.

    `correlation` is (n, n) over the components; None where they are independent.
    """

    result: Estimate
    components: tuple[UncertaintyComponent, ...]
    correlation: Floats | None = None

    def contributions(self) -> dict[Source, float]:
        """Return what each source contributes in the result's unit, the largest first."""
        return contributions(self.components)

    def percents(self) -> dict[Source, float]:
        """Return the share of the variance in percent by source, in the order of `contributions`.

        The covariance of correlated components is shared equally between the two; a share may be negative.
        """
        effects = np.array([float(one.effect) for one in self.components])
        shares = effects**2 if self.correlation is None else effects * (self.correlation @ effects)
        total = float(shares.sum()) or 1.0
        percents = dict.fromkeys(self.contributions(), 0.0)
        for one, share in zip(self.components, shares, strict=True):
            percents[one.source] += 100 * float(share) / total
        return percents

    def table(self) -> "pd.DataFrame":
        """Return the budget as a table: source of uncertainty, contribution, share of the variance in percent."""
        import pandas as pd

        percents = self.percents()
        rows = [
            {"source of uncertainty": source.text, "contribution": value, "percent": percents[source]}
            for source, value in self.contributions().items()
        ]
        return pd.DataFrame(rows, columns=["source of uncertainty", "contribution", "percent"])


def combined(
    value: float,
    components: Sequence[UncertaintyComponent],
    *,
    unit: str = "",
    label: str = "",
    correlation: ArrayLike | None = None,
    dof_rule: str = "interpolated",
) -> Budget:
    """Combine the components of a result: ``u^2 = sum_i sum_j e_i r_ij e_j`` (JCGM 100:2008, eq. 10 and 16).

    Parameters
    ----------
    value, unit, label
        Of the result.
    components
        n components whose effects are numbers in the result's unit.
    correlation
        (n, n) correlation coefficients; independent when omitted.
    dof_rule
        As for `effective_dof`.

    Examples
    --------
    >>> from fringecal.uncertainty.influences import Influence
    >>> strip = UncertaintyComponent(Influence.STRIP_HEIGHT, 0.03)
    >>> scatter = UncertaintyComponent(Influence.PHASE_SCATTER, -0.04, dof=10)
    >>> both = combined(6.6, [strip, scatter], unit="mm", label="height")
    >>> print(both.result)
    height = 6.600 mm, u = 0.050 mm, dof 24
    >>> {source.text: round(percent) for source, percent in both.percents().items()}
    {'phase scatter': 64, 'strip height': 36}
    """
    effects = np.array([float(one.effect) for one in components])
    matrix = np.eye(effects.size) if correlation is None else np.asarray(correlation, float)
    u = math.sqrt(max(float(effects @ matrix @ effects), 0.0))
    dofs = [one.dof for one in components]
    dof = effective_dof(effects, dofs, rule=dof_rule)
    if correlation is not None:
        dof = correlated_dof(effects, matrix, dofs, rule=dof_rule)
    return Budget(
        Estimate(float(value), u, unit, label, dof), tuple(components), None if correlation is None else matrix
    )
