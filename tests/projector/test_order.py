"""The fringe order of the strips: right for every wrap, refused where it cannot be known."""

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.errors import FitError
from fringecal.projector.joint_fit import PhasePoints, fit_rig
from fringecal.projector.orders.order_decision import decide_order
from fringecal.projector.plate_model import plate_model
from fringecal.projector.rig_model import RigModel, projector_point

SHAPE = (360, 480)
CAMERA = PlateCamera.from_values({"scale_mm_per_px": 0.7, "height_mm": 1400.0}, SHAPE)


def aimed_rig(angle_deg, height_mm, pitch_mm, *, off_axis_deg=0.0):
    """A pinhole on +y that looks at the plate's origin, or beside it."""
    angle, axis_angle = np.radians(angle_deg), np.radians(angle_deg + off_axis_deg)
    position = np.array([0.0, height_mm * np.tan(angle), height_mm])
    axis = -np.array([0.0, np.sin(axis_angle), np.cos(axis_angle)])
    slide = np.array([0.0, np.cos(axis_angle), -np.sin(axis_angle)])
    scale = -float(axis @ position)
    d, n, n0 = axis / scale, slide / scale, -float(slide @ position) / scale
    slope = abs(n[1] - n0 * d[1])
    gain = 2 * np.pi / pitch_mm / slope
    parameters = np.array([*(gain * n), gain * n0, *d])
    parameters[:4] -= [*(parameters[3] * d), parameters[3]]
    return RigModel(parameters, projector_point(parameters, near=position)), position


