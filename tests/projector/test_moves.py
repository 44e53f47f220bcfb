"""Moves of a rig's parts against the virtual rig's own optics: both must see the same phase in the same pixel."""

import math

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.projector.move_kinds import Move
from fringecal.projector.moves import MOVES, RigState, moved
from fringecal.projector.rig_model import RigModel
from fringecal.simulate import load_rig
from fringecal.simulate.rig.drawn_projector import build_projector, phase_at, phase_gradient, rational_form

AIMED = (Move.AIMED_PROJECTOR_ALONG_X, Move.AIMED_PROJECTOR_ALONG_Y, Move.AIMED_PROJECTOR_ALONG_Z)
PLACED = (Move.PROJECTOR_ALONG_X, Move.PROJECTOR_ALONG_Y, Move.PROJECTOR_ALONG_Z)
TILT = (1.2, -0.8)  # deg; a camera that leans, so that a wrong frame shows


@pytest.fixture(scope="module")
def rig():
    return load_rig("thesis").at(camera={"tilt_deg": TILT}, projector={"position_mm": (40.0, 1222.0, 1000.0)})


def state_of(rig):
    """The rig as an audit sees it, written down from its document."""
    spec = rig.camera
    values = {
        "scale_mm_per_px": spec.scale_mm_per_px,
        "tilt_x_rad": math.radians(spec.tilt_deg[0]),
        "tilt_y_rad": math.radians(spec.tilt_deg[1]),
        "height_mm": spec.height_mm,
    }
    camera = PlateCamera.from_values(values, (spec.height_px, spec.width_px))
    # The document's scale is the mean on the plate, the model's is across the axis.
    factor = spec.scale_mm_per_px / camera.scale("mean").value
    camera = camera.replaced(camera.parameters * np.array([factor, *[1.0] * 11]))
    projector = build_projector(rig.projector)
    return RigState(camera, RigModel(rational_form(projector), np.array(rig.projector.position_mm)))


def phases(state):
    """Phase on the plate and on a level 3 mm above it over the picture, the constant taken off."""
    u, v = np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 599, 9))
    rays = state.camera.rays(u, v)
    both = np.stack([state.model.phase(*rays.at(z), np.full(u.shape, z)) for z in (0.0, 3.0)])
    return both - both[0, 4, 4]


def demand_same(after, rig_after, *, tolerance_rad=2e-6):
    # 2e-6 rad: rounding of the seven numbers over some 300 rad of phase.
    np.testing.assert_allclose(phases(after), phases(state_of(rig_after)), rtol=0, atol=tolerance_rad)


def test_camera_lowered(rig):
    spec = rig.camera
    height = spec.height_mm - 5
    lower = rig.at(camera={"height_mm": height, "scale_mm_per_px": spec.scale_mm_per_px * height / spec.height_mm})
    after = moved(state_of(rig), {Move.CAMERA_HEIGHT: -5.0})
    # The virtual camera's axis keeps the origin, the moved one's does not: it looks 5 tan(1.4 deg) = 0.12 mm beside.
    origin = 5 * np.array([math.tan(math.radians(t)) for t in TILT])
    back = moved(after, {Move.CAMERA_ALONG_X: -origin[0], Move.CAMERA_ALONG_Y: -origin[1]})
    demand_same(back, lower)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_lamp_moved_and_aimed_again(rig, axis):
    position = np.array(rig.projector.position_mm) + 5.0 * np.eye(3)[axis]
    after = moved(state_of(rig), {AIMED[axis]: 5.0})
    demand_same(after, rig.at(projector={"position_mm": tuple(position.tolist())}))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_lamp_moved_as_it_is(rig, axis):
    """The phase of a point is that of the point as far back: the virtual projector is asked directly."""
    step = 5.0 * np.eye(3)[axis]
    after, projector = moved(state_of(rig), {PLACED[axis]: 5.0}), build_projector(rig.projector)
    for point in ([0.0, 0.0, 0.0], [100.0, -150.0, 3.0], [-180.0, 140.0, 20.0]):
        expected = phase_at(projector, *(np.array(point) - step))
        assert float(after.model.phase(*point)) == pytest.approx(expected, abs=2e-6)


