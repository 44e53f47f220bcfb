"""Fringe orders of unknown objects: decided where shadows and the plate say them, open where nothing does."""

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.optimize import brentq

from fringecal.phase import Regions, demodulate
from fringecal.phase.unwrapping.borders import trusted_borders
from fringecal.phase.unwrapping.regions import smooth_regions
from fringecal.reconstruct import Reason, absolute_phase
from fringecal.reconstruct.orders.contacts import orders_by_contact
from fringecal.reconstruct.orders.epipolar_lines import epipolar_lines
from fringecal.reconstruct.orders.faint_edges import faint_edges
from fringecal.reconstruct.orders.mixed_pixels import beside_breaks
from fringecal.reconstruct.orders.outlined_parts import outlined_parts
from fringecal.reconstruct.orders.plate_closeness import PlateCloseness
from fringecal.reconstruct.orders.region_orders import Bounds, OrderBook, Passages, bounds_of
from fringecal.reconstruct.orders.sinking import Depths
from fringecal.simulate import render
from fringecal.simulate.scene.objects import box
from fringecal.simulate.scene.scene import Scene

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from object_population import OBJECTS, draw_case, fringe_height_mm  # noqa: E402

SEED = 7  # the campaign of benchmarks/object_orders.py uses others
KINDS = tuple(OBJECTS)


@pytest.fixture(scope="module")
def found():
    """One case of every kind, with what was found and what is true, rad."""
    cases = [draw_case(number, seed=SEED) for number in range(len(KINDS))]
    phases = [demodulate(case.frames.frames, case.phase_shifts_rad) for case in cases]
    return [
        (case, absolute_phase(phase, case.calibration), case.true_step_rad())
        for case, phase in zip(cases, phases, strict=True)
    ]


def test_hardly_a_valid_pixel_is_off_by_half_a_fringe(found):
    wrong = sum(int(np.sum(np.abs(f.difference_rad - true)[f.reasons == 0] >= np.pi)) for _, f, true in found)
    valid = sum(int(np.sum(f.reasons == 0)) for _, f, _ in found)
    assert wrong / valid < 1e-3


def test_what_hangs_together_with_the_plate_is_decided(found):
    unseen = (Reason.NO_PHASE, Reason.SHADOW)
    decided = [np.mean(f.reasons[case.decidable() & ~np.isin(f.reasons, unseen)] == 0) for case, f, _ in found]
    assert np.mean(decided) > 0.93


def test_an_isolated_block_is_read_right_by_its_shadow(found):
    case, f, true = found[KINDS.index("block")]
    top = case.frames.lit & (case.frames.z > 0.99 * case.frames.z.max())
    valid = f.reasons[top] == 0
    assert valid.mean() > 0.5
    assert np.mean(np.abs(f.difference_rad - true)[top][valid] < np.pi) > 0.998  # the rest sees its rim


def height_of_step(calibration, turns):
    """Height in the middle of the picture whose step over the plate is so many fringes, mm."""
    rays = calibration.camera.rays(*(np.array([c]) for c in calibration.camera.centre_px))

    def off(z):
        x, y = rays.at(np.array([z]))
        step = calibration.model.phase(x, y, np.array([z])) - calibration.model.phase(rays.ax, rays.ay, 0.0)
        return abs(float(step[0])) / (2 * np.pi) - turns

    return brentq(off, 0.0, 10 * turns * fringe_height_mm(calibration))


def treads_of(case, heights_mm, half_mm=30.0, length_mm=70.0):
    """Treads side by side, each with a shadow of its own: phase, and the case with what is true."""
    edges = np.linspace(-half_mm, half_mm, len(heights_mm) + 1)
    spans = zip(edges, edges[1:], heights_mm, strict=False)
    solids = tuple(box((a, b), (-length_mm / 2, length_mm / 2), h) for a, b, h in spans)
    frames = render(case.spec, Scene(solids=solids), seed=1)
    return demodulate(frames.frames, case.phase_shifts_rad), replace(case, frames=frames)


@pytest.mark.parametrize("turns", [(1.4, 2.4), (2.5, 1.53), (1.3, 4.3)])
def test_treads_side_by_side_that_differ_by_nearly_whole_fringes_are_told_apart_by_their_shadows(found, turns):
    """No two neighbours show the edge between them: one smooth region, whose shadows say two orders."""
    case = found[0][0]
    heights = [height_of_step(case.calibration, t) for t in turns]
    phase, case = treads_of(case, heights)
    got, true = absolute_phase(phase, case.calibration), case.true_step_rad()
    for height in heights:
        tread = case.frames.lit & (np.abs(case.frames.z - height) < 0.01)
        valid = got.reasons[tread] == 0
        assert valid.mean() > 0.5
        assert np.mean(np.abs(got.difference_rad - true)[tread][valid] < np.pi) > 0.995


