"""Calibration reports: valid as DCC 3.3.0, honest about what is not stated, the same in XML and on paper."""

import base64
import copy
import datetime
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest

from fringecal.errors import RecordError
from fringecal.records.calibration_record import CALIBRATION_FILE, read_calibration
from fringecal.records.certificates.certificate_content import dsi_unit, rounded
from fringecal.records.certificates.dcc import certificate_xml
from fringecal.records.certificates.laboratory import Laboratory, missing_in, read_laboratory
from fringecal.records.provenance import sha256_of
from fringecal.records.verification_record import CalibrationUsed
from fringecal.report.html import render_html
from fringecal.session import load_session
from fringecal.workflows.certificate.report import certificate_report
from fringecal.workflows.certificate.run import certificate_of
from fringecal.workflows.shared.stored_calibration import calibration_of
from fringecal.workflows.verify.record import verification_record as record_of_verification
from fringecal.workflows.verify.run import verify

xmlschema = pytest.importorskip("xmlschema", reason="no XML Schema validator is installed")

TESTS = Path(__file__).parents[1]
ARCHIVE = max((TESTS / "records" / "archive").glob("[0-9]*"))
NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
LAB = """
format = 1
report = { number = "2026-117", issued = 2026-11-25, place = "laboratory" }
laboratory = { name = "Optics & Metrology <O&M>", street = "1 A", post_code = "14300", city = "Town", country = "MY" }
customer = { name = "Leaf Group", city = "Town", country = "MY" }
item = { name = "bench-1", manufacturer = "own", model = "projector and camera", serial = "FP-1", condition = "clean" }
person = [{ name = "A. Author", role = "head", signs = true }, { name = "B. Bench" }]
conditions = { temperature_degC = [20.9, 20.1], humidity_percent = [50] }
standard = [{ target = "Twelve glass strips, 3 mm", identification = "GS-07", certificate = "report 2026-044" }]
"""


@pytest.fixture(scope="module")
def schema():
    folder = TESTS / "data" / "dcc"
    locations = {
        "https://ptb.de/si": str(folder / "dsi_2_2_0.xsd"),
        "http://www.w3.org/2000/09/xmldsig#": str(folder / "ds_0_1.xsd"),
        "http://qudt.org/vocab/": str(folder / "quantitykind_stub.xsd"),
    }
    return xmlschema.XMLSchema(str(folder / "dcc_3_3_0.xsd"), locations=locations, allow="local")


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Laboratory:
    file = tmp_path_factory.mktemp("lab") / "lab.toml"
    file.write_text(LAB)
    return read_laboratory(file)


@pytest.fixture(scope="module")
def record():
    return read_calibration(ARCHIVE)


@pytest.fixture(scope="module")
def bars(record):
    session = load_session(ARCHIVE / "session")
    found = verify(session, "bars", calibration_of(record), with_filters=False)
    return record_of_verification(found, session, CalibrationUsed.of(record, ARCHIVE / CALIBRATION_FILE))


@pytest.fixture(scope="module")
def sha256() -> str:
    return sha256_of(ARCHIVE / CALIBRATION_FILE)


@pytest.fixture(scope="module")
def certificate(record, sha256, lab, bars):
    return certificate_of(record, sha256, lab, verification=bars)


@pytest.fixture(scope="module")
def document(certificate) -> ET.Element:
    return ET.fromstring(certificate_xml(certificate, sheets=b"%PDF-1.7 %%EOF"))


def texts(document, path):
    return [node.text for node in document.iterfind(f".//{path}", NAMES)]


# ---- the form -------------------------------------------------------------------------------------
def test_a_report_has_no_fault_against_the_schema(schema, document):
    assert list(schema.iter_errors(document)) == []


def test_a_draft_has_none_either_and_says_so_everywhere(schema, record, sha256):
    draft = certificate_of(record, sha256, Laboratory(), draft=True)
    document = ET.fromstring(certificate_xml(draft))
    assert list(schema.iter_errors(document)) == []
    assert texts(document, "dcc:uniqueIdentifier")[0].startswith("DRAFT")
    assert any("not a calibration report" in (text or "") for text in texts(document, "dcc:declaration/dcc:content"))
    report = certificate_report(draft)
    assert "DRAFT" in report.title
    assert report.verdict.decision == "info"
    assert "not a calibration report" in report.verdict.sentence


