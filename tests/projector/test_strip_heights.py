"""What the heights of strips hang on: own and common parts, and what they do to a rig."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fringecal.camera import PlateCamera
from fringecal.camera.plate.plate_fit import fit_plate_camera
from fringecal.projector import Observations, calibrate_rig, height_parts, total_u
from fringecal.projector.standards.artefact_phase import _own_influences, _spread
from fringecal.projector.standards.strip_heights import seen_heights
from fringecal.projector.standards.strip_phase import StripPhase
from fringecal.targets import parse_target
from fringecal.uncertainty import Estimate, Influence
from fringecal.verification.forms.readings import Reading

COUNT, HEIGHT, OWN_U, COMMON_U = 4, 3.0, 0.006, 0.002
SHAPE = (120, 160)
CAMERA = PlateCamera.from_values({"scale_mm_per_px": 1.0, "height_mm": 1500.0}, SHAPE)


def strips(**more):
    mm = {"count": COUNT, "width_mm": 10.0, "gap_mm": 10.0, "length_mm": 100.0}
    sizes = {k: v if k == "count" else {"value": v, "u": 0.05} for k, v in mm.items()}
    height = {"value": HEIGHT, "u": OWN_U}
    return parse_target(
        {"format": 1, "kind": "strips", "name": "set", "certificate": "x", "height_mm": height, **sizes, **more}
    )


def variance_of_the_mean(target):
    """Variance of the mean height over all strips, of equally many pixels each, by the components."""
    item = np.repeat(np.arange(COUNT), 50)
    y = np.tile(np.linspace(-50, 50, 50), COUNT)
    parts = height_parts(target, seen_heights(target), item, 20.0 * item, y)
    return sum(float(np.mean(one.effect)) ** 2 for one in parts)


def test_without_an_instrument_a_set_has_one_common_error():
    assert variance_of_the_mean(strips()) == pytest.approx(OWN_U**2)


def test_own_errors_average_over_the_strips_and_common_ones_do_not():
    target = strips(
        instrument="micrometer 3",
        instrument_u_mm=COMMON_U,
        paint_mm={"value": 0.05, "u": 0.003},
        seating_mm={"value": 0.01, "u": 0.004},
        depth_mm={"value": 0.02, "u": 0.001},
        parallelism_mm={"value": 0.01, "u": 0.0},
    )
    expected = COMMON_U**2 + 0.003**2 + 0.001**2 + (OWN_U**2 + 0.004**2) / COUNT
    assert variance_of_the_mean(target) == pytest.approx(expected)
    assert seen_heights(target)[0].value == pytest.approx(HEIGHT + 0.05 + 0.01 - 0.02)
    one = math.hypot(COMMON_U, 0.003, 0.001, OWN_U, 0.004)
    assert total_u(target, seen_heights(target)[0]) == pytest.approx(one)


def test_lengths_are_used_at_their_temperature():
    """ISO 1: lengths hold at 20 degC; steel of 11.5e-6 per K that is 10 K warmer is longer by 1.15e-4."""
    steel = strips(expansion_per_K={"value": 11.5e-6, "u": 1e-6})
    warm = steel.warmed(30.0, 2.0)
    assert warm.height_mm.value == pytest.approx(HEIGHT * (1 + 1.15e-4), rel=1e-9)
    assert warm.thermal_rel_u == pytest.approx(math.hypot(11.5e-6 * 2, 1e-6 * 10))
    assert warm.warmed(30.0, 2.0) == warm
    assert steel.warmed(None, 1.0) == steel


def true_phase(x, y, z):
    return 2 * np.pi * (y + (y - 1222.0) * z / (1000.0 - z)) / 8.0


@pytest.fixture(scope="module")
def camera_fit():
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-75.0, 76, 10), np.arange(-55.0, 56, 10)))
    height = Estimate(1500.0, 5.0, "mm", influence=Influence.CAMERA_HEIGHT)
    points = np.column_stack(CAMERA.project(x, y)) + 0.02 * np.random.default_rng(4).standard_normal((x.size, 2))
    return fit_plate_camera(points, np.column_stack([x, y]), SHAPE, pitch_rel_u=2e-4, sigma_px=0.02, height_mm=height)


def fitted(camera_fit, target, *, sets=1):
    """A rig fitted to plate and sets of strips without noise, the sets measured with the same instrument."""
    u, v = (c.ravel() for c in np.meshgrid(np.linspace(2, 157, 40), np.linspace(2, 117, 30)))
    rays, camera = CAMERA.rays(u, v), replace(camera_fit, camera=CAMERA.replaced(CAMERA.parameters))
    cluster = (v // 24 * 100 + u // 24).astype(np.intp)
    item = np.minimum((u // 40).astype(np.intp), COUNT - 1)
    heights, parts, phases = [Estimate(0.0, 0.0, "mm", "plate")], [None], [true_phase(*rays.at(0.0), 0.0)]
    for k in range(sets):
        z = HEIGHT * (1 + k)
        heights.append(Estimate(z, total_u(target, seen_heights(target)[0]), influence=Influence.STRIP_HEIGHT))
        phases.append(true_phase(*rays.at(z), z))
        parts.append(height_parts(target, seen_heights(target), item, rays.ax, rays.ay))
    number = len(phases)
    observations = Observations(
        (u,) * number, (v,) * number, tuple(phases), (cluster,) * number, tuple(heights), parts=tuple(parts)
    )
    return calibrate_rig(observations, camera)[0]


def height_changes_of(rig, influence, z=6.0):
    rays = CAMERA.rays(80.0, 60.0)
    phase = np.array(true_phase(*rays.at(z), z))
    return [float(rig.shifted(c).model.height(phase, rays)) - z for c in rig.components if c.influence is influence]


def test_a_common_error_of_strips_scales_heights(camera_fit):
    """Strips of 3 mm that all are 2 um higher make 6 mm higher by 4 um: heights go about in proportion."""
    target = strips(instrument="micrometer 3", instrument_u_mm=COMMON_U)
    rig = fitted(camera_fit, target)
    (common,) = height_changes_of(rig, Influence.INSTRUMENT)
    assert common == pytest.approx(2 * COMMON_U, rel=0.02)
    own = math.hypot(*height_changes_of(rig, Influence.STRIP_HEIGHT))
    assert own < 2 * OWN_U  # as much as if it were common, were the strips not several


def test_two_sets_of_one_instrument_have_one_error(camera_fit):
    """Sets of 3 and 6 mm, both 2 um higher: what is left at 6 mm is 2 um, of two such errors it were less."""
    rig = fitted(camera_fit, strips(instrument="micrometer 3", instrument_u_mm=COMMON_U), sets=2)
    (common,) = height_changes_of(rig, Influence.INSTRUMENT)
    assert common == pytest.approx(COMMON_U, rel=0.2)


def test_en_respects_what_measured_and_certified_value_share():
    """A common error that moves both alike says nothing of their difference (GUM 5.2.2)."""
    apart = Reading("height", "mm", 6.01, 6.0, 0.005, 0.005, 100)
    same = replace(apart, shared=0.005 * 0.004)
    u = math.sqrt(0.005**2 + 0.005**2 - 2 * 0.005 * 0.004)
    assert apart.en == pytest.approx(0.01 / (1.959964 * 0.005 * math.sqrt(2)), rel=1e-6)
    assert same.en == pytest.approx(0.01 / (1.959964 * u), rel=1e-6)


@pytest.mark.parametrize("instrument_u_mm", [0.0, COMMON_U])
def test_strips_put_side_by_side_have_the_same_errors_as_a_set_at_once(instrument_u_mm):
    """Strip by strip, as a further set is observed, or all at once: the mean height has one variance."""
    target = strips(instrument_u_mm=instrument_u_mm, paint_mm={"value": 0.0, "u": 0.003})
    heights, y = seen_heights(target), np.linspace(-50, 50, 50)
    rows = [height_parts(target, heights, np.full(50, k, np.intp), np.full(50, 20.0 * k), y) for k in range(COUNT)]
    own = _own_influences(StripPhase(None, None, None, heights, 0.0, target))
    together = _spread(rows, [50] * COUNT, own)
    variance = sum(float(np.mean(one.effect)) ** 2 for one in together)
    assert variance == pytest.approx(variance_of_the_mean(target))