def captures(rig, height_mm, *, noise_rad=0.02, seed=0, strips=5):
    rng = np.random.default_rng(seed)

    def points(z, u_low, u_high, number):
        u, v = rng.uniform(u_low, u_high, number), rng.uniform(10, 350, number)
        rays = CAMERA.rays(u, v)
        phase = rig.phase(*rays.at(z), z) + noise_rad * rng.standard_normal(number)
        return PhasePoints(rays, z, phase, (v // 24 * 1000 + u // 24).astype(int))

    centres = np.linspace(60, 420, strips)
    return points(0.0, 5, 475, 4000), [points(height_mm, c - 12, c + 12, 600) for c in centres]


def off_by(piece, orders):
    return PhasePoints(piece.rays, piece.z_mm, piece.phase_rad - 2 * np.pi * orders, piece.cluster)


@pytest.mark.parametrize("lack", [-2, -1, 0, 1, 2])
@pytest.mark.parametrize("stated", [True, False])
def test_order_is_found_whatever_is_lacking(lack, stated):
    rig, position = aimed_rig(50.7, 1000.0, 8.0)
    plate, pieces = captures(rig, 3.0)
    decision = decide_order(plate, [off_by(p, lack) for p in pieces], projector_mm=position + 5 if stated else None)
    assert decision.orders == (lack,) * 5
    assert decision.chosen.angle_deg == pytest.approx(50.7, abs=0.3)  # 0.02 rad of noise on a step of 2.9
    assert decision.chosen.off_axis_deg == pytest.approx(0.0, abs=2.0)


@pytest.mark.parametrize("steep", [False, True])
def test_every_piece_finds_its_own_order(steep):
    rig, position = aimed_rig(60.0 if steep else 40.0, 900.0, 3.0 if steep else 8.0)
    plate, pieces = captures(rig, 10.0 if steep else 3.0)  # 60 deg, 10 mm, pitch 3 mm: a step of 36 rad
    lacks = (2, -1, 0, 3, -2)
    lacking = [off_by(p, k) for p, k in zip(pieces, lacks, strict=True)]
    decision = decide_order(plate, lacking, projector_mm=position if steep else None)
    assert decision.orders == lacks


@pytest.mark.parametrize("sign", [1, -1])
def test_sign_of_phase_does_not_matter(sign):
    rig, position = aimed_rig(45.0, 900.0, 8.0)
    turned = RigModel(rig.parameters * [sign, sign, sign, sign, 1, 1, 1], rig.projector_mm)
    plate, pieces = captures(turned, 3.0)
    for stated in (None, position):
        decision = decide_order(plate, [off_by(p, 1) for p in pieces], projector_mm=stated)
        assert decision.orders == (1,) * 5
        assert abs(decision.chosen.angle_deg) == pytest.approx(45.0, abs=0.3)


def test_strips_of_unequal_height_share_one_decision():
    rig, _ = aimed_rig(50.0, 1000.0, 6.0)
    plate, low = captures(rig, 3.0)
    _, high = captures(rig, 5.0)
    pieces = [low[0], off_by(high[1], 1), low[2], off_by(high[3], -1), low[4]]
    assert decide_order(plate, pieces).orders == (0, 1, 0, -1, 0)


def test_position_far_from_the_truth_is_refused():
    rig, position = aimed_rig(50.7, 1000.0, 8.0)
    plate, pieces = captures(rig, 3.0)
    with pytest.raises(FitError, match="projector position"):
        decide_order(plate, pieces, projector_mm=position * [1, -1, 1])


def test_coarse_light_from_far_away_leaves_the_order_open():
    # Collimated light shows no place of the projector: every order is as good as any other.
    rig = RigModel(np.array([0.0, 1.0, -1.0, 0, 0, 0, 0]), np.full(3, np.inf))
    plate, pieces = captures(rig, 5.0)
    with pytest.raises(FitError, match=r"open.*position_mm"):
        decide_order(plate, pieces)
    assert decide_order(plate, pieces, projector_mm=np.array([0.0, 9e5, 9e5])).orders == (0,) * 5


def test_plate_model_returns_the_five_numbers_of_the_plate():
    rig, _ = aimed_rig(50.7, 1000.0, 8.0)
    plate, _ = captures(rig, 3.0, noise_rad=0.0)
    found = plate_model(plate).parameters
    x, y = plate.rays.ax, plate.rays.ay
    model = RigModel(found, rig.projector_mm)
    np.testing.assert_allclose(model.phase(x, y), rig.phase(x, y), atol=1e-7)


def test_reference_with_strips_on_it_is_refused():
    rig, _ = aimed_rig(50.7, 1000.0, 8.0)
    bare, _ = captures(rig, 3.0)
    on_strip = np.arange(bare.phase_rad.size) % 2 == 0
    covered = PhasePoints(bare.rays, 0.0, bare.phase_rad - 2.9 * on_strip, bare.cluster)
    with pytest.raises(FitError, match="no bare plate"):
        plate_model(covered)


def test_one_height_cannot_make_a_rig():
    rig, _ = aimed_rig(50.7, 1000.0, 8.0)
    plate, _ = captures(rig, 3.0)
    with pytest.raises(FitError, match="one height"):
        fit_rig([plate, plate])


def test_covariance_of_the_fit_is_its_scatter():
    rig, _ = aimed_rig(50.7, 1000.0, 8.0)
    values, stated = [], []
    for seed in range(30):
        plate, pieces = captures(rig, 3.0, noise_rad=0.1, seed=seed, strips=3)
        strips = PhasePoints(
            type(plate.rays)(*(np.concatenate([getattr(p.rays, n) for p in pieces]) for n in ("ax", "ay", "bx", "by"))),
            3.0,
            np.concatenate([p.phase_rad for p in pieces]),
            np.concatenate([p.cluster for p in pieces]),
        )
        fit = fit_rig([plate, strips])
        values.append(fit.model.parameters)
        stated.append(np.sqrt(np.diag(fit.covariance)))
    spread, mean = np.std(values, axis=0, ddof=1), np.mean(stated, axis=0)
    # A standard deviation from 30 draws has 13 %; few clusters make the robust one up to 15 % small.
    np.testing.assert_array_less(np.abs(np.log(spread / mean)), 0.45)
    bias = (np.mean(values, axis=0) - rig.parameters) / (spread / np.sqrt(30))
    np.testing.assert_array_less(np.abs(bias), 4.0)
