"""What speaks against a stated camera and projector, and what places that belong together say of it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fringecal.camera import Lens
from fringecal.projector import (
    PointPairs,
    StatedPair,
    doubts_by_pairs,
    judge_pairs,
    pair_doubts,
)

KNOWN = np.diag(np.array([1.0, 1, 1, 1, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3]) ** 2)
CAMERA = Lens(np.array([1754.1, 1752.9, 645.4, 529.5, -0.07, -0.04, 2e-4, 5e-4, 0.01]), KNOWN, 1280, 1024)
PROJECTOR = Lens(np.array([2496.6, 2495.8, 990.3, 1047.0, 0.04, -0.02, 1e-4, 2e-4, 0.0]), KNOWN, 1920, 1080)
# The projector stands 150 mm to the right and looks back under 17 deg: its centre is -R'T.
ROTATION = Rotation.from_rotvec([-0.1, 0.30, 0.01]).as_matrix()
PAIR = StatedPair(CAMERA, PROJECTOR, ROTATION, -ROTATION @ [150.0, -5.0, 10.0])


def named(doubts):
    return {doubt.name: doubt.refused for doubt in doubts}


def poses(count=6, *, seed=1, noise_px=0.0, stretch=1.0):
    """A board of 7 x 5 points of 15 mm, placed before the rig and seen by OpenCV's projection in both."""
    rng = np.random.default_rng(seed)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(7) * 15.0, np.arange(5) * 15.0))
    board = np.column_stack([x, y, 0 * x])
    found = []
    for _ in range(count):
        turned = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3)).apply(board - [45, 30, 0]) * stretch
        points = turned + [*rng.uniform(-20, 20, 2), rng.uniform(480, 560)]
        seen = []
        for lens, turn, shift in ((CAMERA, np.eye(3), np.zeros(3)), (PROJECTOR, ROTATION, PAIR.shift_mm)):
            core = np.array([[lens["fx_px"], 0, lens["cx_px"]], [0, lens["fy_px"], lens["cy_px"]], [0, 0, 1]])
            pixels = cv2.projectPoints(points, cv2.Rodrigues(turn)[0], shift, core, lens.values[4:])[0][:, 0]
            seen.append(pixels + rng.normal(0, noise_px, pixels.shape))
        found.append(PointPairs(*seen, board))
    return found


def test_a_rig_as_it_is_built_raises_no_doubt():
    assert pair_doubts(PAIR) == ()


def test_rays_of_the_right_pair_meet():
    found = judge_pairs(PAIR, poses())
    assert found.poses == 6
    assert found.points == 6 * 35
    assert found.projector_rms_px < 1e-3
    assert found.scale == pytest.approx(1.0, abs=1e-6)
    assert found.form_rms_mm < 1e-3
    assert doubts_by_pairs(found) == ()


def test_noise_shows_as_it_is():
    found = judge_pairs(PAIR, poses(20, noise_px=0.1))
    # Four coordinates for three of a point: one degree of freedom is left, of 0.01 px^2. The point nearest to both rays
    # is not that of least squares in px, where the devices' resolutions differ: somewhat more is left.
    total = found.camera_rms_px**2 + found.projector_rms_px**2
    assert 0.3 * 0.01 < total < 1.5 * 0.01


def test_a_board_of_another_pitch_is_named():
    found = judge_pairs(PAIR, poses(noise_px=0.05, stretch=1.02))
    assert named(doubts_by_pairs(found))["scale"]
    assert found.scale == pytest.approx(1.02, abs=0.002)


def test_a_moved_projector_is_named():
    moved = replace(PAIR, rotation=Rotation.from_rotvec([0.003, 0, 0]).as_matrix() @ ROTATION)
    assert "given places in the projector" in named(doubts_by_pairs(judge_pairs(moved, poses())))


def test_places_of_another_rig_are_refused():
    wrong = [PointPairs(pose.camera_px, pose.projector_px[::-1], pose.board_mm) for pose in poses()]
    assert any(named(doubts_by_pairs(judge_pairs(PAIR, wrong))).values())


def test_devices_that_look_away_from_each_other_are_named():
    # Half a metre to the right and turned by 60 deg: to the left it sees the camera's field, to the right it does not.
    turn = Rotation.from_rotvec([0, np.radians(60), 0]).as_matrix()
    narrow = replace(PROJECTOR, values=np.r_[3 * PROJECTOR.values[:2], 959.5, 520.0, np.zeros(5)])
    toward = StatedPair(CAMERA, narrow, turn, -turn @ [500.0, 0, 0])
    away = StatedPair(CAMERA, narrow, turn.T, -turn.T @ [500.0, 0, 0])
    assert "fields do not meet" not in named(pair_doubts(toward))
    assert named(pair_doubts(away))["fields do not meet"]


def test_lengths_in_metres_are_named():
    doubts = pair_doubts(replace(PAIR, shift_mm=PAIR.shift_mm / 1000))
    assert named(doubts)["distance of the centres"]
    assert "--unit m" in next(doubt.sentence for doubt in doubts if doubt.name == "distance of the centres")


def test_a_flat_angle_is_open():
    side_by_side = StatedPair(CAMERA, PROJECTOR, np.eye(3), np.array([-10.0, 0, 0]))
    assert named(pair_doubts(side_by_side)) == {"angle between the rays": False}


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ({"camera": 0.1, "projector": 0.2}, {}),
        ({"camera": 0.1, "projector": 0.9}, {"stated residual": False}),
        ({"camera": 0.1, "projector": 49.0}, {"stated residual": True}),
        ({"camera": 0.0, "projector": 0.0, "pair": 0.0}, {}),
    ],
)
def test_what_a_file_says_of_its_own_fit_is_weighed(errors, expected):
    assert named(pair_doubts(replace(PAIR, errors_px=errors))) == expected


def test_light_behind_the_projector_lights_nothing():
    assert np.isnan(PAIR.light(np.array([[0.0, 0, -4000.0]]))).all()
