"""Fitting the camera to a grid: what comes back, with what doubt, and what is refused."""

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import CAMERA_NAMES, PlateCamera
from fringecal.camera.plate.plate_fit import fit_plate_camera
from fringecal.errors import FitError
from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.influences import Influence

SHAPE = (480, 640)
TRUTH = {
    "scale_mm_per_px": 0.5,
    "height_mm": 900.0,
    "tilt_x_rad": 0.02,
    "tilt_y_rad": -0.015,
    "k1": -0.1,
    "aspect": 1.001,
}
HEIGHT = Estimate(900.0, 4.0, "mm", "camera height")


@pytest.fixture(scope="module")
def sheet():
    """Crossings of a 10 mm grid, turned by 0.7 deg on the plate."""
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-140, 141, 20.0), np.arange(-100, 101, 20.0)))
    points = np.column_stack([x, y])
    turn = np.radians(0.7)
    return points, x * np.cos(turn) - y * np.sin(turn) + 1.3, x * np.sin(turn) + y * np.cos(turn) - 0.8


def seen(sheet, *, truth=None, stretch=1.0, noise_px=0.0, seed=0):
    _, x, y = sheet
    camera = PlateCamera.from_values({**TRUTH, **(truth or {})}, SHAPE)
    pixels = np.column_stack(camera.project(stretch * x, stretch * y))
    return pixels + noise_px * np.random.default_rng(seed).standard_normal(pixels.shape)


def test_noise_free_crossings_give_the_camera_back(sheet):
    found = fit_plate_camera(seen(sheet), sheet[0], SHAPE, pitch_rel_u=1e-4, height_mm=HEIGHT)
    for name, value in TRUTH.items():
        # The solver stops at 1e-12 of the cost; tilt and height are the worst conditioned.
        assert found.camera[name] == pytest.approx(value, rel=1e-4, abs=1e-6), name
    assert found.turn_deg == pytest.approx(0.7, abs=1e-4)
    assert found.rms_px < 1e-5


def test_covariance_is_the_scatter_of_repeated_pictures(sheet):
    names = ("scale_mm_per_px", "tilt_x_rad", "k1", "aspect")
    index = [CAMERA_NAMES.index(n) for n in names]
    rng = np.random.default_rng(2)
    values, stated = [], []
    for seed in range(40):
        # Each picture has its own sheet and its own reading of the height, drawn from what is stated of them.
        pixels = seen(sheet, stretch=1 + 3e-4 * rng.standard_normal(), noise_px=0.1, seed=seed)
        height = Estimate(900.0 + 4.0 * rng.standard_normal(), 4.0, "mm", "camera height")
        found = fit_plate_camera(pixels, sheet[0], SHAPE, pitch_rel_u=3e-4, sigma_px=0.1, height_mm=height)
        values.append(found.camera.parameters[index])
        stated.append(np.sqrt(np.diag(found.camera.covariance))[index])
    ratio = np.std(values, axis=0, ddof=1) / np.mean(stated, axis=0)
    # A standard deviation from 40 draws has itself 11 %: 3.3 sigma.
    np.testing.assert_array_less(np.abs(ratio - 1), 0.37)
    bias = (np.mean(values, axis=0) - [TRUTH[n] for n in names]) / np.mean(stated, axis=0)
    np.testing.assert_array_less(np.abs(bias), 3.3 / np.sqrt(40))


def test_stated_inputs_are_components_of_their_own(sheet):
    found = fit_plate_camera(seen(sheet, noise_px=0.02), sheet[0], SHAPE, pitch_rel_u=1e-3, height_mm=HEIGHT)
    effects = {component.influence: component.effect for component in found.components}
    assert set(effects) == {
        Influence.GRID_PITCH, Influence.CAMERA_HEIGHT, Influence.PRINCIPAL_POINT_U, Influence.PRINCIPAL_POINT_V,
    }  # fmt: skip
    # A sheet that is larger by 1e-3 makes all millimetres larger by 1e-3.
    assert abs(effects[Influence.GRID_PITCH][0]) == pytest.approx(0.5e-3, rel=0.01)


