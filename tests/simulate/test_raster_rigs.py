"""Rigs with a raster projector: optics against OpenCV's, light against closed forms, sessions whole."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from fringecal.errors import FringecalError
from fringecal.session import check_session, load_session, write_session
from fringecal.simulate import (
    flat_pose,
    list_raster_rigs,
    load_raster_rig,
    raster_truth,
    render_raster,
    scene_of,
    simulate_raster_session,
)
from fringecal.simulate.scene.printed_patterns import ink_share, pattern_table
from fringecal.simulate.tracing.raster_render import PER_PIXEL, pattern_profiles
from fringecal.targets import parse_target

SMALL = {"width_px": 96, "height_px": 80, "focal_px": 180.0, "principal_offset_px": (0.7, -0.4)}


@pytest.fixture(scope="module")
def rig():
    return load_raster_rig("dlp-small").at(
        camera=SMALL, projector={"columns": 160, "rows": 120, "focal_px": 260.0, "centre_px": (81.0, 57.0)}
    )


def projected(points, lens, rotation=None, shift=None):
    fx, fy, cx, cy, *terms = lens
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    turn = np.zeros(3) if rotation is None else cv2.Rodrigues(np.array(rotation))[0]
    move = np.zeros(3) if shift is None else np.array(shift)
    return cv2.projectPoints(points, turn, move, matrix, np.array(terms))[0].reshape(-1, 2)


def test_shipped_rigs_load_and_an_unknown_one_is_named() -> None:
    for name in list_raster_rigs():
        assert load_raster_rig(name).name == name
    with pytest.raises(FringecalError, match="did you mean 'dlp'"):
        load_raster_rig("dpl")


@pytest.mark.parametrize("diamond", [False, True])
def test_points_are_seen_and_lit_where_opencv_projects_them(rig, diamond) -> None:
    changed = rig.at(projector={"diamond": diamond})
    capture = changed.capture_named("pose-06").model_copy(update={"sheet_mm": None})
    scene = scene_of(parse_target(changed.capture_named("ball").target))
    frames = render_raster(changed, capture, scene, noise=False)
    points = frames.points_mm.reshape(3, -1).T
    truth = raster_truth(changed)
    rows, columns = np.mgrid[: SMALL["height_px"], : SMALL["width_px"]]
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1)
    assert np.abs(projected(points, truth["camera"]) - pixels).max() < 1e-6
    lit = projected(points, truth["projector"], truth["rotation"], truth["shift_mm"])
    assert np.abs(lit - frames.projector_px.reshape(2, -1).T).max() < 1e-6
    assert truth["projector"][1] / truth["projector"][0] == (2.0 if diamond else 1.0)


def test_a_keystone_correction_and_a_stretched_print_are_drawn_as_stated(rig) -> None:
    frame = (0.9, 0.05, 4.0, 0.0, 1.1, -3.0, 0.0, 4e-4, 1.0)
    changed = rig.at(projector={"frame": frame})
    scene = scene_of(parse_target(rig.capture_named("pose-06").target))
    capture = rig.capture_named("pose-06")
    plain, turned = (render_raster(one, capture, scene, noise=False).projector_px for one in (rig, changed))
    through = cv2.perspectiveTransform(plain.reshape(2, -1).T[None], np.reshape(frame, (3, 3)))[0]
    assert np.abs(through.T.reshape(plain.shape) - turned).max() < 1e-9
    # A print 1.25 times as long along x as it is high has its corners where the plain one has them at x / 1.25.
    table = pattern_table(replace(scene.pattern, stretch=0.25))
    plain_table = pattern_table(scene.pattern)
    places = np.random.default_rng(1).uniform(-60, 60, (200, 2))
    inks = [(ink_share(table, 1.25 * x, y, 1e-9), ink_share(plain_table, x, y, 1e-9)) for x, y in places]
    assert all(one == other for one, other in inks)


def test_a_flat_without_turn_faces_the_camera() -> None:
    capture = load_raster_rig("dlp-small").capture_named("pose-01")
    rotation, shift = flat_pose(capture)
    # Its x to the right of the picture, its y up, its z toward the camera, whose own axis is +z.
    assert rotation.tolist() == np.diag([1.0, -1.0, -1.0]).tolist()
    assert shift.tolist() == [0.0, 0.0, 600.0]


def test_light_is_what_the_rasters_pixels_emit(rig) -> None:
    sharp = rig.at(projector={"blur_px": 0.0, "gamma": 2.2, "black": 0.01}, fringes={"fringes": (8.3,)})
    profiles, axes = pattern_profiles(sharp)
    assert axes.tolist() == [0, 0, 0, 1, 1, 1, 2, 2]
    column = np.arange(160)
    level = np.rint(255 * (0.5 + 0.475 * np.cos(2 * np.pi * 8.3 * column / 160))) / 255
    emitted = 0.01 + 0.99 * level**2.2
    middles = profiles[0].reshape(-1, PER_PIXEL)
    assert np.abs(middles - emitted[:, None]).max() < 1e-12
    assert profiles[-2:, 0].tolist() == [1.0, 0.01]


def test_blur_lowers_the_contrast_as_pixel_and_gaussian_do(rig) -> None:
    blurred = rig.at(projector={"blur_px": 1.2}, fringes={"fringes": (16.0,), "contrast": 0.9})
    profiles, _ = pattern_profiles(blurred)
    inner = profiles[0, 20 * PER_PIXEL : -20 * PER_PIXEL]
    at = (np.arange(profiles.shape[1]) + 0.5)[20 * PER_PIXEL : -20 * PER_PIXEL] / PER_PIXEL - 0.5
    wave = np.exp(-2j * np.pi * at / 10)
    found = 2 * np.abs((inner * wave).mean())
    # 10 px a fringe: sinc of the pixel's square times the Gaussian's transform. Rounding to levels moves each of ten
    # values by half a level at most, and the amplitude by 4 / pi of that: 0.0025 of 0.45.
    expected = 0.45 * (1 - 0.002) * np.sinc(1 / 10) * np.exp(-2 * (np.pi * 1.2 / 10) ** 2)
    assert found == pytest.approx(expected, rel=5.5e-3)


def test_a_session_is_sound_and_keeps_its_truth_apart(rig, tmp_path) -> None:
    made = simulate_raster_session(rig, ["pose-02", "plate"], seed=3)
    folder = write_session(tmp_path / "session", made.document, made.frames, extra_files=made.files)
    assert not check_session(folder).faults
    session = load_session(folder)
    assert [axis.name for axis in session.captures["pose-02"].axes] == ["u", "v"]
    assert not [name for name in session.inputs if name.startswith("truth")]
    truth = json.loads((folder / "truth" / "truth.json").read_text())
    assert truth["projector_position_mm"] == list(rig.projector.position_mm)
    again = simulate_raster_session(rig, ["plate"], seed=3)
    assert np.array_equal(again.captures["plate"].frames, made.captures["plate"].frames)


def test_a_raster_rig_with_faults_is_refused(rig) -> None:
    with pytest.raises(FringecalError, match="zeros_deg: 2 values for 3 periods"):
        rig.at(fringes={"zeros_deg": (0.0, 1.0)})
    with pytest.raises(FringecalError, match="no capture 'ballbar'; it has pose-01"):
        rig.capture_named("ballbar")
