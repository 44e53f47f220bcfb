"""What a commissioning judges beside its fit: repeats of the plate, frames, and artefacts that took no part in it."""

from dataclasses import replace

import numpy as np
import pytest

from fringecal.records.limits import Limits
from fringecal.session import load_session, write_session
from fringecal.simulate import load_rig, simulate_session
from fringecal.workflows.commission.checks import commissioning_checks
from fringecal.workflows.commission.plate_repeats import plate_repeats
from fringecal.workflows.commission.record import calibration_record
from fringecal.workflows.commission.run import Commissioning, commission
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


def test_rms_checks_state_their_uncertainty(found):
    check = check_named(commissioning_checks(found), "grid residual")
    assert check.u == pytest.approx(check.value / np.sqrt(2 * found.calibrated.result.camera.fit.dof))
    assert check.expanded == pytest.approx(1.96 * check.u, rel=1e-3)
