"""Patterns as a projector shows them: decoded by the phase room, and held against closed forms and drawn noise."""

import cv2
import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.patterns import (
    Raster,
    alignment_chart,
    choose_periods,
    drawn_ripple,
    flat_frame,
    focus_chart,
    fringe_frame,
    gamma_response,
    gray_frames,
    measured_response,
    order_error_rate,
    pattern_set,
    phase_noise_rad,
    png_of,
)
from fringecal.phase import demodulate, orders_by_gray, raster_by_gray, raster_coordinate

SHIFTS = np.radians([0.0, 90.0, 180.0, 270.0])
SMALL = Raster(240, 60)
COLUMNS = np.broadcast_to(np.arange(240.0), (60, 240))
# Rounding is uniform over a grey level, of a modulation of 127.5; a phase of four frames has 1 / sqrt 2 of that.
ROUNDING_RAD = 0.5 / np.sqrt(3) / 127.5 / np.sqrt(2)


def seen(frames):
    """What a linear camera makes of frames, neither dark nor saturated."""
    return 20 + 0.8 * np.asarray(frames, dtype=float)


def decoded(raster, periods, axis="u", **options):
    maps = [
        demodulate(seen([fringe_frame(raster, axis, p, shift, **options) for shift in SHIFTS]), SHIFTS) for p in periods
    ]
    phases, sigmas = ([np.full(m.phase.shape, 0.01) if k else m.phase for m in maps] for k in (0, 1))
    extent = raster.extent_px(axis)
    return raster_coordinate(phases, sigmas, list(periods), extent, zeros_rad=[0.0] * len(periods), falls=False)


@pytest.mark.parametrize("periods", [(20, 80, 240), (20, 22.5, 240), (17, 18.37, 19.3), (22.5, 240)])
def test_columns_are_found_by_the_phases_of_whole_and_broken_periods(periods):
    found = decoded(SMALL, periods)
    error = found.px - COLUMNS
    assert np.isfinite(found.px).all()
    # Rounding in whole grey values, some times its standard deviation at most; 22.5 px is drawn as 22.5 and not as 23.
    assert np.abs(error).max() < 5 * ROUNDING_RAD * min(periods) / (2 * np.pi)


def test_rows_are_counted_by_the_other_axis():
    found = decoded(Raster(60, 240), (20, 80, 240), axis="v")
    assert np.abs(found.px - COLUMNS.T).max() < 0.05


@pytest.mark.parametrize("complementary", [False, True])
def test_a_gray_code_numbers_the_fringes_that_it_was_drawn_for(complementary):
    map_ = demodulate(seen([fringe_frame(SMALL, "u", 20, shift) for shift in SHIFTS]), SHIFTS)
    code = seen(gray_frames(SMALL, "u", 20, complementary=complementary))
    assert len(code) == 4 * (1 + complementary)
    orders = orders_by_gray(map_, code)
    found = raster_by_gray(orders, np.full(map_.phase.shape, 0.01), 20.0, 240.0)
    apart = found.px - COLUMNS
    # One constant for all: where the decoder begins to count. Nothing slips.
    assert np.ptp(apart[np.isfinite(apart)]) < 0.05
    assert np.isfinite(apart).mean() > 0.95


def test_neighbouring_numbers_differ_in_one_bit():
    code = np.array(gray_frames(Raster(1920, 1), "u", 12))[:, 0] > 0
    assert (np.abs(np.diff(code.astype(int), axis=1)).sum(axis=0) <= 1).all()
    assert len({tuple(column) for column in code.T}) == 160


@pytest.mark.parametrize(
    ("period", "words"), [(22.5, "22 px .* and 23 px"), (2.0, "nearest that can is 3 px"), (240, "needs no Gray code")]
)
def test_a_code_that_cannot_be_drawn_is_refused_with_the_nearest_that_can(period, words):
    with pytest.raises(PhaseError, match=words):
        gray_frames(SMALL, "u", period)


def harmonics(exponent, count=30):
    """Fourier coefficients of ((1 + cos x) / 2)^g over the first: c(k + 1) = c(k) (g - k) / (g + k + 1)."""
    found = [1.0]
    for k in range(1, count):
        found.append(found[-1] * (exponent - k) / (exponent + k + 1))
    return found


