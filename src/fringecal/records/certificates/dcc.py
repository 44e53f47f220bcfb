"""A calibration report as Digital Calibration Certificate 3.3.0 (PTB), its numbers as D-SI quantities."""

import base64
import datetime
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

from fringecal.records.certificates.certificate_content import (
    Certificate,
    Column,
    Conformity,
    Group,
    Measured,
    ResultTable,
    dsi_unit,
)
from fringecal.records.certificates.laboratory import NOT_STATED, Party
from fringecal.uncertainty import COVERAGE

DCC, SI, VERSION = "https://ptb.de/dcc", "https://ptb.de/si", "3.3.0"
LANGUAGE = "en"
NO_COUNTRY = "ZZ"  # ISO 3166 leaves it to users: unknown; drafts only

type Node = ET.Element


def certificate_xml(certificate: Certificate, *, sheets: bytes = b"") -> bytes:
    """Write a calibration report as DCC 3.3.0.

    Parameters
    ----------
    certificate
        What to say.
    sheets
        The same as PDF, to be carried inside; empty to leave it out.

    Returns
    -------
    bytes
        The XML document, UTF-8; unsigned.
    """
    for prefix, name in (("dcc", DCC), ("si", SI)):
        ET.register_namespace(prefix, name)
    root = ET.Element(f"{{{DCC}}}digitalCalibrationCertificate", {"schemaVersion": VERSION})
    _administration(_add(root, "administrativeData"), certificate)
    result = _add(_add(root, "measurementResults"), "measurementResult")
    _measurement(result, certificate)
    if sheets:
        _sheets(_add(root, "document"), certificate, sheets)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


# ---- pieces ---------------------------------------------------------------------------------------
def _add(parent: Node, name: str, text: object = None, *, ref: str = "", space: str = DCC) -> Node:
    node = ET.SubElement(parent, f"{{{space}}}{name}", {"refType": ref} if ref else {})
    if text is not None:
        node.text = str(text)
    return node


def _say(parent: Node, name: str, words: str) -> Node:
    """Add an element that holds words in the report's language."""
    node = _add(parent, name)
    _add(node, "content", words).set("lang", LANGUAGE)
    return node


def _day(parent: Node, name: str, day: datetime.date | None) -> None:
    if day is not None:
        _add(parent, name, day.isoformat())


# ---- administrative data --------------------------------------------------------------------------
def _administration(parent: Node, certificate: Certificate) -> None:
    _software(parent, "dccSoftware", certificate)
    _core(_add(parent, "coreData"), certificate)
    _item(_add(_add(parent, "items"), "item"), certificate)
    laboratory = _add(parent, "calibrationLaboratory")
    if certificate.lab.laboratory.code:
        _add(laboratory, "calibrationLaboratoryCode", certificate.lab.laboratory.code)
    _party(_add(laboratory, "contact"), certificate.lab.laboratory)
    _add(laboratory, "cryptElectronicSignature", "false")
    _persons(_add(parent, "respPersons"), certificate)
    _party(_add(parent, "customer"), certificate.lab.customer)
    _statements(_add(parent, "statements"), certificate)


def _software(parent: Node, name: str, certificate: Certificate) -> None:
    node = _add(_add(parent, name), "software")
    _say(node, "name", "fringecal")
    _add(node, "release", f"v{certificate.software.get('fringecal', '0.0.0')}")
    _say(node, "description", ", ".join(f"{program} {version}" for program, version in certificate.software.items()))


def _core(core: Node, certificate: Certificate) -> None:
    facts = certificate.lab.report
    _add(core, "countryCodeISO3166_1", certificate.lab.laboratory.country or NO_COUNTRY)
    _add(core, "usedLangCodeISO639_1", LANGUAGE)
    _add(core, "mandatoryLangCodeISO639_1", LANGUAGE)
    _add(core, "uniqueIdentifier", certificate.number)
    _identify(_add(core, "identifications"), "other", certificate.record_sha256, "SHA-256 of the calibration record")
    _day(core, "receiptDate", facts.received)
    _day(core, "beginPerformanceDate", certificate.begin)
    _day(core, "endPerformanceDate", certificate.end)
    _add(core, "performanceLocation", facts.place or "other")
    _day(core, "issueDate", facts.issued)


