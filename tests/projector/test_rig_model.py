"""The rig model against closed forms: pinhole geometry, published angles, rays of equal phase."""

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import PlateCamera, Rays
from fringecal.projector.angle.projection_angle import (
    angles_from_breaks,
    apparent_angle,
    fringe_pitch_mm,
    projection_angle,
)
from fringecal.projector.joint_fit import PhasePoints
from fringecal.projector.rig_model import PlateResidual, RigModel, projector_line, projector_point

SHAPE = (601, 801)
X_MM = np.array([-150.0, -75.0, 0.0, 75.0, 150.0])


def pinhole_rig(x_mm, height_mm, *, per_mm=0.1, residual=None):
    """Even fringes on the plate from a pinhole at (x, 0, height): phi = 2 pi f (x H - xp z) / (H - z)."""
    k = 2 * np.pi * per_mm
    parameters = np.array([k, 0, -k * x_mm / height_mm, 0, 0, 0, -1 / height_mm])
    return RigModel(parameters, np.array([x_mm, 0.0, height_mm]), residual or PlateResidual())


def camera_above(height_mm):
    return PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": height_mm}, SHAPE)


def test_textbook_case_of_equal_heights():
    # xc = 0, xp = 600, L = 1000, X = 37, Z = 25, f = 0.1/mm: s = 15.384615 mm, dphi = -9.666439 rad, Z = 25.
    rig, camera = pinhole_rig(600.0, 1000.0), camera_above(1000.0)
    rays = camera.rays(*camera.project(37.0, 0.0, 25.0))
    step = float(rig.phase(37.0, 0.0, 25.0) - rig.phase(rays.ax, rays.ay, 0.0))
    assert step == pytest.approx(-9.666439, abs=1e-6)
    assert -step / (2 * np.pi * 0.1) == pytest.approx(15.384615, abs=1e-6)
    assert 1000 * step / (step - 2 * np.pi * 0.1 * 600) == pytest.approx(25.0, abs=1e-9)
    assert float(rig.height(rig.phase(37.0, 0.0, 25.0), rays)) == pytest.approx(25.0, abs=1e-9)


@pytest.mark.parametrize(
    ("projector_height_mm", "camera_height_mm", "expected_deg"),
    [
        (1000.0, None, (53.99, 52.45, 50.78, 49.00, 47.07)),
        (1000.0, 1000.0, (50.78, 50.78, 50.78, 50.78, 50.78)),
        (2000.0, 1000.0, (48.95, 49.86, 50.74, 51.59, 52.41)),
        (500.0, 1000.0, (54.08, 52.53, 50.87, 49.08, 47.14)),
    ],
)
def test_breaks_of_a_3_mm_strip_show_the_tabled_angles(projector_height_mm, camera_height_mm, expected_deg):
    rig = pinhole_rig(projector_height_mm * np.tan(np.radians(50.7)), projector_height_mm)
    if camera_height_mm is None:
        camera = PlateCamera.from_values({"scale_mm_per_px": 0.5}, SHAPE, telecentric=True)
    else:
        camera = camera_above(camera_height_mm)
    rays = camera.rays(*camera.project(X_MM, 0 * X_MM, 3.0))
    step = rig.phase(X_MM, 0.0, 3.0) - rig.phase(rays.ax, rays.ay, 0.0)
    shown = np.degrees(np.arctan(-step / (2 * np.pi * 0.1) / 3.0))
    # The table rounds to 0.01 deg.
    np.testing.assert_allclose(shown, expected_deg, atol=0.02)


