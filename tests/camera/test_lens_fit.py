"""The full lens from board poses: a published calibration, known virtual lenses, and what is refused."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fringecal.camera import mrcal_wall
from fringecal.camera.lens import LENS_NAMES, Lens
from fringecal.camera.lens_fit import fit_lens
from fringecal.camera.lens_solve import BoardView
from fringecal.camera.lens_uncertainty import projection_difference_px, projection_uncertainty_px
from fringecal.detect.boards import find_chessboard
from fringecal.errors import FitError

DATA = Path(__file__).parents[1] / "data" / "opencv_chess_left"
SHAPE = (480, 640)
TRUTH = np.array([810.0, 812.0, 325.0, 236.0, -0.2, 0.08, 0.001, -0.0005, 0.0])
SOLVERS = [
    "opencv",
    pytest.param("mrcal", marks=pytest.mark.skipif(not mrcal_wall.available(), reason="mrcal is not installed")),
]


def lens(values=TRUTH):
    return Lens(values, np.zeros((9, 9)), SHAPE[1], SHAPE[0])


def seen(poses, *, noise_px=0.0, seed=0, values=TRUTH, bow_mm=0.0):
    """A 9 x 6 board of 25 mm, posed by (turn about x, about y, about z in deg, distance in mm)."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:6, :9]
    x, y = 25.0 * (column - 4.0), 25.0 * (row - 2.5)
    board = np.stack([x, y, bow_mm * (1 - (x / 100.0) ** 2)], axis=-1).reshape(-1, 3)
    views = []
    for k, (a, b, c, distance) in enumerate(poses):
        turned = Rotation.from_euler("xyz", (a, b, c), degrees=True).apply(board)
        shift = np.array([40.0 * np.cos(2.4 * k), 30.0 * np.sin(2.4 * k), distance])
        points = lens(values).project(turned + shift) + rng.normal(0, noise_px, (54, 2))
        views.append(BoardView(points.reshape(6, 9, 2), 25.0))
    return views


POSES = [
    (30, 0, 5, 420), (-30, 5, 0, 450), (0, 30, 10, 430), (5, -30, 0, 460), (25, 25, 90, 480),
    (-25, 20, 45, 440), (20, -25, 15, 430), (-20, -25, -60, 470), (10, 0, 0, 330), (0, 12, 30, 340),
]  # fmt: skip


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
def test_known_lens_comes_back(solver):
    fit = fit_lens(seen(POSES), SHAPE, solver=solver)
    # Board points go through single precision in OpenCV: 2e-5 px.
    assert projection_difference_px(fit.lens, lens()).max() < 2e-3


@pytest.mark.parametrize("solver", SOLVERS)
def test_covariance_is_the_scatter_of_repeated_pictures(solver):
    z = []
    for seed in range(25):
        fit = fit_lens(seen(POSES, noise_px=0.1, seed=seed), SHAPE, solver=solver)
        u = np.sqrt(np.diag(fit.lens.covariance))[:8] / fit.inflation
        z.append((fit.lens.values - TRUTH)[:8] / u)
    # sd of 25 x 8 correlated values around 1.
    assert 0.75 < np.std(z) < 1.25
    np.testing.assert_array_less(np.abs(np.mean(z, axis=0)), 3.5 / np.sqrt(25))


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_bow_of_the_board_is_found(solver):
    fit = fit_lens(seen(POSES, noise_px=0.03, bow_mm=0.5), SHAPE, solver=solver)
    # z of the board's rows: 0.5 mm in the middle, none at the ends, away from the camera as its rows run down.
    assert fit.board_warp_mm[0] == pytest.approx(0.5, rel=0.05)
    assert fit.board_warp_mm[1] == pytest.approx(0.0, abs=0.05)
    assert projection_difference_px(fit.lens, lens()).mean() < 0.1


def test_halves_that_disagree_enlarge_the_uncertainty():
    flat = fit_lens(seen(POSES, noise_px=0.05), SHAPE, solver="opencv", flat_board=True)
    bent = fit_lens(seen(POSES, noise_px=0.05, bow_mm=2.0), SHAPE, solver="opencv", flat_board=True)
    assert flat.inflation < 1.6  # chance alone
    assert bent.uncertainty_px.mean() > 2 * flat.uncertainty_px.mean()


def test_wrong_corners_are_left_out():
    views = seen(POSES, noise_px=0.05)
    for view in views[::3]:
        view.points_px[2, 3] += 4.0
    fit = fit_lens(views, SHAPE, solver="opencv")
    assert fit.outliers == len(views[::3])
    assert projection_difference_px(fit.lens, lens()).mean() < 5 * fit.uncertainty_px.mean()


def test_hidden_points_are_allowed():
    views = seen(POSES)
    for k, view in enumerate(views):
        view.points_px[k % 6, : k % 7] = np.nan
    assert projection_difference_px(fit_lens(views, SHAPE).lens, lens()).max() < 2e-3


def test_uncertainty_is_least_where_the_points_are():
    fit = fit_lens(seen(POSES, noise_px=0.1), SHAPE, solver="opencv")
    middle, corner = projection_uncertainty_px(fit.lens, np.array([[320.0, 240.0], [0.0, 0.0]]))
    assert middle < corner


def test_unproject_inverts_project():
    pixels = np.random.default_rng(1).uniform(0, 480, (60, 2))
    np.testing.assert_allclose(lens().project(lens().unproject(pixels)), pixels, atol=1e-8)


def test_lens_projects_as_opencv_does():
    rays = np.random.default_rng(2).uniform(-0.3, 0.3, (50, 3)) + [0, 0, 1]
    matrix = np.array([[TRUTH[0], 0, TRUTH[2]], [0, TRUTH[1], TRUTH[3]], [0, 0, 1]])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, TRUTH[4:])
    np.testing.assert_allclose(lens().project(rays), expected.reshape(-1, 2), atol=1e-9)


def test_one_square_on_view_never_yields_a_focal_length():
    with pytest.raises(FitError, match="square-on"):
        fit_lens(seen([(0, 0, 0, 500)]), SHAPE)


@pytest.mark.parametrize("noise_px", [0.0, 0.1])
@pytest.mark.parametrize("solver", SOLVERS)
def test_square_on_views_are_refused_however_small_their_residuals(solver, noise_px):
    poses = [(0, 0, angle, 500) for angle in range(0, 80, 10)]
    with pytest.raises(FitError, match="do not determine the focal length"):
        fit_lens(seen(poses, noise_px=noise_px, seed=4), SHAPE, solver=solver)


def test_boards_of_two_spacings_and_other_nonsense_are_refused():
    views = seen(POSES)
    with pytest.raises(FitError, match="different spacings"):
        fit_lens([*views, BoardView(views[0].points_px, 30.0)], SHAPE)
    with pytest.raises(FitError, match="points of the board"):
        fit_lens([*views, BoardView(np.full((6, 9, 2), np.nan), 25.0)], SHAPE)
    with pytest.raises(FitError, match="radial terms"):
        fit_lens(views, SHAPE, radial_terms=5)


def test_names_and_estimates():
    fit = fit_lens(seen(POSES, noise_px=0.1), SHAPE, solver="opencv")
    assert [fit.lens.estimate(name).label for name in LENS_NAMES] == list(LENS_NAMES)
    assert fit.lens.estimate("k3").u == 0.0
