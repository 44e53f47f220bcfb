"""The least squares of a board rig beside OpenCV's and mrcal's, on the same points, in one process.

    python benchmarks/board_rig_speed.py [--poses 15] [--repeats 9]

Points are drawn (`board_rig_coverage.py`), with a flat error in both pictures. Compared are
- the solve alone, from one start, nothing left out and all points of one weight: mrcal's `optimize` with two cameras of
  its model OPENCV5 and a warp of two terms, and the package's least squares with a warp of three;
- from points to a calibrated rig: OpenCV's `calibrateCamera` of either device and `stereoCalibrate`, and
  `fit_board_rig`, which also looks for wrong corners and weighs the poses;
- what programs that map corner by corner do first: a homography around each corner (`findHomography`), beside which the
  package has nothing to do.
Times are this process's own (median), so that others on the machine do not count; rms as lengths over both pictures.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from board_rig_coverage import Drawn, capture, draw_board, draw_rig
from fringecal.projector import BoardPose, BoardStatement, fit_board_rig
from fringecal.projector.board_rig.board_fit import _started
from fringecal.projector.board_rig.board_form import board_form
from fringecal.projector.board_rig.board_problem import board_data, residuals
from fringecal.projector.board_rig.board_solve import minimise

NEIGHBOURS = 24  # pixels to either side of a corner, of which every fourth serves its homography


def median_ms(call: Callable[[], object], repeats: int) -> float:
    call()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return 1e3 * statistics.median(times)


def stereo_rms(rest: np.ndarray, seen: np.ndarray) -> float:
    lengths = [(rest[:, c] ** 2).sum(axis=1)[seen[:, c].all(axis=1)] for c in (slice(0, 2), slice(2, 4))]
    return float(np.sqrt(np.concatenate(lengths).mean()))


def by_mrcal(poses: list[BoardPose], state, rig: Drawn, columns: int) -> Callable[[], dict] | None:
    """A call of mrcal's solve from a start, or None where it is not installed."""
    try:
        import mrcal
    except ImportError:
        return None
    points, places = [], []
    for k, pose in enumerate(poses):
        for device, px in enumerate((pose.camera_px, pose.projector_px)):
            known = np.isfinite(px).all(axis=1)
            rows = np.column_stack([np.where(known[:, None], px, 0.0), np.where(known, 1.0, -1.0)])
            points.append(rows.reshape(-1, columns, 3))
            places.append([k, device, device - 1])

    def turned(rotation: np.ndarray, shift: np.ndarray) -> np.ndarray:
        return np.concatenate([cv2.Rodrigues(rotation)[0].ravel(), shift / 1e3])

    def solve() -> dict:
        return mrcal.optimize(
            intrinsics=np.stack([state.shared[:9], state.shared[9:18]]),
            rt_cam_ref=turned(state.rotation, state.shared[21:24])[None],
            rt_ref_frame=np.stack([turned(r, t) for r, t in zip(state.pose_rotations, state.pose_shifts, strict=True)]),
            points=None,
            observations_board=np.array(points),
            indices_frame_camintrinsics_camextrinsics=np.array(places, dtype=np.int32),
            observations_point=None,
            indices_point_camintrinsics_camextrinsics=None,
            imagersizes=np.array([rig.camera.size, rig.projector.size], dtype=np.int32),
            calibration_object_spacing=(poses[0].board_mm[1, 0] - poses[0].board_mm[0, 0]) / 1e3,
            lensmodel="LENSMODEL_OPENCV5",
            calobject_warp=np.zeros(2),
            do_optimize_intrinsics_core=True,
            do_optimize_intrinsics_distortions=True,
            do_optimize_extrinsics=True,
            do_optimize_frames=True,
            do_optimize_calobject_warp=True,
            do_apply_outlier_rejection=False,
            do_apply_regularization=False,
            verbose=False,
        )

    return solve


def by_opencv(poses: list[BoardPose], rig: Drawn) -> Callable[[], tuple]:
    known = [np.isfinite(p.camera_px).all(axis=1) for p in poses]
    board, seen, lit = (
        [getattr(p, name)[k].astype(np.float32) for p, k in zip(poses, known, strict=True)]
        for name in ("board_mm", "camera_px", "projector_px")
    )

    def solve() -> tuple:
        camera = cv2.calibrateCamera(board, seen, rig.camera.size, None, None)
        projector = cv2.calibrateCamera(board, lit, rig.projector.size, None, None)
        both = (camera[1], camera[2], projector[1], projector[2], rig.camera.size)
        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-9)
        return cv2.stereoCalibrate(board, seen, lit, *both, flags=cv2.CALIB_USE_INTRINSIC_GUESS, criteria=stop)

    return solve


def homographies(corners: int) -> Callable[[], None]:
    grid = np.arange(-NEIGHBOURS, NEIGHBOURS + 1, 4.0)
    around = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    lit = around @ np.array([[0.9, 0.1], [-0.1, 0.8]]) + 0.05 * np.random.default_rng(1).standard_normal(around.shape)

    def solve() -> None:
        for _ in range(corners):
            cv2.findHomography(around, lit)

    return solve


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=15)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--seed", type=int, default=9)
    options = parser.parse_args()
    rng = np.random.default_rng([2, options.seed])
    rig = replace(draw_rig(rng), axes=2, ripple_px=0.0)
    board = draw_board(rng, rig.field)
    poses = [replace(capture(rng, rig, board, k), read_at_camera=False) for k in range(options.poses)]
    corners = sum(len(pose.board_mm) for pose in poses)
    aspect = 2.0 if rig.projector.size == (912, 1140) else 1.0
    form = board_form(poses, BoardStatement())
    data = board_data(poses, form)
    state, expected = _started(poses, data, form, (rig.camera.size, rig.projector.size, aspect, 3))
    seen = np.hstack([data.in_camera, data.in_projector])
    print(f"{options.poses} poses, {corners} corners")
    own = median_ms(lambda: minimise(state, data, seen.astype(float), expected), options.repeats)
    solved, _ = minimise(state, data, seen.astype(float), expected)
    print(f"  least squares alone, fringecal  {own:7.1f} ms   rms {stereo_rms(residuals(solved, data), seen):.5f} px")
    solve = by_mrcal(poses, state, rig, len(np.unique(board.nominal[:, 0])))
    if solve is not None:
        other = median_ms(solve, options.repeats)
        rest = solve()["x"][: 2 * 2 * corners].reshape(len(poses), 2, -1, 2)
        rest = np.concatenate([rest[:, 0].reshape(-1, 2), rest[:, 1].reshape(-1, 2)], axis=1)
        rms = stereo_rms(rest, seen)
        print(f"  least squares alone, mrcal      {other:7.1f} ms   rms {rms:.5f} px   {other / own:.1f} x")
    whole = median_ms(
        lambda: fit_board_rig(poses, rig.camera.size, rig.projector.size, projector_aspect=aspect), options.repeats
    )
    fit = fit_board_rig(poses, rig.camera.size, rig.projector.size, projector_aspect=aspect, equal_weights=True)
    print(f"  points to rig, fringecal        {whole:7.1f} ms   rms {fit.stereo_rms_px:.5f} px (equal weights)")
    solve = by_opencv(poses, rig)
    other = median_ms(solve, options.repeats)
    print(f"  points to rig, OpenCV           {other:7.1f} ms   rms {solve()[0]:.5f} px   {other / whole:.1f} x")
    first = median_ms(homographies(corners), max(1, options.repeats // 3))
    print(f"  homographies, corner by corner  {first:7.1f} ms   with OpenCV's solve {(first + other) / whole:.1f} x")


if __name__ == "__main__":
    main()
