"""A step block in the session takes part in the fit: found in real frames, used, and then no judge of it any more."""

import math

import pytest

from fringecal.errors import SessionError
from fringecal.session import load_session, write_session
from fringecal.simulate import load_rig, simulate_session, truth_of
from fringecal.uncertainty.influences import Influence
from fringecal.workflows.commission.checks import commissioning_checks
from fringecal.workflows.commission.run import commission
from fringecal.workflows.verify.run import verify

STEPS = {
    "name": "steps",
    "kind": "artefact",
    "use": "calibration",
    "target": "step-block",
    "position_mm": (30.0, -40.0),
    "rotation_deg": 20.0,
}
BARS = {"name": "bars", "kind": "artefact", "use": "calibration", "target": "angle-bars"}


@pytest.fixture(scope="module")
def small_rig():
    rig = load_rig("thesis")
    captures = [c.model_dump() for c in rig.capture if c.name in ("grid", "reference", "strips")]
    small = {"width_px": 320, "height_px": 300, "scale_mm_per_px": 0.734 * 2}
    return rig.at(camera=small, capture=[*captures, STEPS])


@pytest.fixture(scope="module")
def found(small_rig, tmp_path_factory):
    taken = simulate_session(small_rig, seed=5)
    folder = tmp_path_factory.mktemp("steps") / "session"
    write_session(folder, taken.document, taken.frames)
    return commission(load_session(folder))


def test_the_block_takes_part_and_brings_the_angle_down_to_the_scale(found, small_rig):
    result = found.calibrated.result
    assert [h.value for h in result.standards[0].seen.observations.height_mm] == [5, 10, 20, 30, 50]
    assert abs(result.origin.angle.value - truth_of(small_rig).angle_origin_deg) < result.origin.angle.expanded().U
    # By hand: the strips' 0.005 of 3 mm is 0.047 deg; with 0.005 of 50 mm it is the grid's pitch that is left, 0.016.
    # The doubt about the lens's axis, which no artefact takes away, stands in rows of its own.
    axis = Influence.PRINCIPAL_POINT_U, Influence.PRINCIPAL_POINT_V
    rest = [c.effect for c in result.origin.budget.components if c.influence not in axis]
    assert math.hypot(*rest) < 0.025
    assert result.contradictions == ()
    checks = {check.name: check for check in commissioning_checks(found)}
    assert checks["stated heights against one another"].decision == "pass"
    assert any("5, 10, 20, 30, 50 mm took part" in note for note in found.notes)


def test_what_took_part_judges_no_more(found, small_rig, tmp_path):
    taken = simulate_session(small_rig.at(capture=[BARS]), seed=5)
    write_session(tmp_path / "session", taken.document, taken.frames)
    with pytest.raises(SessionError, match="verify on an artefact that took no part"):
        verify(load_session(tmp_path / "session"), "bars", found.calibrated.result.rig)