@pytest.mark.parametrize("exponent", [1.2, 1.8, 2.2])
def test_the_ripple_of_a_response_is_that_of_its_harmonics(exponent):
    # Three frames take harmonics 2, 5 .. for -2, -5 .. and 4, 7 .. for the first: of a fringe each turns the phase.
    x = 2 * np.pi * np.arange(24) / 24
    ratios = dict(enumerate(harmonics(exponent), start=1))
    vector = sum(r * np.exp(1j * (k if k % 3 == 1 else -k) * x) for k, r in ratios.items() if k % 3)
    error = np.angle(vector * np.exp(-1j * x))
    found = drawn_ripple(Raster(1920, 1, 16), 24.0, np.radians([0, 120, 240]), true_response=gamma_response(exponent))
    assert found.rms_rad == pytest.approx(error.std(), rel=2e-3)
    assert found.most_rad == pytest.approx(np.abs(error).max(), rel=5e-3)


def test_a_response_that_is_undone_leaves_rounding():
    shifts = np.radians([0, 120, 240])
    raster = Raster(1920, 1, 8, gamma_response(2.2))
    undone = drawn_ripple(raster, 24.0, shifts)
    # Steps of grey are up to 2.2 times as high at the bright end as they would be without a gamma.
    assert undone.rms_rad < 2.2 * 2 * ROUNDING_RAD
    fine = drawn_ripple(Raster(1920, 1, 12, gamma_response(2.2)), 24.0, shifts)
    assert fine.rms_rad < undone.rms_rad / 8


def test_dithered_fringes_have_the_wanted_light_along_a_fringe():
    raster = Raster(90, 4000)
    frame = fringe_frame(raster, "u", 22.5, 0.3, dithered=True)
    wanted = 255 * (1 + np.cos(2 * np.pi * np.arange(90) / 22.5 + 0.3)) / 2
    # Of 4000 pixels as many are one grey value brighter as the light's fraction asks for: golden steps leave 2 in N.
    np.testing.assert_allclose(frame.mean(axis=0), wanted, atol=2 / 1000)
    assert np.unique(frame[:, 7]).size <= 2
    plain, dithered = (drawn_ripple(Raster(1920, 1), 22.5, SHIFTS, dithered=d) for d in (False, True))
    assert dithered.rms_rad < plain.rms_rad / 5


def test_a_measured_ladder_is_undone_as_its_gamma_is():
    grey = np.linspace(0, 255, 18)
    found = measured_response(grey, 10 + 180 * (grey / 255) ** 2.2)
    light = np.linspace(0.1, 1, 50)
    # Straight between 18 steps: a curvature of 1.2 * 2.2 leaves an eighth of a step's square, over the slope.
    np.testing.assert_allclose(found.shown(found.wanted(light)), light, atol=1e-12)
    np.testing.assert_allclose(found.wanted(light), gamma_response(2.2).wanted(light), atol=2.64 / 8 / 17**2 / 0.3)


@pytest.mark.parametrize(
    ("grey", "light", "words"),
    [([0, 1], [0, 1], "at least 3"), ([0, 2, 1], [0, 1, 2], "do not ascend"), ([0, 1, 2], [0, 3, 3], "does not rise")],
)
def test_ladders_that_say_nothing_are_refused(grey, light, words):
    with pytest.raises(PhaseError, match=words):
        measured_response(grey, light)


@pytest.mark.parametrize(("periods", "noise"), [((20, 1920), 0.02), ((20, 33, 36), 0.15), ((20, 196, 1920), 0.12)])
def test_error_rates_are_those_of_drawn_noise(periods, noise):
    rng = np.random.default_rng(11)
    p, count, draws = np.array(periods, float), 96, 40_000
    truth = rng.integers(0, count, draws)
    x = (truth + rng.random(draws)) * p[0]
    phase = 2 * np.pi * x[:, None] / p + rng.normal(0, noise, (draws, len(p)))
    fine = np.mod(phase[:, 0], 2 * np.pi)
    ratios, u = p[0] / p[1:], np.sqrt(1 + (p[0] / p[1:]) ** 2)
    # By least squares over all numbers, the fine phase's own slip over its end counted as right.
    numbers = np.arange(-1, count + 1)
    rest = phase[:, None, 1:] - ratios * (fine[:, None, None] + 2 * np.pi * numbers[None, :, None])
    rest = np.angle(np.exp(1j * rest)) / u
    best = numbers[(rest**2).sum(axis=2).argmin(axis=1)]
    slip = np.rint((2 * np.pi * x / p[0] - fine) / (2 * np.pi))
    wrong = float(np.mean(best != slip))
    bound = order_error_rate(periods, 1920, noise)
    # A union bound: never less (but for what 40,000 draws leave open), and no more than three times as much here.
    assert wrong < bound * 1.1 + 3e-4
    assert bound < 3 * wrong + 1e-3


