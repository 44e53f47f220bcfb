"""The uncertainty of the lens reaches the rig: a worse known lens makes angle and height worse known."""

import numpy as np
import pytest

from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.camera.plate.plate_fit import fit_plate_camera
from fringecal.projector.angle.projection_angle import angle_budget
from fringecal.projector.rig_calibration import Observations, calibrate_rig
from fringecal.projector.rig_model import PlateResidual, RigModel
from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.influences import Influence

SHAPE = (480, 640)
SIGMAS = np.array([1.0, 1.0, 0.5, 0.5, 1e-3, 2e-3, 1e-4, 1e-4, 0.0])
CAMERA = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 400.0, "k1": -0.1}, SHAPE)
PIXEL = (430.0, 150.0)


def rig():
    """Even fringes of 8 mm on the plate from a pinhole at (500, 0, 410): phi = k (x - xp z / H) / (1 - z / H)."""
    k, x, height = 2 * np.pi / 8, 500.0, 410.0
    return RigModel(np.array([k, 0, -k * x / height, 0, 0, 0, -1 / height]), np.array([x, 0, height]), PlateResidual())


def observed():
    """Plate and a 3 mm plate on it, seen by CAMERA."""
    u, v = (c.ravel().astype(float) for c in np.meshgrid(np.arange(8, 640, 16), np.arange(8, 480, 16)))
    cluster = (v // 48).astype(np.intp) * 100 + (u // 48).astype(np.intp)
    phases = []
    for k, z in enumerate((0.0, 3.0)):
        x, y = CAMERA.rays(u, v).at(z)
        phases.append(rig().phase(x, y, z) + np.random.default_rng(k).normal(0, 0.02, u.size))
    heights = (Estimate(0.0, 0.0, "mm", "plate"), Estimate(3.0, 0.001, "mm", "strip height"))
    return Observations((u, u), (v, v), tuple(phases), (cluster, cluster), heights)


def calibrated(factor):
    """The rig calibrated with a lens whose standard uncertainties are `factor` times SIGMAS."""
    values = np.array([800.0, 800, 319.5, 239.5, -0.1, 0, 0, 0, 0])
    lens = Lens(values, np.diag((factor * SIGMAS) ** 2), SHAPE[1], SHAPE[0])
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-140, 141, 20.0), np.arange(-100, 101, 20.0)))
    pixels = np.column_stack(CAMERA.project(x, y)) + np.random.default_rng(9).normal(0, 0.02, (x.size, 2))
    fit = fit_plate_camera(pixels, np.column_stack([x, y]), SHAPE, pitch_rel_u=1e-5, sigma_px=0.02, lens=lens)
    return calibrate_rig(observed(), fit, residual_degree=2)[0]


def height_of(calibration):
    """Height that a phase of 20 mm means at one pixel."""
    rays = CAMERA.rays(*(np.array([c]) for c in PIXEL))
    phase = rig().phase(*rays.at(20.0), 20.0)
    return float(calibration.model.height(phase, calibration.camera.rays(*(np.array([c]) for c in PIXEL)))[0])


@pytest.fixture(scope="module")
def rigs():
    return {factor: calibrated(factor) for factor in (1.0, 8.0)}


def lens_part(budget):
    return float(np.hypot.reduce([c.effect for c in budget.components if c.influence is Influence.LENS]))


def test_the_lens_is_in_the_budget_of_angle_and_height(rigs):
    for quantity, unit in ((lambda c: angle_budget(c).result.value, "deg"), (height_of, "mm")):
        good, worse = (rigs[f].budget(quantity, unit=unit, label="q") for f in (1.0, 8.0))
        assert lens_part(worse) > 2 * lens_part(good) > 0
        assert worse.result.u > good.result.u


def test_focal_length_reaches_the_height_of_the_camera(rigs):
    heights = [np.sqrt(rigs[f].camera.covariance[-1, -1]) for f in (1.0, 8.0)]
    # Scale times focal length is the height: u(f) = 1 px of 800 gives 0.5 mm of 400, less what the grid knows.
    assert 0.1 < heights[0] <= 0.51
    assert heights[1] > 1.5 * heights[0]
