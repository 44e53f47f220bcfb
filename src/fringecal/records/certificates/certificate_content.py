"""The content of a calibration report, apart from its form as XML or on paper."""

import datetime
import math
from dataclasses import dataclass

from fringecal.errors import RecordError
from fringecal.records.certificates.laboratory import Laboratory
from fringecal.records.parts import Decision
from fringecal.uncertainty import COVERAGE, Estimate

_D_SI = {
    "mm": ("\\milli\\metre", ""),
    "mm/px": ("\\milli\\metre", "per pixel"),
    "deg": ("\\degree", ""),
    "rad": ("\\radian", ""),
    "px": ("\\one", "in pixels"),
    "%": ("\\one", "in percent"),
    "": ("\\one", ""),
}


def dsi_unit(unit: str) -> tuple[str, str]:
    r"""Give a unit as D-SI writes it, and what the name must say since D-SI knows no pixels.

    Raises
    ------
    RecordError
        The unit has no D-SI form here.

    Examples
    --------
    >>> dsi_unit("mm/px")
    ('\\milli\\metre', 'per pixel')
    """
    if unit not in _D_SI:
        raise RecordError(f"unit {unit!r} has no form in D-SI; known: {', '.join(filter(None, _D_SI))}")
    return _D_SI[unit]


def rounded(value: float, expanded: float | None) -> tuple[str, str]:
    """Print a value and its expanded uncertainty to two digits of the latter (JCGM 100:2008, 7.2.6).

    Without an uncertainty the value has six digits.

    Examples
    --------
    >>> rounded(0.733912, 0.000278), rounded(50.7061, 1.24), rounded(3.0, None)
    (('0.73391', '0.00028'), ('50.7', '1.2'), ('3', ''))
    """
    if not expanded:
        return f"{value:.6g}", ""
    # From the digits that will be printed: 0.0996 is 0.10, and one decimal fewer.
    decimals = max(0, 1 - math.floor(math.log10(float(f"{expanded:.1e}"))))
    return f"{value:z.{decimals}f}", f"{expanded:.{decimals}f}"


@dataclass(frozen=True)
class Measured:
    """One result: value and expanded uncertainty as text, coverage factor and probability.

    `expanded` is empty and `k` not a number where no uncertainty belongs to the value, as for a count.
    """

    name: str
    value: str
    unit: str
    expanded: str = ""
    k: float = math.nan
    coverage: float = COVERAGE

    @classmethod
    def of(cls, name: str, estimate: Estimate) -> "Measured":
        """Take over an estimate, rounded."""
        expanded = estimate.expanded()
        value, text = rounded(estimate.value, expanded.U)
        return cls(name, value, estimate.unit, text, max(1.0, expanded.k), expanded.coverage)


@dataclass(frozen=True)
class Column:
    """One column of a table of results: texts of numbers in one unit, with expanded uncertainties where they have any.

    `k` holds the coverage factor of each expanded uncertainty. `ref_type` is the meaning that other programs look for,
    for example ``"basic_measuredValue"``.
    """

    name: str
    values: tuple[str, ...]
    unit: str
    expanded: tuple[str, ...] = ()
    k: tuple[float, ...] = ()
    ref_type: str = ""


@dataclass(frozen=True)
class ResultTable:
    """A table of results, column by column."""

    name: str
    columns: tuple[Column, ...]
    note: str = ""


@dataclass(frozen=True)
class Group:
    """Results that belong together."""

    name: str
    quantities: tuple[Measured, ...] = ()
    tables: tuple[ResultTable, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Conformity:
    """A statement of conformity: what was judged, against which limit, by which rule, and the outcome.

    `limit` is the largest value allowed, with `at_least` the smallest; empty where there is none.
    """

    judged: Measured
    limit: str
    decision: Decision
    rule: str
    at_least: bool = False


@dataclass(frozen=True)
class Method:
    """A method that was used, with the documents that describe it."""

    name: str
    description: str
    norms: tuple[str, ...] = ()
    ref_type: str = ""


@dataclass(frozen=True)
class UsedStandard:
    """An artefact that carries the traceability: its name, what its certificate says, the laboratory's mark."""

    name: str
    certificate: str
    identification: str = ""


@dataclass(frozen=True)
class Statement:
    """A sentence that the report must hold, with the clause that asks for it."""

    text: str
    norm: str = ""
    clause: str = ""


@dataclass(frozen=True)
class Certificate:
    """A calibration report.

    Parameters
    ----------
    lab
        What the laboratory states.
    missing
        What it does not state and the report needs; not empty in drafts only.
    begin, end
        First and last day of the work.
    temperature_degC, humidity_percent
        Lowest and highest during it; None in drafts where it is not stated.
    groups, conformities
        Results, and what was judged of them.
    decision
        The severest outcome.
    methods, standards, statements
        How, against what, and what the reader must know.
    software
        Version by name.
    record_sha256
        Hash of the calibration record that the numbers come from.
    """

    lab: Laboratory
    missing: tuple[str, ...]
    begin: datetime.date
    end: datetime.date
    temperature_degC: tuple[float, float] | None  # noqa: N815  (the unit is written so)
    humidity_percent: tuple[float, float] | None
    groups: tuple[Group, ...]
    conformities: tuple[Conformity, ...]
    decision: Decision
    methods: tuple[Method, ...]
    standards: tuple[UsedStandard, ...]
    statements: tuple[Statement, ...]
    software: dict[str, str]
    record_sha256: str

    @property
    def draft(self) -> bool:
        """Whether something that a report needs is not stated: then it is none."""
        return bool(self.missing)

    @property
    def number(self) -> str:
        """The report's number; a draft says that it is one."""
        stated = self.lab.report.number
        if not self.draft:
            return str(stated)
        return f"DRAFT {stated}" if stated else f"DRAFT {self.record_sha256[:12]}"

    @property
    def title(self) -> str:
        """What stands on every sheet."""
        return f"Calibration report {self.number}"
