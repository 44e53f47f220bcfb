"""The full lens from board poses: a published calibration, known virtual lenses, and what is refused."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from fringecal.camera.lens import mrcal_wall
from fringecal.camera.lens.brown_lens import LENS_NAMES
from fringecal.camera.lens.lens_fit import fit_lens
from fringecal.camera.lens.lens_solve import BoardView, Way, solve_lens
from fringecal.camera.lens.lens_uncertainty import projection_difference_px, projection_uncertainty_px
from fringecal.detect.boards import find_chessboard
from fringecal.errors import FitError

DATA = Path(__file__).parents[1] / "data" / "opencv_chess_left"
SHAPE = (480, 640)
SOLVERS = [
    "opencv",
    pytest.param("mrcal", marks=pytest.mark.skipif(not mrcal_wall.available(), reason="mrcal is not installed")),
]


@pytest.fixture(scope="module")
def hand_held():
    pictures = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(DATA.glob("*.jpg"))]
    return [BoardView(find_chessboard(picture, 9, 6), 25.0) for picture in pictures]


@pytest.mark.parametrize("solver", SOLVERS)
def test_hand_held_chessboard(solver, hand_held):
    assert len(hand_held) == 13
    fit = fit_lens(hand_held, SHAPE, solver=solver, flat_board=True)
    # The data's README: f 532.4 px, k1 -0.307 and rms 0.244 px of a flat board with all points; wrong corners
    # are left out here.
    assert fit.lens["fx_px"] == pytest.approx(532.4, abs=4 * fit.lens.estimate("fx_px").u)
    assert fit.lens["k1"] == pytest.approx(-0.307, abs=4 * fit.lens.estimate("k1").u)
    assert 0.1 < fit.rms_px < 0.25
    assert fit.points + fit.outliers == 13 * 54


@pytest.mark.skipif(not mrcal_wall.available(), reason="mrcal is not installed")
@pytest.mark.parametrize("flat_board", [True, False])
def test_mrcal_and_opencv_agree_within_their_uncertainty(hand_held, flat_board):
    first = fit_lens(hand_held, SHAPE, solver="opencv", flat_board=flat_board)
    second = fit_lens(hand_held, SHAPE, solver="mrcal", flat_board=flat_board)
    both = np.hypot(first.uncertainty_px, second.uncertainty_px)
    # Different corners are left out as wrong; otherwise it is one problem solved by two programs.
    assert np.all(projection_difference_px(first.lens, second.lens) < 2 * both)
    for name in ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2"):
        a, b = first.lens.estimate(name), second.lens.estimate(name)
        assert abs(a.value - b.value) < 2 * np.hypot(a.u, b.u), name
    if not flat_board:
        # 0.18 mm by mrcal on these pictures; the sign says to which side.
        np.testing.assert_allclose(first.board_warp_mm, second.board_warp_mm, atol=0.05)
        assert np.abs(first.board_warp_mm).max() == pytest.approx(0.18, abs=0.05)


@pytest.mark.parametrize("solver", SOLVERS)
def test_known_lens_comes_back(solver, boards):
    fit = fit_lens(boards.seen(), SHAPE, solver=solver)
    # Board points go through single precision in OpenCV: 2e-5 px.
    assert projection_difference_px(fit.lens, boards.lens).max() < 2e-3


@pytest.mark.parametrize("solver", SOLVERS)
def test_covariance_is_the_scatter_of_repeated_pictures(solver, boards):
    z = []
    way = Way(solver == "mrcal", "brown", radial_terms=2, flat_board=False)
    for seed in range(25):
        found = solve_lens(boards.seen(noise_px=0.1, seed=seed), SHAPE, way).lens
        z.append((found.values - boards.lens.values)[:8] / np.sqrt(np.diag(found.covariance))[:8])
    # sd of 25 x 8 correlated values around 1.
    assert 0.75 < np.std(z) < 1.25
    np.testing.assert_array_less(np.abs(np.mean(z, axis=0)), 3.5 / np.sqrt(25))


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_bow_of_the_board_is_found(solver, boards):
    fit = fit_lens(boards.seen(noise_px=0.03, bow_mm=0.5), SHAPE, solver=solver)
    # z of the board's rows: 0.5 mm in the middle, none at the ends, away from the camera as its rows run down.
    assert fit.board_warp_mm[0] == pytest.approx(0.5, rel=0.05)
    assert fit.board_warp_mm[1] == pytest.approx(0.0, abs=0.05)
    assert projection_difference_px(fit.lens, boards.lens).mean() < 0.1


def test_halves_that_disagree_enlarge_the_uncertainty(boards):
    flat = fit_lens(boards.seen(noise_px=0.05), SHAPE, solver="opencv", flat_board=True)
    bent = fit_lens(boards.seen(noise_px=0.05, bow_mm=2.0), SHAPE, solver="opencv", flat_board=True)
    assert flat.inflation < 1.6  # chance alone
    assert bent.uncertainty_px.mean() > 2 * flat.uncertainty_px.mean()


def test_wrong_corners_are_left_out(boards):
    views = boards.seen(noise_px=0.05)
    for view in views[::3]:
        view.points_px[2, 3] += 4.0
    fit = fit_lens(views, SHAPE, solver="opencv")
    assert fit.outliers == len(views[::3])
    assert projection_difference_px(fit.lens, boards.lens).mean() < 5 * fit.uncertainty_px.mean()


def test_hidden_points_are_allowed(boards):
    views = boards.seen()
    for k, view in enumerate(views):
        view.points_px[k % 6, : k % 7] = np.nan
    assert projection_difference_px(fit_lens(views, SHAPE).lens, boards.lens).max() < 2e-3


def test_uncertainty_is_least_where_the_points_are(boards):
    fit = fit_lens(boards.seen(noise_px=0.1), SHAPE, solver="opencv")
    middle, corner = projection_uncertainty_px(fit.lens, np.array([[320.0, 240.0], [0.0, 0.0]]))
    assert middle < corner


def test_unproject_inverts_project(boards):
    pixels = np.random.default_rng(1).uniform(0, 480, (60, 2))
    np.testing.assert_allclose(boards.lens.project(boards.lens.unproject(pixels)), pixels, atol=1e-8)


def test_lens_projects_as_opencv_does(boards):
    rays = np.random.default_rng(2).uniform(-0.3, 0.3, (50, 3)) + [0, 0, 1]
    fx, fy, cx, cy, *bent = boards.truth
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(bent))
    np.testing.assert_allclose(boards.lens.project(rays), expected.reshape(-1, 2), atol=1e-9)


def test_one_square_on_view_never_yields_a_focal_length(boards):
    with pytest.raises(FitError, match="square-on"):
        fit_lens(boards.seen([(0, 0, 0, 500)]), SHAPE)


SQUARE_ON = {
    "turned in their plane": [(0, 0, angle, 500) for angle in range(0, 80, 10)],
    "three distances": [(0, 0, 0, 400), (0, 0, 0, 500), (0, 0, 0, 600)],
}


@pytest.mark.parametrize("noise_px", [0.0, 0.1])
@pytest.mark.parametrize("poses", SQUARE_ON.values(), ids=SQUARE_ON)
@pytest.mark.parametrize("solver", SOLVERS)
def test_square_on_views_are_refused_however_small_their_residuals(solver, poses, noise_px, boards):
    with pytest.raises(FitError, match="do not determine the focal length"):
        fit_lens(boards.seen(poses, noise_px=noise_px, seed=4), SHAPE, solver=solver)


def test_square_on_points_fit_a_lens_ten_times_as_long_as_well(boards):
    """Why the refusal asks the conditioning: these residuals say nothing."""
    view = boards.seen([(0, 0, 0, 500)])[0].points_px
    far = replace(boards, truth=(8100.0, 8120.0, *boards.truth[2:4], -20.0, 800.0, 0.01, -0.005, 0.0), spread_mm=40.0)
    assert np.abs(far.seen([(0, 0, 0, 5000)])[0].points_px - view).max() < 1e-9


@pytest.mark.parametrize(
    "poses",
    [
        [(25, 10, 0, 420), (25, 10, 0, 480), (25, 10, 0, 540)],
        [(0.5, -1, 0, 400), (-1, 0.5, 40, 500), (1, 1, 80, 450), (0, -1, 20, 480)],
    ],
    ids=["three parallel under one tilt", "one degree"],
)
@pytest.mark.parametrize("solver", SOLVERS)
def test_too_little_change_of_tilt_is_refused(solver, poses, boards):
    with pytest.raises(FitError, match="do not determine the focal length"):
        fit_lens(boards.seen(poses, noise_px=0.1, seed=4), SHAPE, solver=solver)


@pytest.mark.parametrize("strange", ["another board", "noise"])
def test_a_picture_that_disagrees_is_left_out_whole(strange, boards):
    views = boards.seen(noise_px=0.05)
    points, rng = views[4].points_px, np.random.default_rng(3)
    # Every second column moved, as no lens bends; or corners that are none.
    moved = {"another board": 6.0 * (np.arange(9) % 2)[None, :, None], "noise": rng.normal(0, 8, points.shape)}[strange]
    views[4] = BoardView(points + moved, 25.0)
    fit = fit_lens(views, SHAPE, solver="opencv")
    assert fit.dropped == (4,)
    assert len(fit.views) == 9
    assert projection_difference_px(fit.lens, boards.lens).mean() < 5 * fit.uncertainty_px.mean()


def test_three_pictures_of_three_boards_are_refused(boards):
    rng = np.random.default_rng(7)
    views = [BoardView(view.points_px + rng.normal(0, 30, (6, 9, 2)), 25.0) for view in boards.seen()]
    with pytest.raises(FitError):
        fit_lens(views, SHAPE, solver="opencv")


@pytest.fixture
def without_mrcal(monkeypatch):
    """An installation without mrcal, as far as an import can tell."""
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == "mrcal" else find(name, *more))
    monkeypatch.setitem(sys.modules, "mrcal", None)


def test_without_mrcal_all_but_its_own_models_is_there(without_mrcal, boards):
    fit = fit_lens(boards.seen(noise_px=0.03, bow_mm=0.5), SHAPE)
    assert fit.solver == "opencv"
    assert fit.board_warp_mm[0] == pytest.approx(0.5, rel=0.05)
    assert np.isfinite(fit.uncertainty_at_px(500.0)).all()
    with pytest.raises(FitError, match=r"install fringecal\[mrcal\]"):
        fit_lens(boards.seen(), SHAPE, solver="mrcal")
    for model in ("opencv8", "splined"):
        with pytest.raises(FitError, match=r"install fringecal\[mrcal\]"):
            fit_lens(boards.seen(), SHAPE, model=model)


def test_boards_of_two_spacings_and_other_nonsense_are_refused(boards):
    views = boards.seen()
    with pytest.raises(FitError, match="different spacings"):
        fit_lens([*views, BoardView(views[0].points_px, 30.0)], SHAPE)
    with pytest.raises(FitError, match="points of the board"):
        fit_lens([*views, BoardView(np.full((6, 9, 2), np.nan), 25.0)], SHAPE)
    with pytest.raises(FitError, match="radial terms"):
        fit_lens(views, SHAPE, radial_terms=5)


def test_names_and_estimates(boards):
    fit = fit_lens(boards.seen(noise_px=0.1), SHAPE, solver="opencv")
    assert [fit.lens.estimate(name).label for name in LENS_NAMES] == list(LENS_NAMES)
    assert fit.lens.estimate("k3").u == 0.0