def text_of(place, words):
    def damage(root):
        root.find(f".//{place}", NAMES).text = words

    return damage


def without(parent, name):
    def damage(root):
        holder = root.find(f".//{parent}", NAMES)
        holder.remove(holder.find(name, NAMES))

    return damage


def swapped(root):
    core = root.find(".//dcc:coreData", NAMES)
    core[:] = list(core)[::-1]


DAMAGES = {
    "country in words": text_of("dcc:countryCodeISO3166_1", "Malaysia"),
    "language of three letters": text_of("dcc:usedLangCodeISO639_1", "eng"),
    "day in another order": text_of("dcc:beginPerformanceDate", "25.11.2026"),
    "place that is none": text_of("dcc:performanceLocation", "attic"),
    "empty number": text_of("dcc:uniqueIdentifier", ""),
    "outcome that is none": text_of("dcc:conformity", "passed"),
    "value in words": text_of("si:value", "about 1"),
    "decimal comma": text_of("si:value", "0,734"),
    "coverage factor below 1": text_of("si:coverageFactor", "0.5"),
    "probability above 1": text_of("si:coverageProbability", "95"),
    "negative uncertainty": text_of("si:valueExpandedMU", "-0.1"),
    "PDF that is not base64": text_of("dcc:dataBase64", "%PDF"),
    "no unit": without("si:real", "si:unit"),
    "no laboratory": without("dcc:administrativeData", "dcc:calibrationLaboratory"),
    "no customer": without("dcc:administrativeData", "dcc:customer"),
    "no results": without("dcc:measurementResult", "dcc:results"),
    "no identification of the item": without("dcc:item", "dcc:identifications"),
    "wrong order": swapped,
}


@pytest.mark.parametrize("name", DAMAGES)
def test_damaged_reports_are_rejected(schema, document, name):
    damaged = copy.deepcopy(document)
    DAMAGES[name](damaged)
    assert not schema.is_valid(damaged)


# ---- PTB's further rules, and what ISO/IEC 17025 asks for ------------------------------------------
def test_releases_conditions_and_software_are_declared(document):
    assert all(re.fullmatch(r"v\d+\.\d+\.\d+\S*", text) for text in texts(document, "dcc:release"))
    refs = {node.get("refType") for node in document.iterfind(".//dcc:influenceCondition", NAMES)}
    assert refs == {"basic_temperature", "basic_humidityRelative"}
    assert document.find(".//dcc:measurementResult/dcc:usedSoftware", NAMES) is not None
    assert texts(document, "dcc:influenceCondition//si:value") == ["20.1", "20.9", "0.5", "0.5"]


def test_nothing_deprecated_and_only_units_that_d_si_knows(document):
    names = {node.tag.partition("}")[2] for node in document.iter()}
    assert not names & {"expandedUnc", "coverageInterval", "expandedUncXMLList"}
    units = {*texts(document, "si:unit"), *texts(document, "si:unitXMLList")}
    assert units <= {r"\milli\metre", r"\degree", r"\radian", r"\one", r"\degreecelsius"}
    with pytest.raises(RecordError, match="'furlong' has no form"):
        dsi_unit("furlong")


def test_every_measured_quantity_has_its_uncertainty(document):
    measured = document.findall(".//dcc:quantity[@refType='basic_measuredValue']", NAMES)
    assert len(measured) >= 5
    for quantity in measured:
        tags = {node.tag.partition("}")[2] for node in quantity.iter()}
        assert tags & {"valueExpandedMU", "valueExpandedMUXMLList"}


