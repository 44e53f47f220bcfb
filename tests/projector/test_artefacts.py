"""Further artefacts: found on the plate, their order decided, and what they add to the joint fit.

Phase and camera are two pinholes in closed form; the rig that is "known so far" differs from the true one by what a
strip of wrong height would do to it.
"""

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import CAMERA_NAMES, PlateCamera
from fringecal.errors import FitError
from fringecal.projector.joint_fit import PhasePoints, fit_rig
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.rig_model import RIG_NAMES, RigModel
from fringecal.projector.standards.artefact_phase import observe_artefact
from fringecal.targets import parse_target
from fringecal.uncertainty.components import UncertaintyComponent
from fringecal.uncertainty.influences import Influence

SHAPE = (240, 320)
CAMERA = PlateCamera.from_values({"scale_mm_per_px": 1.2, "height_mm": 1400.0}, SHAPE)
PLACE = (12.0, -20.0, np.radians(25.0))
HEIGHT, SIDE = 1000.0, 1222.0  # mm, of the projector
PITCH = 8.0


def true_phase(x, y, z):
    """Even fringes on the plate, shifting along y: constant along every ray of the pinhole at (0, SIDE, HEIGHT)."""
    foot = y + (y - SIDE) * z / (HEIGHT - z)
    return 2 * np.pi * foot / PITCH


def known_rig(too_high=0.0, relative_u=0.0017):
    """The rig from strips whose stated height is off: every height comes out larger by the same factor."""
    k = 2 * np.pi / PITCH
    # z (1 + e) stated for z true: the rig's slope with height is smaller by the factor, to first order.
    parameters = np.array([0, k, -k * SIDE / HEIGHT * (1 - too_high), 0, 0, 0, -1 / HEIGHT])
    effect = np.zeros(len(CAMERA_NAMES) + len(RIG_NAMES) + 1)
    effect[len(CAMERA_NAMES) + 2] = k * SIDE / HEIGHT * relative_u
    model = RigModel(parameters, np.array([0.0, SIDE, HEIGHT]))
    return RigCalibration(CAMERA, model, (UncertaintyComponent(Influence.STRIP_HEIGHT, effect),))


def target_of(kind, **sizes):
    quantities = {f"{n}_mm" if n != "angle" else "angle_deg": {"value": v, "u": u} for n, (v, u) in sizes.items()}
    return parse_target({"format": 1, "kind": kind, "name": kind, "certificate": "drawn", **quantities})


STEPS = target_of("steps", heights=([5.0, 15.0, 30.0, 50.0], 0.005), width=(40.0, 0.05), length=(70.0, 0.05))
WEDGE = target_of("wedge", angle=(12.0, 0.02), width=(120.0, 0.05), length=(80.0, 0.05))


def seen(tops):
    """Wrapped phase of a scene whose tops are (low, high, half length, z(across)), as plate points below, and z."""
    rays = CAMERA.pixel_rays()
    x0, y0, turn = PLACE
    z = np.zeros(SHAPE)
    for low, high, half, level, slope in tops:
        top = np.full(SHAPE, level)
        for _ in range(20):  # the ray's place depends on the height there
            x, y = rays.at(top)
            across = np.cos(turn) * (x - x0) + np.sin(turn) * (y - y0)
            along = np.cos(turn) * (y - y0) - np.sin(turn) * (x - x0)
            top = level + slope * (across - low)
        inside = (across > low) & (across < high) & (np.abs(along) < half)
        z[inside] = np.maximum(z[inside], top[inside])
    phase = true_phase(*rays.at(z), z)
    return np.angle(np.exp(1j * phase)), phase, z


STEP_TOPS = [(-80 + 40 * i, -40 + 40 * i, 35, h, 0.0) for i, h in enumerate((5.0, 15.0, 30.0, 50.0))]
WEDGE_TOP = [(-60, 60, 40, 0.0, np.tan(np.radians(12.0)))]


def test_a_step_block_is_found_with_every_order_right():
    wrapped, phase, z = seen(STEP_TOPS)
    # 0.3 % too high is 0.19 rad at 50 mm: a wrong prediction, but nearer than the next order.
    found = observe_artefact(STEPS, wrapped, np.ones(SHAPE, bool), known_rig(0.003))
    assert found.left_out == ()
    assert [h.value for h in found.observations.height_mm] == [5, 15, 30, 50]
    x, y, turn = PLACE
    # The votes' lattice has 320 * 1.2 / 160 = 2.4 mm between points.
    assert np.hypot(found.place.x_mm - x, found.place.y_mm - y) < 2.4
    assert found.place.turn_rad == pytest.approx(turn, abs=np.radians(2))
    observed = found.observations
    for u, v, absolute, height in zip(
        observed.u_px, observed.v_px, observed.phase_rad, observed.height_mm, strict=True
    ):
        place = v.astype(int), u.astype(int)
        np.testing.assert_allclose(z[place], height.value)
        np.testing.assert_allclose(absolute, phase[place], atol=1e-9)


