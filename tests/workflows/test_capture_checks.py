"""`reconstruct` on captures with faults put in: checks, causes, and heights tied to a plate that was raised."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fringecal.camera import PlateCamera
from fringecal.errors import FitError
from fringecal.phase import PlateLook, demodulate
from fringecal.projector import RigCalibration, RigModel
from fringecal.session import capture_of_arrays, session_of_captures
from fringecal.workflows.reconstruct import causes_in_words, measurement_checks, measurement_report, reconstruct

SHAPE, STEPS_DEG = (240, 320), (0.0, 120.0, 240.0)
SHIFTS = np.deg2rad(STEPS_DEG)
MODEL = RigModel(np.array([0.02, 0.78, -0.96, 0.0, 1e-4, -4e-4, -5e-4]), np.array([0.0, 1222.0, 1000.0]))
CAMERA = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, SHAPE)
HILL_MM = 4.0


def frames(seed, *, hill=True, raised_mm=0.0):
    """A smooth hill on a plate with texture; both raised alike."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    rays = CAMERA.rays(u, v)
    z = raised_mm + hill * HILL_MM * np.cos(np.minimum(np.hypot(u - 220, v - 140) / 60, 1) * np.pi / 2) ** 2
    paper = 100 + 2 * np.random.default_rng(5).standard_normal(SHAPE)
    wave = paper * (1 + 0.5 * np.cos(MODEL.phase(*rays.at(z), z) + SHIFTS[:, None, None]))
    return np.clip(np.rint(wave + np.random.default_rng(seed).standard_normal(wave.shape)), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def rig():
    return RigCalibration(CAMERA, MODEL, (), look=PlateLook.of(demodulate(frames(1, hill=False), SHIFTS)))


def measured(rig, pictures, **asked):
    capture = capture_of_arrays("hill", "object", pictures, phase_shifts_deg=STEPS_DEG)
    return reconstruct(session_of_captures([capture], rig="drawn"), "hill", rig, **asked)


def failed(found):
    return [check.name for check in measurement_checks(found) if check.decision == "fail"]


def test_a_sound_capture_passes_without_a_word(rig):
    found = measured(rig, frames(2))
    assert failed(found) == []
    assert causes_in_words(found) == ()


def test_a_picture_moved_along_the_fringes_fails_and_says_by_how_much(rig):
    found = measured(rig, np.roll(frames(2), 3, axis=2))
    assert failed(found) == ["picture: displacement against the calibration"]
    assert "about 3.0 px along and 0." in " ".join(causes_in_words(found))


def test_a_raised_plate_is_offered_and_tied_only_when_asked(rig):
    raised = frames(2, raised_mm=0.2)
    found = measured(rig, raised)
    assert "plate beside the object: height" in failed(found)
    assert "--tie-to-plate" in causes_in_words(found)[-1]
    tied = measured(rig, raised, tie_to_plate=True)
    assert failed(tied) == []
    assert tied.tied.offset_mm == pytest.approx(0.2, abs=0.01)
    # Without the rig's own uncertainty the top of the hill is as high over its plate as it was made.
    assert float(tied.surface.z[137:144, 217:224].mean()) == pytest.approx(HILL_MM, abs=0.05)
    assert float(found.surface.z[137:144, 217:224].mean()) == pytest.approx(HILL_MM + 0.2, abs=0.05)
    assert "tied to the plate in view" in measurement_report(tied).subtitle


def test_a_plate_too_high_to_be_taken_for_the_plate_is_named_and_measured_when_tied(rig):
    raised = frames(2, raised_mm=0.5)
    with pytest.raises(FitError, match=r"the plate is raised by \+0\.5"):
        measured(rig, raised)
    tied = measured(rig, raised, tie_to_plate=True)
    assert tied.tied.offset_mm == pytest.approx(0.5, abs=0.01)
    assert float(tied.surface.z[137:144, 217:224].mean()) == pytest.approx(HILL_MM, abs=0.05)


def test_a_frame_moved_across_the_fringes_is_told_by_its_phase_shift(rig):
    calibration = replace(rig, look=replace(rig.look, phase_shifts_rad=tuple(SHIFTS)))
    pictures = frames(2)
    pictures[1] = np.roll(pictures[1], 2, axis=0)
    assert causes_in_words(measured(calibration, frames(2))) == ()
    words = " ".join(causes_in_words(measured(calibration, pictures)))
    assert "frame 2" in words
    assert "px across the fringes" in words


def test_a_refused_capture_names_a_turned_picture(rig):
    with pytest.raises(FitError, match="turned by 180 deg"):
        measured(rig, frames(2)[:, ::-1, ::-1])


def test_light_in_one_frame_fails_and_is_named(rig):
    pictures = frames(2).astype(float)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    pictures[1] += 15 * np.exp(-((u - 60) ** 2 + (v - 60) ** 2) / 50**2)
    found = measured(rig, pictures.astype(np.uint8))
    assert "frames: findings" in failed(found)
    assert "light was added in frame 2" in causes_in_words(found)[0]


def test_a_capture_of_which_hardly_a_pixel_is_left_fails_and_says_for_which_reason(rig):
    """Fringes on a narrow band of plate alone; the rest of the picture is saturated."""
    pictures = frames(2, hill=False)
    pictures[:, 30:] = 255
    found = measured(rig, pictures)
    assert "pixels with a height" in failed(found)
    assert "no phase" in " ".join(causes_in_words(found))


def test_a_recess_fails_unless_its_depth_is_stated(rig):
    """A hollow as deep as the hill was high: two millimetres below the plate and more over a tenth of the picture."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    z = -HILL_MM * np.cos(np.minimum(np.hypot(u - 200, v - 130) / 90, 1) * np.pi / 2) ** 2
    wave = 100 * (1 + 0.5 * np.cos(MODEL.phase(*CAMERA.rays(u, v).at(z), z) + SHIFTS[:, None, None]))
    noise = np.random.default_rng(6).standard_normal(wave.shape)
    pictures = np.clip(np.rint(wave + noise), 0, 255).astype(np.uint8)
    assert "surface below the plate" in failed(measured(rig, pictures))
    stated = measured(rig, pictures, height_range_mm=(-6.0, 6.0))
    assert "surface below the plate" not in failed(stated)
    assert float(stated.surface.z[127:134, 197:204].mean()) == pytest.approx(-HILL_MM, abs=0.05)


def test_a_picture_in_shadow_but_for_a_part_that_is_measured_passes(rig):
    pictures = frames(2)
    pictures[:, 110:] = np.random.default_rng(3).integers(4, 8, pictures[:, 110:].shape)
    assert "pixels with a height" not in failed(measured(rig, pictures))


def test_without_texture_kept_the_check_says_from_which_size_on_it_would_see(rig):
    bare = RigCalibration(CAMERA, MODEL, ())
    (check,) = [one for one in measurement_checks(measured(bare, frames(2))) if one.name.startswith("picture")]
    assert check.decision in {"info", "pass"}
    assert "px" in check.rule
    assert check.u is not None
    assert math.isfinite(check.u)
