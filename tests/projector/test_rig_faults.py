"""Faults put into drawn captures of a board rig are named, clean ones are not; the pose that helps most is proposed."""

import dataclasses

import cv2
import numpy as np
import pytest

from fringecal.camera import Lens
from fringecal.projector import (
    BoardPose,
    BoardRig,
    RigFaultKind,
    advise_poses,
    fit_board_rig,
    pose_arrangement,
    rig_faults,
)

CAMERA, PROJECTOR = (1280, 1024), (1920, 1080)
BOARD = 12.0 * np.stack([*(g.ravel() for g in np.meshgrid(np.arange(9.0), np.arange(7.0))), np.zeros(63)], axis=1)


PROJECTOR_VALUES = np.array([2900.0, 2900, 950, 800, 0.06, -0.05, -4e-4, 2e-4, 0])


def device(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrix and Brown's terms as OpenCV takes them."""
    fx, fy, cx, cy, *terms = values
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), np.array(terms)


def drawn_rig(focus: float = 1.0) -> BoardRig:
    camera = Lens(
        np.array([2200.0 * focus, 2200 * focus, 650, 500, -0.1, 0.1, 4e-4, -3e-4, 0]), np.zeros((9, 9)), *CAMERA
    )
    projector = Lens(PROJECTOR_VALUES, np.zeros((9, 9)), *PROJECTOR)
    rotation = cv2.Rodrigues(np.array([0.1, 0.42, -0.02]))[0]
    return BoardRig(camera, projector, rotation, np.array([-250.0, 90.0, 60.0]), np.zeros((24, 24)))


def drawn(rng: np.random.Generator, *, stretch: float = 0.0, focus: float = 0.0, tilt: float = 0.5, count: int = 9):
    """Poses of a board whose print and whose camera's focus may be off."""
    poses = []
    for k in range(count):
        rig = drawn_rig(1 + focus * rng.standard_normal())
        turn = cv2.Rodrigues(np.array([tilt * np.cos(2.4 * k), tilt * np.sin(2.4 * k), 0.1 * k]))[0]
        place = np.array([*rng.uniform(-25, 25, 2), 600 + rng.uniform(-60, 60)])
        points = (BOARD * [1 + stretch, 1, 1]) @ turn.T + place - turn @ BOARD.mean(axis=0)
        seen = rig.camera.project(points) + 0.03 * rng.standard_normal((63, 2))
        lit = rig.project(points) + 0.03 * rng.standard_normal((63, 2))
        poses.append(BoardPose(BOARD, seen, lit, read_at_camera=False, name=f"pose {k}"))
    return poses


def named(poses: list[BoardPose]) -> list[tuple[RigFaultKind, tuple[str, ...], float]]:
    found = rig_faults(fit_board_rig(poses, CAMERA, PROJECTOR))
    return [(one.kind, one.poses, one.size) for one in found]


def test_clean_captures_have_no_fault():
    assert named(drawn(np.random.default_rng(1))) == []


@pytest.mark.parametrize("stated", [True, False])
def test_poses_turned_away_scatter_as_their_phase_says_and_are_no_fault(stated):
    rng = np.random.default_rng(14)
    poses = drawn(rng)
    for k in (2, 5):  # a fourth of the light pixels, a quarter of their light: coordinates four times as uncertain
        lit = poses[k].projector_px + 0.03 * np.sqrt(4**2 - 1) * rng.standard_normal((63, 2))
        poses[k] = dataclasses.replace(poses[k], projector_px=lit)
    if stated:
        poses = [
            dataclasses.replace(pose, projector_u_px=0.12 if k in (2, 5) else 0.03) for k, pose in enumerate(poses)
        ]
    kinds = {kind for kind, _, _ in named(poses)}
    assert kinds == (set() if stated else {RigFaultKind.POSE_SCATTERS})


def test_a_stretched_print_is_told_with_its_size():
    ((kind, _, size),) = named(drawn(np.random.default_rng(2), stretch=0.008))
    assert kind is RigFaultKind.STRETCHED_PRINT
    assert size == pytest.approx(0.008, rel=0.25)  # to first order, and the poses are rolled by 50 deg at most


def test_a_focus_that_moves_is_told_with_its_size():
    ((kind, _, size),) = named(drawn(np.random.default_rng(3), focus=0.006))
    assert kind is RigFaultKind.FOCUS_CHANGED
    assert size == pytest.approx(0.006, rel=0.7)


@pytest.mark.parametrize("poses", [3, 9])
def test_poses_that_tell_too_little_are_named(poses):
    if poses == 3:
        assert named(drawn(np.random.default_rng(4), count=3))[0][0] is RigFaultKind.POSES_TOO_FEW
    else:
        assert named(drawn(np.random.default_rng(5), tilt=0.05))[0][0] is RigFaultKind.POSES_ALIKE


@pytest.mark.parametrize("which", ["projector", "camera"])
def test_a_list_that_is_numbered_from_the_other_end_is_named(which):
    poses = drawn(np.random.default_rng(6))
    field = f"{which}_px"
    poses[4] = dataclasses.replace(poses[4], **{field: getattr(poses[4], field)[::-1].copy()})
    ((kind, names, _),) = named(poses)
    assert kind is RigFaultKind.NUMBERED_OTHERWISE
    assert names == ("pose 4",)


def test_a_board_that_moved_between_its_pictures_disagrees():
    poses = drawn(np.random.default_rng(7))
    other = drawn(np.random.default_rng(8))
    poses[2] = dataclasses.replace(poses[2], projector_px=other[5].projector_px)
    assert [one[:2] for one in named(poses)] == [(RigFaultKind.POSE_DISAGREES, ("pose 2",))]