def test_what_the_lengths_of_a_block_have_in_common_is_one_error_of_all_of_its_treads():
    """Treads of 5 to 50 mm by one instrument: it moves all alike, temperature each in proportion to its height."""
    wrapped, _, _ = seen(STEP_TOPS)
    both = {"instrument": "comparator", "instrument_u_mm": 0.003, "thermal_rel_u": 1e-4}
    target = STEPS.model_copy(update=both)
    observed = observe_artefact(target, wrapped, np.ones(SHAPE, bool), known_rig()).observations
    changes = {one.influence: by for one, by in observed.errors() if one.influence is not Influence.STEP_HEIGHT}
    heights = np.array([h.value for h in observed.height_mm])
    assert sorted(changes[Influence.INSTRUMENT]) == [0, 1, 2, 3]
    for surface, height in enumerate(heights):
        np.testing.assert_allclose(changes[Influence.INSTRUMENT][surface], 0.003)
        np.testing.assert_allclose(changes[Influence.TEMPERATURE][surface], 1e-4 * height)
    own = [by for one, by in observed.errors() if one.influence is Influence.STEP_HEIGHT]
    assert [list(by) for by in own] == [[0], [1], [2], [3]]
    totals = [h.u for h in observed.height_mm]
    np.testing.assert_allclose(totals, np.sqrt(0.005**2 + 0.003**2 + (1e-4 * heights) ** 2))


def test_shadow_costs_pixels_and_not_the_block():
    wrapped, _, z = seen(STEP_TOPS)
    lit = np.random.default_rng(5).random(SHAPE) > 0.3
    lit[:, 200:230] = False
    found = observe_artefact(STEPS, wrapped, lit, known_rig())
    assert len(found.observations.height_mm) == 4
    for u, v, height in zip(*(getattr(found.observations, n) for n in ("u_px", "v_px", "height_mm")), strict=True):
        np.testing.assert_allclose(z[v.astype(int), u.astype(int)], height.value)


def test_an_order_that_the_rig_cannot_predict_is_left_out():
    # 5 mm of strip height known to 2.5 %: 2 pi / 8 * 1.22 rad/mm * 50 mm * 2.5 % = 1.2 rad; three times that is open.
    found = observe_artefact(STEPS, seen(STEP_TOPS)[0], np.ones(SHAPE, bool), known_rig(relative_u=0.025))
    assert [h.value for h in found.observations.height_mm] == [5, 15, 30]
    assert len(found.left_out) == 1
    assert "50 mm left out: its fringe order is open" in found.left_out[0]


@pytest.mark.parametrize("scene", [[], [(-80, 80, 35, 22.0, 0.0)]])
def test_a_block_that_is_not_there_is_refused(scene):
    with pytest.raises(FitError, match="was not found"):
        observe_artefact(STEPS, seen(scene)[0], np.ones(SHAPE, bool), known_rig())


def test_a_target_without_a_top_is_refused():
    with pytest.raises(FitError, match="no level or sloping top"):
        observe_artefact(target_of("sphere", diameter=(20.0, 0.01)), *seen([])[:2], known_rig())


def test_a_wedge_is_level_nowhere_and_known_everywhere():
    wrapped, phase, z = seen(WEDGE_TOP)
    found = observe_artefact(WEDGE, wrapped, np.ones(SHAPE, bool), known_rig())
    observed = found.observations
    place = observed.v_px[0].astype(int), observed.u_px[0].astype(int)
    np.testing.assert_allclose(observed.phase_rad[0], phase[place], atol=1e-9)
    angle, position = observed.components_of(0)
    assert (angle.influence, position.influence) == (Influence.WEDGE_ANGLE, Influence.WEDGE_POSITION)
    # The place is known to a point of the lattice: the heights miss the truth by no more than that doubt says.
    error = observed.height_mm[0].value + observed.relief_mm[0] - z[place]
    assert np.abs(error).max() < 3 * position.effect
    # tan(angle) moves by u / cos^2: at the far end, 120 mm from the foot, that is 0.044 mm.
    far = 120 * np.radians(0.02) / np.cos(np.radians(12)) ** 2
    assert 0.9 * far < np.max(angle.effect) <= far


def points(z_mm, u_mm, seed):
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, 319, 3000), rng.uniform(0, 239, 3000)
    return u, v, z_mm, u_mm, (v // 24 * 100 + u // 24).astype(int)


def surfaces(stated, true):
    made = []
    for (u, v, z, doubt, cluster), height in zip(stated, true, strict=True):
        rays = CAMERA.rays(u, v)
        phase = true_phase(*rays.at(height), height)
        made.append(PhasePoints(rays, z, phase, cluster, (doubt,) if doubt else ()))
    return made


def test_a_tall_block_outvotes_strips_of_wrong_height():
    # Strips stated 3.00, in truth 2.99, u 0.005; a block of 50 mm right within its u of 0.005.
    stated = [points(0.0, 0.0, 1), points(3.0, 0.005, 2), points(50.0, 0.005, 3)]
    fit = fit_rig(surfaces(stated, (0.0, 2.99, 50.0)))
    rays = CAMERA.rays(np.array([60.0, 160.0, 300.0]), np.array([40.0, 120.0, 230.0]))
    height = fit.model.height(true_phase(*rays.at(20.0), 20.0), rays)
    # By strips alone 20 mm would read 20 (1 + 0.01 / 3) = 20.067. Weighted by both doubts, the scale is off by
    # about 0.01 / 3 (3 / 50)^2: 0.0002 mm; the rest is what the block's own doubt allows.
    np.testing.assert_allclose(height, 20.0, atol=0.002)
    # They are two of their standard uncertainties lower. A doubt of 0.005 mm is 0.0048 rad here; a surface as a
    # whole is believed to 0.002 rad, so each of plate, strips and block may take up to a sixth of the move.
    assert -2.0 < fit.height_changes_u[1][0] < -1.3
    assert fit.height_changes_u[0].size == 0


def test_strips_alone_keep_their_stated_height():
    fit = fit_rig(surfaces([points(0.0, 0.0, 1), points(3.0, 0.005, 2)], (0.0, 2.99)))
    assert abs(fit.height_changes_u[1][0]) < 0.05
