"""A rig of camera and inverse camera from a board in poses: drawn rigs, OpenCV's and published answers, a real ball."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from fringecal.camera import Lens, lens_gradient
from fringecal.errors import FitError
from fringecal.projector import (
    BoardPose,
    BoardRig,
    BoardStatement,
    RigFaultKind,
    fit_board_rig,
    outside_volume,
    rig_faults,
    rig_points,
)

DATA = Path(__file__).parents[1] / "data" / "dp_tpu_ball"
CAMERA, PROJECTOR = (1280, 1024), (912, 1140)
BOARD_CORNER = np.array([-48.0, -36.0, 0.0])  # mm, the first of its points


def drawn_rig() -> BoardRig:
    """A camera, and a projector with a diamond raster 25 deg to its side, both with a lens that bends."""
    camera = Lens(np.array([2200.0, 2202, 650, 500, -0.12, 0.15, 5e-4, -3e-4, 0.0]), np.zeros((9, 9)), *CAMERA)
    projector = Lens(np.array([1700.0, 3400, 460, 900, 0.06, -0.05, -4e-4, 2e-4, 0.0]), np.zeros((9, 9)), *PROJECTOR)
    turn = cv2.Rodrigues(np.array([0.05, np.radians(25.0), -0.02]))[0]
    return BoardRig(camera, projector, turn, np.array([-250.0, 20.0, 60.0]), np.zeros((24, 24)))


def drawn_poses(rig: BoardRig, rng: np.random.Generator, *, sigma_px: float = 0.0, count: int = 10) -> list[BoardPose]:
    """A board of 9 x 7 points in tilted poses; the phase is read where the camera sees a corner."""
    columns, rows = np.meshgrid(np.arange(9.0), np.arange(7.0))
    board = 12.0 * np.stack([columns.ravel() - 4, rows.ravel() - 3, np.zeros(63)], axis=1)
    poses = []
    for k in range(count):
        tilt = np.array([0.5 * np.cos(2.4 * k), 0.5 * np.sin(2.4 * k), 0.4 * k])
        shift = np.array([*rng.uniform(-35, 35, 2), 600 + rng.uniform(-60, 60)])
        points = board @ cv2.Rodrigues(tilt)[0].T + shift
        error = sigma_px * rng.standard_normal((63, 2))
        seen, lit = rig.camera.project(points), rig.project(points)
        # The projector's place of the board's plane at the pixel where the corner was found.
        moved = board.copy()
        slope = lens_gradient(rig.camera.values, points).by_point @ cv2.Rodrigues(tilt)[0][:, :2]
        moved[:, :2] += np.linalg.solve(slope, error[..., None])[..., 0]
        lit = rig.project(moved @ cv2.Rodrigues(tilt)[0].T + shift) + 0.3 * sigma_px * rng.standard_normal((63, 2))
        poses.append(BoardPose(board, seen + error, lit))
    return poses


def without_rows(pose: BoardPose) -> BoardPose:
    return dataclasses.replace(pose, projector_px=pose.projector_px * [1.0, np.nan])


def real_poses(name: str) -> tuple[list[BoardPose], dict[str, np.ndarray]]:
    found = dict(np.load(DATA / f"{name}.npz"))
    triples = zip(found["board_mm"].astype(float), found["camera_px"], found["projector_px"], strict=True)
    return [BoardPose(*each) for each in triples], found


def ball(points: np.ndarray) -> tuple[float, np.ndarray]:
    """Radius of the best sphere, and each point's distance from it, mm."""
    terms = np.column_stack([2 * points, np.ones(len(points))])
    start = np.linalg.lstsq(terms, (points**2).sum(axis=1), rcond=None)[0]
    centre = start[:3]
    for _ in range(20):
        arm = points - centre
        length = np.linalg.norm(arm, axis=1)
        design = np.column_stack([arm / length[:, None], np.ones(len(arm))])
        centre = centre + np.linalg.lstsq(design, length, rcond=None)[0][:3]
        if np.allclose(points - centre, arm, atol=1e-9):
            break
    length = np.linalg.norm(points - centre, axis=1)
    return float(length.mean()), length - length.mean()


def test_derivatives_are_opencvs():
    """cv2.projectPoints differentiates by turn, shift, focal lengths, principal point and Brown's terms."""
    lens = drawn_rig().camera
    points = np.random.default_rng(1).uniform([-90, -90, 500], [90, 90, 700], (40, 3))
    found = lens_gradient(lens.values, points)
    matrix = np.array([[lens["fx_px"], 0, lens["cx_px"]], [0, lens["fy_px"], lens["cy_px"]], [0, 0, 1]])
    pixels, slopes = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, lens.values[4:])[:2]
    assert found.pixels == pytest.approx(pixels.reshape(-1, 2), abs=1e-9)
    assert found.by_point == pytest.approx(slopes[:, 3:6].reshape(-1, 2, 3), abs=1e-9)
    assert found.by_lens == pytest.approx(slopes[:, 6:15].reshape(-1, 2, 9), abs=1e-9)


