"""A plate that is not flat: its form, and what it does to a rig that takes it for a plane."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fringecal.calibration import CameraFindings
from fringecal.camera import PlateCamera
from fringecal.camera.plate.plate_fit import fit_plate_camera
from fringecal.projector import FORM_TERMS, Observations, PlateForm, calibrate_rig, form_height, form_of_flatness
from fringecal.projector.angle.angle_theory import displacement
from fringecal.projector.angle.other_causes import with_other_causes
from fringecal.projector.angle.projection_angle import ProjectorPosition
from fringecal.projector.plate_form import unknown_form
from fringecal.projector.rig_calibration import NOT_STATED
from fringecal.uncertainty import Estimate, Influence

SHAPE = (240, 320)
CAMERA = PlateCamera.from_values({"scale_mm_per_px": 1.0, "height_mm": 1500.0}, SHAPE)
BOX = (-159.5, 159.5, -119.5, 119.5)
HEIGHT, SIDE, PITCH, STRIPS_MM = 1000.0, 1222.0, 8.0, 3.0
BOW_MM = 0.2


def true_phase(x, y, z):
    """A pinhole with a plain ruling at (0, SIDE, HEIGHT): lines along x on the plate."""
    return 2 * np.pi * (y + (y - SIDE) * z / (HEIGHT - z)) / PITCH


def bow(along):
    """A parabola across one direction: 0.2 mm at both ends, 0.1 mm below the plane in the middle."""
    coefficients = np.zeros(len(FORM_TERMS))
    coefficients[FORM_TERMS.index((2, 0) if along == "x" else (0, 2))] = BOW_MM
    return coefficients


@pytest.fixture(scope="module")
def camera_fit():
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-150.0, 151, 15), np.arange(-110.0, 111, 11)))
    points = np.column_stack(CAMERA.project(x, y))
    points += 0.02 * np.random.default_rng(4).standard_normal(points.shape)
    height = Estimate(1500.0, 5.0, "mm", influence=Influence.CAMERA_HEIGHT)
    fit = fit_plate_camera(points, np.column_stack([x, y]), SHAPE, pitch_rel_u=2e-4, sigma_px=0.02, height_mm=height)
    return replace(fit, camera=CAMERA.replaced(CAMERA.parameters, fit.camera.covariance))


def observed(form_mm=None):
    """Plate and strips, both raised by the true form; what is stated of the heights knows nothing of it."""
    coefficients = np.zeros(len(FORM_TERMS)) if form_mm is None else form_mm
    u, v = (c.ravel() for c in np.meshgrid(np.linspace(2, 317, 60), np.linspace(2, 237, 45)))
    rays, phases = CAMERA.rays(u, v), []
    for stated in (0.0, STRIPS_MM):
        z = stated + form_height(coefficients, BOX, *rays.at(stated))
        phases.append(true_phase(*rays.at(z), z))
    cluster = (v // 24 * 100 + u // 24).astype(np.intp)
    heights = (
        Estimate(0.0, 0.0, "mm", "plate"),
        Estimate(STRIPS_MM, 0.005, "mm", influence=Influence.STRIP_HEIGHT),
    )
    return Observations((u, u), (v, v), tuple(phases), (cluster, cluster), heights)


def read_heights(rig, z=20.0):
    """What a calibrated rig reads for points at a true height, over the field."""
    u, v = (c.ravel() for c in np.meshgrid(np.linspace(10, 309, 7), np.linspace(10, 229, 5)))
    rays = CAMERA.rays(u, v)
    return rig.model.height(true_phase(*rays.at(z), z), rays)


def test_a_form_has_no_part_in_any_plane():
    """Legendre's polynomials of second order and more are square to 1, x and y over the box."""
    x, y = np.meshgrid(*(np.polynomial.legendre.leggauss(8)[0] * half for half in (159.5, 119.5)))
    w = np.outer(*(np.polynomial.legendre.leggauss(8)[1],) * 2)
    for unit in np.eye(len(FORM_TERMS)):
        height = form_height(unit, BOX, x, y)
        for plane in (np.ones_like(x), x, y):
            assert abs(np.sum(w * height * plane)) < 1e-9


def test_forms_as_large_as_stated_have_the_coefficients_that_are_taken_for_them():
    """Normal coefficients, third order half of second, scaled to one largest distance: their sizes by drawing."""
    rng = np.random.default_rng(8)
    x, y = np.meshgrid(*(np.linspace(low, high, 31) for low, high in (BOX[:2], BOX[2:])))
    drawn = rng.standard_normal((800, len(FORM_TERMS))) * [1, 1, 1, 0.5, 0.5, 0.5, 0.5]
    scaled = [one / np.abs(form_height(one, BOX, x, y)).max() for one in drawn]
    stated = np.array([axis.sum() for axis in form_of_flatness(1.0, BOX).axes_mm])
    # 800 draws know a standard deviation to 2.5 %; both numbers are rounded to two digits.
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(scaled), axis=0)), stated, rtol=0.1)


