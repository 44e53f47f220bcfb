"""A calibration report for reading: the same content as its XML, in the order of ISO/IEC 17025:2017, 7.8.2."""

from collections.abc import Iterator
from datetime import datetime

import pandas as pd

from fringecal.records import NOT_STATED, Certificate, Column, Group, Measured, Party, ResultTable
from fringecal.report import Fact, Report, Section, Table, Verdict

_OUTCOMES = {
    "pass": "All values judged conform to the laboratory's limits.",
    "conditionalPass": "All values judged are within the laboratory's limits, some without proof of conformity.",
    "conditionalFail": "A value is beyond one of the laboratory's limits; that it does not conform is not proved.",
    "fail": "A value does not conform to the laboratory's limits.",
    "info": "Nothing was judged.",
}


def certificate_report(certificate: Certificate, *, command: str = "", created: datetime | None = None) -> Report:
    """Return the calibration report as a page and sheets; its number stands on every sheet, its end is marked.

    Parameters
    ----------
    certificate
        The content.
    command, created
        Command line and time of writing.
    """
    draft = f"DRAFT, not a calibration report: {len(certificate.missing)} statements are missing. "
    return Report(
        title=certificate.title,
        subtitle=f"{certificate.lab.laboratory.name or NOT_STATED}: calibration of a fringe-projection rig",
        verdict=Verdict(
            "info" if certificate.draft else certificate.decision,
            (draft if certificate.draft else "") + _OUTCOMES[certificate.decision],
        ),
        facts=tuple(_facts(certificate)),
        sections=(
            _administration(certificate),
            *(_group(group) for group in certificate.groups),
            _conformities(certificate),
            _methods(certificate),
            _statements(certificate),
        ),
        versions=certificate.software,
        command=command,
        created=created,
    )


def _facts(certificate: Certificate) -> Iterator[Fact]:
    yield Fact("Number", certificate.number)
    issued = certificate.lab.report.issued
    yield Fact("Issued", issued.isoformat() if issued else NOT_STATED)
    item = certificate.lab.item
    yield Fact("Item", item.name or NOT_STATED, f"serial number {item.serial or NOT_STATED}")
    if certificate.groups:
        for quantity in (certificate.groups[0].quantities[0], *certificate.groups[1].quantities[:1]):
            yield Fact(quantity.name, _words(quantity), f"k = {quantity.k:.2f}, 95 %" if quantity.expanded else "")


def _words(found: Measured) -> str:
    uncertainty = f" ± {found.expanded}" if found.expanded else ""
    return f"{found.value}{uncertainty} {found.unit}".rstrip()


def _administration(certificate: Certificate) -> Section:
    lab, facts = certificate.lab, certificate.lab.report
    place = facts.place or NOT_STATED
    rows = [
        ("Laboratory", _address(lab.laboratory)),
        ("Customer", _address(lab.customer)),
        ("Item", _item(certificate)),
        ("Condition of the item", lab.item.condition or NOT_STATED),
        ("Received", facts.received.isoformat() if facts.received else ""),
        ("Calibrated", f"{certificate.begin.isoformat()} to {certificate.end.isoformat()}, place: {place}"),
        ("Issued", facts.issued.isoformat() if facts.issued else NOT_STATED),
        ("Temperature", _range(certificate.temperature_degC, "°C")),
        ("Relative humidity", _range(certificate.humidity_percent, "%")),
        ("Authorised by", _people(certificate, signs=True)),
        ("Further persons", _people(certificate, signs=False)),
        ("Calibration record, SHA-256", certificate.record_sha256),
    ]
    kept = [(name, words) for name, words in rows if words]
    sentences = tuple(f"Missing: {text}." for text in certificate.missing)
    table = Table("Laboratory, customer, item", pd.DataFrame(kept, columns=["what", "stated"]))
    return Section("Administration", sentences, (table,))


def _address(party: Party) -> str:
    parts = (party.name, party.street, " ".join(filter(None, (party.post_code, party.city))), party.country)
    return ", ".join(part for part in (*parts, party.email, party.phone) if part) or NOT_STATED


def _item(certificate: Certificate) -> str:
    item = certificate.lab.item
    marks = (item.manufacturer, item.model, item.serial and f"serial number {item.serial}")
    own = item.owner_id and f"owner's number {item.owner_id}"
    return ", ".join(part for part in (item.name, *marks, own) if part) or NOT_STATED


def _range(ends: tuple[float, float] | None, unit: str) -> str:
    if ends is None:
        return NOT_STATED
    return f"{ends[0]:g} {unit}" if ends[0] == ends[1] else f"{ends[0]:g} to {ends[1]:g} {unit}"


def _people(certificate: Certificate, *, signs: bool) -> str:
    names = [f"{p.name}, {p.role}" if p.role else p.name for p in certificate.lab.person if p.signs is signs]
    return "; ".join(names) or (NOT_STATED if signs else "")


def _group(group: Group) -> Section:
    rows = [(q.name, q.value, q.expanded, f"{q.k:.2f}" if q.expanded else "", q.unit) for q in group.quantities]
    frame = pd.DataFrame(rows, columns=["quantity", "value", "U (95 %)", "k", "unit"])
    quantities = (Table(group.name, frame),) if rows else ()
    return Section(group.name, (group.note,) if group.note else (), (*quantities, *map(_table, group.tables)))


def _table(table: ResultTable) -> Table:
    columns: dict[str, tuple[str, ...]] = {}
    for column in table.columns:
        columns |= _printed(column)
    return Table(table.name, pd.DataFrame(columns), table.note)


def _printed(column: Column) -> dict[str, tuple[str, ...]]:
    unit = f" / {column.unit}" if column.unit else ""
    factors = tuple(f"{k:.2f}" for k in column.k)
    uncertainty = {f"U of it (95 %){unit}": column.expanded, "k": factors} if column.expanded else {}
    return {f"{column.name}{unit}": column.values, **uncertainty}


def _conformities(certificate: Certificate) -> Section:
    rows = [
        (
            one.judged.name,
            one.judged.value,
            one.judged.expanded,
            f"{one.judged.k:.2f}" if one.judged.expanded else "",
            f"{'>=' if one.at_least else '<='} {one.limit}" if one.limit else "",
            one.judged.unit,
            one.decision,
            one.rule,
        )
        for one in certificate.conformities
    ]
    names = ["judged", "value", "U (95 %)", "k", "limit", "unit", "outcome", "rule"]
    return Section("Statements of conformity", tables=(Table("What was judged", pd.DataFrame(rows, columns=names)),))


def _methods(certificate: Certificate) -> Section:
    methods = [(m.name, m.description, ", ".join(m.norms)) for m in certificate.methods]
    standards = [(s.name, s.certificate, s.identification) for s in certificate.standards]
    return Section(
        "Methods and artefacts",
        tables=(
            Table("Methods", pd.DataFrame(methods, columns=["method", "what was done", "following"])),
            Table(
                "Artefacts", pd.DataFrame(standards, columns=["artefact", "its numbers come from", "identification"])
            ),
        ),
    )


def _statements(certificate: Certificate) -> Section:
    words = [f"{s.text} ({s.norm}, {s.clause})" if s.clause else s.text for s in certificate.statements]
    return Section("Statements", (*words, f"End of {certificate.title[:1].lower()}{certificate.title[1:]}."))
