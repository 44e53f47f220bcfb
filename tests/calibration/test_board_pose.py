"""One pose of a board with fringes: coordinates at its corners against the truth, and what leaves it aside."""

import re

import cv2
import numpy as np
import pytest

from fringecal.calibration import RasterMap, posed_board
from fringecal.detect import refined_corners
from fringecal.simulate import flat_pose, load_raster_rig, raster_truth, render_raster, scene_of
from fringecal.targets import parse_target

NOISE_PX = 0.05
TARGET = {
    "format": 1, "kind": "chessboard", "name": "board", "certificate": "virtual", "columns": 7, "rows": 5,
    "square_mm": {"value": 22.0, "u": 0.002},
}  # fmt: skip


@pytest.fixture(scope="module")
def shot():
    """A tilted board, its true coordinates with noise that goes with one over brightness, and its corners' truth."""
    rig = load_raster_rig("dlp-small").at(
        camera={"width_px": 320, "height_px": 240, "focal_px": 640.0, "principal_offset_px": (0.0, 0.0)},
        fringes={"fringes": (8.0,), "axes": ("u",)},
    )
    target = parse_target(TARGET)
    capture = rig.capture_named("pose-02").model_copy(update={"sheet_mm": (200.0, 150.0), "position_mm": (0, 0, 560)})
    frames = render_raster(rig, capture, scene_of(target), seed=3)
    white = frames.frames[-2]
    u = NOISE_PX * 200 / np.maximum(white.astype(float), 2)
    rng = np.random.default_rng(11)
    px = frames.projector_px + u * rng.standard_normal((2, *white.shape))
    return rig, target, white, RasterMap(px, np.stack([u, u])), frames, capture


def true_corners(rig, target, capture):
    """Corners in picture and projector by OpenCV, whatever way the board is numbered: (n, 2) each."""
    rotation, shift = flat_pose(capture)
    square = target.square_mm.value
    x = (np.arange(target.columns) - (target.columns - 1) / 2) * square
    y = -(np.arange(target.rows) - (target.rows - 1) / 2) * square
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, np.zeros(len(grid))]) @ rotation.T + shift
    truth = raster_truth(rig)
    return seen(points, truth["camera"]), seen(points @ np.transpose(truth["rotation"]) + truth["shift_mm"],
                                               truth["projector"])  # fmt: skip


def seen(points, lens):
    fx, fy, cx, cy, *terms = lens
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(terms))[0].reshape(-1, 2)


def in_order(found, truth):
    """Match each found point with the true one nearest to it."""
    return np.argmin(np.linalg.norm(found[:, None] - truth[None], axis=2), axis=1)


def test_coordinates_at_corners_are_the_projectors(shot) -> None:
    rig, target, white, raster, _, capture = shot
    found = posed_board("pose", white, target, raster)
    assert (found.corners, found.lit, found.handed, found.reason) == (35, 35, 1, "")
    camera, projector = true_corners(rig, target, capture)
    match = in_order(found.pose.camera_px, camera)
    assert len(set(match.tolist())) == 35
    corner_error = found.pose.camera_px - camera[match]
    assert np.abs(corner_error).max() < 0.15
    # What the projector lights at the corner that was found: the true coordinate moved by the corner's own error.
    slope = np.linalg.lstsq(
        np.column_stack([camera - camera.mean(axis=0), np.ones(len(camera))]), projector, rcond=None
    )[0][:2]
    error = found.pose.projector_px - projector[match] - corner_error @ slope
    # 100 and more light pixels of 0.05 px each about a corner; a surface's value at its middle has twice their u.
    assert np.sqrt((error**2).mean()) < 0.02
    assert np.abs(error).max() < 0.08


