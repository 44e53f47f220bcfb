"""Noise found from the pictures themselves, where texture, fringes and edges try to be taken for it."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import Noise, estimate_noise, noise_from_repeats

THREE = np.deg2rad([0, 120, 240])
SHAPE = (300, 400)
ROUNDING = 1 / 12


def scene(period_px, angle_deg, rng, fringes, texture=0.0, steps=THREE):
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    angle = np.deg2rad(angle_deg)
    phi = 2 * np.pi * (u * np.cos(angle) + v * np.sin(angle)) / period_px
    phi += np.where(u > 250, 1.3, 0.0)  # an edge of an object
    albedo = (1 - 0.3 * (u / 200 - 1) ** 2) * (1 + texture * rng.standard_normal(SHAPE))
    return albedo * fringes(phi, steps)


@pytest.mark.parametrize(("period_px", "angle_deg"), [(12, 90), (8, 45), (30, 10), (200, 0)])
@pytest.mark.parametrize("texture", [0.0, 0.1])
def test_read_noise_is_found_whatever_the_scene(period_px, angle_deg, texture, rng, fringes, camera):
    # Rounding adds 1/12; 5 %: the median of 10^5 correlated differences, and the line's split into two terms.
    for sigma in (1.0, 3.0):
        frames = camera(scene(period_px, angle_deg, rng, fringes, texture), rng, sigma=sigma)
        found = estimate_noise(frames, THREE)
        level = frames.mean()
        assert found.sigma(level) == pytest.approx(np.sqrt(sigma**2 + ROUNDING), rel=0.05)


@pytest.mark.parametrize("n", [3, 4, 8])
def test_gain_is_found(n, rng, fringes, camera):
    steps = 2 * np.pi * np.arange(n) / n
    frames = camera(scene(25, 70, rng, fringes, 0.05, steps), rng, sigma=1.0, gain=0.25)
    found = estimate_noise(frames, steps)
    # The slope rests on a range of brightness of 1:3 and on 12 bins.
    assert found.gain == pytest.approx(0.25, rel=0.08)
    for grey in (60.0, 120.0, 200.0):
        assert found.sigma(grey) == pytest.approx(np.sqrt(1 + ROUNDING + 0.25 * grey), rel=0.05)


def test_gamma_is_not_taken_for_noise(rng, fringes, camera):
    frames = 255 * (scene(20, 60, rng, fringes) / 255) ** 2.2
    found = estimate_noise(camera(frames, rng, sigma=1.5), THREE)
    assert found.sigma(80.0) == pytest.approx(np.sqrt(1.5**2 + ROUNDING), rel=0.05)


def test_repeats_give_read_noise_and_gain(rng, fringes, camera):
    clean = scene(20, 60, rng, fringes, 0.3)
    found = noise_from_repeats(np.stack([camera(clean, rng, sigma=1.0, gain=0.2) for _ in range(3)]), white_level=255)
    assert found.gain == pytest.approx(0.2, rel=0.05)
    assert found.read_sigma == pytest.approx(np.sqrt(1 + ROUNDING), rel=0.15)


@pytest.mark.parametrize("value", [0, 90, 255])
def test_integers_never_have_less_than_the_noise_of_rounding(value):
    found = estimate_noise(np.full((3, 32, 32), value, np.uint8), THREE)
    assert (found.read_sigma, found.gain) == (pytest.approx(np.sqrt(ROUNDING)), 0.0)


def test_pictures_without_a_number_have_no_noise_to_estimate():
    assert estimate_noise(np.full((3, 32, 32), np.nan), THREE) == Noise(0.0)


def test_wrong_shapes_are_refused():
    with pytest.raises(PhaseError, match="at least 16 x 16"):
        estimate_noise(np.zeros((3, 8, 8)), THREE)
    with pytest.raises(PhaseError, match="3 phase shifts need"):
        estimate_noise(np.zeros((4, 80, 80)), THREE)
    with pytest.raises(PhaseError, match="R >= 2"):
        noise_from_repeats(np.zeros((1, 3, 8, 8)))
