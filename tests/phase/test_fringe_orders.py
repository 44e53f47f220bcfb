"""Orders from several periods against true phases, predicted error rates, and pictures that contradict them."""

import numpy as np
import pytest
from scipy import special

from fringecal.errors import PhaseError
from fringecal.phase import correct_gamma, demodulate, estimate_waveform, unwrap
from fringecal.phase.orders.absolute import absolute_phase
from fringecal.phase.orders.multi_period import FringeOrders, PlateOrders, decide_orders, plate_number
from fringecal.phase.orders.period_cycle import cycle_of

SHAPE = (120, 160)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
ON_BOX = (np.abs(U - 80) < 30) & (np.abs(V - 60) < 25)


def scene(fringes, step):
    """Fringes along u, and a box on which they are `step` fringes further: true phase of the shortest, rad."""
    return 2 * np.pi * (0.3 + fringes * U / SHAPE[1] + np.where(ON_BOX, step, 0.0))


def shown(truth, periods, wrap, rng, sigma=0.0):
    """Give the wrapped phases of all periods with noise, and their sigmas."""
    ratios = min(periods) / np.asarray(periods, float)
    noise = sigma * rng.standard_normal((len(ratios), *SHAPE))
    return wrap(ratios[:, None, None] * truth + noise), np.full((len(ratios), *SHAPE), max(sigma, 1e-3))


def wrong(orders, truth):
    """Say at which decided pixels the order is not the true one, up to whole cycles."""
    turns = np.rint((orders.phase - truth) / (2 * np.pi))
    return (turns % orders.cycle != 0) & np.isfinite(orders.phase)


@pytest.mark.parametrize(
    ("ratios", "cycle"),
    # Least common multiples; 0.93 has its beat at 1 / 0.07 = 14.3 fringes; 18, 20 and 23 meet at 4140 = 230 x 18.
    [([2 / 3], 3), ([1 / 8], 8), ([1 / 30], 30), ([1 / 8, 1 / 64], 64), ([0.93], 14), ([18 / 20, 18 / 23], 230)],
)
def test_a_cycle_ends_where_all_periods_meet_again(ratios, cycle):
    assert cycle_of(ratios) == cycle


@pytest.mark.parametrize(
    ("periods", "fringes", "step"),
    [((12, 96), 7.0, 2.4), ((96, 12), 7.0, 2.4), ((200 / 3, 100), 2.0, 0.7), ((10, 80, 640), 25, 17.3)],
)
@pytest.mark.parametrize("sigma", [0.0, 0.1])
def test_every_pixel_has_its_order_whatever_steps_there_are(periods, fringes, step, sigma, wrap, rng):
    truth = scene(fringes, step)
    orders = decide_orders(*shown(truth, periods, wrap, rng, sigma), periods)
    assert not wrong(orders, truth).any()
    assert orders.undecided < 1e-3
    count = absolute_phase(orders)
    off = (count.phase - truth) / (2 * np.pi)
    # The whole picture holds fewer fringes than the cycle.
    assert count.in_one_cycle
    np.testing.assert_allclose(off[np.isfinite(off)], np.nanmedian(off), atol=0.25)


def test_the_predicted_rate_of_errors_is_the_one_that_occurs(wrap, rng):
    # Noise 0.3 rad at a ratio of 8: 19.4 % of the orders are wrong (Gauss), if each pixel decides for itself.
    expected = special.erfc(np.pi / (np.sqrt(2) * 0.3 * np.hypot(8, 1)))
    assert expected == pytest.approx(0.194, abs=5e-4)
    truth = scene(7, 0.0)
    phases, sigmas = shown(truth, (12, 96), wrap, rng, 0.3)
    alone = phases[0] + 2 * np.pi * np.rint((8 * wrap(phases[1] - truth / 8) + truth - phases[0]) / (2 * np.pi))
    assert np.mean(np.abs(alone - truth) > np.pi) == pytest.approx(expected, abs=4 * np.sqrt(0.194 * 0.806 / U.size))
    orders = decide_orders(phases, sigmas, (12, 96))
    assert orders.error_rate == pytest.approx(expected, abs=2e-3)  # 0.02 rad of model error is added
    # Sums over 25 pixels lower the noise fivefold: pi / (8 * 0.06) = 6.5 sigma, where the window is whole.
    assert wrong(orders, truth).mean() < 1e-3
    assert orders.undecided < 0.01


