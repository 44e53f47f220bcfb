"""The grid detector on pictures whose every crossing is known in closed form."""

import cv2
import numpy as np
import pytest

from fringecal.detect.grid.grid_search import find_grid


def relative_scale_error(scene, grid):
    """Slope of position over true index against the true pitch, along both directions of the grid."""
    p, q = (np.round(values) for values in scene.to_plate(grid.u_px, grid.v_px))
    design = np.stack([np.ones_like(p), p, q], axis=1)
    (_, pu, qu), *_ = np.linalg.lstsq(design, grid.u_px, rcond=None)
    (_, pv, qv), *_ = np.linalg.lstsq(design, grid.v_px, rcond=None)
    return np.array([np.hypot(pu, pv), np.hypot(qu, qv)]) / scene.pitch_px - 1


def assert_no_slip(scene, grid):
    slips, _ = scene.index_errors(grid)
    assert np.ptp(slips, axis=1).tolist() == [0, 0]


SCENES = {
    "square-on": {},
    "turned-20": {"rotation_deg": 20},
    "turned-44": {"rotation_deg": 44},
    "turned-60": {"rotation_deg": 60},
    "fine": {"pitch_px": 7, "width_px": 1.6, "blur_px": 0.6, "rotation_deg": -30, "shape": (200, 240)},
    "wide-lines": {"pitch_px": 40, "width_px": 15, "blur_px": 1.5, "rotation_deg": 10},
    "hair-lines": {"pitch_px": 90, "width_px": 1, "blur_px": 0.7, "shape": (560, 640)},
    "part-of-picture": {"lines": (9, 7), "rotation_deg": 12},
    "light-lines": {"dark": 200, "light": 60, "rotation_deg": 7},
    "sharp-edges": {"blur_px": 0, "supersampling": 12, "rotation_deg": 3.3},
}


@pytest.mark.parametrize("name", SCENES)
def test_noise_free_scale_is_unbiased(name, virtual_grid):
    scene = virtual_grid(**SCENES[name])
    grid = find_grid(scene.picture())
    assert_no_slip(scene, grid)
    # The project's own limit for pictures without noise; a detector off by one pixel in N fails by 100x.
    assert np.abs(relative_scale_error(scene, grid)).max() < 5e-6


@pytest.mark.parametrize("name", SCENES)
def test_with_noise_every_crossing_is_within_its_uncertainty(name, virtual_grid):
    scene = virtual_grid(**SCENES[name])
    grid = find_grid(scene.picture(noise=2.0, seed=3, quantise=True))
    assert_no_slip(scene, grid)
    _, error = scene.index_errors(grid)
    z = error / grid.sigma_px[:, None]
    # sd of z is 1 within the sampling of >= 60 crossings and their correlation along lines; sharp edges
    # sway against the raster, which the scatter counts in full though it averages out.
    assert 0.2 < z.std() < 1.4
    assert np.abs(relative_scale_error(scene, grid)).max() < 2e-4


@pytest.mark.parametrize(("k1", "limit_px"), [(-0.3, 0.03), (0.25, 0.03)])
def test_strong_distortion_bends_lines_but_not_crossings(k1, limit_px, virtual_grid):
    scene = virtual_grid(k1=k1, focal_px=500.0, rotation_deg=5, shift_px=(5, 3))
    grid = find_grid(scene.picture())
    assert_no_slip(scene, grid)
    # 15 to 40 px of displacement at the corners; what is left is the bow within one patch.
    assert np.abs(scene.index_errors(grid)[1]).max() < limit_px


def test_points_lie_on_the_lines_between_crossings(virtual_grid):
    scene = virtual_grid(rotation_deg=12)
    for line in find_grid(scene.picture()).lines:
        p, q = scene.to_plate(line.u_px[line.good], line.v_px[line.good])
        across = q if line.family == "horizontal" else p
        # Noise-free: only rounding and the tails of the crossing lines are left.
        assert np.abs(across - np.round(across)).max() * scene.pitch_px < 2e-3
        assert np.all(np.diff(p if line.family == "horizontal" else q) > 0)