def _identify(parent: Node, issuer: str, value: str, name: str) -> None:
    node = _add(parent, "identification")
    _add(node, "issuer", issuer)
    _add(node, "value", value)
    _say(node, "name", name)


def _item(node: Node, certificate: Certificate) -> None:
    item = certificate.lab.item
    _say(node, "name", item.name or NOT_STATED)
    _say(node, "description", f"Condition when received: {item.condition or NOT_STATED}")
    _say(_add(node, "manufacturer"), "name", item.manufacturer or NOT_STATED)
    _add(node, "model", item.model or NOT_STATED)
    marks = _add(node, "identifications")
    _identify(marks, "manufacturer", item.serial or NOT_STATED, "Serial number")
    if item.owner_id:
        _identify(marks, "owner", item.owner_id, "Owner's number")


def _party(node: Node, party: Party) -> None:
    _say(node, "name", party.name or NOT_STATED)
    for key, name in (("email", "eMail"), ("phone", "phone")):
        if getattr(party, key):
            _add(node, name, getattr(party, key))
    place = _add(node, "location")
    for key, name in (("street", "street"), ("post_code", "postCode"), ("city", "city"), ("country", "countryCode")):
        stated = getattr(party, key)
        if stated or key == "city":
            _add(place, name, stated or NOT_STATED)


def _persons(node: Node, certificate: Certificate) -> None:
    persons = [(p.name, p.role, p.signs) for p in certificate.lab.person] or [(NOT_STATED, None, False)]
    for name, role, signs in persons:
        person = _add(node, "respPerson")
        _say(_add(person, "person"), "name", name)
        if role:
            _add(person, "role", role)
        _add(person, "mainSigner", str(signs).lower())
        _add(person, "cryptElectronicSignature", "false")


def _statements(node: Node, certificate: Certificate) -> None:
    for statement in certificate.statements:
        one = _add(node, "statement")
        if statement.norm:
            _add(one, "norm", statement.norm)
        if statement.clause:
            _add(one, "reference", statement.clause)
        _say(one, "declaration", statement.text)
    if certificate.decision != "info":
        overall = _add(node, "statement", ref="basic_conformity")
        _say(overall, "declaration", "Severest outcome of all statements of conformity in the results below.")
        _add(overall, "conformity", certificate.decision)


# ---- measurement ----------------------------------------------------------------------------------
def _measurement(node: Node, certificate: Certificate) -> None:
    _say(node, "name", "Calibration of a fringe-projection rig")
    methods = _add(node, "usedMethods")
    for method in certificate.methods:
        one = _add(methods, "usedMethod", ref=method.ref_type)
        _say(one, "name", method.name)
        _say(one, "description", method.description)
        for norm in method.norms:
            _add(one, "norm", norm)
    _software(node, "usedSoftware", certificate)
    _standards(node, certificate)
    _conditions(_add(node, "influenceConditions"), certificate)
    results = _add(node, "results")
    for group in certificate.groups:
        _group(_add(results, "result", ref="gp_measuringResult1"), group)
    if certificate.conformities:
        _conformities(_add(results, "result"), certificate.conformities)


def _standards(node: Node, certificate: Certificate) -> None:
    if not certificate.standards:
        return
    equipments = _add(node, "measuringEquipments")
    for standard in certificate.standards:
        one = _add(equipments, "measuringEquipment", ref="basic_standardUsed")
        _say(one, "name", standard.name)
        _say(one, "description", f"Its numbers come from: {standard.certificate}")
        if standard.identification:
            marks = _add(one, "identifications")
            _identify(marks, "calibrationLaboratory", standard.identification, "Laboratory's number")


def _conditions(node: Node, certificate: Certificate) -> None:
    stated = (
        ("basic_temperature", "Temperature", certificate.temperature_degC, "\\degreecelsius", 1.0),
        ("basic_humidityRelative", "Relative humidity", certificate.humidity_percent, "\\one", 0.01),
    )
    for ref, name, values, unit, factor in stated:
        condition = _add(node, "influenceCondition", ref=ref)
        _say(condition, "name", name)
        data = _add(condition, "data")
        if values is None:
            _say(data, "text", NOT_STATED)
            continue
        for end, value in zip(("Min", "Max"), values, strict=True):
            quantity = _add(data, "quantity", ref=f"{ref}{end}")
            _say(quantity, "name", f"{name}, {'lowest' if end == 'Min' else 'highest'}")
            real = _add(quantity, "real", space=SI)
            _add(real, "value", f"{factor * value:.6g}", space=SI)
            _add(real, "unit", unit, space=SI)