def test_nan_neither_spreads_nor_gets_an_order(wrap, rng):
    truth = scene(7, 2.4)
    phases, sigmas = shown(truth, (12, 96), wrap, rng, 0.05)
    phases[0, 30:40, 20:50] = np.nan
    phases[1, 80:90, 20:50] = np.nan  # nothing decides these
    orders = decide_orders(phases, sigmas, (12, 96))
    assert np.isnan(orders.phase[30:40, 20:50]).all()
    assert np.isnan(orders.phase[83:87, 23:47]).all()
    assert not wrong(orders, truth).any()
    blank = np.isnan(orders.phase)
    blank[29:41, 19:51] = blank[79:91, 19:51] = False  # what is left between a hole and the box is too narrow
    assert not blank.any()


def test_a_zero_that_is_elsewhere_is_found_and_orders_are_still_right_against_one_another(wrap, rng):
    truth = scene(7, 2.4)
    phases, sigmas = shown(truth, (12, 96), wrap, rng, 0.02)
    phases[1] = wrap(phases[1] + 0.3)  # orders lie 0.785 rad apart
    orders = decide_orders(phases, sigmas, (12, 96))
    assert orders.zeros_rad[0] == pytest.approx(0.3, abs=0.005)
    assert not wrong(orders, truth).any()


def test_a_later_capture_is_counted_as_the_plate_even_if_its_zero_is_found_one_order_off(wrap, rng):
    plate, box = scene(7, 0.0), scene(7, 2.4)
    offset = np.pi / 8  # half way between two orders: chance says which zero is found
    found = []
    for truth, more in ((plate, -0.01), (box, 0.01)):
        phases, sigmas = shown(truth, (12, 96), wrap, rng, 0.01)
        phases[1] = wrap(phases[1] + offset + more)
        found.append(decide_orders(phases, sigmas, (12, 96)))
    counted = plate + 2 * np.pi * 5  # the rig counts from another fringe
    tie = PlateOrders.of(found[0], counted)
    number = tie.number_for(found[1])
    assert found[0].zeros_rad[0] * found[1].zeros_rad[0] < 0
    assert number != tie.number
    off = (found[1].phase + 2 * np.pi * number - box - 2 * np.pi * 5) / (2 * np.pi)
    np.testing.assert_allclose(off - 8 * np.rint(off / 8), 0, atol=0.05)
    assert tie.number_for(decide_orders(*shown(box, (12, 18), wrap, rng, 0.01), (12, 18))) is None


def test_a_plate_that_is_not_to_be_seen_ties_nothing(wrap, rng):
    orders = decide_orders(*shown(scene(7, 0.0), (12, 96), wrap, rng, 0.01), (12, 96))
    assert plate_number(orders, scene(7, 0.0)) == 0
    assert plate_number(orders, scene(3, 0.0)) is None  # another rig's
    assert plate_number(orders, np.full(SHAPE, np.nan)) is None


@pytest.mark.parametrize("stated", [(96, 12), (12, 18), (12, 120)])
def test_periods_that_the_pictures_contradict_are_refused(stated, wrap, rng):
    phases, sigmas = shown(scene(7, 2.4), (12, 96), wrap, rng, 0.02)
    with pytest.raises(PhaseError, match="do not fit the stated periods"):
        decide_orders(phases, sigmas, stated)


