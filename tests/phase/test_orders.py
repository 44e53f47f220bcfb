"""Fringe orders by Gray code, reference and two periods; one picture; smoothing."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import (
    Noise,
    decode_gray,
    fourier_phase,
    order_error_rate,
    smooth_phase,
    unwrap_gray,
    unwrap_guided,
    unwrap_temporal,
)

SHAPE = (160, 240)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)


def strips_scene():
    """Five strips, each a step of more than pi, on a plate of tilted fringes: true phase and plate phase."""
    plate = 2 * np.pi * V / 12.3 + 0.01 * U
    on = np.zeros(SHAPE, bool)
    for k in range(5):
        on |= (np.abs(U - 31 - 44 * k) < 11) & (np.abs(V - 80) < 65)
    return plate + np.where(on, 3.9 + 0.6 * V / SHAPE[0], 0.0), plate


def gray_frames(number, bits):
    gray = number ^ (number >> 1)
    return np.stack([(gray >> (bits - 1 - k) & 1) * 160 + 40 for k in range(bits)])


@pytest.mark.parametrize("sigma", [0.0, 0.05, 0.1])
def test_strips_are_right_everywhere_with_known_heights_or_two_periods(sigma, rng, wrap):
    # Every spatial method gets 78 %: the steps exceed pi.
    truth, plate = strips_scene()
    fine = wrap(truth + sigma * rng.standard_normal(SHAPE))
    guided, ambiguous = unwrap_guided(fine, plate, -0.7, 5.2)
    assert not ambiguous.any()
    assert (np.abs(guided - truth) < 1).all()
    # The coarse fringe is the shorter one's third part: |3 e - e'| stays below pi at 10 sigma.
    coarse = truth / 3 + sigma * rng.standard_normal(SHAPE)
    assert order_error_rate(sigma, sigma, 3.0) < 1e-20
    assert (np.abs(unwrap_temporal(coarse, fine, 3.0) - truth) < 1).all()


def test_a_range_of_more_than_a_fringe_leaves_pixels_undecided(wrap):
    truth, plate = strips_scene()
    found, ambiguous = unwrap_guided(wrap(truth), plate, -0.5, 7.5)
    # Differences from -0.5 to 7.5 - 2 pi = 1.22 fit twice: the plate; those of the strips, 3.9 to 4.5, once.
    np.testing.assert_array_equal(ambiguous, truth - plate < 1)
    assert np.isnan(found[ambiguous]).all()
    np.testing.assert_allclose(found[~ambiguous], truth[~ambiguous], atol=1e-9)


def test_a_phase_out_of_range_and_nan_get_no_order():
    found, ambiguous = unwrap_guided([[2.0, np.nan, 0.1]], np.zeros((1, 3)), -0.5, 1.0)
    assert np.isnan(found[0, :2]).all()
    assert found[0, 2] == pytest.approx(0.1)
    assert not ambiguous.any()


def test_gray_code_gives_the_order_at_every_pixel(rng, wrap, camera):
    truth, _ = strips_scene()
    number = np.floor(truth / (2 * np.pi) + 0.5).astype(int)  # jumps where the phase in (-pi, pi] does
    frames = camera(gray_frames(number, 5).astype(float), rng, sigma=2.0)
    white, black = np.full(SHAPE, 200.0), np.full(SHAPE, 40.0)
    code, valid = decode_gray(frames, white, black)
    np.testing.assert_array_equal(code, number)
    assert valid.all()
    np.testing.assert_allclose(unwrap_gray(wrap(truth), code), truth, atol=1e-9)


def test_complementary_code_repairs_what_a_blurred_edge_breaks(rng, wrap):
    # The code's edges lie up to 1.2 rad off the phase's jump; the half code's edges as much off the middle.
    truth, _ = strips_scene()
    off = 1.2 * np.sin(0.9 * U + 0.3 * V)
    number = np.floor((truth + off) / (2 * np.pi) + 0.5).astype(int)
    half = np.floor((truth + off) / np.pi + 1.0).astype(int)  # 2 k in the first half of fringe k, 2 k + 1 after
    plain = np.abs(unwrap_gray(wrap(truth), number) - truth) < 1
    assert 0.5 < plain.mean() < 0.95
    np.testing.assert_allclose(unwrap_gray(wrap(truth), number, half_code=half), truth, atol=1e-9)


def test_gray_code_says_where_it_cannot_be_read():
    frames = gray_frames(np.arange(8)[None].repeat(4, axis=0), 3).astype(float)
    frames[1, 2, 5] = 122.0  # between the levels
    white, black = np.full((4, 8), 200.0), np.full((4, 8), 40.0)
    white[0, 0] = 43.0
    code, valid = decode_gray(frames, white, black)
    assert not valid[2, 5]
    assert not valid[0, 0]
    assert valid.sum() == valid.size - 2
    with pytest.raises(PhaseError, match="1 to 30 bits"):
        decode_gray(frames, white[:2], black)
    with pytest.raises(PhaseError, match="the half code"):
        unwrap_gray(np.zeros((4, 8)), code, half_code=np.zeros(3))


def test_one_picture_gives_the_phase_of_a_smooth_surface(rng, wrap, camera):
    truth = 2 * np.pi * (V * 0.95 + 0.3 * U) / 9 + 1.5 * np.exp(-((U - 120) ** 2 + (V - 80) ** 2) / 1500)
    frame = camera((1 - 0.2 * (U / 120 - 1) ** 2) * (110 + 70 * np.cos(truth)), rng, sigma=1.5)
    found = fourier_phase(frame, noise=Noise(1.5))
    inner = np.s_[25:-25, 25:-25]
    assert found.valid[inner].all()
    assert not found.valid[:5].any()
    error = wrap(found.phase - truth)[inner]
    # Half the fringes' frequency passes, so the bump (1/e radius 39 px) does. What is left comes from the
    # borders, where the picture does not join up with itself: below 1/250 fringe.
    assert np.sqrt(np.mean(error**2)) < 2 * np.pi / 250
    assert np.median(found.modulation[inner]) == pytest.approx(70 * 0.94, rel=0.05)


def test_stated_noise_of_one_picture_is_what_it_has(wrap, camera):
    # Fringes of a whole number of periods, so that the window leaves no leakage: only noise is in the error.
    truth = 2 * np.pi * V / 10
    errors = []
    for seed in range(6):
        frame = camera(110 + 70 * np.cos(truth), np.random.default_rng(seed), sigma=3.0)
        found = fourier_phase(frame, noise=Noise(3.0))
        errors.append(wrap(found.phase - truth)[20:-20, 20:-20].std())
    assert np.median(found.sigma[20:-20, 20:-20]) == pytest.approx(np.mean(errors), rel=0.1)


def test_one_picture_without_fringes_is_refused(rng):
    with pytest.raises(PhaseError, match="no fringes found"):
        fourier_phase(rng.normal(100, 2, (64, 64)))
    with pytest.raises(PhaseError, match="filter width"):
        fourier_phase(np.zeros((64, 64)), width=1.5)


@pytest.mark.parametrize(("kind", "size", "factor"), [("mean", 3, 1 / 3), ("mean", 5, 1 / 5), ("median", 3, 0.41)])
def test_smoothing_lowers_noise_and_leaves_jumps(kind, size, factor, rng, wrap):
    # A mean of m values divides noise by sqrt(m), a median of 9 normal values leaves 0.408 (Kendall and Stuart).
    truth = 3 + 0.002 * (V + 0.2 * U)  # slow, for the median; through a jump in the middle
    found = smooth_phase(wrap(truth + 0.05 * rng.standard_normal(SHAPE)), kind=kind, size=size)
    inner = wrap(found - truth)[5:-5, 5:-5]
    assert inner.std() == pytest.approx(0.05 * factor, rel=0.05)
    assert np.abs(inner).max() < 0.15


def test_smoothing_keeps_the_mask_and_lets_no_nan_out():
    phase = np.full((9, 9), 3.1)
    phase[4, 4] = np.nan
    phase[:, 5:] = -3.1
    found = smooth_phase(phase)
    assert np.isnan(found).sum() == 1
    assert (np.abs(found[np.isfinite(found)]) >= 3.09).all()
    with pytest.raises(PhaseError, match="odd size"):
        smooth_phase(phase, size=4)
