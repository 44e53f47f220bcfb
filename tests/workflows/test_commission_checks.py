"""What a commissioning judges beside its fit: repeats, frames, independent artefacts, what could be wrong unseen."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fringecal.phase import Finding, FindingKind
from fringecal.projector import ProjectorPosition, angles_at_origin
from fringecal.records import DEFAULT_LIMITS
from fringecal.records.limits import Limits
from fringecal.session import load_session, write_session
from fringecal.simulate import load_rig, simulate_session
from fringecal.workflows.commission.checks import commissioning_checks
from fringecal.workflows.commission.plate_repeats import plate_repeats
from fringecal.workflows.commission.record import calibration_record
from fringecal.workflows.commission.run import Commissioning, commission
from fringecal.workflows.commission.testability import statements_tested, unseen_sentence
from fringecal.workflows.shared import displaced
from fringecal.workflows.shared.sections.report_parts import severest
from fringecal.workflows.verify.checks import verified_checks
from fringecal.workflows.verify.session_artefacts import Verified, verify_session

REPEATS = 4
READ_LEVELS = 1.0


def small_rig():
    """The thesis's rig at half size, its plate taken four times, bars beside it."""
    rig = load_rig("thesis").at(
        camera={"width_px": 320, "height_px": 240, "scale_mm_per_px": 1.4},
        projector={"pitch_mm": 16.0},
        noise={"read_levels": READ_LEVELS},
    )
    wanted = {"grid": 1, "reference": REPEATS, "strips": 1, "bars": 1}
    captures = [c.model_dump() | {"repeat": wanted[c.name]} for c in rig.capture if c.name in wanted]
    return rig.at(capture=captures)


def taken(rig, folder):
    shot = simulate_session(rig, seed=5, with_truth=False)
    write_session(folder, shot.document, shot.frames, extra_files=shot.files)
    return load_session(folder)


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> Commissioning:
    return commission(taken(small_rig(), tmp_path_factory.mktemp("session") / "s"))


def check_named(checks, name):
    (check,) = [check for check in checks if check.name == name]
    return check


def test_the_noise_of_repeats_is_the_one_predicted(found):
    repeats = found.repeats
    assert repeats is not None
    assert repeats.sets == REPEATS
    # Three steps: u(phi) = sqrt(2/3) sigma / B, with the noise and rounding (1/12) that the simulator draws.
    light = found.calibrated.reference.map
    expected = np.sqrt(2 / 3 * (READ_LEVELS**2 + 1 / 12) * np.mean(light.modulation[light.valid] ** -2.0))
    assert repeats.noise_rad == pytest.approx(expected, rel=0.02)
    assert repeats.ratio.value == pytest.approx(1.0, abs=0.03)
    assert check_named(commissioning_checks(found), "noise of repeats over its prediction").decision == "pass"
    # Nothing moves in the simulator: shifts are of the mean over all pixels.
    assert np.abs(repeats.shift_rad).max() < 5 * repeats.noise_rad / np.sqrt(light.valid.sum())


def test_noise_beyond_its_prediction_is_no_pass(found):
    strict = Limits.model_validate({"format": 1, "commission": {"noise_ratio": 0.9}})
    assert check_named(commissioning_checks(found, strict), "noise of repeats over its prediction").decision == "fail"


def test_a_bump_that_no_model_holds_is_the_plates_form(found):
    """Half a period of a ripple per block pair, far too fine for the smooth residual: rms is amplitude over root 2."""
    reference, result = found.calibrated.reference, found.calibrated.result
    plate = result.plate.unwrapped_rad
    shape = plate.shape
    ripple = 0.02 * np.sin(2 * np.pi * np.arange(shape[1]) / 96)[None, :]
    bent = plate_repeats(reference, plate + ripple, result.rig)
    flat = found.repeats
    scale = bent.form_mm.value / 1.0
    per_rad = scale / np.sqrt(np.mean(np.sinc(16 / 96) ** 2 * ripple**2))  # a block of 16 px averages the ripple
    slope = abs(float(result.rig.model.gradient(0.0, 0.0)[2]))
    assert per_rad * slope == pytest.approx(1.0, rel=0.03)
    assert flat.form_mm.value < 0.15 * bent.form_mm.value
    tight = Limits.model_validate({"format": 1, "commission": {"plate_form_mm": 1e-6}})
    assert check_named(commissioning_checks(found, tight), "plate form beyond the model, rms").decision == "fail"


def test_a_plate_taken_once_has_no_such_checks(found):
    reference = found.calibrated.reference
    once = replace(reference, capture=replace(reference.capture, repeat=1))
    assert plate_repeats(once, found.calibrated.result.plate.unwrapped_rad, found.calibrated.result.rig) is None


def test_bars_in_the_session_verify_the_rig(found):
    checks = commissioning_checks(found)
    bars = [check for check in checks if check.name.startswith("bars: mean error")]
    assert len(bars) == len(found.verified.bars[0].errors.profiles) + 1
    assert all(check.decision == "pass" for check in bars)
    record = calibration_record(found)
    assert {check.name for check in bars} < {check.name for check in record.checks}
    assert any(note.startswith("bars: mean error") for note in record.notes)


def test_an_artefact_that_cannot_be_measured_fails_and_stops_nothing(found):
    """The plate's pictures in place of the bars': heights of nought, no zig-zag."""
    captures = dict(found.calibrated.session.captures)
    plate = captures["reference"]
    captures["bars"] = replace(captures["bars"], paths=plate.paths, sha256=plate.sha256, repeat=plate.repeat)
    verified = verify_session(replace(found.calibrated.session, captures=captures), found.calibrated.result.rig)
    assert not verified.bars
    ((name, reason),) = verified.failures
    assert name == "bars"
    assert reason
    checks = verified_checks(verified)
    assert severest(checks) == "fail"
    assert checks[0].name == "bars: measured"
    assert severest(verified_checks(Verified())) == "info"