def test_the_statements_of_the_norm_stand_there_and_no_boast(document, certificate):
    words = " ".join(text or "" for text in texts(document, "dcc:statement/dcc:declaration/dcc:content"))
    for needed in ("relate only to the item", "reproduced in full", "no electronic signature", "A. Author"):
        assert needed in words
    # Grid paper and strips of a virtual rig have nominal sizes only; the strips have a certificate in lab.toml.
    assert "not shown to be traceable" in words
    assert "Grid paper, 10 mm" in words
    assert "strips" not in words
    page = render_html(certificate_report(certificate))
    assert "accredited" not in page.lower()
    assert "End of calibration report 2026-117" in page
    assert {s.get("schemaVersion") for s in [document]} == {"3.3.0"}
    assert set(texts(document, "dcc:cryptElectronicSignature")) == {"false"}


# ---- the numbers ----------------------------------------------------------------------------------
def test_numbers_are_the_records(document, record, certificate):
    mean = record.scale.mean.estimate()
    real = document.find(".//dcc:result/dcc:data/dcc:quantity/si:real", NAMES)
    doubt = float(real.find(".//si:valueExpandedMU", NAMES).text)
    # Two digits of U: 5 % of it at most; the value to the same place.
    assert doubt == pytest.approx(mean.expanded().U, rel=0.05)
    assert float(real.find("si:value", NAMES).text) == pytest.approx(mean.value, abs=0.05 * doubt)
    (names,) = [t for t in texts(document, "dcc:quantity/dcc:name/dcc:content") if t and "mean, per pixel" in t]
    assert names == "Scale on the reference plate, mean, per pixel"
    outcomes = texts(document, "dcc:metaData/dcc:conformity")
    assert outcomes == [one.decision for one in certificate.conformities if one.decision != "info"]
    errors = document.find(".//dcc:quantity[@refType='basic_measurementError']//si:valueXMLList", NAMES).text.split()
    assert len(errors) == 5


def test_paper_and_xml_say_the_same(document, certificate):
    page = render_html(certificate_report(certificate))
    for path in ("si:value", "si:valueExpandedMU", "dcc:uniqueIdentifier", "dcc:beginPerformanceDate"):
        for text in texts(document, f"dcc:results//{path}") or texts(document, path):
            assert text in page, (path, text)
    assert base64.b64decode(texts(document, "dcc:dataBase64")[0]) == b"%PDF-1.7 %%EOF"


@pytest.mark.parametrize(
    ("value", "expanded", "texts"),
    [
        (0.73391234, 0.000278, ("0.73391", "0.00028")),
        (0.73391234, 0.000998, ("0.7339", "0.0010")),
        (50.7061, 1.24, ("50.7", "1.2")),
        (1500.3, 12.4, ("1500", "12")),
        (-0.0104, 0.05, ("-0.010", "0.050")),
        (-0.0001, 0.05, ("0.000", "0.050")),
        (3.0, None, ("3", "")),
    ],
)
def test_values_are_rounded_to_two_digits_of_their_uncertainty(value, expanded, texts):
    assert rounded(value, expanded) == texts


# ---- what is missing or does not fit ----------------------------------------------------------------
def test_what_is_not_stated_is_asked_for_by_name(record, sha256, lab):
    with pytest.raises(RecordError) as caught:
        certificate_of(record, sha256, Laboratory())
    message = str(caught.value)
    for key in ("report.number", "laboratory.city", "customer.name", "item.serial", "conditions.humidity", "signs"):
        assert key in message
    one = lab.model_copy(update={"customer": lab.customer.model_copy(update={"city": None})})
    assert missing_in(one) == ("customer.city: the customer's city",)
    warm = record.model_copy(update={"session": record.session.model_copy(update={"temperature_degC": 21.5})})
    without = lab.model_copy(update={"conditions": lab.conditions.model_copy(update={"temperature_degC": None})})
    assert certificate_of(warm, sha256, without).temperature_degC == (21.5, 21.5)


def test_a_verification_of_another_calibration_is_refused(record, sha256, lab, bars):
    with pytest.raises(RecordError, match="another calibration"):
        certificate_of(record, "0" * 64, lab, verification=bars)
    other = bars.model_copy(update={"session": bars.session.model_copy(update={"rig": "other"})})
    with pytest.raises(RecordError, match="of rig 'other'"):
        certificate_of(record, sha256, lab, verification=other)