def test_counts_every_line_of_a_sheet_inside_the_picture(virtual_grid):
    grid = find_grid(virtual_grid(lines=(9, 7), rotation_deg=12).picture())
    assert (len(grid.family("vertical")), len(grid.family("horizontal"))) == (9, 7)
    assert len(grid.row) == 63


@pytest.mark.parametrize("seed", range(4))
def test_covered_parts_are_gaps_and_no_index_slips(seed, virtual_grid):
    rng = np.random.default_rng(seed)
    scene = virtual_grid(
        shape=(420, 520), rotation_deg=rng.uniform(-45, 45), tilt=tuple(rng.uniform(-0.05, 0.05, 2)), k1=-0.1
    )
    picture = scene.picture(noise=2.0, seed=seed)
    v, u = np.mgrid[:420, :520]
    picture *= 0.6 + 0.5 * u / 520
    for _ in range(4):
        cu, cv, radius = rng.uniform(60, 460), rng.uniform(60, 360), rng.uniform(15, 50)
        picture[np.hypot(u - cu, v - cv) < radius] = rng.uniform(20, 230)
    grid = find_grid(picture)
    assert_no_slip(scene, grid)
    assert len(grid.row) > 200


def test_same_result_from_8_bit_16_bit_and_float(virtual_grid):
    picture = virtual_grid(rotation_deg=3).picture(quantise=True)
    grids = [find_grid(picture), find_grid(picture.astype(np.uint16) * 257), find_grid(picture / 255.0)]
    for other in grids[1:]:
        np.testing.assert_allclose(other.u_px, grids[0].u_px, atol=1e-3)  # float32 sums


def test_stated_polarity_is_obeyed(virtual_grid):
    picture = virtual_grid(dark=200, light=60).picture()
    assert find_grid(picture, polarity="light").polarity == "light"


def test_blur_of_eight_pixels_is_an_honest_smaller_answer(virtual_grid):
    scene = virtual_grid(pitch_px=40, rotation_deg=5)
    picture = cv2.GaussianBlur(scene.picture(), (0, 0), 8) + np.random.default_rng(0).normal(0, 1, scene.shape)
    grid = find_grid(picture)
    assert_no_slip(scene, grid)
    error = scene.index_errors(grid)[1]
    assert grid.profile.blur_px > 4
    assert (error / grid.sigma_px[:, None]).std() < 2
    assert np.median(grid.sigma_px) > 0.01  # against 0.003 px in focus


def test_half_a_sheet_is_half_a_grid(virtual_grid):
    scene = virtual_grid(rotation_deg=8)
    picture = scene.picture(noise=2.0)
    picture[:, :240] = 90
    grid = find_grid(picture)
    assert_no_slip(scene, grid)
    assert 0.7 * (16 * 10) < len(grid.row) < 16 * 11
    # Crossings cut by the cover's edge may be off; the others must not be.
    assert np.median(np.abs(scene.index_errors(grid)[1])) < 0.02


@pytest.mark.parametrize(("fine_px", "spacing_px"), [(3, 30), (12, 12)])
def test_millimetre_paper_gives_the_finest_lines_that_are_seen(fine_px, spacing_px, virtual_grid):
    heavy = virtual_grid(pitch_px=10 * fine_px, width_px=4, rotation_deg=4)
    fine = virtual_grid(pitch_px=fine_px, width_px=1.2, rotation_deg=4)
    ink = 1 - (1 - heavy.coverage()) * (1 - 0.7 * fine.coverage())
    grid = find_grid(200 - 140 * ink + np.random.default_rng(0).normal(0, 1.5, ink.shape))
    assert_no_slip(heavy if spacing_px == 10 * fine_px else fine, grid)