def test_exact_points_give_the_rig_back():
    rig = drawn_rig()
    fit = fit_board_rig(drawn_poses(rig, np.random.default_rng(2)), CAMERA, PROJECTOR)
    assert fit.stereo_rms_px < 1e-5
    assert fit.rig.camera.values[:4] == pytest.approx(rig.camera.values[:4], abs=0.02)
    assert fit.rig.projector.values[:4] == pytest.approx(rig.projector.values[:4], abs=0.02)
    assert fit.rig.centre_mm == pytest.approx(rig.centre_mm, abs=0.01)
    assert fit.rig.undetermined == ()


def test_wrong_corners_are_left_out():
    rig = drawn_rig()
    poses = drawn_poses(rig, np.random.default_rng(3), sigma_px=0.05)
    poses[2].camera_px[5] += 4.0
    poses[4].projector_px[7] -= 9.0
    fit = fit_board_rig(poses, CAMERA, PROJECTOR)
    assert not fit.poses[2].used[5, :2].any()
    assert not fit.poses[4].used[7, 2:].any()
    assert sum(int((~pose.used).sum()) for pose in fit.poses) < 12
    assert fit.rig.camera_s_px == pytest.approx(0.05, rel=0.1)
    assert fit.rig.projector_s_px == pytest.approx(0.015, rel=0.15)


def test_the_corners_own_error_is_taken_out_of_the_projectors_coordinate():
    """Equation (4): raw residuals of both pictures go together, those that are weighed do not."""
    fit = fit_board_rig(drawn_poses(drawn_rig(), np.random.default_rng(14), sigma_px=0.05, count=16), CAMERA, PROJECTOR)
    camera = np.vstack([pose.camera_residual_px for pose in fit.poses])
    raw = np.vstack([pose.projector_residual_px for pose in fit.poses])
    weighed = fit.solution.rest_px[:, 2:]
    together = [np.abs(np.linalg.lstsq(camera, rest, rcond=None)[0]).max() for rest in (raw, weighed)]
    assert together[0] > 0.5
    assert together[1] < 0.05
    assert raw.std() > 2.5 * weighed.std()
    assert weighed.std() == pytest.approx(0.015, rel=0.1)


def test_one_axis_gives_the_same_points_and_says_what_it_cannot_tell():
    rig = drawn_rig()
    poses = drawn_poses(rig, np.random.default_rng(4), sigma_px=0.02)
    fit = fit_board_rig([without_rows(pose) for pose in poses], CAMERA, PROJECTOR, projector_aspect=2.0)
    assert fit.rig.axes == ("u",)
    assert {"projector.fy_px", "projector.cy_px"} <= set(fit.rig.undetermined)
    assert "projector.fx_px" not in fit.rig.undetermined
    truth = np.array([[0.0, 0, 600], [30, -20, 570], [-25, 25, 630]])
    lit = rig.project(truth) * [1.0, np.nan]
    found = rig_points(fit.rig, rig.camera.project(truth), lit)
    assert np.all(np.abs(found.points_mm - truth) < 3.5 * found.u_mm)
    assert np.all(found.u_mm < 1.5)
    assert np.isnan(found.epipolar_px).all()


def test_the_prints_scale_is_one_error_of_all_lengths():
    """With exact points a length's relative u is the print's; no data tell it."""
    rig = drawn_rig()
    fit = fit_board_rig(
        drawn_poses(rig, np.random.default_rng(5)), CAMERA, PROJECTOR, board=BoardStatement(pitch_u_rel=2e-4)
    )
    truth = np.array([[-30.0, 0, 600], [30, 0, 600]])
    found = rig_points(fit.rig, rig.camera.project(truth), rig.project(truth))
    arm = (found.points_mm[1] - found.points_mm[0]) / 60
    gradient = np.concatenate([-arm, arm])
    u_length = np.sqrt(gradient @ found.joint_covariance(fit.rig) @ gradient)
    assert u_length / 60 == pytest.approx(2e-4, rel=1e-2)


