"""Brightness, blur, noise, shadows and steps of virtual pictures against closed forms."""

import numba
import numpy as np
import pytest

from fringecal.simulate import RigSpec, load_rig, plate, render
from fringecal.simulate.rig.drawn_projector import harmonics
from fringecal.simulate.scene.objects import box
from fringecal.simulate.scene.scene import Scene


def rig(**sections):
    base = RigSpec(
        name="test",
        camera={
            "kind": "telecentric",
            "width_px": 161,
            "height_px": 121,
            "scale_mm_per_px": 1.0,
            "height_mm": 1500.0,
        },
        projector={"position_mm": (0.0, 1200.0, 1000.0), "pitch_mm": 10.0, "contrast": 0.8},
        light={"shading": False, "ambient": 0.0, "mid_grey": 0.4},
    )
    return base.at(**sections)


def quiet(spec, scene=None, **options):
    return render(spec, scene or plate(), noise=False, **options)


def test_mean_of_the_steps_is_the_stated_grey_and_ambient_is_part_of_it():
    frames = quiet(rig(light={"ambient": 0.25})).frames
    np.testing.assert_allclose(frames.mean(axis=0), 0.4 * 255, rtol=1e-12)


def test_pixel_collects_fringes_over_its_square():
    taken = quiet(rig(projector={"position_mm": (0.0, 1.2e6, 1e6)}))
    i1, i2, i3 = taken.frames
    modulation = np.sqrt(3 * (i3 - i2) ** 2 + (2 * i1 - i2 - i3) ** 2) / 3
    # sinc of pixel over period, 1 / 10; the quadrature's own error is (2 pi / 10)^4 / 4320 = 3.6e-5.
    np.testing.assert_allclose(modulation / taken.modulation, np.sinc(0.1), rtol=6e-5)


def test_defocus_lowers_modulation_by_its_gaussian():
    sharp, blurred = (harmonics(rig(projector={"defocus_mm": s})) for s in (0.0, 2.0))
    # Published: blur of 2 mm at a pitch of 10 mm leaves 0.454 of the modulation.
    assert blurred[1] / sharp[1] == pytest.approx(0.454, abs=5e-4)


@pytest.mark.parametrize("gamma", [1.1, 1.5, 2.2])
def test_gamma_has_the_published_harmonics(gamma):
    a = harmonics(rig(projector={"gamma": gamma, "contrast": 1.0}))
    assert a[2] / a[1] == pytest.approx((gamma - 1) / (gamma + 2), abs=1e-6)
    assert a[3] / a[2] == pytest.approx((gamma - 2) / (gamma + 3), abs=1e-6)


def test_square_slide_has_odd_harmonics_only():
    a = harmonics(rig(projector={"profile": "square", "contrast": 1.0}))
    np.testing.assert_allclose(a[2::2], 0.0, atol=1e-12)
    assert a[1] == pytest.approx(4 / np.pi)
    assert a[3] == pytest.approx(-4 / (3 * np.pi))


def test_brightness_falls_with_cosine_and_inverse_square():
    spec = rig(projector={"contrast": 0.0}, light={"shading": True})
    frame = quiet(spec).frames[0]
    for row, column in ((5, 5), (60, 80), (110, 150)):
        x, y = column - 80.0, 60.0 - row
        r2 = x**2 + (1200.0 - y) ** 2 + 1000.0**2
        expected = 0.4 * 255 * ((1200.0**2 + 1000.0**2) / r2) ** 1.5
        # Mean over the pixel against its centre: second derivative, below 1e-6.
        assert frame[row, column] == pytest.approx(expected, rel=2e-6)


def test_vignetting_takes_its_share_at_the_corner():
    frame = quiet(rig(projector={"contrast": 0.0}, camera={"vignetting": 0.2})).frames[0]
    share = (80**2 + 60**2) / (161**2 + 121**2) * 4
    assert frame[0, 0] / frame[60, 80] == pytest.approx(1 - 0.2 * share, rel=1e-4)


def test_shadow_of_a_box_has_its_closed_form_length():
    height, far_edge = 15.0, -10.3
    scene = Scene(solids=(box((-30.0, 30.0), (far_edge, 8.0), height),))
    frame = quiet(rig(projector={"contrast": 0.0}), scene).frames[0]
    dark_mm = np.sum(1 - frame[:, 80] / (0.4 * 255))
    expected = height * (1200.0 - far_edge) / (1000.0 - height)
    # Each end is met by 34 samples per pixel: half a sample either side.
    assert dark_mm == pytest.approx(expected, abs=2 / 34)


def test_shadow_holds_only_ambient_light():
    scene = Scene(solids=(box((-30.0, 30.0), (-10.0, 8.0), 15.0),))
    taken = quiet(rig(light={"ambient": 0.25}), scene)
    deep = ~taken.lit & (np.abs(taken.y + 20) < 4) & (np.abs(taken.x) < 25)
    np.testing.assert_allclose(taken.frames[:, deep], 0.4 * 255 * 0.25 / 1.25, rtol=1e-9)
    assert np.all(taken.modulation[deep] == 0)


