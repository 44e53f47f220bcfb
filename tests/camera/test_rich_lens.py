"""Lenses with more terms than Brown's: known ones come back, Brown's follows them, and what is refused."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from fringecal.camera.lens import mrcal_wall
from fringecal.camera.lens.lens_fit import fit_lens
from fringecal.camera.lens.lens_uncertainty import projection_difference_px
from fringecal.camera.lens.rich_lens import RATIONAL, RichLens, brown_of, coverage, demand_for_splines
from fringecal.errors import FitError

NEEDS_MRCAL = pytest.mark.skipif(not mrcal_wall.available(), reason="mrcal is not installed")
RATIONAL_TERMS = np.array([0.4, 0.15, 0.001, -0.0005, 0.02, 0.7, 0.25, 0.03])
CORE = np.array([[600.0, 0, 325.0], [0, 602.0, 236.0], [0, 0, 1]])


def rational(points):
    """OpenCV's rational model, written by OpenCV."""
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), CORE, RATIONAL_TERMS)[0].reshape(-1, 2)


@pytest.fixture(scope="module")
def wide(boards):
    """Poses that also fill the corners."""
    more = [(a, b, c, 0.55 * d) for a, b, c, d in boards.poses]
    far = [(-b, a, c + 40, 0.65 * d) for a, b, c, d in boards.poses]
    return replace(boards, poses=(*more, *far), spread_mm=60.0)


def rays_of(fit):
    return np.concatenate([view.points_mm for view in fit.views])


@NEEDS_MRCAL
def test_a_rational_lens_comes_back_and_brown_follows_it(wide):
    fit = fit_lens(wide.seen(noise_px=0.05, project=rational), wide.shape, model="opencv8")
    rays = rays_of(fit)
    apart = np.hypot(*(fit.rich.project(rays) - rational(rays)).T)
    assert fit.rms_px == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    # Mostly a turn of the camera, which is no error of the lens and not taken out here.
    assert np.median(apart) < 0.1
    assert fit.left_px.max() < 0.5
    off = np.hypot(*(fit.lens.project(rays) - rational(rays)).T)
    assert np.sqrt(np.mean(off**2)) < 3 * (np.sqrt(np.mean(fit.left_px**2)) + np.median(fit.uncertainty_px))


@NEEDS_MRCAL
def test_a_splined_lens_follows_what_brown_cannot(wide):
    def wavy(points):
        # A ripple of 1 px over the field: no lens of Brown's has it.
        pixels = rational(points)
        return pixels + np.stack([np.sin(pixels[:, 1] / 60.0), np.cos(pixels[:, 0] / 70.0)], axis=1)

    views = wide.seen(noise_px=0.05, project=wavy)
    plain = fit_lens(views, wide.shape, flat_board=True)
    splined = fit_lens(views, wide.shape, model="splined", flat_board=True)
    assert splined.rms_px < 0.5 * plain.rms_px
    # What Brown's lens leaves of it is said, and is part of the uncertainty.
    assert 0.3 < np.sqrt(np.mean(splined.left_px**2)) < 1.5
    assert splined.inflation > 3


@NEEDS_MRCAL
def test_a_splined_lens_that_is_brown_gives_brown_back(wide):
    fit = fit_lens(wide.seen(noise_px=0.05), wide.shape, model="splined", flat_board=True)
    apart = projection_difference_px(fit.lens, wide.lens)
    assert np.median(apart / fit.uncertainty_px) < 3
    assert np.sqrt(np.mean(fit.left_px**2)) < 0.1


def test_splines_are_refused_where_points_are_missing(wide):
    few = [view.points_px.reshape(-1, 2) for view in wide.seen(wide.poses[:5])]
    with pytest.raises(FitError, match=r"5 views, 10 are needed.*unknowns"):
        demand_for_splines(few, wide.lens)
    middle = [np.random.default_rng(k).uniform((250, 180), (390, 300), (200, 2)) for k in range(12)]
    with pytest.raises(FitError, match="of the picture"):
        demand_for_splines(middle, wide.lens)


@NEEDS_MRCAL
def test_splines_from_few_poses_are_refused_by_the_fit(boards):
    with pytest.raises(FitError, match="splined lens is not determined"):
        fit_lens(boards.seen(boards.poses[:6]), boards.shape, model="splined")


def test_brown_of_a_brown_lens_is_itself(boards):
    values = np.concatenate([boards.lens.values, np.zeros(3)])
    u = np.concatenate([[1.0, 1.0, 0.5, 0.5, 1e-3, 2e-3, 1e-4, 1e-4], np.zeros(4)])
    rich = RichLens(RATIONAL, values, np.diag(u**2), 640, 480)
    rays = boards.lens.unproject(boards.lens.pixels())
    found = brown_of(rich, rays, start=values[:9] * 1.01, radial_terms=2)
    np.testing.assert_allclose(found.lens.values, boards.lens.values, rtol=1e-6, atol=1e-9)
    assert found.left_px.max() < 1e-6
    # The turn that is free takes nothing from focal lengths and distortion, and nearly all from the centre.
    np.testing.assert_allclose(np.sqrt(np.diag(found.lens.covariance))[[0, 1, 4, 5]], u[[0, 1, 4, 5]], rtol=0.02)


def test_coverage_counts_cells():
    everywhere = np.stack(np.meshgrid(np.arange(0, 640, 20.0), np.arange(0, 480, 20.0)), -1).reshape(-1, 2)
    assert coverage(everywhere, (480, 640)) == 1.0
    assert coverage(everywhere[everywhere[:, 0] < 320], (480, 640)) == 0.5