def test_swapped_frames_of_an_artefact_are_named(found):
    captures = dict(found.calibrated.session.captures)
    bars = captures["bars"]
    swap = [1, 0, 2]
    captures["bars"] = replace(
        bars, paths=tuple(bars.paths[i] for i in swap), sha256=tuple(bars.sha256[i] for i in swap)
    )
    verified = verify_session(replace(found.calibrated.session, captures=captures), found.calibrated.result.rig)
    ((_, reason),) = verified.failures
    assert "swapped frames" in reason
    assert "check the order of the files" in reason


def test_frames_that_are_well_pass(found):
    for name in ("reference", "strips"):
        check = check_named(commissioning_checks(found), f"frames of {name}")
        assert (check.value, check.decision) == (0.0, "pass")


def test_compressed_frames_are_no_pass_however_small_their_phase_error(found):
    """Of u(phase), which is understated, every other uncertainty is made."""
    finding = Finding(FindingKind.COMPRESSED, "squares", "2 times", 0.001, "keep PNG")
    plate, strips = found.diagnosed
    marked = replace(plate, diagnosis=replace(plate.diagnosis, findings=(finding,)))
    checks = commissioning_checks(replace(found, diagnosed=(marked, strips)))
    assert check_named(checks, "frames of reference").decision == "conditionalFail"
    assert severest(checks) == "conditionalFail"
    bars = found.verified.bars[0]
    bad = replace(bars, diagnosed=replace(bars.diagnosed, diagnosis=marked.diagnosis))
    assert severest(verified_checks(replace(found.verified, bars=(bad,)))) == "conditionalFail"


def test_rms_checks_state_their_uncertainty(found):
    check = check_named(commissioning_checks(found), "grid residual")
    assert check.u == pytest.approx(check.value / np.sqrt(2 * found.calibrated.result.camera.fit.dof))
    assert check.expanded == pytest.approx(1.96 * check.u, rel=1e-3)


STRIPS = "height of the strips"


def known_to(found, u_mm):
    """The same session without bars, its projector's position stated with another uncertainty."""
    result = found.calibrated.result
    stated = ProjectorPosition(result.stated_projector.value_mm, np.full(3, u_mm))
    other = replace(result, stated_projector=stated, origin=angles_at_origin(result.rig, stated))
    return replace(
        found,
        calibrated=replace(found.calibrated, result=other),
        angles=replace(found.angles, displacement=displaced(result.rig, stated)),
        verified=Verified(),
    )


def strips_of(found):
    (row,) = [row for row in statements_tested(found, DEFAULT_LIMITS) if row.name == STRIPS]
    return row


def test_strips_alone_scale_all_heights_and_no_position_worth_the_name_tells(found):
    """One height of strips: heights go with it as 1:1, and a position known to 100 mm shows no error that matters."""
    wide = known_to(found, 100.0)
    row = strips_of(wide)
    assert row.heights_rel == pytest.approx(1.0, rel=0.01)
    assert row.height_percent > 5
    checks = commissioning_checks(wide)
    assert severest(checks) == "conditionalPass"
    assert unseen_sentence(checks).startswith("Heights could be wrong by")
    assert STRIPS in unseen_sentence(checks)


@pytest.mark.parametrize("u_mm", [3.0, 30.0])
def test_a_stated_position_shows_what_turns_the_angle_beyond_its_en(found, u_mm):
    """``tan(a) = b / h``: a height off by dh/h turns the angle by sin(2 a) / 2 dh/h; En = 1 and 1.645 u are passed."""
    stated = known_to(found, u_mm)
    origin = stated.calibrated.result.origin
    expanded = math.hypot(origin.angle.expanded().U, origin.theory.expanded().U)
    shift_deg = expanded + 1.645 * math.hypot(origin.angle.u, origin.theory.u)
    by_angle = math.radians(shift_deg) / (math.sin(2 * math.radians(origin.angle.value)) / 2)
    row = strips_of(stated)
    # The position across the line holds the angle, and one coordinate more: it shows no less.
    assert row.error_rel <= by_angle * 1.02
    assert row.error_rel > 0.6 * by_angle


def test_bars_in_the_session_show_what_their_mean_error_shows(found):
    pooled = found.verified.bars[0].errors.pooled
    row = strips_of(found)
    assert row.shown_by == "bars: mean error"
    mean = np.nanmean(found.verified.bars[0].surface.z[np.isfinite(found.verified.bars[0].errors.error_mm)])
    # Heights are scaled as the strips are; the mean error moves by the bars' mean height times that.
    k = 1.96  # of many degrees of freedom
    assert row.error_rel == pytest.approx((k + 1.645) * pooled.u_mm / mean, rel=0.05)
    assert unseen_sentence(commissioning_checks(found)) == ""


def test_the_laboratorys_limit_decides_and_the_record_says_so(found):
    row = strips_of(found)
    strict = Limits.model_validate({"format": 1, "commission": {"height_percent": 0.5 * row.height_percent}})
    checks = commissioning_checks(found, strict)
    (check,) = [c for c in checks if STRIPS in c.name]
    assert check.decision == "conditionalPass"
    record = calibration_record(found, limits=strict)
    (kept,) = [one for one in record.unseen if one.name == STRIPS]
    assert kept.height_percent == pytest.approx(row.height_percent)
    assert kept.limit_percent == pytest.approx(0.5 * row.height_percent)
    assert kept.error_percent == pytest.approx(100 * row.error_rel)
    names = [one.name for one in record.unseen if not one.heights_rest_on_it]
    assert names == ["certificate of bars"]
