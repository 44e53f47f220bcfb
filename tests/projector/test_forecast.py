"""Forecasts and advice against what really happens: rigs drawn anew, fitted anew, and their heights' spread.

The rigs are perturbed at the level of observations, which is exact for what is judged here: true strip heights, a
camera off by its doubts, and phase noise that neighbours share. Images would add nothing but time.
"""

import math

import numpy as np
import pytest
from scipy import special

from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.camera.plate.plate_fit import fit_plate_camera
from fringecal.projector.advice import Proposal, advise
from fringecal.projector.forecast import forecast_height
from fringecal.projector.height_models import height_changes
from fringecal.projector.joint_fit import fit_rig
from fringecal.projector.rig_calibration import Observations, calibrate_rig
from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.influences import Influence, Source

SHAPE = (240, 320)
CAMERA = PlateCamera.from_values({"scale_mm_per_px": 1.5, "height_mm": 1500.0}, SHAPE)
HEIGHT, SIDE, PITCH = 1000.0, 1222.0, 8.0
STRIP_U, BLOCK_U, WAVES, NOISE = 0.005, 0.005, 0.001, 0.01
BLOCK = Proposal("a step block of 30 mm", (30.0,), BLOCK_U, 0.3)
TRIALS = 60
DEGREE = 2  # of the plate residual: the virtual plate has none


def true_phase(x, y, z):
    return 2 * np.pi * (y + (y - SIDE) * z / (HEIGHT - z)) / PITCH


def surface(u, v, z, rng, camera=CAMERA):
    """Phase that a surface of true height z sends to pixels, with noise of pixels and waves of blocks of 24 px."""
    cluster = (v // 24 * 100 + u // 24).astype(np.intp)
    _, block = np.unique(cluster, return_inverse=True)
    phase = true_phase(*camera.rays(u, v).at(z), z)
    return phase + NOISE * rng.standard_normal(u.size) + WAVES * rng.standard_normal(block.max() + 1)[block], cluster


def pixels(seed, number=400, share=1.0):
    rng = np.random.default_rng(seed)
    low, high = 0.5 - share / 2, 0.5 + share / 2
    return rng.uniform(319 * low, 319 * high, number), rng.uniform(239 * low, 239 * high, number)


def observed(true_heights, rng, *, camera=CAMERA):
    """Plate, strips of stated 3 mm and, where a third height is given, a block of stated 30 mm."""
    places = [pixels(1, 800), pixels(2), pixels(3, share=BLOCK.extent)][: len(true_heights)]
    phases = [surface(u, v, z, rng, camera) for (u, v), z in zip(places, true_heights, strict=True)]
    stated = [Estimate(0.0, 0.0, "mm", "plate"), Estimate(3.0, STRIP_U, "mm", influence=Influence.STRIP_HEIGHT)]
    stated += [Estimate(30.0, BLOCK_U, "mm", influence=Influence.STEP_HEIGHT)]
    (u, v), (phase, cluster) = (tuple(zip(*rows, strict=True)) for rows in (places, phases))
    return Observations(u, v, phase, cluster, tuple(stated[: len(true_heights)]))


@pytest.fixture(scope="module")
def camera_fit():
    return grid_camera()


def grid_camera():
    """A camera as its grid gives it: height known to 5 mm, pitch to 2e-4, crossings to 0.01 px."""
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-200.0, 201, 20), np.arange(-160.0, 161, 20)))
    points = np.column_stack(CAMERA.project(x, y))
    points += 0.01 * np.random.default_rng(4).standard_normal(points.shape)
    return fit_plate_camera(
        points, np.column_stack([x, y]), SHAPE, pitch_rel_u=2e-4, height_mm=Estimate(1500.0, 5.0, "mm", "camera height")
    )


def even_normals(number, rng):
    """Normal deviates, one from each of `number` equal slices of probability: their spread is 1 with few of them."""
    return special.ndtri((rng.permutation(number) + 0.5) / number)