def test_nonsense_is_refused(wrap, rng):
    phases, sigmas = shown(scene(7, 0.0), (12, 96), wrap, rng)
    for maps, doubts, periods in ((phases[:1], sigmas[:1], (12,)), (phases, sigmas[0], (12, 96))):
        with pytest.raises(PhaseError, match="two periods or more"):
            decide_orders(maps, doubts, periods)
    for periods in ((12, 12), (12, -3), (12, np.nan)):
        with pytest.raises(PhaseError, match="positive and all different"):
            decide_orders(phases, sigmas, periods)
    with pytest.raises(PhaseError, match="no pixel carries fringes of all periods"):
        decide_orders(np.full_like(phases, np.nan), sigmas, (12, 96))


def test_two_real_wavelengths_are_counted_on_wall_and_box(kamino_frames):
    # Periods 66.67 and 100 projector px meet every third fringe. In every smooth part spatial unwrapping of the short
    # period alone is an independent answer; the camera sees the same projector column by both periods.
    steps = np.deg2rad([-120, 0, 120])
    maps = [correct_gamma(demodulate(f, steps), steps, estimate_waveform(f, steps)) for f in kamino_frames]
    orders = decide_orders([m.phase for m in maps], [m.sigma for m in maps], (66.67, 100.0))
    assert orders.cycle == 3
    assert orders.error_rate < 0.01
    count = absolute_phase(orders)
    assert not count.in_one_cycle
    wall, box = np.s_[30:180, 420:1900], np.s_[450:950, 720:1000]
    for part in (wall, box):
        alone = unwrap(maps[0].phase[part], np.isfinite(orders.phase[part]))
        main = alone.pieces == np.bincount(alone.pieces[alone.pieces > 0]).argmax()
        off = np.rint((orders.phase[part] - alone.phase)[main] / (2 * np.pi)) % 3
        assert (off == np.bincount(off.astype(int)).argmax()).mean() > 0.999


def in_squares(truth, size=20, gap=4):
    """Leave only the white squares of a board, which touch nowhere."""
    v, u = V % (2 * size), U % (2 * size)
    first = (v < size - gap) & (u < size - gap)
    second = (v >= size) & (v < 2 * size - gap) & (u >= size) & (u < 2 * size - gap)
    return np.where(first | second, truth, np.nan)


@pytest.mark.parametrize("projected", [None, 24.0])
def test_squares_of_a_board_that_holds_more_fringes_than_a_cycle_are_one_plane(projected, wrap, rng):
    # 21 fringes and a cycle of 8: every white square is a piece, and none may be a whole cycle off.
    truth = in_squares(scene(21, 0.0))
    orders = decide_orders(*shown(truth, (12, 96), wrap, rng, 0.05), (12, 96), projected=projected)
    count = absolute_phase(orders, projected=projected)
    off = (count.phase - truth) / (2 * np.pi)
    known = np.isfinite(off)
    np.testing.assert_allclose(off[known], np.median(off[known]), atol=0.25)
    assert known.sum() > 0.95 * np.isfinite(truth).sum()
    assert not count.in_one_cycle


def test_a_box_a_whole_number_of_cycles_up_is_left_open_and_counted_once_all_fringes_are_numbered(wrap, rng):
    # 15 fringes seen of 24 projected, the box 9 fringes up: within a cycle of 8 it looks like 1 fringe up.
    truth = np.where(ON_BOX | ~((np.abs(U - 80) < 36) & (np.abs(V - 60) < 31)), scene(15, 9.0), np.nan)
    phases, sigmas = shown(truth, (12, 96), wrap, rng, 0.05)
    count = absolute_phase(decide_orders(phases, sigmas, (12, 96)))
    assert np.isnan(count.phase[ON_BOX]).all()
    assert count.undecided == pytest.approx(ON_BOX.sum() / np.isfinite(truth).sum(), abs=0.01)
    assert "state how many fringes are projected" in count.sentence()
    # With a third period of 24 fringes each pixel has its own number.
    phases, sigmas = shown(truth, (12, 96, 288), wrap, rng, 0.05)
    count = absolute_phase(decide_orders(phases, sigmas, (12, 96, 288), projected=24.0), projected=24.0)
    off = (count.phase - truth) / (2 * np.pi)
    np.testing.assert_allclose(off[np.isfinite(truth)], off[0, 0], atol=0.25)
    assert count.known_by == "numbers"


