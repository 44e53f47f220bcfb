"""The plate's form from its poses: what each shows, what none does, and that its uncertainty holds."""

import math

import numpy as np
import pytest

from fringecal.calibration import PosedPlate, form_by_poses
from fringecal.calibration.plate_flatness import plate_form
from fringecal.camera import PlateCamera
from fringecal.errors import FitError
from fringecal.projector import FORM_TERMS, PlateForm

BOX = (-150.0, 150.0, -120.0, 120.0)
X, Y = np.meshgrid(np.linspace(-110, 110, 60), np.linspace(-80, 80, 45))


def form(**terms):
    """A form by the degrees of its terms, as d20=0.2."""
    return PlateForm(BOX, np.array([terms.get(f"d{i}{j}", 0.0) for i, j in FORM_TERMS]))


def heights(plate, pose, *, rng, tilt=0.0, noise=0.0):
    """Heights of a plate in a pose, written down apart from the package: rig's error, form, seating, noise."""
    rig = 0.3 * np.sin(X / 40) * np.cos(Y / 25) + 0.1 * (X / 100) ** 2
    turn = math.radians(pose.turn_deg)
    x, y = X - pose.dx_mm, Y - pose.dy_mm
    px, py = math.cos(turn) * x + math.sin(turn) * y, -math.sin(turn) * x + math.cos(turn) * y
    seat = rng.normal(0, 0.05) + tilt * (rng.standard_normal() * X + rng.standard_normal() * Y)
    return rig + plate.height(px, py) + seat + noise * rng.standard_normal(X.shape)


def measured(plate, poses, *, seed=0, tilt=0.0, noise=0.005, **options):
    rng = np.random.default_rng(seed)
    seen = [PosedPlate(heights(plate, p, rng=rng, tilt=tilt, noise=noise), p.turn_deg, p.dx_mm, p.dy_mm) for p in poses]
    return form_by_poses(X, Y, seen, BOX, u_tilt=max(tilt, 1e-9), **options)


def pose(turn_deg=0.0, dx_mm=0.0, dy_mm=0.0):
    return PosedPlate(np.zeros(0), turn_deg, dx_mm, dy_mm)


def u_of(found):
    return np.sqrt(np.sum(np.square(found.axes_mm), axis=0))


def test_a_shift_shows_a_bow_as_well_as_the_tilt_is_known():
    bow = form(d20=0.15)
    sure = measured(bow, [pose(), pose(dx_mm=40.0), pose(dy_mm=30.0)], tilt=0.0)
    assert sure.coefficients_mm == pytest.approx(bow.coefficients_mm, abs=0.003)
    unsure = measured(bow, [pose(), pose(dx_mm=40.0), pose(dy_mm=30.0)], tilt=1e-4)
    # P2 = (3 s^2 - 1) / 2 shifted by d: slope 3 d / 150^2 per mm of coefficient; two poses' tilts differ by sqrt 2.
    assert u_of(unsure)[0] == pytest.approx(1e-4 * math.sqrt(2) * 150**2 / (3 * 40), rel=0.25)


def test_a_half_turn_shows_third_order_and_no_bow():
    plate = form(d20=0.15, d30=0.06, d12=-0.04)
    found = measured(plate, [pose(), pose(turn_deg=180.0)], likely_mm=0.4)
    odd = [k for k, term in enumerate(FORM_TERMS) if sum(term) == 3]
    even = [k for k, term in enumerate(FORM_TERMS) if sum(term) == 2]
    assert found.coefficients_mm[odd] == pytest.approx(plate.coefficients_mm[odd], abs=0.004)
    assert u_of(found)[even] == pytest.approx(0.4, rel=0.01)  # as before anything was measured


def test_a_quarter_turn_shows_a_twist_and_how_both_bows_differ():
    square = (-120.0, 120.0, -120.0, 120.0)
    twist = PlateForm(square, np.array([0.08, 0.05, -0.08, 0, 0, 0, 0]))
    rng = np.random.default_rng(3)
    seen = [PosedPlate(heights(twist, pose(t), rng=rng, noise=0.005), t) for t in (0.0, 90.0)]
    found = form_by_poses(X, Y, seen, square, u_tilt=1e-9)
    assert found.coefficients_mm[:3] == pytest.approx([0.08, 0.05, -0.08], abs=0.005)
    assert np.linalg.norm(np.array(found.axes_mm) @ np.array([1, 0, 1, 0, 0, 0, 0])) > 0.3  # the common bow


@pytest.mark.parametrize("tilt", [0.0, 2e-4])
def test_its_uncertainty_holds_over_drawn_plates(tilt):
    poses = [pose(), pose(dx_mm=40.0), pose(dy_mm=-35.0), pose(turn_deg=90.0), pose(turn_deg=180.0)]
    scores = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        drawn = PlateForm(BOX, rng.normal(0, 0.1, len(FORM_TERMS)))
        found = measured(drawn, poses, seed=seed + 1000, tilt=tilt)
        covariance = np.sum([np.outer(a, a) for a in found.axes_mm], axis=0)
        off = found.coefficients_mm - drawn.coefficients_mm
        scores.append(off @ np.linalg.solve(covariance, off))
    # Chi-squared with seven degrees of freedom: the mean of 60 is 7 with standard deviation sqrt(14 / 60).
    assert np.mean(scores) == pytest.approx(7, abs=4 * math.sqrt(14 / 60))


def test_one_pose_is_refused():
    with pytest.raises(FitError, match="two poses"):
        form_by_poses(X, Y, [PosedPlate(0 * X)], BOX, u_tilt=1e-4)


def test_a_calibration_takes_a_measured_form_as_it_is():
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 1000.0}, (480, 640))
    bow = form(d20=0.15)
    assert plate_form(bow, camera) is bow