def found_spread(camera_fit, with_block, z_mm=28.0):
    """Standard deviation of a height over rigs drawn from what is stated, at five places of the field."""
    rng = np.random.default_rng(2008)
    u, v = np.array([20.0, 160, 300, 20, 300]), np.array([20.0, 120, 20, 220, 220])
    strips, blocks = even_normals(TRIALS, rng), even_normals(TRIALS, rng)
    camera = camera_fit.camera
    sd = np.sqrt(np.diag(camera.covariance))
    unit = np.where(sd > 0, sd, 1.0)
    sizes, axes = np.linalg.eigh(camera.covariance / np.outer(unit, unit))
    draws = np.column_stack([even_normals(TRIALS, rng) for _ in sizes]) * np.sqrt(np.clip(sizes, 0, None))
    offs = draws @ axes.T * unit
    errors = []
    for trial in range(TRIALS):
        true = [0.0, 3.0 + STRIP_U * strips[trial], 30.0 + BLOCK_U * blocks[trial]][: 3 if with_block else 2]
        # What the fit holds for the camera is off the camera that took the pictures.
        taken_by = camera.replaced(camera.parameters + offs[trial])
        fit = fit_rig(observed(true, rng, camera=taken_by).surfaces(camera), residual_degree=DEGREE)
        phase = true_phase(*taken_by.rays(u, v).at(z_mm), z_mm)
        errors.append(fit.model.height(phase, camera.rays(u, v)) - z_mm)
    return np.array(errors).std(axis=0, ddof=1), (u, v)


def stated(calibration, z_mm, u, v):
    return np.sqrt(np.sum(height_changes(calibration, z_mm, u, v) ** 2, axis=0))


@pytest.mark.parametrize("with_block", [False, True])
def test_stated_uncertainty_at_the_ridge_is_the_spread_over_many_rigs(camera_fit, with_block):
    true = (0.0, 3.0, 30.0) if with_block else (0.0, 3.0)
    spread, (u, v) = found_spread(camera_fit, with_block)
    variances = []
    for seed in range(6):  # one draw of a block that covers few blocks of neighbours says little of their scatter
        calibration, _ = calibrate_rig(observed(true, np.random.default_rng(seed)), camera_fit, residual_degree=DEGREE)
        variances.append(stated(calibration, 28.0, u, v) ** 2)
    # The bar is 10 %; the parts that are not drawn evenly (noise) make the spread itself uncertain by up to 5 %.
    np.testing.assert_allclose(np.sqrt(np.mean(variances, axis=0)), spread, rtol=0.15)


def test_a_block_brings_what_was_promised(camera_fit):
    rng = np.random.default_rng(7)
    observations = observed((0.0, 3.0), rng)
    _, fit = calibrate_rig(observations, camera_fit)
    advice = advise(observations, camera_fit, fit, heights_mm=(28.0,), proposals=(BLOCK,))
    (gain,) = advice.gains
    # By hand: u(28) is 28 / 3 u(strip) = 0.047 before and 28 / 30 u(block) = 0.0047 after, scatter left out.
    assert gain.before_mm[28.0] == pytest.approx(28 / 3 * STRIP_U, rel=0.10)
    assert gain.after_mm[28.0] == pytest.approx(28 / 30 * BLOCK_U, rel=0.35)
    calibration, _ = calibrate_rig(observed((0.0, 3.0, 30.0), rng), camera_fit)
    # What the block then truly gives, against the promise: both estimate scatter from one draw, 10 % each.
    assert forecast_height(calibration, 28.0).rms_mm == pytest.approx(gain.after_mm[28.0], rel=0.15)
    assert "a step block of 30 mm" in advice.sentences[-1]
    assert Influence.STRIP_HEIGHT.text in advice.sentences[0]


def test_forecast_names_what_dominates(camera_fit):
    calibration, _ = calibrate_rig(observed((0.0, 3.0), np.random.default_rng(8)), camera_fit)
    forecast = forecast_height(calibration, 20.0, noise_rad=NOISE, known_to_mm=3.0)
    source, share = forecast.dominant
    assert source == Source(Influence.STRIP_HEIGHT)
    # 20 mm on strips of 3.000(5) mm: 0.0333 mm, nearly the same everywhere.
    parts = forecast.contributions_mm()
    assert parts[source] == pytest.approx(20 / 3 * STRIP_U, rel=0.03)
    assert share == pytest.approx(parts[source] ** 2 / forecast.rms_mm**2)
    assert Source(Influence.EXTRAPOLATION, "3 mm") in parts
    assert sum(c**2 for c in parts.values()) == pytest.approx(forecast.rms_mm**2)
    # One radian is PITCH / (2 pi tan) of height where the camera looks straight down.
    middle = forecast.noise_mm[4, 4]
    assert middle == pytest.approx(NOISE * PITCH / (2 * math.pi) / (SIDE / HEIGHT), rel=0.05)
    below = forecast_height(calibration, 2.0, known_to_mm=3.0)
    assert Source(Influence.PHASE_SCATTER) in below.contributions_mm()
