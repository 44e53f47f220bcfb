"""Theory from stated positions, the lamp behind a mirror, and where the lamp really stands."""

from dataclasses import replace

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import CAMERA_NAMES, PlateCamera
from fringecal.errors import DetectionError, FitError
from fringecal.projector.angle.angle_theory import displacement, reflected_source, seen_axes, theoretical_apparent
from fringecal.projector.angle.projection_angle import ProjectorPosition
from fringecal.projector.orders.whole_fringes import explained, predicted_turns
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.rig_model import RigModel
from fringecal.uncertainty.components import UncertaintyComponent
from fringecal.uncertainty.influences import Influence

SHAPE = (601, 801)
X_MM = (-150.0, -75.0, 0.0, 75.0, 150.0)


def pinhole_rig(x_mm, height_mm, *, per_mm=0.1):
    """Even fringes on the plate from a pinhole at (x, 0, height): phi = 2 pi f (x H - xp z) / (H - z)."""
    k = 2 * np.pi * per_mm
    parameters = np.array([k, 0, -k * x_mm / height_mm, 0, 0, 0, -1 / height_mm])
    return RigModel(parameters, np.array([x_mm, 0.0, height_mm]))


@pytest.mark.parametrize(
    ("height", "camera_height", "table_deg"),
    [
        (1000.0, 1e9, (53.99, 52.45, 50.78, 49.00, 47.07)),
        (1000.0, 1000.0, (50.78,) * 5),
        (2000.0, 1000.0, (48.95, 49.86, 50.74, 51.59, 52.41)),
        (500.0, 1000.0, (54.08, 52.53, 50.87, 49.08, 47.14)),
    ],
)
def test_apparent_theory_is_similar_triangles_for_a_low_strip(height, camera_height, table_deg):
    """The table is `tan = (X - x_c) / (H_c - Z) + (x_p - X) / (H_p - Z)` of a strip of Z = 3 mm; theory has Z = 0."""
    x_p = height * np.tan(np.radians(50.7))
    rig, camera = pinhole_rig(x_p, height), PlateCamera.from_values(
        {"scale_mm_per_px": 0.5, "height_mm": camera_height}, SHAPE
    )  # fmt: skip
    stated = ProjectorPosition(np.array([x_p, 0.0, height]), np.zeros(3))
    z = 3.0
    for x, table in zip(X_MM, table_deg, strict=True):
        low = theoretical_apparent(rig, stated, camera, x, 0.0).value
        high = np.degrees(np.arctan(x / (camera_height - z) + (x_p - x) / (height - z)))
        assert high == pytest.approx(table, abs=0.02)
        assert low == pytest.approx(np.degrees(np.arctan(x / camera_height + (x_p - x) / height)), abs=1e-6)


def test_a_mirror_at_45_deg_turns_the_lamp_round_it():
    lamp = ProjectorPosition(np.array([0.0, 400.0, 1000.0]), np.array([1.0, 2.0, 3.0]))
    mirror = ProjectorPosition(np.array([0.0, 1200.0, 1000.0]), np.full(3, 0.0))
    # The plane through (., 1200, 1000) whose normal is (0, 1, -1) / sqrt 2: y and z about the point change places.
    found = reflected_source(lamp, mirror, (0.0, 2.0, -2.0))
    np.testing.assert_allclose(found.value_mm, [0.0, 1200.0, 200.0], atol=1e-9)
    np.testing.assert_allclose(found.u_mm, [1.0, 3.0, 2.0], atol=1e-9)


def test_a_mirrors_place_counts_twice_across_it():
    lamp = ProjectorPosition(np.zeros(3), np.zeros(3))
    mirror = ProjectorPosition(np.array([0.0, 600.0, 0.0]), np.array([9.0, 2.0, 9.0]))
    np.testing.assert_allclose(reflected_source(lamp, mirror, (0, 5, 0)).u_mm, [0.0, 4.0, 0.0], atol=1e-12)
    with pytest.raises(FitError, match="no direction"):
        reflected_source(lamp, mirror, (0, 0, 0))


def calibration(model, *modes):
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 1000.0}, SHAPE)
    return RigCalibration(camera, model, modes)


def moved_mode(x_mm, height_mm, dx, dz):
    """What one standard uncertainty of the pinhole's place does to all parameters."""
    effect = np.zeros(len(CAMERA_NAMES) + 7 + 1)
    shift = pinhole_rig(x_mm + dx, height_mm + dz).parameters - pinhole_rig(x_mm, height_mm).parameters
    effect[len(CAMERA_NAMES) : len(CAMERA_NAMES) + 7] = shift
    return UncertaintyComponent(Influence.PHASE_SCATTER, effect)