def test_a_projected_picture_of_exactly_one_cycle_is_not_cut_by_noise_at_its_ends(wrap, rng):
    truth = 2 * np.pi * 8 * U / (SHAPE[1] - 1)  # from 0 to 8, where noise takes it below the one and above the other
    phases, sigmas = shown(truth, (12, 96), wrap, rng, 0.1)
    count = absolute_phase(decide_orders(phases, sigmas, (12, 96), projected=8.0), projected=8.0)
    off = (count.phase - truth) / (2 * np.pi)
    known = np.isfinite(off)
    np.testing.assert_allclose(off[known], np.median(off[known]), atol=0.25)
    assert known.mean() > 0.95


@pytest.mark.parametrize("degrees", [-90, 90, 36])
def test_a_constant_offset_of_all_periods_is_found_and_named(degrees, wrap, rng):
    # phi_k = r_k x + c for every period: sin where cos was meant is c = -90 deg.
    truth, periods = scene(25, 17.3), (10, 80, 640)
    phases, sigmas = shown(truth, periods, wrap, rng, 0.05)
    orders = decide_orders(wrap(phases + np.deg2rad(degrees)), sigmas, periods, projected=64.0)
    assert np.rad2deg(orders.offset_rad) == pytest.approx(degrees, abs=1.0)
    assert f"offset by {degrees} deg" in orders.sentence()
    assert ("sines" in orders.sentence()) == (abs(degrees) == 90)
    off = (orders.phase - truth) / (2 * np.pi)
    known = np.isfinite(off)
    np.testing.assert_allclose(off[known], np.median(off[known]), atol=0.25)
    assert known.mean() > 0.99


def test_an_offset_that_noise_hides_at_single_pixels_is_found_by_many(wrap, rng):
    # 16 and 17 units: orders lie 2 pi / 17 = 0.37 rad apart, noise of both phases is 0.16 rad. Half way between two
    # orders chance would choose.
    truth, periods = scene(12, 0.0), (16, 17)
    phases, sigmas = shown(truth, periods, wrap, rng, 0.11)
    phases[1] = wrap(phases[1] + np.pi / 17)
    orders = decide_orders(phases, sigmas, periods)
    assert abs(orders.zeros_rad[0]) == pytest.approx(np.pi / 17, abs=0.03)
    off = (orders.phase - truth) / (2 * np.pi)
    known = np.isfinite(off)
    assert np.mean(np.abs(off[known] - np.median(off[known])) > 0.25) < 1e-3
    assert known.mean() > 0.95


@pytest.mark.parametrize("counts", [(1, 8, 64), (0.9, 3.9, 15.9)])
def test_counts_given_as_lengths_are_named(counts, wrap, rng):
    lengths = 1 / np.asarray(counts, float)
    phases, sigmas = shown(scene(0.8 * max(counts), 0.0), lengths, wrap, rng, 0.02)
    with pytest.raises(PhaseError, match="fringes in the picture and not lengths"):
        decide_orders(phases, sigmas, counts)
    orders = decide_orders(phases, sigmas, lengths, projected=max(counts))
    assert orders.undecided < 0.01


def test_every_pixel_of_a_gray_code_stands_for_itself_wherever_the_largest_piece_lies(wrap):
    # 16 numbers; recentring on a piece at the lower end would take whatever lies above 9 for less than 0.
    truth = np.where((U < 90) | (U > 120), scene(15, 0.0), np.nan)
    orders = FringeOrders(truth.astype(np.float32), 16, (), (), 0.0, 0.0, 0.0, numbers_all=True)
    count = absolute_phase(orders)
    np.testing.assert_allclose(count.phase, truth, atol=1e-4)
    assert count.known_by == "numbers"
