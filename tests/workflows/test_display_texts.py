"""What a reader sees of an influence or a finding can be renamed: no number, and nothing in a file, hangs on it."""

import math
from pathlib import Path

import numpy as np
import pytest

from fringecal.errors import RecordError
from fringecal.phase.diagnostics.diagnosis import diagnose
from fringecal.phase.diagnostics.finding_kinds import FindingKind
from fringecal.projector.angle.projection_angle import angle_budget
from fringecal.projector.forecast import forecast_height
from fringecal.records.calibration_record import CALIBRATION_FILE, ModeRecord, parse_calibration
from fringecal.workflows.compare.run import compare_calibrations, shared_influences
from fringecal.workflows.shared.record_parts import budget_rows
from fringecal.workflows.shared.sections.report_parts import budget_table
from fringecal.workflows.shared.stored_calibration import calibration_of

ARCHIVE = max((Path(__file__).parents[1] / "records" / "archive").glob("[0-9]*")) / CALIBRATION_FILE


@pytest.fixture(scope="module")
def record():
    return parse_calibration(ARCHIVE.read_text(encoding="utf-8"))


def numbers_of(record):
    """All that hangs on which influence a component comes from."""
    rig = calibration_of(record)
    forecasts = [forecast_height(rig, z, known_to_mm=3.0) for z in (2.0, 20.0)]
    return {
        "sources": [component.source for component in rig.components],
        "comparison": [(one.first, one.second, one.difference) for one in compare_calibrations(record, record)],
        "shared": shared_influences(record, record),
        "forecasts": [forecast.contributions_mm() for forecast in forecasts],
        "budget": angle_budget(rig).contributions(),
        "rows": budget_rows(angle_budget(rig)),
    }


def test_renaming_influences_changes_no_number_and_no_file(record, request):
    before = numbers_of(record)
    named = list(budget_table("b", angle_budget(calibration_of(record))).frame.iloc[:, 0])
    request.getfixturevalue("renamed")
    assert numbers_of(record) == before
    assert {row.label for row in before["rows"]} == {source.identifier for source in before["budget"]}
    table = budget_table("b", angle_budget(calibration_of(record))).frame
    assert set(table.iloc[:, 0]) == {"renamed"}
    assert len(table) == len(named) > 3


def fringes(order):
    """Four frames of slanting fringes in an order."""
    v, u = np.mgrid[:120, :160]
    steps = np.arange(4) * math.pi / 2
    phase = 2 * math.pi * (u + 0.2 * v) / 17
    frames = 110 + 80 * np.cos(phase + steps[:, None, None]) + np.random.default_rng(3).normal(0, 1, (4, 120, 160))
    return np.rint(frames[list(order)]).astype(np.uint8), steps


def test_renaming_findings_changes_none_of_them(request):
    before = diagnose(*fringes((0, 2, 1, 3)))
    request.getfixturevalue("renamed")
    found = diagnose(*fringes((0, 2, 1, 3)))
    assert found.findings == before.findings
    # A fatal one stands alone: what else is measured from such frames means nothing.
    assert found.kinds() == (FindingKind.SWAPPED_FRAMES,)
    assert found.findings[0].document()["name"] == "swapped frames"


def test_a_component_of_an_unknown_influence_is_refused(record):
    """A misspelt label would else count as one more independent influence, and change audits without a word."""
    strange = ModeRecord(label="strip hieght", effect=record.rig.modes[0].effect)
    rig = record.rig.model_copy(update={"modes": (*record.rig.modes, strange)})
    with pytest.raises(RecordError, match="'strip hieght' names no influence.* use the version that wrote the record"):
        calibration_of(record.model_copy(update={"rig": rig}))