def test_a_wrong_order_stands_across_the_epipolar_line():
    rig = drawn_rig()
    fit = fit_board_rig(drawn_poses(rig, np.random.default_rng(6), sigma_px=0.03), CAMERA, PROJECTOR)
    truth = np.array([[0.0, 0, 600], [20.0, 10, 610]])
    lit = rig.project(truth)
    lit[1, 1] += 36.0  # a fringe of the second axis
    found = rig_points(fit.rig, rig.camera.project(truth), lit, projector_u_px=0.05)
    ratio = np.abs(found.epipolar_px / found.epipolar_u_px)
    assert ratio[0] < 3.5
    assert ratio[1] > 50


def test_points_far_from_all_boards_are_outside():
    rig = drawn_rig()
    fit = fit_board_rig(drawn_poses(rig, np.random.default_rng(7), sigma_px=0.03), CAMERA, PROJECTOR)
    truth = np.array([[0.0, 0, 600], [0.0, 0, 2500]])
    found = rig_points(fit.rig, rig.camera.project(truth), rig.project(truth))
    assert outside_volume(fit.rig, found).tolist() == [False, True]


def test_opencv_agrees_where_it_solves_the_same():
    """Equal weights, flat board, no k3, lists found apart: cv2.stereoCalibrate's least squares."""
    poses = drawn_poses(drawn_rig(), np.random.default_rng(8), sigma_px=0.05)
    apart = [dataclasses.replace(pose, read_at_camera=False) for pose in poses]
    fit = fit_board_rig(apart, CAMERA, PROJECTOR, radial_terms=2, warp_degree=0, equal_weights=True)
    board = [p.board_mm.astype(np.float32) for p in poses]
    seen = [[getattr(p, f"{d}_px").astype(np.float32) for p in poses] for d in ("camera", "projector")]
    start = [cv2.calibrateCamera(board, s, size, None, None, flags=cv2.CALIB_FIX_K3) for s, size in
             zip(seen, (CAMERA, PROJECTOR), strict=True)]  # fmt: skip
    found = cv2.stereoCalibrate(
        board, *seen, start[0][1], start[0][2], start[1][1], start[1][2], CAMERA,
        flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12),
    )  # fmt: skip
    assert fit.stereo_rms_px <= found[0] * 1.002
    weighted = [abs(a - b) / e.u for a, b, e in (
        (fit.rig.camera["fx_px"], found[1][0, 0], fit.rig.estimate("camera.fx_px")),
        (fit.rig.projector["fy_px"], found[3][1, 1], fit.rig.estimate("projector.fy_px")),
        (fit.rig.shift_mm[0], found[6][0, 0], fit.rig.estimate("projector.shift_x_mm")),
    )]  # fmt: skip
    assert max(weighted) < 0.5


