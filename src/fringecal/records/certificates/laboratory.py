"""What only the laboratory can say for a calibration report: `lab.toml`, format 1. Nothing in it is made up."""

import datetime
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from fringecal.records.owned import read_owned

NOT_STATED = "not stated"

Words = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
Country = Annotated[str, StringConstraints(pattern="^[A-Z]{2}$")]
Range = Annotated[tuple[float, ...], Field(min_length=1, max_length=2)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ReportFacts(_Table):
    """The report itself: its number, the day of issue, where and when the work was done.

    `begin` and `end` are the day of the session where they are not stated.
    """

    number: Words | None = None
    issued: datetime.date | None = None
    place: Literal["laboratory", "customer", "laboratoryBranch", "customerBranch", "other"] | None = None
    received: datetime.date | None = None
    begin: datetime.date | None = None
    end: datetime.date | None = None


class Party(_Table):
    """Laboratory or customer: name and postal address; country as two letters (ISO 3166)."""

    name: Words | None = None
    street: Words | None = None
    post_code: Words | None = None
    city: Words | None = None
    country: Country | None = None
    email: Words | None = None
    phone: Words | None = None
    code: Words | None = None


class Item(_Table):
    """What was calibrated: the rig, so that it can be told from any other, and the condition it was found in."""

    name: Words | None = None
    manufacturer: Words | None = None
    model: Words | None = None
    serial: Words | None = None
    owner_id: Words | None = None
    condition: Words | None = None


class Person(_Table):
    """Somebody who answers for the report; `signs` marks who authorises it."""

    name: Words
    role: Words | None = None
    signs: bool = False


class Conditions(_Table):
    """Environment during the calibration: one value, or lowest and highest."""

    temperature_degC: Range | None = None  # noqa: N815  (the unit is written so)
    humidity_percent: Range | None = None


class Standard(_Table):
    """An artefact by the name of its target, as the laboratory's books hold it."""

    target: Words
    identification: Words
    certificate: Words | None = None


class Laboratory(_Table):
    """All of `lab.toml`."""

    format: Literal[1] = 1
    report: ReportFacts = ReportFacts()
    laboratory: Party = Party()
    customer: Party = Party()
    item: Item = Item()
    person: tuple[Person, ...] = ()
    conditions: Conditions = Conditions()
    standard: tuple[Standard, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _leave_out_what_is_empty(cls, stated: Any) -> Any:
        """Take an empty value for what it is, nothing stated: a template need not be filled in whole."""
        return _stated_only(stated) if isinstance(stated, dict) else stated


def _stated_only(table: Mapping[str, Any]) -> dict[str, Any]:
    kept: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            kept[key] = _stated_only(value)
        elif isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
            # A mark alone, such as signs = true, describes nobody.
            kept[key] = [one for one in map(_stated_only, value) if any(not isinstance(v, bool) for v in one.values())]
        elif value not in ("", []):  # blanks are a slip, which is refused
            kept[key] = value
    return kept


# What ISO/IEC 17025:2017, 7.8.2.1 and 7.8.4.1, asks for and no record can know.
NEEDED = {
    "report.number": "the report's own number",
    "report.issued": "the day of issue, such as 2026-11-22, without quotes",
    "report.place": 'where it was done: "laboratory", "customer" or "other"',
    "laboratory.name": "name of the laboratory",
    "laboratory.street": "its street and number",
    "laboratory.post_code": "its post code",
    "laboratory.city": "its city",
    "laboratory.country": "its country, two letters",
    "customer.name": "name of the customer; the laboratory itself, if it calibrates its own rig",
    "customer.city": "the customer's city",
    "customer.country": "the customer's country, two letters",
    "item.name": "what was calibrated",
    "item.manufacturer": "who built it",
    "item.model": "its model",
    "item.serial": "its serial number, or another identification",
    "item.condition": "the condition in which it was found",
    "conditions.temperature_degC": "temperature, one value or lowest and highest: [20.5] or [20.1, 20.9]",
    "conditions.humidity_percent": "relative humidity in percent, likewise: [50] or [48, 55]",
}


def missing_in(lab: Laboratory, *, temperature_stated: bool = False) -> tuple[str, ...]:
    """Name every key that a calibration report needs and `lab.toml` does not state, each with what it is.

    Parameters
    ----------
    lab
        What is stated.
    temperature_stated
        Whether the session states the temperature.

    Examples
    --------
    >>> missing_in(Laboratory())[0]
    "report.number: the report's own number"
    """
    return tuple(_missing(lab, temperature_stated))


def _missing(lab: Laboratory, temperature_stated: bool) -> Iterator[str]:
    for key, meaning in NEEDED.items():
        table, _, name = key.partition(".")
        if getattr(getattr(lab, table), name) is None and not (temperature_stated and name == "temperature_degC"):
            yield f"{key}: {meaning}"
    if not any(person.signs for person in lab.person):
        yield "person: name and role of who authorises the report, with signs = true"


COLDEST_DEGC, WARMEST_DEGC = -40.0, 85.0
"""Temperatures in which cameras and projectors are built to work at most: what lies beyond is a slip of the pen."""


def impossible_in(lab: Laboratory, *, begin: datetime.date, end: datetime.date) -> tuple[str, ...]:
    """Name everything stated that cannot be, each with the reason.

    Parameters
    ----------
    lab
        What is stated.
    begin, end
        First and last day of the work, as stated or by the session.

    Examples
    --------
    >>> lab = Laboratory(conditions=Conditions(humidity_percent=(5000.0,)))
    >>> impossible_in(lab, begin=datetime.date(2026, 11, 22), end=datetime.date(2026, 11, 22))
    ('conditions.humidity_percent: 5000 % cannot be; relative humidity lies between 0 and 100 %',)
    """
    return (*_impossible_days(lab.report, begin, end), *_impossible_conditions(lab.conditions))


def _impossible_days(facts: ReportFacts, begin: datetime.date, end: datetime.date) -> Iterator[str]:
    if end < begin:
        yield f"report.end: the work cannot end on {end}, before it began on {begin}"
    if facts.received is not None and facts.received > begin:
        yield f"report.received: the item cannot come in on {facts.received}, after the work began on {begin}"
    if facts.issued is not None and facts.issued < max(begin, end):
        yield f"report.issued: no report is issued on {facts.issued}, before the work ended on {max(begin, end)}"


def _impossible_conditions(conditions: Conditions) -> Iterator[str]:
    for degrees in conditions.temperature_degC or ():
        if not COLDEST_DEGC <= degrees <= WARMEST_DEGC:
            yield (
                f"conditions.temperature_degC: {degrees:g} degC cannot be; no rig works outside {COLDEST_DEGC:g} to "
                f"{WARMEST_DEGC:g} degC"
            )
    for percent in conditions.humidity_percent or ():
        if not 0 <= percent <= 100:  # noqa: PLR2004 -- by its definition
            yield (f"conditions.humidity_percent: {percent:g} % cannot be; relative humidity lies between 0 and 100 %")


def read_laboratory(path: str | Path) -> Laboratory:
    """Read `lab.toml`; what it does not state stays open.

    Raises
    ------
    RecordError
        The file cannot be read, is not TOML, states no format 1, or holds keys or values that do not belong there.
    """
    return read_owned(path, Laboratory, name="the laboratory's file")