def test_coordinates_scatter_by_their_own_u(shot) -> None:
    rig, target, white, raster, _, capture = shot
    rng = np.random.default_rng(21)
    camera, projector = true_corners(rig, target, capture)
    ratios = []
    for _ in range(4):
        noisy = RasterMap(raster.px + raster.u_px * rng.standard_normal(raster.px.shape), np.sqrt(2) * raster.u_px)
        pose = posed_board("pose", white, target, noisy).pose
        clean = posed_board("pose", white, target, raster).pose
        # The same corners, and half of the variance is drawn anew.
        ratios.append((pose.projector_px - clean.projector_px) / (pose.projector_u_px / np.sqrt(2)))
    # 4 x 70 ratios: their rms is 1 within 4 standard errors, 0.17. Weights by robust residuals cost 5 % of efficiency,
    # and change from draw to draw.
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1, abs=0.3)


def test_corners_are_placed_by_gradients_where_light_falls_off(shot) -> None:
    rig, target, white, _, _, capture = shot
    ramp = np.clip(white * np.linspace(1.0, 0.45, white.shape[1]), 0, 255)
    camera, _ = true_corners(rig, target, capture)
    start = camera.reshape(target.rows, target.columns, 2) + 0.3
    found = refined_corners(ramp, start).reshape(-1, 2)
    assert np.abs(found - camera).mean() < 0.05
    hidden = start.copy()
    hidden[0, 0] = np.nan
    assert np.isnan(refined_corners(ramp, hidden)[0, 0]).all()


def test_glare_and_wrong_orders_at_some_pixels_do_not_move_coordinates(shot) -> None:
    rig, target, white, raster, _, capture = shot
    rng = np.random.default_rng(5)
    px = raster.px.copy()
    px[:, rng.random(white.shape) < 0.1] = np.nan  # glare
    px[:, rng.random(white.shape) < 0.05] += 80.0  # a fringe too many
    found = posed_board("pose", white, target, RasterMap(px, raster.u_px))
    clean = posed_board("pose", white, target, raster)
    assert found.lit >= 33
    both = np.isfinite(found.pose.projector_px).all(axis=1)
    assert np.abs(found.pose.projector_px - clean.pose.projector_px)[both].max() < 0.1


def test_a_board_that_is_partly_lit_says_how_much(shot) -> None:
    _, target, white, raster, _, _ = shot
    px = raster.px.copy()
    px[:, :, :250] = np.nan
    found = posed_board("pose", white, target, RasterMap(px, raster.u_px))
    assert found.pose is None
    assert f"known at {found.lit} of 35 corners" in found.reason
    unlit = np.isnan(px[0])
    told = posed_board("pose", white, target, RasterMap(px, raster.u_px, ~unlit, np.zeros_like(unlit)))
    dark = 35 - told.lit
    # The light ends within one column of corners: those beside it are at its edge.
    assert re.search(
        rf"({dark}|{dark - 5}|{dark - 4}|{dark - 3}|{dark - 2}|{dark - 1}) not lit by the projector", told.reason
    )
    full = posed_board("pose", white, target, RasterMap(px, raster.u_px, np.ones_like(unlit), unlit))
    assert "saturated" in full.reason
    px = raster.px.copy()
    px[:, :, :150] = np.nan
    half = posed_board("pose", white, target, RasterMap(px, raster.u_px))
    assert half.pose is not None
    # A corner whose surroundings are dark on one side is not continued to.
    unlit = half.pose.camera_px[:, 0] < 140
    assert np.isnan(half.pose.projector_px[unlit]).all()


def test_no_board_and_mirrored_coordinates_are_told(shot) -> None:
    _, target, white, raster, _, _ = shot
    noise = np.random.default_rng(2).normal(100, 2, white.shape).astype(np.uint8)
    blank = posed_board("pose", noise, target, raster)
    assert blank.pose is None
    assert blank.reason.startswith("no board: ")
    mirrored = RasterMap(raster.px * np.array([-1.0, 1.0])[:, None, None] + 640, raster.u_px)
    assert posed_board("pose", white, target, mirrored).handed == -1