def _group(node: Node, group: Group) -> None:
    _say(node, "name", group.name)
    if group.note:
        _say(node, "description", group.note)
    data = _add(node, "data")
    for quantity in group.quantities:
        _quantity(_add(data, "quantity", ref="basic_measuredValue"), quantity)
    for table in group.tables:
        _table(_add(data, "list", ref="gp_table1"), table)


def _named(node: Node, name: str, unit: str) -> str:
    """Name a quantity, with what its unit cannot say, and return the unit."""
    symbol, rest = dsi_unit(unit)
    _say(node, "name", f"{name}, {rest}" if rest else name)
    return symbol


def _quantity(node: Node, found: Measured) -> None:
    unit = _named(node, found.name, found.unit)
    real = _add(node, "real", space=SI)
    _add(real, "value", found.value, space=SI)
    _add(real, "unit", unit, space=SI)
    if found.expanded:
        uncertainty = _add(_add(real, "measurementUncertaintyUnivariate", space=SI), "expandedMU", space=SI)
        _add(uncertainty, "valueExpandedMU", found.expanded, space=SI)
        _add(uncertainty, "coverageFactor", f"{found.k:.2f}", space=SI)
        _add(uncertainty, "coverageProbability", f"{found.coverage:g}", space=SI)


def _table(node: Node, table: ResultTable) -> None:
    _say(node, "name", table.name)
    if table.note:
        _say(node, "description", table.note)
    for column in table.columns:
        _column(_add(node, "quantity", ref=column.ref_type), column)


def _column(node: Node, column: Column) -> None:
    unit = _named(node, column.name, column.unit)
    numbers = _add(node, "realListXMLList", space=SI)
    _add(numbers, "valueXMLList", _joined(column.values), space=SI)
    _add(numbers, "unitXMLList", unit, space=SI)
    if column.expanded:
        uncertainty = _add(numbers, "measurementUncertaintyUnivariateXMLList", space=SI)
        uncertainty = _add(uncertainty, "expandedMUXMLList", space=SI)
        _add(uncertainty, "valueExpandedMUXMLList", _joined(column.expanded), space=SI)
        _add(uncertainty, "coverageFactorXMLList", _joined(f"{k:.2f}" for k in column.k), space=SI)
        _add(uncertainty, "coverageProbabilityXMLList", _joined(f"{COVERAGE:g}" for _ in column.k), space=SI)


def _joined(texts: Iterable[str]) -> str:
    return " ".join(texts)


def _conformities(node: Node, conformities: Sequence[Conformity]) -> None:
    _say(node, "name", "Statements of conformity")
    data = _add(node, "data")
    for one in conformities:
        quantity = _add(data, "quantity")
        _quantity(quantity, one.judged)
        _judgement(_add(_add(quantity, "measurementMetaData"), "metaData", ref="basic_conformity"), one)


def _judgement(node: Node, one: Conformity) -> None:
    _say(node, "declaration", one.rule or "within the limit")
    if one.decision != "info":
        _add(node, "conformity", one.decision)
    if one.limit:
        side = "Lower" if one.at_least else "Upper"
        quantity = _add(_add(node, "data"), "quantity", ref=f"basic_acceptanceLimit{side}")
        unit = _named(quantity, "Limit", one.judged.unit)
        real = _add(quantity, "real", space=SI)
        _add(real, "value", one.limit, space=SI)
        _add(real, "unit", unit, space=SI)


def _sheets(node: Node, certificate: Certificate, sheets: bytes) -> None:
    _say(node, "name", f"{certificate.title}, for reading")
    _add(node, "fileName", "certificate.pdf")
    _add(node, "mimeType", "application/pdf")
    _add(node, "dataBase64", base64.b64encode(sheets).decode("ascii"))