def test_choices_number_the_range_and_fewer_frames_come_first():
    found = choose_periods(1920, 20, 0.05, steps=4)
    assert [one.frames for one in found] == sorted(one.frames for one in found)
    for one in found:
        assert one.periods_px[0] == 20
        assert all(period == int(period) for period in one.periods_px)
        if one.error_rate < 1e-3:
            lengths = np.lcm.reduce(np.array(one.periods_px, int))
            assert lengths >= 1920
    assert min(one.error_rate for one in found if one.frames == 16) < 1e-9


def test_noise_of_a_phase_is_that_of_its_frames():
    rng = np.random.default_rng(5)
    frames = 100 + 50 * np.cos(1.0 + SHIFTS)[:, None] + rng.normal(0, 2.0, (4, 40_000))
    phase = np.arctan2(-(frames * np.sin(SHIFTS)[:, None]).sum(axis=0), (frames * np.cos(SHIFTS)[:, None]).sum(axis=0))
    assert phase_noise_rad(2.0, 50.0, 4) == pytest.approx(phase.std(), rel=0.02)


@pytest.mark.parametrize("bits", [8, 10, 16])
def test_pngs_are_read_pixel_by_pixel(bits):
    raster = Raster(64, 24, bits)
    for frame in (fringe_frame(raster, "u", 12.7, 1.0), fringe_frame(raster, "v", 7, 0), focus_chart(raster)):
        read = cv2.imdecode(np.frombuffer(png_of(frame), np.uint8), cv2.IMREAD_UNCHANGED)
        assert read.dtype == frame.dtype == (np.uint8 if bits == 8 else np.uint16)
        np.testing.assert_array_equal(read, frame)
    white = flat_frame(raster, 1.0)
    assert (white >> (0 if bits == 8 else 16 - bits) == 2**bits - 1).all()


def test_the_alignment_chart_touches_all_four_edges():
    chart = alignment_chart(Raster(320, 200))
    inner = slice(40, -40)
    for edge in (chart[0, inner], chart[-1, inner], chart[inner, 0], chart[inner, -1]):
        assert (edge == 255).all()
    # Single pixels in the corners: half of them lit, none beside its like.
    assert chart[:20, :20].mean() == pytest.approx(127.5)
    assert (np.diff(chart[:20, :20].astype(int), axis=1) != 0).all()


def test_the_focus_chart_has_lines_of_one_pixel():
    chart = focus_chart(Raster(600, 400))
    assert (np.abs(np.diff(chart[250, 10:90].astype(int))) == 255).all()


def test_a_set_is_in_the_order_of_a_session():
    found = pattern_set(SMALL, ("u", "v"), {"u": (20.0, 240.0), "v": (20.0, 60.0)}, steps=3, code="plain", charts=True)
    names = [one.file for one in found.patterns]
    assert names[:7] == ["u-0-0.png", "u-0-1.png", "u-0-2.png", "u-1-0.png", "u-1-1.png", "u-1-2.png", "v-0-0.png"]
    assert found.files("gray", "v") == ["v-gray-00.png", "v-gray-01.png"]
    assert found.patterns[-1].draw().shape == (60, 240)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"steps": 2}, "three at least"),
        ({"axes": ()}, "one axis or both"),
        ({"periods_px": {"u": ()}}, "no period"),
        ({"periods_px": {"u": (2.0,)}}, "nearest that can is 3 px"),
        ({"contrast": 1.5}, "contrast"),
        ({"code": "plain", "periods_px": {"u": (22.5,)}}, "22 px"),
    ],
)
def test_sets_that_cannot_be_drawn_are_refused(change, words):
    stated = {"axes": ("u",), "periods_px": {"u": (20.0,)}} | change
    with pytest.raises(PhaseError, match=words):
        pattern_set(SMALL, **stated)


@pytest.mark.parametrize("size", [(0, 10), (99_999, 10)])
def test_projectors_that_are_none_are_refused(size):
    with pytest.raises(PhaseError):
        Raster(*size)
