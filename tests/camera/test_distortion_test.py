"""The distortion test on crossings displaced by known lenses."""

import numpy as np
import pytest

from fringecal.camera.distortion.distortion_test import examine_distortion
from fringecal.camera.lens.radial_lens import RadialLens
from fringecal.detect.grid.grid_search import GridDetection, GridLine
from fringecal.detect.grid.line_profile import LineProfile
from fringecal.errors import FitError

SHAPE = (480, 640)
HALF_DIAGONAL = 400.0
MIDDLE = (319.5, 239.5)


def seen_grid(k1=0.0, *, focal_px=HALF_DIAGONAL, centre=MIDDLE, noise_px=0.02, seed=0, tilt=0.0):
    """A 17 x 23 grid seen by a Brown lens; its lines hold the crossings as points."""
    rng = np.random.default_rng(seed)
    row, column = (a.ravel() for a in np.mgrid[:17, :23])
    x, y = (column - 11) * 26.0 / focal_px, (row - 8) * 26.0 / focal_px
    w = 1 + tilt * x
    x, y = x / w + (MIDDLE[0] - centre[0]) / focal_px, y / w + (MIDDLE[1] - centre[1]) / focal_px
    factor = 1 + k1 * (x**2 + y**2)
    u = x * factor * focal_px + centre[0] + rng.normal(0, noise_px, x.size)
    v = y * factor * focal_px + centre[1] + rng.normal(0, noise_px, x.size)
    sigma = np.full(u.size, noise_px)
    lines = [
        GridLine(family, k, u[pick], v[pick], sigma[pick], np.zeros(pick.sum(), dtype=int))
        for family, index in (("horizontal", row), ("vertical", column))
        for k in range(index.max() + 1)
        for pick in [index == k]
    ]
    return GridDetection(row, column, u, v, sigma, tuple(lines), SHAPE, "dark", LineProfile(2.0, 0.5))


@pytest.mark.parametrize(("k1", "verdict"), [(-0.01, "barrel"), (0.01, "pincushion")])
def test_known_distortion_is_found_with_its_coefficient(k1, verdict):
    test = examine_distortion(seen_grid(k1), terms=1)
    assert test.verdict == verdict
    found = test.coefficients["k1"]
    assert abs(found.value - k1) < 4 * found.u
    radius = np.hypot(11, 8) * 26.0 / HALF_DIAGONAL
    assert test.max_px.value == pytest.approx(abs(k1) * radius**3 * HALF_DIAGONAL, rel=0.02)


def test_tilt_alone_is_no_distortion():
    verdicts = [examine_distortion(seen_grid(0.0, tilt=0.1, seed=seed)).verdict for seed in range(12)]
    assert verdicts.count("none") >= 10  # 5 % false alarms: more than 2 of 12 in 2 % of cases


def test_false_alarms_at_the_stated_level():
    p = [examine_distortion(seen_grid(seed=seed)).p_value for seed in range(50)]
    assert 0.35 < np.mean(p) < 0.65  # p is uniform without distortion; sd of the mean is 0.041
    assert np.mean(np.array(p) < 0.05) < 0.17  # 5 % expected, above 17 % in 0.1 % of cases


def test_distortion_at_the_detection_limit_is_found_mostly():
    limit = examine_distortion(seen_grid(), terms=1).detection_limit_px
    radius = np.hypot(11, 8) * 26.0 / HALF_DIAGONAL
    k1 = -limit / (radius**3 * HALF_DIAGONAL)
    found = [examine_distortion(seen_grid(k1, seed=s), terms=1).verdict == "barrel" for s in range(40)]
    assert np.mean(found) > 0.82  # 95 % by design; below 82 % in 0.2 % of cases


def test_free_centre_is_found():
    test = examine_distortion(seen_grid(-0.05, centre=(340.0, 225.0)), terms=1, centre="free")
    for name, true in (("cu", 340.0), ("cv", 225.0)):
        assert abs(test.coefficients[name].value - true) < 4 * test.coefficients[name].u


def test_stated_focal_length_gives_brown_k1():
    test = examine_distortion(seen_grid(-0.2, focal_px=1100.0, noise_px=0.01), terms=1)
    relative = test.coefficients["k1"].u / abs(test.coefficients["k1"].value)
    assert test.lens.brown_k1(1100.0) == pytest.approx(-0.2, rel=4 * relative)


def test_lines_are_straight_after_undistortion():
    test = examine_distortion(seen_grid(-0.05), terms=1)
    assert test.straightness_before["rms_px"].max() > 0.5
    # A straight line through 17 or 23 points with 0.02 px of noise.
    assert test.straightness_after["rms_px"].max() < 0.04


def test_outliers_do_not_make_distortion():
    grid = seen_grid(seed=2)
    grid.u_px[[3, 100, 222]] += 5.0
    assert examine_distortion(grid).verdict == "none"


def test_undistort_inverts_distort():
    lens = RadialLens((300.0, 250.0), 400.0, (-0.1, 0.02), (0.002, -0.001))
    points = np.random.default_rng(0).uniform(0, 480, (50, 2))
    np.testing.assert_allclose(lens.undistort(lens.distort(points)), points, atol=1e-8)


def test_too_few_crossings_and_too_many_terms_are_refused():
    grid = seen_grid()
    few = GridDetection(
        grid.row[:20],
        grid.column[:20],
        grid.u_px[:20],
        grid.v_px[:20],
        grid.sigma_px[:20],
        (),
        SHAPE,
        "dark",
        grid.profile,
    )
    with pytest.raises(FitError, match="20 crossings"):
        examine_distortion(few)
    with pytest.raises(FitError, match="radial terms"):
        examine_distortion(grid, terms=4)
