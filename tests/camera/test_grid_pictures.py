"""Lens and scale from whole pictures: real ones against another program, virtual ones against their truth."""

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest

from fringecal.camera.distortion.check_points import check_points, effect_of_neglect_px
from fringecal.camera.distortion.distortion_test import examine_distortion
from fringecal.camera.distortion.grid_scale import thesis_scale
from fringecal.camera.distortion.straightness import family_rms_px
from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.plate.grid_camera import camera_height, fit_grid_camera
from fringecal.detect.dots import find_dot_grid
from fringecal.detect.grid.grid_search import FAMILIES, find_grid
from fringecal.detect.grid.line_section import line_section
from fringecal.errors import DetectionError
from fringecal.uncertainty.estimates import Estimate
from fringecal.workflows.commission.checks import pitch_check

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data" / "discorpy_grids"


def read(name):
    return cv2.imread(str(DATA / name), cv2.IMREAD_GRAYSCALE)


@pytest.fixture(scope="module")
def dots():
    grid = find_dot_grid(read("dot_pattern_05.jpg"))
    return grid, examine_distortion(grid)


@pytest.fixture(scope="module")
def photograph():
    picture = read("GoPro8_line_grid_halfsize.jpg")
    grid = find_grid(picture)
    return picture, grid, examine_distortion(grid)