def test_slide_with_another_pitch(rig):
    after = moved(state_of(rig), {Move.SLIDE_PITCH: 0.005})
    demand_same(after, rig.at(projector={"pitch_mm": 1.005 * rig.projector.pitch_mm}))


def test_slide_turned(rig):
    """Fringes at the origin turn; a slide turned about the axis of light that leans by t turns them otherwise."""
    after = moved(state_of(rig), {Move.SLIDE_TURN: 0.002})
    projector = build_projector(rig.projector)
    axis = np.array(projector.axes[2])
    carrier = np.array(projector.carrier) @ np.array(projector.axes[:2])
    turned = carrier + 0.002 * np.cross(-axis, carrier)  # the light's axis points down, the model's up
    lengths = [np.linalg.norm(np.cross(axis, n)) for n in (carrier, turned)]
    assert lengths[1] == pytest.approx(lengths[0], rel=1e-5)
    point = np.array([60.0, -80.0, 0.0]) - np.array(rig.projector.position_mm)
    change = float((turned - carrier) @ point / (axis @ point))
    base = state_of(rig).model
    origin = -np.array(rig.projector.position_mm)
    change -= float((turned - carrier) @ origin / (axis @ origin))
    measured = after.model.phase(60.0, -80.0) - after.model.phase(0.0, 0.0)
    measured -= base.phase(60.0, -80.0) - base.phase(0.0, 0.0)
    # Second order of 0.002 rad in some 100 rad of phase: 2e-4.
    assert abs(float(measured)) == pytest.approx(abs(change), abs=5e-4)


@pytest.mark.parametrize("direction_deg", [0.0, 70.0, 200.0])
def test_plate_tilted(rig, direction_deg):
    """Camera and lamp are turned as one about the plate's origin, the slide's light with them."""
    tilt = math.radians(0.2)
    rise = np.array([math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))]) * tilt
    about = np.array([rise[1], -rise[0], 0.0]) / tilt
    cross = np.array([[0, -about[2], about[1]], [about[2], 0, -about[0]], [-about[1], about[0], 0]])
    turn = np.eye(3) + math.sin(tilt) * cross + (1 - math.cos(tilt)) * cross @ cross
    lean = turn.T @ np.array([math.tan(math.radians(t)) for t in TILT] + [1.0])
    slope = turn.T @ phase_gradient(build_projector(rig.projector), np.zeros(3))
    tilted = rig.at(
        camera={
            "tilt_deg": tuple(math.degrees(math.atan(lean[i] / lean[2])) for i in range(2)),
            "height_mm": rig.camera.height_mm * lean[2],
        },
        projector={
            "position_mm": tuple((turn.T @ np.array(rig.projector.position_mm)).tolist()),
            "pitch_mm": 2 * math.pi / math.hypot(slope[0], slope[1]),
            "across_deg": math.degrees(math.atan2(slope[1], slope[0])),
        },
    )
    after = moved(state_of(rig), {Move.PLATE_TILT_X: rise[0], Move.PLATE_TILT_Y: rise[1]})
    # Two turns one after the other are one turn to second order, 0.0035^2 / 2 = 6e-6 of 300 rad, and the scale
    # of a leaning camera is held to the mean on the plate by the document, across the axis by the model: 1e-4.
    np.testing.assert_allclose(phases(after), phases(state_of(tilted)), rtol=2e-4, atol=0.01)


def test_every_move_changes_something_and_none_is_nothing(rig):
    base = state_of(rig)
    for name, move in MOVES.items():
        same, other = move(base, 0.0), move(base, 0.01)
        assert np.allclose(phases(same), phases(base), atol=1e-7), name
        looks = (
            other.strip_scale * math.prod(other.set_scales.values()),
            other.camera_blur_px2,
            other.fringe_blur_mm2,
            *phases(other).ravel(),
        )
        before = (1.0, 0.0, 0.0, *phases(base).ravel())
        assert not np.allclose(looks, before, rtol=0, atol=1e-7), name
