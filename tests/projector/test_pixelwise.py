"""Laws of phase to height at every pixel, against two pinholes in closed form and the published residuals."""

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.errors import FitError
from fringecal.projector.height_models import HEIGHT_MODELS, height_model
from fringecal.projector.pixelwise import fit_pixelwise
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.rig_model import RigModel

SHAPE = (40, 50)
CAMERA = PlateCamera.from_values({"scale_mm_per_px": 8.0, "height_mm": 1500.0}, SHAPE)
SIDE, HEIGHT, PITCH = 1222.0, 1000.0, 8.0
FLATS = np.array([10.0, 20, 30, 40, 50])


def step(z, *, bend=0.0):
    """Phase over the plate's at every pixel; `bend` distorts the slide."""
    rays = CAMERA.pixel_rays()

    def phase(x, y, z):
        p = (y - SIDE) / (HEIGHT - z) + SIDE / HEIGHT  # 0 on the axis, which meets the plate at its origin
        return 2 * np.pi * HEIGHT / PITCH * p * (1 + bend * p**2)

    return phase(*rays.at(z), z) - phase(rays.ax, rays.ay, 0.0)


@pytest.mark.parametrize(("law", "worst_mm"), [("inverse-linear", 1e-9), ("three-term", 1e-7), ("cubic", 5e-3)])
def test_inverse_linear_is_exact_for_two_pinholes(law, worst_mm):
    # Exact by algebra; the cubic leaves the fourth order of a series in z / 1000 mm and z / 1500 mm.
    model = fit_pixelwise(np.stack([step(z) for z in FLATS]), FLATS, law=law)
    for z in (5.0, 33.0, 47.0):
        np.testing.assert_allclose(model.height(step(z)), z, atol=worst_mm)


def test_a_bent_slide_needs_the_third_term():
    flats = np.stack([step(z, bend=-0.05) for z in FLATS])
    worst = {
        law: np.abs(fit_pixelwise(flats, FLATS, law=law).height(step(25.0, bend=-0.05)) - 25.0).max()
        for law in ("inverse-linear", "three-term")
    }
    assert worst["three-term"] < 0.2 * worst["inverse-linear"]
    assert worst["inverse-linear"] > 1e-5  # above what arithmetic leaves


def test_smooth_coefficients_average_the_noise_of_flats():
    rng = np.random.default_rng(2)
    flats = np.stack([step(z) + 0.05 * rng.standard_normal(SHAPE) for z in FLATS])
    rough = fit_pixelwise(flats, FLATS)
    errors = [np.std(m.height(step(30.0)) - 30.0) for m in (rough, rough.smoothed(3))]
    # 10 numbers for 2000 pixels: noise falls by sqrt(2000 / 10) = 14.
    assert errors[1] < errors[0] / 7


def test_a_pixel_without_flats_has_no_height():
    flats = np.stack([step(z) for z in FLATS])
    flats[:, 3, 4] = np.nan
    height = fit_pixelwise(flats, FLATS).height(step(10.0))
    assert np.isnan(height[3, 4])
    assert np.isfinite(height).sum() == height.size - 1


@pytest.mark.parametrize("heights", [[10.0], [10.0, 10.0], [0.0, 10.0]])
def test_too_few_flats_are_refused(heights):
    with pytest.raises(FitError, match="flats of different height"):
        fit_pixelwise(np.stack([step(z) for z in heights]), heights)


def test_every_model_has_one_interface():
    k = 2 * np.pi / PITCH
    rig = RigModel(np.array([0, k, -k * SIDE / HEIGHT, 0, 0, 0, -1 / HEIGHT]), np.array([0.0, SIDE, HEIGHT]))
    calibration = RigCalibration(CAMERA, rig, ())
    rays = CAMERA.pixel_rays()
    phase = rig.phase(*rays.at(8.0), 8.0)
    worst = {n: np.abs(height_model(calibration, n).height(phase, rays) - 8.0).max() for n in HEIGHT_MODELS}
    # At 8 mm: one angle is off by what the field does, 20 mm a pixel; first order by z / 1000 of z.
    assert worst["constant-angle"] > worst["column-angle"] > worst["cubic"] > worst["pixelwise"]
    assert worst["pixelwise"] < 1e-9
    assert worst["projective"] < 1e-9
    with pytest.raises(KeyError, match="no height model"):
        height_model(calibration, "best")