def test_flank_turned_away_from_the_lamp_is_dark():
    scene = Scene(solids=(box((-30.0, 30.0), (-10.0, 8.0), 15.0),)).placed(0.0, 0.0, 0.0)
    tilted = rig(camera={"tilt_deg": (0.0, -20.0)})
    taken = quiet(tilted, scene)
    facing_away = (taken.z > 1) & (taken.z < 14)
    assert facing_away.sum() > 50
    assert not taken.lit[facing_away].any()


def test_noise_has_its_stated_variance():
    spec = rig(noise={"read_levels": 1.5, "gain": 0.03}, projector={"contrast": 0.0})
    noisy = np.stack([render(spec, plate(), seed=s).frames for s in range(4)]).astype(float)
    expected = np.sqrt(1.5**2 + 0.03 * 0.4 * 255 + 1 / 12)
    # 4 x 3 x 161 x 121 draws: the standard deviation of a standard deviation is 0.15 %.
    assert (noisy - 0.4 * 255).std() == pytest.approx(expected, rel=0.006)
    assert noisy.mean() == pytest.approx(0.4 * 255, abs=0.02)


def test_frames_of_one_capture_do_not_share_their_noise():
    frames = render(rig(projector={"contrast": 0.0}), plate(), seed=3).frames.astype(float)
    correlation = np.corrcoef(frames.reshape(3, -1))
    np.testing.assert_allclose(correlation, np.eye(3), atol=0.03)


def test_flicker_changes_whole_frames():
    spec = rig(
        camera={"width_px": 8, "height_px": 8},
        projector={"contrast": 0.0},
        light={"flicker": 0.05},
        noise={"read_levels": 0.0},
    )
    means = np.array([render(spec, plate(), seed=s).frames.mean(axis=(1, 2)) for s in range(60)]) / (0.4 * 255)
    # 180 lamps: sd of the sd is 5.3 %.
    assert means.std() == pytest.approx(0.05, rel=0.2)


def test_bits_and_saturation():
    twelve = rig(camera={"bits": 12}, light={"mid_grey": 0.7})
    frames = render(twelve, plate()).frames
    assert frames.dtype == np.uint16
    assert frames.max() == 4095
    assert render(rig(), plate()).frames.dtype == np.uint8


def test_sensor_gamma_keeps_the_stated_grey():
    frame = quiet(rig(projector={"contrast": 0.0}, camera={"gamma": 0.45})).frames[0]
    np.testing.assert_allclose(frame, 0.4 * 255, rtol=1e-12)


def test_camera_defocus_blurs_a_fringe_by_its_gaussian():
    sharp, blurred = (quiet(rig(camera={"defocus_px": s})) for s in (0.0, 1.0))
    inner = np.s_[0, 30:-30, 30:-30]
    ratio = blurred.frames[inner].std() / sharp.frames[inner].std()
    assert ratio == pytest.approx(np.exp(-2 * (np.pi / 10) ** 2), rel=0.01)


def test_true_steps_are_nominal_plus_error_plus_tilt():
    spec = rig(steps={"error_deg": (0.0, 3.0, -2.0), "tilt_deg": ((0, 0), (2.0, 0.0), (0.0, -4.0))})
    even = quiet(rig()).frames
    taken = quiet(spec)
    u = (np.arange(161) - 80) / 161
    v = ((np.arange(121) - 60) / 121)[:, None]
    true = np.radians([0 * u + 0 * v, 120 + 3 + 2 * u + 0 * v, 240 - 2 - 4 * v + 0 * u])
    amplitude = (even.max() - even.min()) / 2
    expected = 0.4 * 255 + amplitude * np.cos(taken.phase + true)
    # The fringes' amplitude is read from 121 rows, 0.5 % low where none holds the very crest.
    np.testing.assert_allclose(taken.frames, expected, atol=0.01 * amplitude)


def test_texture_belongs_to_the_surface_not_to_the_picture():
    spec = rig(surface={"smooth": 0.02, "speckle": 0.05, "speckle_mm": 2.0}, projector={"contrast": 0.0})
    first, second = (quiet(spec).frames[0] for _ in range(2))
    assert np.array_equal(first, second)
    assert first.std() / first.mean() > 0.02


def test_same_seed_same_picture_on_any_number_of_threads():
    spec = load_rig("thesis").at(camera={"width_px": 200, "height_px": 150})
    scene = Scene(solids=(box((-30.0, 30.0), (-10.0, 8.0), 15.0),))
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = render(spec, scene, seed=5).frames
        numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
        together = render(spec, scene, seed=5).frames
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(alone, together)
    assert not np.array_equal(alone, render(spec, scene, seed=6).frames)