def test_a_scaler_and_a_keystone_correction_are_named():
    """A frame of 1920 x 1080 shown on 1280 x 800, and one whose upper edge is drawn in by 12 and 6 %."""
    poses = drawn(np.random.default_rng(9))
    scaled = [dataclasses.replace(p, projector_px=p.projector_px * [1280 / 1920, 800 / 1080]) for p in poses]
    ((kind, _, size),) = named(scaled)
    assert kind is RigFaultKind.FRAME_SCALED
    assert size == pytest.approx(800 / 1080 / (1280 / 1920) - 1, abs=2e-3)
    w, h = PROJECTOR
    corners = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    drawn_in = np.array([[0.12 * w, 0], [0.94 * w, 0], [w, h], [0, h]], np.float32)
    matrix = cv2.getPerspectiveTransform(drawn_in, corners)
    keystoned = [
        dataclasses.replace(p, projector_px=cv2.perspectiveTransform(p.projector_px[None], matrix)[0]) for p in poses
    ]
    assert [one[0] for one in named(keystoned)] == [RigFaultKind.FRAME_SCALED]


def test_a_knock_between_two_poses_is_named_with_the_first_pose_after_it():
    before, after = drawn(np.random.default_rng(31)), drawn(np.random.default_rng(31))
    knock = cv2.Rodrigues(np.radians([0.2, 0.3, 0.0]))[0]
    for k, pose in enumerate(after):  # the projector turned by 0.36 deg about its own centre
        rays = cv2.undistortPoints(pose.projector_px[:, None], *device(PROJECTOR_VALUES))[:, 0]
        turned = np.column_stack([rays, np.ones(len(rays))]) @ knock.T
        lit = cv2.projectPoints(turned, np.zeros(3), np.zeros(3), *device(PROJECTOR_VALUES))[0][:, 0]
        after[k] = dataclasses.replace(pose, projector_px=lit)
    assert [(kind, names) for kind, names, _ in named([*before[:5], *after[5:]])] == [
        (RigFaultKind.RIG_MOVED, ("pose 5",))
    ]


def test_axes_exchanged_in_all_captures_are_named():
    size = np.array(PROJECTOR)
    poses = [
        dataclasses.replace(pose, projector_px=(pose.projector_px / size)[:, ::-1] * size)
        for pose in drawn(np.random.default_rng(32))
    ]
    # As a session turns them: the projector would see the boards mirrored, and one axis is counted the other way.
    poses = [dataclasses.replace(p, projector_px=p.projector_px * [-1, 1] + [PROJECTOR[0], 0]) for p in poses]
    kinds = {fault.kind for fault in rig_faults(fit_board_rig(poses, CAMERA, PROJECTOR), projector_aspect=None)}
    assert kinds == {RigFaultKind.AXES_EXCHANGED}


ONE_POSE = {
    "exchanged": (lambda c, p: (c, (p / PROJECTOR)[:, ::-1] * PROJECTOR), RigFaultKind.AXES_EXCHANGED, "axes"),
    "falling": (lambda c, p: (c, p * [-1, 1] + [PROJECTOR[0], 0]), RigFaultKind.NUMBERED_OTHERWISE, "falls along u"),
    "turned": (lambda c, p: ([CAMERA[0] - 1, CAMERA[1] - 1] - c, p), RigFaultKind.NUMBERED_OTHERWISE, "pictures"),
}


@pytest.mark.parametrize("how", list(ONE_POSE))
def test_a_pose_whose_pictures_or_fringes_are_arranged_otherwise_says_how(how):
    change, kind, word = ONE_POSE[how]
    poses = drawn(np.random.default_rng(33))
    camera, projector = change(poses[4].camera_px, poses[4].projector_px)
    poses[4] = dataclasses.replace(poses[4], camera_px=camera, projector_px=projector)
    fit = fit_board_rig(poses, CAMERA, PROJECTOR)
    found = pose_arrangement(fit, 4)
    assert found is not None
    assert (found.kind, found.poses) == (kind, ("pose 4",))
    assert word in found.message
    assert pose_arrangement(fit, 3) is None


def test_the_proposed_pose_does_what_it_promises():
    """Added with points as the others', it lowers the median u in the volume by the ratio that was promised."""
    rng = np.random.default_rng(10)
    poses = drawn(rng, tilt=0.25, count=6)
    fit = fit_board_rig(poses, CAMERA, PROJECTOR)
    best = advise_poses(fit, count=2)
    assert best[0].ratio <= best[1].ratio < 1
    rig = drawn_rig()
    points = BOARD @ best[0].rotation.T + best[0].shift_mm
    seen, lit = (rig.camera.project(points), rig.project(points))
    noise = [0.03 * rng.standard_normal((63, 2)) for _ in range(2)]
    hidden = ~(((seen >= 0) & (seen <= np.array(CAMERA) - 1)).all(axis=1)
               & ((lit >= 0) & (lit <= np.array(PROJECTOR) - 1)).all(axis=1))  # fmt: skip
    seen[hidden] = lit[hidden] = np.nan
    added = BoardPose(BOARD, seen + noise[0], lit + noise[1], read_at_camera=False)
    after = fit_board_rig([*poses, added], CAMERA, PROJECTOR)
    ratio = median_u(after, fit) / median_u(fit, fit)
    assert ratio == pytest.approx(best[0].ratio, rel=0.2)


def median_u(fit, where) -> float:
    from fringecal.projector import rig_points

    volume = where.rig.volume_mm[::5]
    by_rig = rig_points(where.rig, where.rig.camera.project(volume), where.rig.project(volume)).by_rig
    return float(np.median(np.sqrt(np.einsum("nij,jk,nik->n", by_rig, fit.rig.covariance, by_rig))))