def test_a_lens_off_the_image_centre_is_in_the_budget(sheet):
    """A square-on grid cannot show it, yet it turns the line of sight at the centre by offset / focal length."""
    off = {"cu_px": 6.0, "cv_px": -4.0}
    camera = PlateCamera.from_values(TRUTH | off, SHAPE)
    pixels = seen(sheet, truth=off, noise_px=0.05)
    found = fit_plate_camera(pixels, sheet[0], SHAPE, pitch_rel_u=1e-4, height_mm=HEIGHT).camera

    def slopes(of):
        ray = of.rays(*of.centre_px)
        return np.array([float(ray.bx), float(ray.by)])

    changes = []
    for axis in np.linalg.cholesky(found.covariance + 1e-18 * np.eye(12)).T:
        changes.append(slopes(found.replaced(found.parameters + axis)) - slopes(found))
    u = np.sqrt(np.sum(np.square(changes), axis=0))
    assert np.all(np.abs(slopes(found) - slopes(camera)) < 2 * u)
    # 1 % of the picture's diagonal, over the focal length; what the grid's tilt and barrel tell makes it smaller.
    assert np.all(u < 1.05 * 0.01 * np.hypot(*SHAPE) / camera.focal_px)
    assert np.all(u > 0.2 * 0.01 * np.hypot(*SHAPE) / camera.focal_px)


def test_wrong_crossings_are_left_out(sheet):
    pixels = seen(sheet, noise_px=0.05)
    pixels[::20] += 3.0
    found = fit_plate_camera(pixels, sheet[0], SHAPE, pitch_rel_u=1e-4, height_mm=HEIGHT)
    assert np.isnan(found.residual_u_px[::20]).all()
    assert np.isfinite(found.residual_u_px).mean() > 0.9
    assert found.camera["scale_mm_per_px"] == pytest.approx(0.5, rel=3e-4)


def test_telecentric_needs_no_height(sheet):
    values = {"scale_mm_per_px": 0.5, "k1": 0.02}
    camera = PlateCamera.from_values(values, SHAPE, telecentric=True)
    pixels = np.column_stack(camera.project(sheet[1], sheet[2]))
    found = fit_plate_camera(pixels, sheet[0], SHAPE, pitch_rel_u=1e-4, telecentric=True)
    assert found.camera["scale_mm_per_px"] == pytest.approx(0.5, rel=1e-6)
    assert found.camera["k1"] == pytest.approx(0.02, rel=1e-4)


def test_lines_placed_a_little_bent_are_not_taken_for_tilt():
    """A long lens shows a tilt of 0.05 deg by 0.01 px: no more than what lines nearly along the pixels are off by."""
    truth = {"scale_mm_per_px": 0.2, "height_mm": 7000.0, "tilt_x_rad": 0.002, "tilt_y_rad": -0.005}
    camera = PlateCamera.from_values(truth, SHAPE)
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-55, 56, 5.0), np.arange(-40, 41, 5.0)))
    pixels = np.column_stack(camera.project(x, y)) + 1e-3 * np.random.default_rng(3).standard_normal((x.size, 2))
    v = (pixels[:, 1] - 239.5) / 400
    pixels += 0.005 * np.column_stack([v + v**2, (pixels[:, 0] - 319.5) / 400 - v**2])
    height = Estimate(7000.0, 20.0, "mm", "camera height")
    found = fit_plate_camera(pixels, np.column_stack([x, y]), SHAPE, pitch_rel_u=1e-4, height_mm=height).camera
    u = np.sqrt(np.diag(found.covariance))[2:4]
    assert np.all(np.abs(found.parameters[2:4] - [0.002, -0.005]) < 2 * u)
    assert np.all(u < 0.002)


def test_parallel_rays_may_lean(sheet):
    """Their picture does not tell: the doubt is stated, and nothing else has to make up for it."""
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "tilt_x_rad": 0.02}, SHAPE, telecentric=True)
    pixels = np.column_stack(camera.project(sheet[1], sheet[2]))
    found = fit_plate_camera(pixels, sheet[0], SHAPE, pitch_rel_u=1e-4, telecentric=True)
    assert {Influence.CAMERA_TILT_X, Influence.CAMERA_TILT_Y} <= {one.influence for one in found.components}
    u = np.sqrt(np.diag(found.camera.covariance))[2:4]
    np.testing.assert_allclose(np.degrees(u), 1.0, rtol=0.01)
    assert abs(found.camera["tilt_x_rad"] - 0.02) < 2 * u[0]


def test_one_square_on_grid_without_height_is_refused(sheet):
    with pytest.raises(FitError, match="height_mm"):
        fit_plate_camera(seen(sheet), sheet[0], SHAPE, pitch_rel_u=1e-4)


def test_too_few_crossings_are_refused(sheet):
    with pytest.raises(FitError, match="11 crossings"):
        fit_plate_camera(seen(sheet)[:11], sheet[0][:11], SHAPE, pitch_rel_u=1e-4, height_mm=HEIGHT)


def test_rows_numbered_the_wrong_way_are_refused(sheet):
    with pytest.raises(FitError, match="numbering"):
        fit_plate_camera(seen(sheet), sheet[0] * [1, -1], SHAPE, pitch_rel_u=1e-4, height_mm=HEIGHT)