def test_a_break_far_below_a_pixels_noise_is_found_and_none_on_a_smooth_surface():
    rng = np.random.default_rng(0)
    v, u = np.mgrid[0:120, 0:160].astype(float)
    surface = 0.02 * v + 0.01 * u + 0.03 * rng.standard_normal(u.shape)
    inside = (u > 10) & (u < 150) & (v > 10) & (v < 110)
    assert not faint_edges(surface, inside, 6.0, 0.03).any()
    broken = faint_edges(surface + 0.15 * (u >= 80), inside, 6.0, 0.03)
    assert broken[20:100, 79:81].all()
    assert not broken[:, :60].any()
    assert not broken[:, 100:].any()


def raised_disc(step_rad, darker=0.0):
    """A noisy plane, one smooth region, with a disc of radius 30 px that lies whole fringes and `step_rad` higher."""
    rng = np.random.default_rng(1)
    v, u = np.mgrid[0:160, 0:160].astype(float)
    disc = np.hypot(u - 80, v - 80) < 30
    surface = 0.01 * u + step_rad * disc + 0.03 * rng.standard_normal(u.shape)
    background = 100.0 * (1 - darker * disc) * (1 + 0.01 * rng.standard_normal(u.shape))
    ones = np.ones(u.shape, np.int32)
    return Regions(surface, ones, ones), background, np.hypot(u - 80, v - 80) < 15


@pytest.mark.parametrize("bow_rad", [0.0, 0.15])
def test_plate_lies_on_its_own_phase_as_closely_as_the_rest_of_it_does_and_a_top_does_not(bow_rad):
    """Plate; more of it two fringes on; a top 0.3 rad off; a hill's foot, of which an eighth has left the plate."""
    rng = np.random.default_rng(4)
    values = 0.02 * rng.standard_normal((120, 400)) + bow_rad * np.sin(np.arange(400) / 9)
    cores = np.repeat(np.arange(1, 5), 100)[None].repeat(120, axis=0).astype(np.int32)
    values[cores == 2] += 4 * np.pi
    values[cores == 3] += 0.3 + (bow_rad > 0)
    values[:15, 300:] += 1.5
    close = PlateCloseness.of(Regions(values, cores, cores), main=1).within(8.0, 0.05)
    assert close.tolist() == [False, True, True, False, True]


@pytest.mark.parametrize(("step_rad", "darker"), [(0.15, 0.0), (-0.15, 0.0), (0.0, 0.1)])
def test_what_a_faint_outline_encloses_is_a_region_of_its_own(step_rad, darker):
    """The outline shows in the mean of windows, of 0.37 u(phi), where a pixel's noise hides it."""
    regions, background, middle = raised_disc(step_rad, darker)
    found = outlined_parts(regions, background, 0.03)
    assert found.number == 2
    assert (found.labels[middle] == 2).all()
    assert (found.labels[:20] == 1).all()


def test_what_no_outline_encloses_stays_one_region():
    """Not a disc alike in phase and light; not a roof; not a hill that is curved everywhere."""
    regions, background, _ = raised_disc(0.0)
    assert outlined_parts(regions, background, 0.03).number == 1
    v, u = np.mgrid[0:160, 0:160].astype(float)
    noise = 0.03 * np.random.default_rng(2).standard_normal(u.shape)
    for surface in (0.03 * np.abs(u - 80), 3 * np.exp(-((u - 80) ** 2 + (v - 80) ** 2) / 2 / 25**2)):
        assert outlined_parts(replace(regions, values=surface + noise), background, 0.03).number == 1


@pytest.mark.parametrize(("neck_px", "number"), [(6, 2), (30, 1)])
def test_a_neck_ties_no_surfaces_and_a_broad_one_does(neck_px, number):
    """Two squares of one phase with a gap between them that is bridged over some pixels."""
    labels = np.ones((120, 160), np.int32)
    labels[:, 76:84] = 0
    labels[60 : 60 + neck_px, 76:84] = 1
    values = 0.02 * np.random.default_rng(6).standard_normal(labels.shape)
    assert outlined_parts(Regions(values, labels, labels), np.full(labels.shape, 90.0), 0.02).number == number


def test_an_outline_is_found_at_any_resolution():
    """A picture of more rows than the outline rules take is reduced first, and its parts enlarged again."""
    rng = np.random.default_rng(3)
    v, u = np.mgrid[0:1500, 0:1200].astype(float)
    disc = np.hypot(u - 600, v - 700) < 200
    surface = 0.12 * disc + 0.05 * rng.standard_normal(u.shape)
    ones = np.ones(u.shape, np.int32)
    found = outlined_parts(Regions(surface, ones, ones), np.full(u.shape, 90.0), 0.05)
    assert found.number == 2
    assert (found.labels[np.hypot(u - 600, v - 700) < 180] == 2).all()
    assert (found.labels[np.hypot(u - 600, v - 700) > 225] == 1).all()


