"""Phase, its uncertainty and the mask, against closed forms and repeated simulation."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import Noise, PhaseMap, Reason, buckets, demodulate, fringe_period, phase_gradient, scheme
from fringecal.phase.demodulation.demodulate import MAX_SIGMA_RAD

THREE = np.deg2rad([0, 120, 240])
SHAPE = (120, 160)


def plane(period_px=17.3, angle_deg=33.0, shape=SHAPE):
    v, u = np.mgrid[: shape[0], : shape[1]]
    angle = np.deg2rad(angle_deg)
    return 2 * np.pi * (u * np.cos(angle) + v * np.sin(angle)) / period_px


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32, np.float64])
@pytest.mark.parametrize("n", [3, 4, 7])
def test_agrees_with_float64_least_squares(dtype, n, fringes, wrap, rng):
    # The oracle is numpy's lstsq in float64 on the very same integers; 1e-5 rad is the kernel's promise.
    steps = np.sort(rng.uniform(0, 2 * np.pi, n)) if n > 3 else THREE
    frames = fringes(plane(), steps).astype(dtype)
    design = np.column_stack([np.ones(n), np.cos(steps), -np.sin(steps)])
    a, c, s = np.linalg.lstsq(design, frames.reshape(n, -1).astype(float), rcond=None)[0]
    found = demodulate(frames, steps, noise=Noise(1.0))
    assert np.abs(wrap(found.phase.ravel() - np.arctan2(s, c))).max() <= 1e-5
    np.testing.assert_allclose(found.modulation.ravel(), np.hypot(c, s), rtol=1e-5)
    np.testing.assert_allclose(found.background.ravel(), a, rtol=1e-5)
    assert found.phase.dtype == found.sigma.dtype == np.float32
    assert found.valid.all()


def test_arctangent_is_good_all_round_and_on_the_axes():
    phi = np.concatenate([np.linspace(-np.pi, np.pi, 200_001), np.arange(-4, 5) * np.pi / 4])
    frames = np.stack([1e4 * np.cos(phi + d) for d in np.deg2rad([0, 90, 180, 270])])[:, None, :]
    found = demodulate(frames, np.deg2rad([0, 90, 180, 270]), noise=Noise(1.0), dark_level=-1e9)
    assert np.abs(np.angle(np.exp(1j * (found.phase[0] - phi)))).max() < 5e-6
    assert found.phase.astype(float).max() <= np.pi
    assert found.phase.astype(float).min() > -np.pi


def test_half_a_turn_stays_inside_the_range(fringes):
    # The contract is (-pi, pi] in real numbers; float32's own pi lies outside it, the number below it is 1.5e-7 off.
    for phi in (np.pi, -np.pi, np.nextafter(-np.pi, 0)):
        for steps in (THREE, np.deg2rad([0, 90, 180, 270])):
            found = demodulate(fringes(np.full((4, 40), phi), steps), steps, noise=Noise(1.0)).phase.astype(float)
            assert (np.abs(np.abs(found) - np.pi) < 2e-7).all()
            assert ((found > -np.pi) & (found <= np.pi)).all()


def test_what_is_far_dimmer_than_the_picture_is_no_fringe(fringes):
    # Stray light of 3 % of the modulation, without noise that would betray it; 8 % is still measured.
    modulation = np.full(SHAPE, 80.0)
    modulation[:20], modulation[20:40] = 2.4, 6.4
    found = demodulate(fringes(plane(), THREE, 120, modulation), THREE, noise=Noise(0.01))
    np.testing.assert_array_equal(found.reasons == Reason.LOW_MODULATION, modulation == 2.4)
    every = demodulate(fringes(plane(), THREE, 120, modulation), THREE, noise=Noise(0.01), min_modulation=0.0)
    assert every.valid.all()


@pytest.mark.parametrize("n", [3, 4, 5, 8])
def test_white_noise_gives_the_published_uncertainty(n, fringes, wrap, rng):
    # u(phi) = sqrt(2/N) sigma/B. 100 x 19200 draws: relative spread of the estimate 0.05 %; the second-order
    # term in u, 1 + u^2 at u = 0.02, is smaller still.
    steps, sigma, modulation = 2 * np.pi * np.arange(n) / n, 2.0, 80.0
    truth, clean = plane(), fringes(plane(), steps)
    squares = []
    for _ in range(100):
        noisy = clean + sigma * rng.standard_normal(clean.shape)
        # One pixel in 10^6 is a misfit by chance (five sigma) and left out.
        squares.append(np.nanmean(wrap(demodulate(noisy, steps, noise=Noise(sigma)).phase - truth) ** 2))
    expected = np.sqrt(2 / n) * sigma / modulation
    assert np.sqrt(np.mean(squares)) == pytest.approx(expected, rel=0.02)
    stated = demodulate(clean, steps, noise=Noise(sigma)).sigma
    np.testing.assert_allclose(stated, expected, rtol=1e-5)


def test_shot_noise_varies_along_the_fringe_as_published(fringes, wrap, rng):
    # var = 2 (g A + r^2)/(3 B^2) - g B cos(3 phi)/(3 B^2); A = 120, B = 80, g = 0.25, r = 1: ratio 1.95.
    a, b, g, r = 120.0, 80.0, 0.25, 1.0
    phi = np.repeat(np.linspace(-np.pi, np.pi, 97)[:-1, None], 4000, axis=1)
    clean = fringes(phi, THREE, a, b)
    variance = 2 * (g * a + r**2) / (3 * b**2) - g * b * np.cos(3 * phi) / (3 * b**2)
    assert variance.max() / variance.min() == pytest.approx(1.95, abs=0.01)
    found = demodulate(clean, THREE, noise=Noise(r, g))
    np.testing.assert_allclose(found.sigma**2, variance, rtol=1e-4)
    noisy = clean + rng.standard_normal(clean.shape) * np.sqrt(g * clean + r**2)
    error = wrap(demodulate(noisy, THREE, noise=Noise(r, g)).phase - phi)
    # The variance of 4000 draws is known to 2.2 %; five of that for 96 tries.
    np.testing.assert_allclose(error.var(axis=1), variance[:, 0], rtol=0.12)
    coefficient = 2 * np.mean(error.var(axis=1) * np.cos(3 * phi[:, 0]))
    assert coefficient == pytest.approx(-0.00104, abs=0.00005)


@pytest.mark.parametrize(("n", "sigma", "gain"), [(3, 1.2, 0.0), (3, 1.0, 0.25), (4, 2.0, 0.1), (5, 1.0, 0.25)])
def test_per_pixel_interval_covers_95_percent_with_the_estimated_noise(n, sigma, gain, fringes, camera, wrap, rng):
    # Everything as a user has it: 8 bit, shading, texture, noise not stated. 93..97 %, and never off
    # because of rounding: 76800 px leave 0.1 % of chance.
    shape = (240, 320)
    truth = plane(23.0, 71.0, shape)
    shading = 1 - 0.3 * np.linspace(-1, 1, shape[1]) ** 2
    texture = shading * (1 + 0.05 * rng.standard_normal(shape))
    steps = 2 * np.pi * np.arange(n) / n
    frames = camera(texture * fringes(truth, steps, 120, 75), rng, sigma=sigma, gain=gain)
    found = demodulate(frames, steps)
    error = wrap(found.phase - truth)[found.valid]
    covered = np.abs(error) <= 1.96 * found.sigma[found.valid]
    assert found.valid.mean() > 0.99
    assert 0.93 <= covered.mean() <= 0.97


@pytest.mark.parametrize(("modulation", "printed"), [(100.0, 0.00236), (10.0, 0.0236)])
def test_quantisation_is_the_rounding_noise(modulation, printed, fringes, wrap):
    # sqrt(2/N)/(sqrt(12) B), printed for N = 3; the simulated 0.00233 and 0.0220 differ by up to 7 %.
    frames = np.rint(fringes(plane(17.3719, 33.0, (300, 300)), THREE, 120.0, modulation)).astype(np.uint8)
    found = demodulate(frames, THREE, noise=Noise(1 / np.sqrt(12)))
    assert np.median(found.sigma) == pytest.approx(printed, rel=0.01)
    error = wrap(found.phase - plane(17.3719, 33.0, (300, 300)))
    assert error.std() == pytest.approx(printed, rel=0.1)


def test_flags_name_the_cause(fringes):
    frames = np.rint(fringes(plane(), THREE, 120, 80)).astype(np.float64)
    frames[:, 0, 0] = 0  # dark, and without modulation
    frames[0, 0, 1] = 255  # saturated in one frame
    frames[:, 0, 2] = 120  # no modulation
    found = demodulate(frames.astype(np.uint8), THREE, noise=Noise(1.0))
    assert found.reasons[0, 0] == Reason.DARK | Reason.LOW_MODULATION
    assert found.reasons[0, 1] == Reason.SATURATED
    assert found.reasons[0, 2] == Reason.LOW_MODULATION
    assert (found.reasons.ravel()[3:] == 0).all()
    assert np.isnan(found.phase[0, :3]).all()
    assert np.isnan(found.sigma[0, :3]).all()
    shares = found.shares()
    assert shares["valid"] == pytest.approx(1 - 3 / found.phase.size)
    assert shares["saturated"] == pytest.approx(1 / found.phase.size)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_pixel_that_is_no_number_is_outside_and_harms_no_other(bad, fringes):
    frames = fringes(plane(), THREE)
    frames[1, 5, 7] = bad
    found = demodulate(frames, THREE, noise=Noise(1.0))
    assert found.reasons[5, 7] & Reason.OUTSIDE
    assert found.valid.sum() == found.phase.size - 1
    assert np.isfinite(found.phase[found.valid]).all()


def test_twelve_bit_frames_saturate_at_their_own_white(fringes):
    frames = np.minimum(fringes(plane(), THREE, 3000, 1500), 4095).astype(np.uint16)
    found = demodulate(frames, THREE, white_level=4095, noise=Noise(2.0))
    np.testing.assert_array_equal((found.reasons & Reason.SATURATED) > 0, frames.max(axis=0) >= 4095)
    assert not (demodulate(frames, THREE, noise=Noise(2.0)).reasons & Reason.SATURATED).any()


@pytest.mark.parametrize("value", [0, 77, 255])
def test_constant_pictures_have_no_valid_pixel(value):
    found = demodulate(np.full((3, 40, 50), value, np.uint8), THREE)
    assert not found.valid.any()
    assert ((found.reasons & Reason.LOW_MODULATION) > 0).all()


def test_noise_alone_rarely_passes_for_a_phase(rng):
    # C and S are normal with sqrt(2/3) sigma, B is Rayleigh, so u = sqrt(2/3) sigma/B <= 0.25 happens
    # in exp(-1/(2 0.25^2)) = 0.034 % of the pixels; 10^6 pixels know that to 6 %.
    frames = 500 + 5 * rng.standard_normal((3, 1000, 1000))
    share = demodulate(frames, THREE, noise=Noise(5.0)).valid.mean()
    assert share == pytest.approx(np.exp(-1 / (2 * MAX_SIGMA_RAD**2)), rel=0.25)


def test_a_frame_that_does_not_belong_is_a_misfit(fringes):
    four = np.deg2rad([0, 90, 180, 270])
    frames = fringes(plane(), four)
    frames[2, 10:20, 10:20] = 120.0
    found = demodulate(frames, four, noise=Noise(1.0))
    flagged = (found.reasons & Reason.MISFIT) > 0
    # Frames 0 and 2 should add up to 2 A; what is missing, B |cos(phi)|, leaves a residual of a quarter of it
    # in each of four frames: rms B |cos(phi)| / 2 with one degree of freedom.
    block = np.zeros(SHAPE, bool)
    block[10:20, 10:20] = True
    assert not flagged[~block].any()
    assert flagged[block & (np.abs(np.cos(plane())) > 0.6)].all()


def test_three_frames_cannot_misfit(fringes):
    frames = fringes(plane(), THREE)
    frames[1] = 40.0
    assert not (demodulate(frames, THREE, noise=Noise(1.0)).reasons & Reason.MISFIT).any()


def test_named_scheme_and_reused_buffers(fringes, wrap):
    five = scheme("hariharan-5")
    frames = fringes(plane(), five.phase_shifts_rad)
    first = demodulate(frames, five, noise=Noise(1.0))
    assert np.abs(wrap(first.phase - plane())).max() < 1e-5
    again = demodulate(frames[::-1], five, noise=Noise(1.0), out=first)
    assert again.phase is first.phase
    assert np.abs(wrap(again.phase + plane())).max() < 1e-5  # frames in reverse order mirror the phase


def test_answer_does_not_depend_on_threads_or_memory_layout(fringes, rng):
    import numba

    frames = rng.integers(0, 255, (3, 257, 511), dtype=np.uint8)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = demodulate(frames, THREE)
    finally:
        numba.set_num_threads(before)
    many = demodulate(np.asfortranarray(frames), THREE)
    for name in ("phase", "modulation", "background", "sigma", "reasons"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (np.zeros((2, 9, 9)), "one frame per phase shift"),
        (np.zeros((3, 9)), "one frame per phase shift"),
        (np.zeros((3, 0, 9)), "none empty"),
        (np.zeros((3, 9, 9), complex), "integers or real"),
        (np.array([["a"] * 3] * 3), "one frame per phase shift"),
    ],
)
def test_wrong_shapes_and_types_are_refused(frames, message):
    with pytest.raises(PhaseError, match=message):
        demodulate(frames, THREE)


def test_out_of_another_shape_is_refused():
    empty = [np.empty((4, 4), np.float32) for _ in range(4)]
    out = PhaseMap(*empty, np.empty((4, 4), np.uint8), Noise(1.0))
    with pytest.raises(PhaseError, match="out has maps of shape"):
        demodulate(np.zeros((3, 5, 5)), THREE, noise=Noise(1.0), out=out)


@pytest.mark.parametrize(("read_sigma", "gain"), [(-1.0, 0.0), (np.nan, 0.0), (1.0, -0.1), (np.inf, 0.0)])
def test_impossible_noise_is_refused(read_sigma, gain):
    with pytest.raises(PhaseError, match="impossible"):
        Noise(read_sigma, gain)


def test_convention_on_a_real_capture(lens_frames):
    # Known of these pictures: with I = A + B cos(phi + d), d = 0, 90, 180, 270 by file name, the phase FALLS
    # with +x, and the mean period along a row of the board is about 22.3 px, growing to the right.
    found = demodulate(lens_frames, np.deg2rad([0, 90, 180, 270]))
    board = np.s_[190:260, 80:730]
    assert found.valid[board].mean() > 0.99
    along_u, _ = phase_gradient(found.phase[board], found.valid[board])
    assert 2 * np.pi / -np.nanmean(along_u) == pytest.approx(22.3, abs=0.2)
    left, right = fringe_period(found.phase[190:260, 80:280]), fringe_period(found.phase[190:260, 530:730])
    assert left.period_px < 20 < 26 < right.period_px
    assert abs(left.direction_deg) > 179


def test_periods_of_a_real_three_step_capture(kamino_frames):
    # Its notes: about 75 to 76 px and 115 px; swapping the first and last frame must turn the phase round.
    steps = np.deg2rad([-120, 0, 120])
    for frames, expected, tolerance in zip(kamino_frames, (75.5, 115.0), (2.0, 4.0), strict=True):
        found = demodulate(frames, steps)
        forward = fringe_period(found.phase, found.valid)
        assert forward.period_px == pytest.approx(expected, abs=tolerance)
        assert forward.gradient_rad_px[0] > 0
        backward = fringe_period(demodulate(frames[::-1], steps).phase)
        assert backward.gradient_rad_px[0] == pytest.approx(-forward.gradient_rad_px[0], rel=0.01)


def test_n_bucket_and_given_steps_agree(fringes):
    frames = fringes(plane(), 2 * np.pi * np.arange(6) / 6)
    a = demodulate(frames, buckets(6), noise=Noise(1.0))
    b = demodulate(frames, 2 * np.pi * np.arange(6) / 6, noise=Noise(1.0))
    np.testing.assert_array_equal(a.phase, b.phase)


def test_compressed_pictures_leave_little_speckle_beside_the_board(lens_frames):
    # Right of the board there is no fringe; the ringing of the compression there is 0.7 levels (median).
    found = demodulate(lens_frames, np.deg2rad([0, 90, 180, 270]))
    assert found.valid[100:840, 750:].mean() < 0.01
    assert found.valid[190:260, 80:730].mean() > 0.999
