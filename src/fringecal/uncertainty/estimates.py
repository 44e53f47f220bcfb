"""An estimate: a value with its uncertainty."""

import math
from dataclasses import dataclass

from scipy.special import ndtri, stdtrit  # scipy.stats gives the same and takes ten times as long to load

from fringecal.uncertainty.influences import Influence

COVERAGE = 0.95
"""Coverage probability of every expanded uncertainty that is stated anywhere."""

_EXACT_DIGITS = 6  # after the point, where no uncertainty says how many are worth printing


def coverage_factor(dof: float = math.inf, coverage: float = COVERAGE) -> float:
    """Return the coverage factor k: Student's t for the degrees of freedom, normal where they are infinite.

    Two-sided, ``k = t_p(nu)`` (JCGM 100:2008, G.3 and table G.2).

    Examples
    --------
    >>> [round(coverage_factor(dof), 3) for dof in (5, 30, math.inf)]
    [2.571, 2.042, 1.96]
    """
    level = 0.5 + coverage / 2
    return float(stdtrit(dof, level) if math.isfinite(dof) else ndtri(level))


@dataclass(frozen=True)
class Expanded:
    """An expanded uncertainty `U = k u`, with its coverage factor and coverage probability."""

    U: float
    k: float
    coverage: float


@dataclass(frozen=True)
class Estimate:
    """A value with standard uncertainty, degrees of freedom, unit and label.

    Parameters
    ----------
    value, u
        Best estimate and its standard uncertainty, both in `unit`.
    unit
        Unit as text, for example ``"mm/px"`` or ``"deg"``.
    label
        What the number is, as it stands in tables and budgets.
    dof
        Degrees of freedom of `u`; infinite when `u` is taken as exactly known.
    influence
        Which influence quantity of other results it is, where it is one.

    Examples
    --------
    >>> scale = Estimate(0.734, 0.0002, unit="mm/px", label="mean scale", dof=30)
    >>> print(scale)
    mean scale = 0.73400 mm/px, u = 0.00020 mm/px, dof 30
    """

    value: float
    u: float
    unit: str = ""
    label: str = ""
    dof: float = math.inf
    influence: Influence | None = None

    def expanded(self, coverage: float = COVERAGE) -> Expanded:
        """Expand by the coverage factor for the stated degrees of freedom."""
        k = coverage_factor(self.dof, coverage)
        return Expanded(k * self.u, k, coverage)

    @property
    def interval_95(self) -> tuple[float, float]:
        """Bounds of the 95 % coverage interval, symmetric about the value."""
        half = self.expanded().U
        return self.value - half, self.value + half

    def __str__(self) -> str:
        """Print value and standard uncertainty to two digits of the uncertainty."""
        digits = max(0, 1 - math.floor(math.log10(self.u))) if self.u > 0 else _EXACT_DIGITS
        unit = f" {self.unit}" if self.unit else ""
        dof = "inf" if math.isinf(self.dof) else f"{self.dof:.0f}"
        return f"{self.label} = {self.value:.{digits}f}{unit}, u = {self.u:.{digits}f}{unit}, dof {dof}"
