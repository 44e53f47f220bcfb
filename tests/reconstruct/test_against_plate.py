"""A capture held against the calibration's plate: displacements, contrast and turns that were put in are found."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from fringecal.camera import PlateCamera
from fringecal.phase import PlateLook, demodulate
from fringecal.projector import RigCalibration, RigModel
from fringecal.reconstruct import PoseKind, capture_held
from fringecal.records import CalibrationRecord, LookRecord
from fringecal.workflows.reconstruct import causes_of
from fringecal.workflows.shared import look_record
from fringecal.workflows.shared.phase_notes import look_of

SHAPE = (240, 320)
SHIFTS = np.deg2rad([0.0, 120.0, 240.0])
# Light from 1 m above and 1.2 m aside: fringes of 10 px that converge by a few per cent over the field.
MODEL = RigModel(np.array([0.02, 0.78, -0.96, 0.0, 1e-4, -4e-4, -5e-4]), np.array([0.0, 1222.0, 1000.0]))
RIG = RigCalibration(PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, SHAPE), MODEL, ())


def frames(seed, *, texture=2.0, moved=(0, 0), raised_mm=0.0, contrast=1.0, brightness=1.0, blur=0.0):
    """A bare plate with texture of so many grey levels, seen by a camera moved by whole pixels (along u, along v)."""
    margin = 12
    v, u = np.mgrid[-margin : SHAPE[0] + margin, -margin : SHAPE[1] + margin].astype(float)
    rays = RIG.camera.rays(u, v)
    phase = MODEL.phase(*rays.at(raised_mm), raised_mm)
    paper = 100 + texture * np.random.default_rng(5).standard_normal(u.shape)
    wave = brightness * paper * (1 + 0.5 * contrast * np.cos(phase + SHIFTS[:, None, None]))
    wave = np.stack([ndimage.gaussian_filter(one, blur) for one in wave]) if blur else wave
    left, top = margin - moved[0], margin - moved[1]
    seen = wave[:, top : top + SHAPE[0], left : left + SHAPE[1]]
    noise = np.random.default_rng(seed).standard_normal(seen.shape)
    return np.clip(np.rint(seen + noise), 0, 255).astype(np.uint8)


def rig(**plate):
    """The rig, which knows how the plate looked."""
    return replace(RIG, look=PlateLook.of(demodulate(frames(1, **plate), SHIFTS)))


def held(calibration, seed=2, **capture):
    return capture_held(demodulate(frames(seed, **capture), SHIFTS), calibration)


def test_a_plate_that_stayed_is_told_so():
    found = held(rig())
    assert abs(found.texture.du_px) < 5 * found.texture.u_px
    assert abs(found.texture.dv_px) < 5 * found.texture.u_px
    assert found.light.contrast == pytest.approx(1, abs=0.01)
    assert causes_of(found) == ()


@pytest.mark.parametrize("moved", [(3, 0), (10, 0), (0, 1), (-6, 1)])
def test_texture_shows_where_the_camera_moved(moved):
    found = held(rig(), moved=moved)
    assert (found.texture.du_px, found.texture.dv_px) == pytest.approx(moved, abs=0.1)
    assert "the picture moved by about" in causes_of(found)[0]


def test_without_texture_the_fringes_bend_shows_a_displacement_along_them():
    found = held(rig(texture=0.0), texture=0.0, moved=(10, 0))
    assert not found.texture_expected
    # Fringes run along rows within 2 deg.
    assert abs(found.pose.along_px) == pytest.approx(10, abs=5 * found.pose.u_along_px)
    assert "the camera moved by about" in causes_of(found)[0]


def test_a_raised_plate_is_named_with_its_height():
    found = held(rig(), raised_mm=0.4)
    plate = next(pose for pose in found.pose.poses if pose.kind is PoseKind.PLATE)
    assert plate.values["height"] == pytest.approx(0.4, abs=5 * plate.u["height"] + 0.005)
    assert any("the plate is raised by +0.40 mm" in cause for cause in causes_of(found))


def test_lost_contrast_is_measured_and_brightness_is_no_fault():
    assert held(rig(), contrast=0.8).light.contrast == pytest.approx(0.8, abs=0.01)
    found = held(rig(), brightness=0.93)
    assert found.light.brightness == pytest.approx(0.93, abs=0.005)
    assert causes_of(found) == ()


def test_a_blurred_picture_loses_texture():
    found = held(rig(texture=3.0), texture=3.0, blur=1.0)
    # White texture blurred by s px keeps the share 1 / (2 pi s^2) of itself at the peak: 0.16 for 1 px.
    assert found.texture.sharpness < 0.3
    assert "blurred" in " ".join(causes_of(found))


def test_another_plate_is_named_where_texture_would_be_seen():
    calibration = rig()
    strange = replace(calibration.look, texture=calibration.look.texture[:, ::-1, ::-1])
    found = held(replace(calibration, look=strange))
    assert found.texture_expected
    assert "another plate lies there" in causes_of(found)[0]


@pytest.mark.parametrize(
    ("way", "word"), [(np.s_[:, :, ::-1], "mirrored"), (np.s_[:, ::-1, ::-1], "turned by 180 deg")]
)
def test_a_turned_picture_is_named(way, word):
    found = capture_held(demodulate(frames(2)[way], SHIFTS), rig())
    assert word in causes_of(found)[0]


def test_a_record_keeps_how_the_plate_looked():
    look = rig().look
    written = look_record(look)
    again = look_of(LookRecord.model_validate_json(written.model_dump_json()))
    assert np.nanmax(np.abs(again.texture - look.texture)) <= written.texture.step / 2 * 1.001
    assert np.array_equal(np.isnan(again.texture), np.isnan(look.texture))
    assert np.array_equal(again.corners_px, look.corners_px)
    assert again.phase_shifts_rad == look.phase_shifts_rad
    assert np.nanmax(np.abs(again.background / look.background - 1)) < 0.001
    assert len(written.model_dump_json()) < 150_000
    assert CalibrationRecord.model_fields["look"].default is None