@pytest.mark.parametrize(("step_rad", "borders"), [(0.0, 1), (0.13, 0)])
def test_a_border_meets_on_average_or_not_at_all(step_rad, borders):
    """A fiftieth of a fringe is four standard deviations of a pixel's noise here, and some thirty of a cell's mean."""
    rng = np.random.default_rng(4)
    labels = np.ones((96, 96), np.int32)
    labels[:, 48:] = 2
    values = step_rad * (labels == 2) + 0.03 * rng.standard_normal(labels.shape)
    assert len(trusted_borders(values, labels)) == borders


def test_a_fold_meets_however_steep_its_flanks():
    labels = np.ones((96, 96), np.int32)
    labels[:, 48:] = 2
    u = np.arange(96) - 47.5
    values = -0.3 * np.abs(u)[None, :] + 0.03 * np.random.default_rng(5).standard_normal(labels.shape)
    assert trusted_borders(values, labels)[0, :3].tolist() == [1, 2, 0]


def flat_regions(steps):
    labels = np.repeat(np.arange(1, len(steps) + 1, dtype=np.int32), 30)[None, :] * np.ones((30, 1), np.int32)
    return Regions(np.asarray(steps, float)[labels - 1], labels, labels)


@pytest.mark.parametrize("rising", [1, -1])
def test_what_an_order_puts_below_the_plate_is_impossible_unless_it_may_be_so_low(rising):
    regions = flat_regions(rising * np.array([0.1, 2.0]))
    depths = Depths.of(regions, rising, -0.9)
    assert not depths.impossible({1: 0, 2: 0})
    assert depths.impossible({2: -1})
    assert depths.impossible({1: 0, 2: -2})
    assert not Depths.of(regions, rising, -11.0).impossible({2: -2})


def test_a_border_over_which_the_modulation_dips_joins_nothing():
    """Two flat regions that meet in one phase: continuous paint, or an edge at which a pixel sees both."""
    values, labels = np.zeros((80, 80)), np.ones((80, 80), np.int32)
    labels[:, 40:] = 2
    light = np.full(values.shape, 80.0, np.float32)
    light[:, 40:] = 50.0
    assert len(trusted_borders(values, labels, (light, labels))) == 1
    cores = labels.copy()
    cores[:, 33:44], light[:, 35:37] = 0, 30.0
    assert len(trusted_borders(values, labels, (light, cores))) == 0