def test_a_lamp_moved_to_the_left_is_said_to_stand_there():
    found = calibration(pinhole_rig(588.0, 1000.0), moved_mode(588.0, 1000.0, 2.0, 0.0))
    stated = ProjectorPosition(np.array([600.0, 40.0, 1000.0]), np.full(3, 1.0))
    moved = displacement(found, stated)
    # Along the fringes (y) nothing can be said: the point of the line nearest to what is stated.
    np.testing.assert_allclose(moved.difference_mm, [-12.0, 0.0, 0.0], atol=1e-6)
    assert moved.u_mm[0] == pytest.approx(np.hypot(2.0, 1.0), rel=0.01)
    assert not moved.agrees
    assert "about 12 mm (u = 2 mm) further left than stated" in moved.sentence()


def test_the_coordinate_along_the_fringes_is_not_named():
    """Its difference is zero by choice of the point, its u a rounding error: the ratio of the two says nothing."""
    found = calibration(pinhole_rig(588.0, 1000.0), moved_mode(588.0, 1000.0, 2.0, 0.0))
    moved = displacement(found, ProjectorPosition(np.array([600.0, 40.0, 1000.0]), np.full(3, 1.0)))
    moved = replace(moved, difference_mm=np.array([-12.0, -1e-3, 0.0]), covariance=np.diag([5.0, 1e-8, 9.0]))
    assert "up" not in moved.sentence()
    assert "down" not in moved.sentence()
    assert seen_axes(found.model) == (True, False, True)


def test_a_lamp_within_its_uncertainty_agrees():
    found = calibration(pinhole_rig(598.0, 1000.0), moved_mode(598.0, 1000.0, 2.0, 0.0))
    moved = displacement(found, ProjectorPosition(np.array([600.0, 0.0, 1000.0]), np.full(3, 1.0)))
    # Two degrees of freedom, chi-squared 4/5: exp(-0.4).
    assert moved.probability == pytest.approx(np.exp(-0.4), rel=0.02)
    assert "agrees" in moved.sentence()


def test_what_the_breaks_cannot_tell_apart_is_said():
    """Far or near along the light is hardly seen; across it is: a lamp 12 mm to the left looks 12 mm higher too."""
    along = np.array([600.0, 1000.0]) / 10
    found = calibration(pinhole_rig(588.0, 1000.0), moved_mode(588.0, 1000.0, *along))
    moved = displacement(found, ProjectorPosition(np.array([600.0, 0.0, 1000.0]), np.full(3, 1.0)))
    assert not moved.agrees
    sentence = moved.sentence()
    assert "do not determine" in sentence
    assert "12 mm further left or 20 mm higher" in sentence  # 12 x 1000 / 600


def test_parallel_light_has_no_place():
    rig = RigModel(np.array([0.6, 0, -0.7, 0, 0, 0, 0.0]), np.full(3, np.inf))
    with pytest.raises(FitError, match="parallel"):
        displacement(calibration(rig), ProjectorPosition(np.zeros(3), np.ones(3)))


def plate_of(camera, rig):
    """Return the phase of the bare plate, pixel by pixel."""
    rays = camera.pixel_rays()
    return rig.phase(rays.ax, rays.ay, 0.0)


@pytest.mark.parametrize("turns", [0.5, 1.0, 2.0])
def test_a_step_of_whole_fringes_is_named_with_its_remedy(turns):
    """Pitch 10 mm, parallel view: h tan(theta) / 10 fringes at the origin, less than 5 % more or less beside it."""
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.1, "height_mm": 1e9}, SHAPE)
    projector = np.array([1200.0, 0.0, 1000.0])
    height = 1 / (0.12 / turns + 1e-3)  # the ray's foot lies (1200 + x) h / (1000 - h) off: 10 mm for each fringe
    plate = plate_of(camera, pinhole_rig(1200.0, 1000.0))
    found = predicted_turns(plate, camera, height, projector)
    assert abs(np.median(found)) == pytest.approx(turns, rel=1e-3)
    error = explained(DetectionError("narrow"), plate, camera, height, projector)
    assert ("whole fringes" in str(error)) == (turns >= 1)
    if turns >= 1:
        assert f"{turns:.2f} periods" in str(error)
        assert "pitch" in str(error)
        assert "strips of about" in str(error)


def test_where_no_projector_is_stated_the_refusal_stays_as_it_is():
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 1e9}, SHAPE)
    error = DetectionError("narrow")
    assert explained(error, plate_of(camera, pinhole_rig(1200.0, 1000.0)), camera, 8.3, None) is error