def test_a_standard_that_took_no_part_is_refused(record, sha256, lab):
    strange = lab.standard[0].model_copy(update={"target": "Gauge block"})
    with pytest.raises(RecordError, match="'Gauge block' took no part"):
        certificate_of(record, sha256, lab.model_copy(update={"standard": (strange,)}))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "states no format"),
        ("format = 2", "format"),
        ("format = 1\ncustomers = {}", "customers: Extra inputs"),
        ('format = 1\nlaboratory = { country = "Malaysia" }', "laboratory.country"),
        ('format = 1\nreport = { number = "  " }', "report.number"),
        ('format = 1\nreport = { place = "attic" }', "report.place"),
        ("format = 1\nconditions = { humidity_percent = [nan] }", "humidity_percent"),
        ("format = [", "not valid TOML"),
        ("\0", "not valid TOML"),
    ],
)
def test_a_file_that_is_none_of_the_laboratorys_is_refused(tmp_path, text, reason):
    (tmp_path / "lab.toml").write_text(text)
    with pytest.raises(RecordError, match=re.escape(reason)):
        read_laboratory(tmp_path / "lab.toml")
    with pytest.raises(RecordError, match="cannot be read"):
        read_laboratory(tmp_path / "absent.toml")


def test_days_are_the_sessions_unless_stated(record, sha256, lab, certificate):
    assert certificate.begin == certificate.end == record.session.captured.date()
    before = record.session.captured.date() - datetime.timedelta(days=2)
    facts = lab.report.model_copy(update={"begin": before})
    stated = certificate_of(record, sha256, lab.model_copy(update={"report": facts}))
    assert stated.begin == before
    assert replace(stated, missing=("x",)).draft


@pytest.mark.parametrize(
    ("table", "stated", "reason"),
    [
        ("report", {"issued": datetime.date(2007, 1, 1)}, "report.issued: no report is issued on 2007-01-01"),
        ("report", {"received": datetime.date(2031, 1, 1)}, "report.received: the item cannot come in on 2031-01-01"),
        ("report", {"begin": datetime.date(2031, 1, 2), "issued": datetime.date(2032, 1, 1)}, "report.begin"),
        ("report", {"end": datetime.date(2007, 1, 1)}, "report.end: the work cannot end on 2007-01-01"),
        ("conditions", {"humidity_percent": (40.0, 5000.0)}, "conditions.humidity_percent: 5000 % cannot be"),
        ("conditions", {"humidity_percent": (-1.0,)}, "conditions.humidity_percent: -1 % cannot be"),
        ("conditions", {"temperature_degC": (-300.0,)}, "conditions.temperature_degC: -300 degC cannot be"),
    ],
)
def test_what_cannot_be_is_refused_with_the_reason(record, sha256, lab, table, stated, reason):
    """A day before the work, air wetter than water, colder than absolute zero: in a draft as well."""
    wrong = lab.model_copy(update={table: getattr(lab, table).model_copy(update=stated)})
    for draft in (False, True):
        with pytest.raises(RecordError, match=re.escape(reason)):
            certificate_of(record, sha256, wrong, draft=draft)


def test_a_session_colder_than_can_be_is_refused(record, sha256, lab):
    cold = record.model_copy(update={"session": record.session.model_copy(update={"temperature_degC": -300.0})})
    without = lab.model_copy(update={"conditions": lab.conditions.model_copy(update={"temperature_degC": None})})
    with pytest.raises(RecordError, match="-300 degC cannot be"):
        certificate_of(cold, sha256, without)


def test_a_record_that_does_not_say_what_could_hide_is_no_pass(record, sha256, lab):
    """The archived record is of a version that did not ask; one that asked and found all within limits may pass."""
    passed = tuple(c.model_copy(update={"decision": "pass"}) for c in record.checks)
    old = record.model_copy(update={"checks": passed, "unseen": None})
    assert certificate_of(old, sha256, lab).decision == "conditionalPass"
    asked = old.model_copy(update={"unseen": ()})
    assert certificate_of(asked, sha256, lab).decision == "pass"
