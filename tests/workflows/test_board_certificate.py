"""Calibration reports of rigs with a board's calibration: valid, and no pass while nothing shows the board's scale."""

from pathlib import Path

import pytest

from fringecal.errors import RecordError
from fringecal.records import CalibrationUsed, Laboratory, certificate_xml, read_board_calibration
from fringecal.session import load_session
from fringecal.workflows.certificate import certificate_of, certificate_report
from fringecal.workflows.verify import artefact_record, verify_in_volume

xmlschema = pytest.importorskip("xmlschema", reason="no XML Schema validator is installed")

FOLDER = Path(__file__).parents[1] / "data" / "dcc"
LOCATIONS = {
    "https://ptb.de/si": str(FOLDER / "dsi_2_2_0.xsd"),
    "http://www.w3.org/2000/09/xmldsig#": str(FOLDER / "ds_0_1.xsd"),
    "http://qudt.org/vocab/": str(FOLDER / "quantitykind_stub.xsd"),
}


@pytest.fixture(scope="module")
def written(board_record):
    return read_board_calibration(board_record)


@pytest.fixture(scope="module")
def verified(written, volume_folder):
    """Records of verifications on the ball and on the flat."""
    session = load_session(volume_folder)
    used = CalibrationUsed.of(written, Path("calibration.json"))
    return {name: artefact_record(verify_in_volume(session, name, written), session, used) for name in ("ball", "flat")}


def report(written, verification=None):
    return certificate_of(written, written.file_sha256, Laboratory(), verification=verification, draft=True)


def test_the_report_is_valid_and_says_what_the_record_says(written, verified) -> None:
    found = report(written, verified["ball"])
    schema = xmlschema.XMLSchema(str(FOLDER / "dcc_3_3_0.xsd"), locations=LOCATIONS, allow="local")
    schema.validate(certificate_xml(found, sheets=b"%PDF").decode())
    numbers = {one.name: one for group in found.groups for one in group.quantities}
    assert numbers["Distance of their centres"].value.startswith("260.0")
    # U is k = 1.96 times the record's 0.02 mm.
    assert float(numbers["Distance of their centres"].expanded) == pytest.approx(0.039, abs=0.001)
    assert any("inverse camera" in method.description for method in found.methods)
    assert certificate_report(found).sections


@pytest.mark.parametrize(
    ("artefact", "decision"), [(None, "conditionalPass"), ("flat", "conditionalPass"), ("ball", "pass")]
)
def test_only_a_certified_length_shows_the_scale_of_the_board(artefact, decision, written, verified) -> None:
    found = report(written, None if artefact is None else verified[artefact])
    assert found.decision == decision
    conditional = [one for one in found.statements if "squares of the board" in one.text]
    assert bool(conditional) is (decision != "pass")


def test_a_verification_by_another_calibration_is_refused(written, verified) -> None:
    strange = verified["ball"].calibration.model_copy(update={"sha256": "0" * 64})
    with pytest.raises(RecordError, match="made with another calibration"):
        report(written, verified["ball"].model_copy(update={"calibration": strange}))
