"""What the results of a study say: bias, standard deviation against stated u, and coverage, quantity by quantity."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.errors import FringecalError
from fringecal.records import Check, Comparison, Decision, RigResult
from fringecal.uncertainty import COVERAGE, wilson_interval

Array = NDArray[np.float64]

WANTED = (0.93, 0.97)  # share of 95 % intervals that may hold the truth: 500 rigs know it to 1 % (standard deviation)
FEWEST = 2  # rigs: one has no spread
ENOUGH = 52
"""Rigs from which a coverage can be judged: if the intervals of all of fewer held the truth, the band of the coverage
would still begin below 93 % (Wilson: ``n / (n + 1.96^2) >= 0.93``)."""


@dataclass(frozen=True)
class QuantityCoverage:
    """One quantity over all rigs that were commissioned.

    Parameters
    ----------
    name, unit
        The quantity.
    error, u, expanded
        Found minus true, standard uncertainty and 95 % expanded uncertainty of every rig, in the unit.
    """

    name: str
    unit: str
    error: Array
    u: Array
    expanded: Array

    @property
    def z(self) -> Array:
        """Errors over their standard uncertainties."""
        return self.error / self.u

    @property
    def bias(self) -> float:
        """Mean error."""
        return float(np.mean(self.error))

    @property
    def u_bias(self) -> float:
        """Standard uncertainty of the mean error: standard deviation over the root of the number of rigs."""
        return self.sd / np.sqrt(self.error.size)

    @property
    def sd(self) -> float:
        """Standard deviation of the errors."""
        return float(np.std(self.error, ddof=1))

    @property
    def stated(self) -> float:
        """Root mean square of the stated standard uncertainties."""
        return float(np.sqrt(np.mean(self.u**2)))

    @property
    def ratio(self) -> float:
        """Standard deviation of the errors over the stated u; 1 where the stated u is right."""
        return self.sd / self.stated

    @property
    def hits(self) -> int:
        """How many 95 % intervals hold the true value."""
        return int(np.count_nonzero(np.abs(self.error) <= self.expanded))

    @property
    def coverage(self) -> float:
        """Share of 95 % intervals that hold the true value."""
        return self.hits / self.error.size

    @property
    def band(self) -> tuple[float, float]:
        """95 % interval of the coverage: the number of rigs is finite."""
        return wilson_interval(self.hits, self.error.size)

    @property
    def decision(self) -> Decision:
        """Pass within 93..97 %; conditional fail where only the band reaches it, fail where the band does not.

        Too few rigs prove no pass: unless their band lies outside, they are information alone.
        """
        outside = self.band[0] > WANTED[1] or self.band[1] < WANTED[0]
        if self.error.size < ENOUGH and not outside:
            return "info"
        if WANTED[0] <= self.coverage <= WANTED[1]:
            return "pass"
        return "fail" if outside else "conditionalFail"


@dataclass(frozen=True)
class StudySummary:
    """A study: quantities over the rigs commissioned, and the rigs refused with the reason of each."""

    rigs: int
    quantities: tuple[QuantityCoverage, ...]
    refused: dict[int, str]

    @property
    def sentence(self) -> str:
        """Say in one sentence what the study shows."""
        within = sum(q.decision == "pass" for q in self.quantities)
        shares = [100 * q.coverage for q in self.quantities]
        number = len(self.quantities)
        judged = self.rigs - len(self.refused)
        few = f"Too few to judge a coverage: {judged} rigs, {ENOUGH} at least are needed. " if judged < ENOUGH else ""
        return few + (
            f"{self.rigs - len(self.refused)} of {self.rigs} rigs were commissioned, {len(self.refused)} refused. "
            f"95 % intervals hold the true value in {min(shares):.1f} to {max(shares):.1f} % of the rigs; "
            f"{within} of {number} quantities lie within {100 * WANTED[0]:.0f} to {100 * WANTED[1]:.0f} %."
        )

    def frame(self) -> pd.DataFrame:
        """Tabulate all quantities."""
        rows = [
            {
                "quantity": q.name,
                "unit": q.unit,
                "n": q.error.size,
                "bias": q.bias,
                "u(bias)": q.u_bias,
                "standard deviation": q.sd,
                "stated u": q.stated,
                "standard deviation / u": q.ratio,
                "coverage / %": 100 * q.coverage,
                "from / %": 100 * q.band[0],
                "to / %": 100 * q.band[1],
            }
            for q in self.quantities
        ]
        return pd.DataFrame(rows)

    def refusals(self) -> pd.DataFrame:
        """Tabulate the refused rigs."""
        rows = [{"rig": number, "reason": reason} for number, reason in self.refused.items()]
        return pd.DataFrame(rows, columns=["rig", "reason"])

    def checks(self) -> tuple[Check, ...]:
        """Judge every coverage."""
        rule = (
            "share of 95 % intervals that hold the true value, 93 to 97 %; fail where its binomial band lies outside; "
            f"not judged otherwise with fewer than {ENOUGH} rigs"
        )
        return tuple(
            Check(
                name=f"coverage of {q.name}",
                value=100 * q.coverage,
                unit="%",
                limit=100 * WANTED[0 if q.coverage < COVERAGE else 1],
                decision=q.decision,
                rule=rule,
            )
            for q in self.quantities
        )


def summarise(results: Sequence[RigResult]) -> StudySummary:
    """Gather the results of a study by quantity.

    Raises
    ------
    FringecalError
        Fewer than two rigs were commissioned: there is no standard deviation.
    """
    refused = {result.number: result.refused for result in results if result.refused}
    good = [result for result in results if not result.refused]
    if len(good) < FEWEST:
        reason = f"; the first refusal: {next(iter(refused.values()))}" if refused else ""
        raise FringecalError(f"{len(good)} of {len(results)} rigs could be commissioned, two are needed{reason}")
    quantities = tuple(_quantity([result.quantities[k] for result in good]) for k in range(len(good[0].quantities)))
    return StudySummary(len(results), quantities, refused)


def _quantity(rows: Sequence[Comparison]) -> QuantityCoverage:
    found = [row.found.estimate(row.name) for row in rows]
    error = np.array([e.value - row.true for e, row in zip(found, rows, strict=True)])
    expanded = np.array([e.expanded().U for e in found])
    return QuantityCoverage(rows[0].name, found[0].unit, error, np.array([e.u for e in found]), expanded)
