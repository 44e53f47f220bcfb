"""The projection's uncertainty over the field: against repeated fits, against mrcal's own, and where it ends."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fringecal.camera.lens import mrcal_wall
from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.lens.lens_fit import fit_lens
from fringecal.camera.lens.lens_solve import Way, solve_lens
from fringecal.camera.lens.lens_uncertainty import projection_uncertainty_px
from fringecal.errors import FitError

PLACES = np.array([[320.0, 240.0], [100.0, 240.0], [320.0, 60.0], [560.0, 420.0], [40.0, 40.0]])
NOISE_PX = 0.1


def moved(vector, points):
    return Rotation.from_rotvec(vector[:3]).apply(points) + vector[3:]


def error_px(found, truth, anchor, distance_mm):
    """Error of a lens at PLACES, after the move of the camera that fits the boards' points best."""
    seen = truth.project(anchor)
    best = least_squares(
        lambda x: (found.project(moved(x, anchor)) - seen).ravel(), np.zeros(6), x_scale=[1e-3] * 3 + [1.0] * 3
    )
    rays = truth.unproject(PLACES)
    points = rays * (distance_mm / np.linalg.norm(rays, axis=1, keepdims=True))
    return found.project(moved(best.x, points)) - PLACES


@pytest.fixture(scope="module")
def fitted(boards):
    """Repeated pictures of the same poses: lenses, and the points of one of them in the camera's frame."""
    way = Way(use_mrcal=False, model="brown", radial_terms=2, flat_board=False)
    solved = [solve_lens(boards.seen(noise_px=NOISE_PX, seed=seed), boards.shape, way) for seed in range(60)]
    anchor = np.concatenate([view.points_mm for view in solved[0].views])
    return [each.lens for each in solved], anchor[::7]


@pytest.mark.parametrize("distance_mm", [430.0, 1500.0])
def test_stated_uncertainty_is_the_scatter_of_repeated_pictures(boards, fitted, distance_mm):
    lenses, anchor = fitted
    errors = np.array([error_px(found, boards.lens, anchor, distance_mm) for found in lenses])
    worst = [np.sqrt(np.linalg.eigvalsh(each.T @ each / len(each))[-1]) for each in errors.transpose(1, 0, 2)]
    stated = [projection_uncertainty_px(found, PLACES, anchor_mm=anchor, distance_mm=distance_mm) for found in lenses]
    # A standard deviation from 60 draws has 9 %; of ten such figures one is 2.5 times as far off.
    np.testing.assert_array_less(np.abs(np.log(worst / np.median(stated, axis=0))), 0.35)


@pytest.mark.skipif(not mrcal_wall.available(), reason="mrcal is not installed")
@pytest.mark.parametrize("distance_mm", [430.0, 1500.0])
def test_stated_uncertainty_is_that_of_mrcal(boards, distance_mm):
    import mrcal

    views = boards.seen(noise_px=NOISE_PX, seed=1)
    fit = fit_lens(views[:7], boards.shape, solver="mrcal")  # too few for halves: nothing enlarged
    start = (fit.lens.values[:8], np.array([pose_of(view) for view in fit.views]))
    inputs = mrcal_wall._inputs([view.points_px for view in views[:7]], 25.0, *start, boards.shape)
    inputs |= mrcal_wall._choices("LENSMODEL_OPENCV4", warped=True)
    mrcal.optimize(**inputs)
    model = mrcal.cameramodel(optimization_inputs=inputs, icam_intrinsics=0)
    rays = mrcal.unproject(PLACES, *model.intrinsics(), normalize=True) * distance_mm / 1000.0
    theirs = mrcal.projection_uncertainty(rays, model, method="cross-reprojection-rrp-Jfp", what="worstdirection-stdev")
    ours = fit.uncertainty_at_px(distance_mm, PLACES)
    # mrcal also counts the noise of the points that tie the frames together. It is seen far behind the boards in
    # the middle of the picture, where nothing else is, and is a few percent elsewhere.
    np.testing.assert_allclose(ours[1:], theirs[1:], rtol=0.15)
    assert 0.5 * theirs[0] < ours[0] < 1.05 * theirs[0]


def pose_of(view):
    """Turn and shift of a flat board from its points in the camera's frame: its first row and column."""
    first, along, down = (
        view.points_mm[0],
        view.points_mm[8] - view.points_mm[0],
        view.points_mm[45] - view.points_mm[0],
    )
    axes = np.stack([along / np.linalg.norm(along), down / np.linalg.norm(down)])
    turn = Rotation.align_vectors(axes / np.linalg.norm(axes, axis=1, keepdims=True), np.eye(3)[:2])[0]
    return np.concatenate([turn.as_rotvec(), first])


def test_it_grows_with_the_covariance_and_away_from_the_points(boards):
    fit = fit_lens(boards.seen(noise_px=NOISE_PX), boards.shape, solver="opencv")
    larger = replace(fit, lens=replace(fit.lens, covariance=4 * fit.lens.covariance))
    np.testing.assert_allclose(larger.uncertainty_at_px(430.0), 2 * fit.uncertainty_at_px(430.0), rtol=1e-9)
    middle, corner = fit.uncertainty_at_px(430.0, PLACES[[0, 4]])
    assert corner > 3 * middle
    # Where the boards stood is where the lens is known best.
    assert np.median(fit.uncertainty_at_px(430.0)) < np.median(fit.uncertainty_at_px(4300.0))


def test_far_away_is_the_limit_of_large_distances(boards):
    fit = fit_lens(boards.seen(noise_px=NOISE_PX), boards.shape, solver="opencv")
    # A shift of the camera by 1 mm is 1e-8 of this distance.
    np.testing.assert_allclose(fit.uncertainty_at_px(1e8), fit.uncertainty_at_px(np.inf), rtol=1e-4)


@pytest.mark.parametrize("distance_mm", [0.0, -1.0, np.nan])
def test_a_distance_behind_the_camera_is_refused(boards, distance_mm):
    fit = fit_lens(boards.seen(noise_px=NOISE_PX), boards.shape, solver="opencv")
    with pytest.raises(FitError, match="must be positive"):
        fit.uncertainty_at_px(distance_mm)
    with pytest.raises(FitError, match="needs the board"):
        projection_uncertainty_px(fit.lens, distance_mm=500.0)


def test_places_that_no_ray_reaches_are_left_open():
    # r (1 - 0.5 r^2) has its maximum 0.544 at r = 0.816: pixels farther out than 218 px see nothing.
    folded = Lens(np.array([400.0, 400, 320, 240, -0.5, 0, 0, 0, 0]), np.diag([1.0] * 4 + [0] * 5), 641, 481)
    rays = folded.unproject(np.array([[320.0 + 200, 240.0], [320.0 + 230, 240.0]]))
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1, :2]).all()
    u = projection_uncertainty_px(folded)
    assert np.isnan(u[0])
    assert np.isfinite(u).mean() > 0.3