def test_mrcal_agrees_where_it_solves_the_same():
    """Equal weights, Brown's five terms, a flat board: mrcal's own least squares of two cameras from our answer."""
    mrcal = pytest.importorskip("mrcal")
    poses = [dataclasses.replace(p, read_at_camera=False) for p in
             drawn_poses(drawn_rig(), np.random.default_rng(11), sigma_px=0.05)]  # fmt: skip
    fit = fit_board_rig(poses, CAMERA, PROJECTOR, warp_degree=0, equal_weights=True)
    used = np.concatenate([pose.used for pose in fit.poses])
    seen = np.stack([np.stack([p.camera_px, p.projector_px]) for p in poses]).reshape(-1, 63, 2)
    weights = np.stack([[pose.used[:, :2].all(axis=1), pose.used[:, 2:].all(axis=1)] for pose in fit.poses])
    board = np.concatenate([seen, np.where(weights.reshape(-1, 63, 1), 1.0, -1.0)], axis=2).reshape(-1, 7, 9, 3)
    corner = [pose.rotation @ BOARD_CORNER + pose.shift_mm for pose in fit.poses]
    state = {
        "intrinsics": np.stack([fit.rig.camera.values, fit.rig.projector.values]),
        "rt_cam_ref": np.append(cv2.Rodrigues(fit.rig.rotation)[0].ravel(), fit.rig.shift_mm / 1e3)[None],
        "rt_ref_frame": np.stack([np.append(cv2.Rodrigues(p.rotation)[0].ravel(), c / 1e3)
                                  for p, c in zip(fit.poses, corner, strict=True)]),
    }  # fmt: skip
    found = mrcal.optimize(
        **state, points=None, observations_board=board,
        indices_frame_camintrinsics_camextrinsics=np.array([[k // 2, k % 2, k % 2 - 1] for k in range(20)], np.int32),
        observations_point=None, indices_point_camintrinsics_camextrinsics=None,
        imagersizes=np.array([CAMERA, PROJECTOR], np.int32), calibration_object_spacing=0.012,
        lensmodel="LENSMODEL_OPENCV5", calobject_warp=None, do_optimize_intrinsics_core=True,
        do_optimize_intrinsics_distortions=True, do_optimize_extrinsics=True, do_optimize_frames=True,
        do_optimize_calobject_warp=False, do_apply_outlier_rejection=False, do_apply_regularization=False,
    )  # fmt: skip
    rest = found["x"][: 2 * 63 * 20].reshape(-1, 63, 2)[weights.reshape(-1, 63)]
    assert used.mean() > 0.99
    assert fit.stereo_rms_px == pytest.approx(np.sqrt((rest**2).sum(axis=1).mean()), rel=1e-3)
    u = np.sqrt(np.diag(fit.rig.camera.covariance))
    # Of k1 to k3 mrcal expects nothing: along what the boards do not tell of them it goes further.
    assert np.all(np.abs(state["intrinsics"][0] - fit.rig.camera.values)[:4] < 0.1 * u[:4])


@pytest.mark.parametrize(("name", "rms_um", "published_mm"), [("real", 32.0, 25.467), ("sim", 14.0, 25.429)])
def test_the_ball(name, rms_um, published_mm):
    """The ball of DP-TPU by one coordinate: rms over the best 98 % of its pixels, and OpenCV's radius in the readme."""
    poses, data = real_poses(name)
    fit = fit_board_rig(poses, (640, 480), (912, 1140))
    row, column = np.nonzero(np.isfinite(data["ball_phase_rad"]))
    place = data["ball_phase_rad"][row, column] / (2 * np.pi * 96) * 912 - 1
    pixels = np.column_stack([column, row]).astype(float)
    points = rig_points(fit.rig, pixels, np.column_stack([place, np.full(len(place), np.nan)])).points_mm
    _, off = ball(points)
    best = np.argsort(np.abs(off))[: int(np.ceil(0.98 * len(off)))]
    radius, off = ball(points[best])
    assert 1e3 * np.sqrt(np.mean(off**2)) <= rms_um
    assert radius == pytest.approx(published_mm, abs=0.04)  # the authors' and OpenCV's solutions differ by as much


def test_real_poses_in_the_glare_are_told_and_count_less():
    """Two nearly square-on poses of the real rig have projector coordinates that ripple by 0.3 px."""
    poses, _ = real_poses("real")
    fit = fit_board_rig(poses, (640, 480), (912, 1140))
    scatter = [fault for fault in rig_faults(fit, projector_aspect=2.0) if fault.kind is RigFaultKind.POSE_SCATTERS]
    assert [fault.poses for fault in scatter] == [("0", "1")]
    assert min(pose.projector_s_px for pose in fit.poses[:2]) > 4 * fit.rig.projector_s_px
    clear = [np.vstack([p.camera_residual_px, p.projector_residual_px]) for p in fit.poses[2:]]
    assert np.sqrt((np.vstack(clear) ** 2).sum(axis=1).mean()) < 0.13


def test_real_poses_by_equal_weights_leave_less_than_opencv():
    """Its stereo rms of these points is 0.208 px."""
    apart = [dataclasses.replace(pose, read_at_camera=False) for pose in real_poses("real")[0]]
    fit = fit_board_rig(apart, (640, 480), (912, 1140), equal_weights=True)
    assert fit.stereo_rms_px < 0.20
    assert np.mean([pose.used.mean() for pose in fit.poses]) > 0.95


def test_too_few_poses_are_refused():
    poses = drawn_poses(drawn_rig(), np.random.default_rng(9), count=2)
    with pytest.raises(FitError, match="at least 3"):
        fit_board_rig(poses, CAMERA, PROJECTOR)


def test_poses_that_say_nothing_are_refused():
    """All alike but for noise, or points on one line."""
    rig, rng = drawn_rig(), np.random.default_rng(12)
    pose = drawn_poses(rig, rng, sigma_px=0.03, count=1)[0]
    with pytest.raises(FitError):
        fit_board_rig([pose] * 6, CAMERA, PROJECTOR)
    row = {name: getattr(pose, name)[:9] for name in ("board_mm", "camera_px", "projector_px")}
    with pytest.raises(FitError, match="one line"):
        fit_board_rig([dataclasses.replace(pose, **row)] * 6, CAMERA, PROJECTOR)


def test_a_mirrored_axis_is_refused():
    poses = drawn_poses(drawn_rig(), np.random.default_rng(13), sigma_px=0.03)
    mirrored = [dataclasses.replace(p, projector_px=p.projector_px * [-1, 1] + [911, 0]) for p in poses]
    with pytest.raises(FitError, match="mirrored"):
        fit_board_rig(mirrored, CAMERA, PROJECTOR)