@pytest.mark.parametrize("along", ["x", "y"])
def test_a_bow_of_the_plate_moves_heights_as_its_component_says(along, camera_fit):
    axis = bow(along)
    known = replace(observed(), form=PlateForm(BOX, axes_mm=(axis,)))
    flat, _ = calibrate_rig(known, replace(camera_fit, solved=None))
    bent, _ = calibrate_rig(observed(axis), camera_fit)
    (component,) = [c for c in flat.components if c.influence is Influence.PLATE_FLATNESS]
    # The bow is there and nobody corrects it: heights err against the sense in which knowing it would move them.
    expected = read_heights(flat) - read_heights(flat.shifted(component))
    found = read_heights(bent) - 20.0
    assert np.abs(found).max() > 0.5 * BOW_MM
    np.testing.assert_allclose(found, expected, atol=0.02 * BOW_MM)


def test_a_bow_that_is_known_is_corrected(camera_fit):
    axis = bow("y")
    observations = replace(observed(axis), form=PlateForm(BOX, axis))
    rig, _ = calibrate_rig(observations, camera_fit)
    # The form is taken where a level plate would be met: 0.2 mm times the slope of a ray, 0.1, times the form's own.
    np.testing.assert_allclose(read_heights(rig), 20.0, atol=2e-3)


def test_a_plate_of_which_nothing_is_stated_has_a_row_that_says_so(camera_fit):
    rig, _ = calibrate_rig(replace(observed(), form=unknown_form(BOX)), camera_fit)
    (component,) = [c for c in rig.components if c.influence is Influence.PLATE_FLATNESS]
    assert component.detail == NOT_STATED
    assert not component.effect.any()


def test_a_sheet_that_is_not_flat_moves_the_camera_as_a_fit_to_it_does():
    """A small bow of the sheet: the camera fitted to its crossings against the first-order change."""
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-150.0, 151, 15), np.arange(-110.0, 111, 11)))
    height = Estimate(1500.0, 5.0, "mm", influence=Influence.CAMERA_HEIGHT)
    noise = 0.01 * np.random.default_rng(7).standard_normal((x.size, 2))

    def fitted(bow_mm):
        h = form_height(bow_mm * bow("y") / BOW_MM, BOX, x, y)
        points = np.column_stack(CAMERA.project(x, y, h)) + noise
        return fit_plate_camera(
            points, np.column_stack([x, y]), SHAPE, pitch_rel_u=2e-4, sigma_px=0.01, height_mm=height
        )

    small = 0.01
    flat, bent = fitted(0.0), fitted(small)
    (change,) = flat.changed_by_heights(lambda a, b: form_height(small * bow("y") / BOW_MM, BOX, a, b)[None])
    moved = flat.camera.parameters - bent.camera.parameters
    # To first order, in units of what the parameters are known to.
    u = np.sqrt(np.diag(flat.camera.covariance))
    known = u > 0
    np.testing.assert_allclose(change[known] / u[known], moved[known] / u[known], atol=0.02)
    assert np.abs(moved[known] / u[known]).max() > 0.1


def test_a_projector_that_a_bow_displaces_is_not_the_only_cause_named(camera_fit):
    """Where the projector stands is stated rightly; the plate is bowed by 0.3 mm from middle to ends."""
    axis = bow("y")
    observations = replace(observed(axis), form=unknown_form(BOX))
    rig, fit = calibrate_rig(observations, camera_fit)
    stated = ProjectorPosition(np.array([0.0, SIDE, HEIGHT]), np.full(3, 1.0))
    found = displacement(rig, stated)
    assert not found.agrees
    named = with_other_causes(found, rig, stated, observations, (camera_fit, fit))
    (bowed,) = [cause for cause in named.others if cause.endswith("along y)")]
    (size_mm,) = map(float, re.findall(r"its middle (\d\.\d+) mm", bowed))
    assert size_mm == pytest.approx(1.5 * BOW_MM, rel=0.1)  # the sheet, which is flat here, would have been bent too
    assert "lower than its ends" in bowed
    assert bowed in named.sentence()


def test_what_a_form_does_to_the_camera_counts_once(camera_fit):
    """The scale has its row as well; a rig fitted with that camera has the components it had without."""
    axes = form_of_flatness(0.1, BOX)
    findings = CameraFindings(None, None, camera_fit, None, None)
    on_plate = findings.on_plate(axes)
    rows = [c for c in on_plate.fit.components if c.influence is Influence.PLATE_FLATNESS]
    assert len(rows) == len(axes.axes_mm)
    before, after = (one.fit.camera.covariance for one in (findings, on_plate))
    np.testing.assert_allclose(after - before, sum(np.outer(c.effect, c.effect) for c in rows), atol=1e-12)
    observations = replace(observed(), form=axes)
    once, twice = (calibrate_rig(observations, one.fit)[0].covariance for one in (findings, on_plate))
    np.testing.assert_allclose(twice, once, rtol=1e-6, atol=1e-9 * np.abs(once).max())
