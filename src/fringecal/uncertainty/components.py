"""Uncertainty components: what one standard uncertainty of each influence does to a quantity, and all of them together.

One vocabulary for parameters, maps, budgets, audits and comparisons: the effect of a component is `c_i u(x_i)`,
sensitivity coefficient times standard uncertainty (JCGM 100:2008, 5.1.3), in the unit of what it acts upon: a number, a
vector of parameters, or one number for each pixel.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.influences import Influence, Source


@dataclass(frozen=True)
class UncertaintyComponent:
    """One component of an uncertainty.

    Parameters
    ----------
    influence
        What it comes from.
    effect
        Signed change of the quantity under one standard uncertainty of the influence: a number or an array.
    dof
        Degrees of freedom of that standard uncertainty.
    detail
        Which of several influences of this kind; see `Source`.
    """

    influence: Influence
    effect: Any
    dof: float = math.inf
    detail: str = ""

    @property
    def source(self) -> Source:
        """Where it comes from; several components may share a source, as the principal axes of a covariance do."""
        return Source(self.influence, self.detail)

    @classmethod
    def of(cls, estimate: Estimate, sensitivity: Any = 1.0) -> "UncertaintyComponent":
        """Take the component that an input's estimate adds to a result, by its sensitivity coefficient.

        An estimate that names no influence is an input of one's own model, known by its label.

        Examples
        --------
        >>> strip = Estimate(3.0, 0.005, "mm", influence=Influence.STRIP_HEIGHT)
        >>> UncertaintyComponent.of(strip, 2.0).effect, UncertaintyComponent.of(Estimate(1.0, 0.1, label="l")).source
        (0.01, Source(influence=<Influence.INPUT: 'input'>, detail='l'))
        """
        if estimate.influence is None:
            return cls(Influence.INPUT, sensitivity * estimate.u, estimate.dof, estimate.label)
        return cls(estimate.influence, sensitivity * estimate.u, estimate.dof)


def contributions(components: Iterable[UncertaintyComponent]) -> dict[Source, float]:
    """Return what each source contributes, the largest first: its components' effects in quadrature.

    Parameters
    ----------
    components
        Independent components whose effects are numbers.

    Examples
    --------
    >>> axes = [UncertaintyComponent(Influence.PHASE_SCATTER, e) for e in (3.0, -4.0)]
    >>> contributions([UncertaintyComponent(Influence.GRID_PITCH, 2.0), *axes])
    {Source(influence=<Influence.PHASE_SCATTER: 'phase scatter'>, detail=''): 5.0, ...
    """
    total: dict[Source, float] = {}
    for one in components:
        total[one.source] = math.hypot(total.get(one.source, 0.0), float(one.effect))
    return dict(sorted(total.items(), key=lambda item: -item[1]))