@pytest.mark.parametrize("camera_height_mm", [700.0, 1000.0, 5000.0])
def test_apparent_angle_is_the_limit_of_a_low_strip(camera_height_mm):
    rig = pinhole_rig(1200.0, 900.0)
    shown = apparent_angle(rig, camera_above(camera_height_mm), X_MM, 0 * X_MM)
    # s / Z for Z -> 0 of s = Z [X / (Hc - Z) + (xp - X) / (Hp - Z)]; differences over 0.1 mm: 1e-7.
    expected = np.arctan(X_MM / camera_height_mm + (1200.0 - X_MM) / 900.0)
    np.testing.assert_allclose(shown, expected, atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_projection_angle_of_a_pinhole_whatever_the_sign_of_phase(sign):
    rig = pinhole_rig(1200.0, 900.0, per_mm=sign * 0.125)
    np.testing.assert_allclose(projection_angle(rig, X_MM, 0 * X_MM), np.arctan((1200 - X_MM) / 900), atol=1e-6)
    assert float(fringe_pitch_mm(rig)) == pytest.approx(8.0, rel=1e-6)


def test_angles_from_breaks_are_exact_for_any_height():
    rig = pinhole_rig(1200.0, 900.0)
    rays = Rays(X_MM, 10 + 0 * X_MM, 0.05 + 0 * X_MM, -0.02 + 0 * X_MM)
    x, y = rays.at(7.0)
    tangent, foot_x, foot_y = angles_from_breaks(rig, PhasePoints(rays, 7.0, rig.phase(x, y, 7.0), np.arange(5)))
    # The projector's ray through the top meets the plate at its foot: tan = (xp - foot) / H.
    np.testing.assert_allclose(foot_x, x + (x - 1200) * 7 / (900 - 7), atol=1e-8)
    np.testing.assert_allclose(foot_y, y, atol=1e-9)
    np.testing.assert_allclose(tangent, (1200 - foot_x) / 900, rtol=1e-9)


def test_the_projector_stands_on_the_line_of_its_planes():
    position = np.array([250.0, 900.0, 1100.0])
    axis = np.array([0.2, 0.65, 0.73])
    slide = np.array([0.8, -0.5, 0.2])
    d = axis / -(axis @ position)
    n = 300 * (slide + 0.3 * axis) / (axis @ position)
    n0 = -float(n @ position)
    parameters = np.array([*n, n0, *d])
    point, direction = projector_line(parameters)
    assert np.linalg.norm(np.cross(position - point, direction)) < 1e-8 * np.linalg.norm(position)
    np.testing.assert_allclose(projector_point(parameters, near=position + [1.0, 2.0, 0.0]), position, atol=2.5)


def test_collimated_light_has_no_projector():
    parameters = np.array([0.6, 0.0, -0.5, 0.2, 0, 0, 0])
    assert np.isinf(projector_point(parameters)).all()
    model = RigModel(parameters, projector_point(parameters))
    assert float(model.height(model.phase(3.0, 4.0, 5.0), Rays(*np.array([3.0, 4.0, 0, 0])))) == pytest.approx(5.0)


def lens_on_slide(x, y, z):
    """Phase of a pinhole at (1000, 0, 900) whose lens distorts the slide: constant along every ray."""
    p, q = (1000 - x) / (900 - z), -y / (900 - z)
    return 500 * (p - 10 / 9) * (1 + 0.02 * ((p - 10 / 9) ** 2 + q**2)) + 3 * q**2


def test_residual_is_carried_up_along_the_projectors_rays():
    rng = np.random.default_rng(3)
    box = (-260.0, 260.0, -210.0, 210.0)
    x, y = rng.uniform(-260, 260, 4000), rng.uniform(-210, 210, 4000)
    k = 500 / 900
    ratio = RigModel(np.array([-k, 0, k * 1000 / 900, 0, 0, 0, -1 / 900]), np.array([1000.0, 0, 900.0]))
    shape = PlateResidual(5, np.zeros(21), box)
    left = lens_on_slide(x, y, 0) - ratio.ratio(x, y, 0)
    coefficients = np.linalg.lstsq(shape.design(x, y), left, rcond=None)[0]
    model = RigModel(ratio.parameters, ratio.projector_mm, PlateResidual(5, coefficients, box))
    tops = rng.uniform([-150, -150, 0], [150, 150, 40], (200, 3)).T
    phase = lens_on_slide(*tops)
    # The lens is a cubic on the slide and so on the plate: a polynomial of degree 5 holds it exactly.
    np.testing.assert_allclose(model.phase(*tops), phase, atol=1e-8)
    assert np.abs(ratio.phase(*tops) - phase).max() > 0.1
    camera = camera_above(1500.0)
    height = model.height(phase, camera.rays(*camera.project(*tops)))
    np.testing.assert_allclose(height, tops[2], atol=1e-4)  # each lift gains two to three digits


def test_no_phase_no_height():
    rig = pinhole_rig(600.0, 1000.0)
    assert np.isnan(rig.height(np.array([np.nan]), Rays(*np.zeros((4, 1))))).all()
