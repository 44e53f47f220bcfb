"""Camera models as files: read by mrcal and OpenCV and from them, refused when nonsense, and used by the rig."""

import cv2
import numpy as np
import pytest

from fringecal.camera.lens import mrcal_wall
from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.lens.rich_lens import RATIONAL, RichLens
from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.camera.plate.plate_fit import fit_plate_camera
from fringecal.errors import FitError, RecordError
from fringecal.records.exports.cameramodel import (
    cameramodel_text,
    opencv_text,
    rich_lens_text,
    write_lens,
)
from fringecal.records.foreign.lens_files import parse_lens, read_lens

VALUES = np.array([800.0, 801.0, 321.0, 238.0, -0.1, 0.02, 0.001, -0.002, 0.01])
SIGMAS = np.array([1.5, 1.5, 0.8, 0.8, 2e-3, 4e-3, 1e-4, 1e-4, 1e-3])
LENS = Lens(VALUES, np.diag(SIGMAS**2) + 0.3 * np.outer(SIGMAS, SIGMAS), 640, 480)
PINHOLE = "{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [1, 1, 2, 2], 'imagersize': SIZE}"
NEGATIVE = [[1 + (i == j) * (-3 if i == 4 else 1) for j in range(9)] for i in range(9)]  # a variance of -1
YAML = opencv_text(LENS)


@pytest.mark.parametrize("name", ["lens.cameramodel", "lens.yml"])
def test_written_lens_is_read_back_with_its_covariance(name, tmp_path):
    found = read_lens(write_lens(tmp_path / name, LENS))
    # Twelve digits are written.
    np.testing.assert_allclose(found.values, VALUES, rtol=1e-11)
    np.testing.assert_allclose(found.covariance, LENS.covariance, rtol=1e-10)
    assert (found.width_px, found.height_px, found.covariance_known) == (640, 480, True)


def test_opencv_reads_our_yaml(tmp_path):
    storage = cv2.FileStorage(str(write_lens(tmp_path / "lens.yml", LENS)), cv2.FILE_STORAGE_READ)
    np.testing.assert_allclose(storage.getNode("camera_matrix").mat()[0], [800, 0, 321])
    np.testing.assert_allclose(storage.getNode("distortion_coefficients").mat().ravel(), VALUES[4:])


def test_yaml_of_opencv_is_read(tmp_path):
    path = tmp_path / "theirs.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", np.array([[800.0, 0, 321], [0, 801, 238], [0, 0, 1]]))
    storage.write("distortion_coefficients", VALUES[4:][None])
    storage.release()
    found = read_lens(path)
    np.testing.assert_allclose(found.values, VALUES, rtol=1e-12)
    assert not found.covariance_known


@pytest.mark.skipif(not mrcal_wall.available(), reason="mrcal is not installed")
def test_mrcal_reads_and_projects_as_we_do(tmp_path):
    import mrcal

    model = mrcal.cameramodel(str(write_lens(tmp_path / "lens.cameramodel", LENS)))
    rays = np.random.default_rng(0).uniform(-0.3, 0.3, (40, 3)) + [0, 0, 1]
    np.testing.assert_allclose(mrcal.project(rays, *model.intrinsics()), LENS.project(rays), atol=1e-8)


def test_camera_on_the_plate_is_a_lens_too():
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 900.0, "k1": -0.1}, (480, 640))
    found = parse_lens(cameramodel_text(camera))
    assert found["fx_px"] == pytest.approx(1800.0)
    assert found["cx_px"] == pytest.approx(319.5)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "neither"),
        ("not a model", "neither"),
        ("[1, 2]", "neither"),
        ("{'lensmodel': 'LENSMODEL_CAHVOR', 'intrinsics': [1], 'imagersize': [4, 3]}", "mrcal-convert-lensmodel"),
        ("{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [1, 2], 'imagersize': [4, 3]}", "4 intrinsics, found 2"),
        ("{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [1, 1, 2, 2]}", "imagersize"),
        ("{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [-1, 1, 2, 2], 'imagersize': [4, 3]}", "not positive"),
        (
            "{'lensmodel': 'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=9_Ny=9_fov_x_deg=60', 'imagersize': [640, 480], "
            "'intrinsics': [800, 800, 320, 240, 0]}",
            "166 intrinsics, found 5",
        ),
        (
            "{'lensmodel': 'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=9999_Ny=9999_fov_x_deg=60', 'imagersize': "
            "[9, 9], 'intrinsics': [800, 800, 320, 240, 0]}",
            "knots",
        ),
        ("camera_matrix: !!opencv-matrix\n rows: 2", "camera_matrix"),
        (PINHOLE.replace("SIZE", "[4, " + "9" * 5000 + "]"), "more than the 40 characters"),
        (PINHOLE.replace("SIZE", "[1e400, 3]"), "imagersize"),
        (PINHOLE.replace("SIZE", "[70000, 3]"), "65535"),
        (PINHOLE.replace("SIZE", "[4, 3], 'lens_covariance': [[1], [1, 2]]"), "positive semi-definite"),
        (PINHOLE.replace("SIZE", f"[4, 3], 'lens_covariance': {[[1e999] * 9] * 9}"), "neither"),
        (PINHOLE.replace("SIZE", f"[4, 3], 'lens_covariance': {NEGATIVE}"), "positive semi-definite"),
        ("{'a': " + "[" * 100_000, "nested deeper than the 16"),
        ("{'a': " + "-" * 100_000 + "1}", "neither"),
        (YAML.replace("image_width: 640", "image_width: " + "9" * 5000), "image_width"),
        (YAML.replace("rows: 3", "rows: 999999999"), "as many numbers"),
    ],
)
def test_nonsense_is_refused(text, reason):
    with pytest.raises(RecordError, match=reason):
        parse_lens(text)


