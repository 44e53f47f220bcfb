"""A step block on the thesis rig: known heights decide fringes, and the numbers agree with what was drawn."""

import dataclasses
import json
from datetime import UTC, datetime

import jsonschema
import pytest

from fringecal.errors import FitError
from fringecal.records.schemas import published_schema
from fringecal.records.verification_record import CalibrationUsed
from fringecal.targets import load_target
from fringecal.workflows.verify.artefacts import verify_artefact
from fringecal.workflows.verify.record_artefact import artefact_record
from fringecal.workflows.verify.report_artefact import artefact_report

HEIGHTS_MM = (5.0, 10.0, 20.0, 30.0, 50.0)


@pytest.fixture(scope="module")
def block(thesis):
    (found,) = thesis.commissioned.verified.artefacts
    return found


def test_every_step_is_found_at_its_own_fringe(block) -> None:
    found = {reading.name: reading for reading in block.readings}
    for height in HEIGHTS_MM:
        step = found[f"step of {height:g} mm"]
        # The rig's heights are right to 0.1 % (its bars show it); a wrong fringe would be off by 6.5 mm.
        assert step.error == pytest.approx(0.0, abs=0.01 + 0.001 * height)
        assert abs(step.en) < 1
        assert step.u_measured < 0.003 * height + 0.002
    assert found["amplification coefficient"].measured == pytest.approx(1.0, abs=0.001)
    assert "agree within both uncertainties" in block.sentence


def test_record_and_report_hold_the_numbers(block, thesis, tmp_path) -> None:
    record = artefact_record(block, thesis.session, CalibrationUsed(file="calibration.json", sha256="0" * 64))
    document = json.loads(record.model_dump_json())
    jsonschema.validate(document, published_schema("verification"))
    assert [row["name"] for row in document["readings"]] == [reading.name for reading in block.readings]
    assert {check["decision"] for check in document["checks"]} == {"pass"}
    report = artefact_report(block, created=datetime(2026, 1, 1, tzinfo=UTC))
    assert report.verdict.decision == "pass"
    assert {len(table.frame) for table in report.sections[0].tables} == {len(block.readings)}


def test_another_artefact_is_refused(thesis) -> None:
    capture = dataclasses.replace(thesis.session.named("reference"), target=load_target("step-block"))
    with pytest.raises(FitError, match="no steps in the picture"):
        verify_artefact(capture, thesis.found.result.rig)