@pytest.fixture(scope="module")
def campaign():
    spec = importlib.util.spec_from_file_location("camera_campaign", ROOT / "benchmarks" / "camera_campaign.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_real_dots_lie_straight_with_the_lens_taken_out(dots):
    _, test = dots
    # discorpy: 0.51 / 0.33 px before, 0.14 / 0.11 px after: what is left is to be less.
    before = [family_rms_px(test.straightness_before, family) for family in FAMILIES]
    assert before == pytest.approx([0.51, 0.33], abs=0.03)
    assert max(family_rms_px(test.straightness_after, family) for family in FAMILIES) < 0.11
    assert test.verdict == "barrel"


def test_real_dots_are_indexed_without_a_slip(dots):
    grid, _ = dots
    nodes = np.full((grid.row.max() + 1, grid.column.max() + 1, 2), np.nan)
    nodes[grid.row, grid.column] = np.stack([grid.u_px, grid.v_px], axis=1)
    for axis, component in ((0, 1), (1, 0)):
        steps = np.diff(nodes[..., component], axis=axis)
        # discorpy's distance is 15.0 px; one slipped index changes a step by as much.
        assert np.nanmax(np.abs(steps - 15.0)) < 2.0


def test_centroids_of_drawn_dots():
    v, u = np.mgrid[0:1200, 0:1600] / 5.0
    turn = np.radians(7.0)
    x, y = (u * np.cos(turn) + v * np.sin(turn)) / 24, (v * np.cos(turn) - u * np.sin(turn)) / 24
    ink = np.hypot(x - np.round(x), y - np.round(y)) * 24 < 6
    picture = (200 - 150 * ink).reshape(240, 5, 320, 5).mean(axis=(1, 3))
    grid = find_dot_grid(picture)
    seen_u, seen_v = grid.u_px + 0.4, grid.v_px + 0.4  # centre of a pixel among its 5 x 5 samples
    x = (seen_u * np.cos(turn) + seen_v * np.sin(turn)) / 24
    y = (seen_v * np.cos(turn) - seen_u * np.sin(turn)) / 24
    # Five samples across a pixel place an edge to 0.06 px rms; a dot's outline crosses 38 pixels: 0.01 px.
    assert np.hypot(x - np.round(x), y - np.round(y)).max() * 24 < 0.04


@pytest.mark.parametrize("picture", [np.zeros((100, 100)), np.random.default_rng(0).normal(0, 1, (200, 200))])
def test_what_shows_no_dots_is_refused(picture):
    with pytest.raises(DetectionError, match="dots"):
        find_dot_grid(picture)


def test_very_strong_barrel_is_taken_out(photograph):
    _, _, test = photograph
    assert test.verdict == "barrel"
    assert test.lens.inverse
    # 22 and 16 px before; lines on paper under plexiglass are no straighter than this.
    assert max(family_rms_px(test.straightness_after, family) for family in FAMILIES) < 0.25
    # discorpy's vanishing points, from the same points: (996.6, 736.5), without an uncertainty.
    assert test.lens.centre_px == pytest.approx((996.6, 736.5), abs=3.0)


def test_check_points_and_cost(photograph):
    picture, _, test = photograph
    table = check_points(test, picture.shape, mm_per_px=0.5)
    assert len(table) == 9
    assert (table["outward / px"] <= 0).all()  # barrel: everything moves inward
    assert table["neglected / mm"].max() <= 0.5 * effect_of_neglect_px(test).max() + 1e-9


def test_the_section_is_dark_where_lines_were_found(photograph):
    picture, grid, _ = photograph
    for family in FAMILIES:
        section = line_section(picture, grid, family)
        at_lines = np.interp(section.line_px, section.distance_px, section.grey)
        between = np.interp((section.line_px[1:] + section.line_px[:-1]) / 2, section.distance_px, section.grey)
        assert np.median(at_lines) < np.median(between) - 20


def test_a_tilted_sheet_has_its_scale_at_the_centre(campaign):
    rig = campaign.draw_rig(np.random.default_rng(4)).at(camera={"tilt_deg": (3.0, -2.0)})
    grey, _, _ = campaign.picture(rig, 25.0, np.random.default_rng(5))
    grid = find_grid(grey)
    pitch = Estimate(25.0 * rig.camera.scale_mm_per_px, 1e-4, "mm")
    at_centre = examine_distortion(grid).scale_at_centre(pitch)
    assert abs(at_centre.value - rig.camera.scale_mm_per_px) < 4 * at_centre.u
    naive = thesis_scale(grid, pitch).beside(at_centre).mean
    assert abs(naive.value - rig.camera.scale_mm_per_px) < 2 * naive.u


def test_a_wrong_pitch_shows_in_the_height_when_the_lens_is_known(campaign):
    rig = campaign.draw_rig(np.random.default_rng(4)).at(camera={"tilt_deg": (1.0, -0.5), "distortion": (0.0,) * 5})
    grey, _, _ = campaign.picture(rig, 30.0, np.random.default_rng(6))
    focal = rig.camera.height_mm / rig.camera.scale_mm_per_px
    values = np.array([focal, focal, 239.5, 199.5, 0, 0, 0, 0, 0])
    lens = Lens(values, np.diag(np.r_[(1e-3 * values[:2]) ** 2, 0.25, 0.25, np.zeros(5)]), 480, 400)
    true_pitch, stated = 30.0 * rig.camera.scale_mm_per_px, Estimate(rig.camera.height_mm, 5.0, "mm")
    grid = find_grid(grey)
    for factor, decision in ((1.0, "pass"), (1.2, "fail")):
        pitch = Estimate(factor * true_pitch, 1e-4 * true_pitch, "mm")
        seen = camera_height(fit_grid_camera(grid, pitch, lens=lens))
        # Height is focal length times scale, which goes with the pitch; the lens is known to 0.1 %.
        assert seen.value == pytest.approx(factor * stated.value, rel=4e-3)
        assert pitch_check(seen, stated).decision == decision


def test_campaign_of_virtual_cameras(campaign):
    trials = campaign.run(3, 5)
    assert len(trials) >= 4
    above = [t for t in trials if abs(t.displacement_px) > t.test.detection_limit_px]
    assert above
    assert all(t.right for t in above)  # 99 % each
    # 95 % each: more than 2 of 5 outside in 0.12 % of cases.
    assert sum(t.covered for t in trials) >= len(trials) - 2
    straight = [t for t in trials if t.displacement_px == 0]
    assert sum(t.test.verdict != "none" for t in straight) <= 2  # 5 % each: 3 of 5 in 0.12 % of cases