def test_a_shadow_says_so_and_what_light_reaches_never_does(found):
    case, f, _ = found[KINDS.index("block")]
    dark = ~case.frames.lit
    inner = cv2.erode(dark.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert np.mean(f.reasons[inner] == Reason.SHADOW) > 0.97
    lit = cv2.erode((~dark).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert np.mean(f.reasons[lit] == Reason.SHADOW) < 1e-3


def test_pixels_beside_an_edge_say_so(found):
    case, f, _ = found[KINDS.index("block")]
    assert np.any(f.reasons == Reason.EDGE)
    assert np.isnan(f.difference_rad[f.reasons != 0]).all()


def test_lines_run_where_raised_points_show_their_fringes(found):
    for case, _, _ in found:
        lines, rig = epipolar_lines(case.calibration), case.calibration
        u, v = rig.camera.centre_px
        rays = rig.camera.rays(np.array([u]), np.array([v]))
        x, y = rays.at(5.0)
        foot = np.array(rig.model.foot(x, y, np.array([5.0]))).ravel()
        ahead = 20 * lines.forward * np.array([lines.slope[0] + lines.slope[1] * v + lines.slope[2] * u, 1.0])
        if not lines.along_columns:
            ahead = 20 * lines.forward * np.array([1.0, lines.slope[0] + lines.slope[1] * u + lines.slope[2] * v])
        there = rig.camera.rays(np.array([u + ahead[0]]), np.array([v + ahead[1]]))
        along = np.array([there.ax[0] - rays.ax[0], there.ay[0] - rays.ay[0]])
        toward = foot - [rays.ax[0], rays.ay[0]]
        assert along @ toward / np.linalg.norm(along) / np.linalg.norm(toward) > 0.998
        assert np.sign(rig.model.phase(x, y, 5.0) - rig.model.phase(rays.ax, rays.ay, 0.0))[0] == lines.rising


def passages(gain_turns, *, shadow):
    n = len(gain_turns)
    ones = np.ones(n, np.int64)
    dark = np.full(n, shadow)
    gain = 2 * np.pi * np.asarray(gain_turns, float)
    return Passages(ones, 2 * ones, dark, ~dark, 0 * ones, gain, np.zeros(n))


def test_a_shadow_whose_ends_show_one_ray_ties_two_regions():
    bounds = bounds_of(passages([3.02] * 20, shadow=True), np.array([0, 20, 20]))
    assert [int(b[0]) for b in bounds[:3]] == [1, 2, -3]
    assert bounds.equal.all()


def test_paint_of_any_width_ties_nothing():
    rng = np.random.default_rng(0)
    tied = [
        bounds_of(passages(np.linspace(a, a + 1.5, 20), shadow=True), np.array([0, 20, 20])).equal.any()
        for a in rng.uniform(0, 5, 50)
    ]
    assert not any(tied)


def test_side_by_side_rays_may_skip_but_not_run_back():
    bounds = bounds_of(passages([-2.1] * 20, shadow=False), np.array([0, 20, 20]))
    assert int(bounds.fringes[0]) == 2
    assert not bounds.equal[0]


def test_bounds_from_both_sides_decide_and_a_weak_contradiction_is_left_aside():
    rows = [(1, 2, 3, True, 50), (2, 3, 0, False, 30), (3, 1, -3, False, 30), (1, 3, 7, True, 6)]
    columns = [np.array([row[k] for row in rows]) for k in range(5)]
    book = OrderBook(3, Bounds(*columns[:3], columns[3].astype(bool), columns[4]))
    assert book.choose(1, 0)
    assert book.carry() == [3]
    np.testing.assert_array_equal(book.orders(), [np.nan, 0, 3, 3])


def test_what_nothing_bounds_stays_open():
    columns = [np.array([1]), np.array([2]), np.array([0]), np.array([False]), np.array([40])]
    book = OrderBook(2, Bounds(*columns))
    book.choose(1, 0)
    book.carry()
    assert np.isnan(book.orders()[2])
    assert not book.choose(2, -1)
    assert book.choose(2, 4)


def test_many_small_regions_do_not_hang_on_a_short_border():
    """Nine regions of 900 px in a row meet over 30 px each; the first meets the plate, region 0, over so many."""
    chain = [(k, k + 1, 1, 30) for k in range(1, 9)]
    sizes, orders = np.array([90_000] + 9 * [900]), np.array([0.0] + 9 * [np.nan])
    breadth = np.sqrt(9 * 900)
    for pairs, hangs in ((int(0.3 * breadth), False), (int(0.5 * breadth), True)):
        found = orders_by_contact(np.array([(0, 1, 2, pairs), *chain]), sizes, orders, lambda _: False)
        assert found == ({k: 1 + k for k in range(1, 10)} if hangs else {})


def test_without_borders_nothing_hangs():
    assert orders_by_contact(np.zeros((0, 4), np.int64), np.array([10, 10]), np.array([0.0, np.nan]), bool) == {}


def test_a_region_in_which_paths_disagree_is_narrowed_until_they_agree():
    """A ramp that ends at an edge: around its foot it is continuous, over the edge it jumps by 0 to 2 fringes."""
    v, u = np.mgrid[0:200, 0:200].astype(float)
    ramp = np.where((u > 60) & (u < 140) & (v > 40), 4 * np.pi * (v - 40) / 160, 0.0)
    regions = smooth_regions(np.angle(np.exp(1j * ramp)), np.ones(ramp.shape, bool))
    for label in range(1, regions.number + 1):
        turns = np.rint((ramp - regions.values)[regions.cores == label] / (2 * np.pi))
        assert np.unique(turns).size == 1


def test_both_sides_of_a_break_and_what_is_mixed_between_them_are_found():
    step = np.zeros((20, 30))
    step[:, 16:] = 20.0
    step[5:15, 15] = 11.0
    expected = np.zeros(step.shape, bool)
    expected[:, 15:17] = True
    expected[5:15, 14] = True
    np.testing.assert_array_equal(beside_breaks(step, np.full(step.shape, 80.0, np.float32)), expected)


def test_a_steep_slope_and_the_border_of_what_is_open_are_no_break():
    u = np.mgrid[:20, :30][1].astype(float)
    slope = 1.9 * u
    slope[:, 20:] = np.nan
    assert not beside_breaks(slope, np.full(slope.shape, 80.0, np.float32)).any()


def test_a_dim_pixel_beside_a_shadow_is_found_and_one_on_dark_paint_is_not():
    step, light = np.zeros((20, 30)), np.full((20, 30), 80.0, np.float32)
    step[:, 20:], light[:, 20:] = np.nan, 2.0
    light[:, 19], light[:, 5:8] = 30.0, 30.0
    np.testing.assert_array_equal(np.flatnonzero(beside_breaks(step, light).any(axis=0)), [19])