def test_a_rational_lens_is_followed_by_browns_or_refused(tmp_path):
    mild = np.array([0.3, 0.1, 1e-3, -5e-4, 0.01, 0.35, 0.1, 0.0])
    rich = RichLens(RATIONAL, np.concatenate([VALUES[:4], mild]), np.zeros((12, 12)), 640, 480)
    found = parse_lens(rich_lens_text(rich))
    assert not found.covariance_known
    rays = np.random.default_rng(0).uniform((-0.35, -0.25, 1), (0.35, 0.25, 1), (50, 3))
    core = np.array([[800.0, 0, 321], [0, 801, 238], [0, 0, 1]])
    theirs = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), core, mild)[0].reshape(-1, 2)
    # Up to a turn of the camera, which is free and small here.
    assert np.hypot(*(found.project(rays) - theirs).T).max() < 0.3
    wild = np.array([8.0, 40.0, 1e-3, -5e-4, 90.0, 8.3, 42.0, 150.0])
    text = rich_lens_text(RichLens(RATIONAL, np.concatenate([VALUES[:4] * 0.4, wild]), np.zeros((12, 12)), 640, 480))
    with pytest.raises(RecordError, match="px rms only"):
        parse_lens(text)


@pytest.mark.skipif(not mrcal_wall.available(), reason="mrcal is not installed")
def test_a_splined_model_is_written_as_mrcal_reads_it_and_read_as_browns(tmp_path):
    import mrcal

    name = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=10_Ny=8_fov_x_deg=60"
    rich = RichLens(name, np.concatenate([VALUES[:4], np.zeros(160)]), np.zeros((164, 164)), 640, 480)
    path = tmp_path / "splined.cameramodel"
    path.write_text(rich_lens_text(rich), encoding="utf-8")
    model, values = mrcal.cameramodel(str(path)).intrinsics()
    assert model == name
    np.testing.assert_allclose(values, rich.values)
    # Without spline terms the lens is stereographic: 2 tan(t / 2) in focal lengths, which Brown's k1.. describe.
    angle = np.radians([0.0, 5.0, 10.0, 20.0])
    rays = np.column_stack([np.sin(angle), np.zeros(4), np.cos(angle)])
    seen = read_lens(path).project(rays)[:, 0]
    np.testing.assert_allclose(seen, 321 + 800 * 2 * np.tan(angle / 2), atol=0.3)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RecordError, match="none.cameramodel"):
        read_lens(tmp_path / "none.cameramodel")


def plate_crossings(noise_px=0.0, seed=0):
    """A 10 mm grid seen by LENS, 640 mm above the plate, the camera leaning a little."""
    # Height over focal length and scale is the cosine of the lean.
    height_mm = 640.0 / np.sqrt(1 + np.tan(0.02) ** 2 + np.tan(0.01) ** 2)
    values = {"scale_mm_per_px": 0.8, "height_mm": height_mm, "tilt_x_rad": 0.02, "tilt_y_rad": -0.01}
    values |= {n: LENS[n] for n in ("k1", "k2", "p1", "p2", "k3")} | {"aspect": 800 / 801, "cu_px": 1.5, "cv_px": -1.5}
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-200, 201, 20.0), np.arange(-150, 151, 20.0)))
    camera = PlateCamera.from_values(values, (480, 640))
    pixels = np.column_stack(camera.project(x, y))
    return np.column_stack([x, y]), pixels + np.random.default_rng(seed).normal(0, noise_px, pixels.shape), camera


def test_stated_lens_gives_the_height_that_a_square_on_grid_cannot():
    points, pixels, truth = plate_crossings()
    fit = fit_plate_camera(pixels, points, (480, 640), pitch_rel_u=1e-5, lens=LENS)
    # The tilted grid itself sharpens the focal length; what is stated is met exactly here.
    assert fit.camera["height_mm"] == pytest.approx(truth["height_mm"], rel=1e-4)
    assert fit.camera["scale_mm_per_px"] == pytest.approx(0.8, rel=1e-5)


def test_uncertainty_of_the_lens_reaches_the_rigs_camera():
    points, pixels, _ = plate_crossings(noise_px=0.05)
    exact = Lens(VALUES, np.zeros((9, 9)), 640, 480, covariance_known=False)
    us = []
    for lens in (exact, LENS):
        fit = fit_plate_camera(pixels, points, (480, 640), pitch_rel_u=1e-5, lens=lens)
        us.append(np.sqrt(fit.camera.covariance[-1, -1]) / fit.camera["height_mm"])
        stated = sum((np.outer(one.effect, one.effect) for one in fit.components), np.zeros((12, 12)))
        assert stated[-1, -1] <= fit.camera.covariance[-1, -1] * (1 + 1e-6)
    # fx is stated to 1.7 px in 800; scale times focal length is the height.
    assert us[1] > 5 * us[0]
    assert us[1] < 1.1 * np.sqrt(LENS.covariance[0, 0]) / 800


def test_model_of_another_picture_size_or_kind_is_refused():
    points, pixels, _ = plate_crossings()
    with pytest.raises(FitError, match="640 x 480"):
        fit_plate_camera(pixels, points, (960, 1280), pitch_rel_u=1e-5, lens=LENS)
    with pytest.raises(FitError, match="telecentric"):
        fit_plate_camera(pixels, points, (480, 640), pitch_rel_u=1e-5, lens=LENS, telecentric=True)
