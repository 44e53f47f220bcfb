"""Schemes against closed forms and the published errors of each under a wrong step, gamma and clipping."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import buckets, carre, least_squares, scheme
from fringecal.thesis import quadrant_phase

PHI = np.linspace(-np.pi, np.pi, 3601)[:-1] + 1e-4
NAMES = ["three-120", "three-90", "four", "hariharan-5", "schwider-4", "8-bucket"]


def demodulated(weights, frames):
    _, c, s = weights @ frames
    return np.arctan2(s, c)


def amplitude(error, phi, order):
    """Amplitude of sin(order phi) in an error, by projection."""
    return 2 * np.mean(error * np.sin(order * phi))


@pytest.mark.parametrize("name", NAMES)
def test_every_named_scheme_returns_phase_modulation_and_background(name, fringes):
    found = scheme(name)
    a, c, s = found.weights @ fringes(PHI, found.phase_shifts_rad, 90.0, 35.0)
    np.testing.assert_allclose(np.arctan2(s, c), PHI, atol=1e-12)
    np.testing.assert_allclose(np.hypot(c, s), 35.0, rtol=1e-12)
    np.testing.assert_allclose(a, 90.0, rtol=1e-12)


def test_textbook_numerators_and_denominators():
    # Steps 0, 120, 240: N = sqrt3 (I3 - I2), D = 2 I1 - I2 - I3, both 3 B.
    # Steps 0, 90, 180: N = I1 + I3 - 2 I2, D = I1 - I3, both 2 B.
    np.testing.assert_allclose(
        3 * scheme("three-120").weights[1:], [[2, -1, -1], [0, -np.sqrt(3), np.sqrt(3)]], atol=1e-12
    )
    np.testing.assert_allclose(2 * scheme("three-90").weights[1:], [[1, 0, -1], [1, -2, 1]], atol=1e-12)
    np.testing.assert_allclose(2 * scheme("four").weights[1:], [[1, 0, -1, 0], [0, -1, 0, 1]], atol=1e-12)


@pytest.mark.parametrize(("half_step_deg", "low", "rms", "high"), [(90, 0.707, 1.0, 1.225), (60, 0.816, 1.826, 2.449)])
def test_noise_of_three_unequal_steps_depends_on_phase_as_published(half_step_deg, low, rms, high):
    # Steps -a, 0, +a: min, rms and max of u(phi) B / sigma, three digits as printed.
    _, wc, ws = least_squares(np.deg2rad([-half_step_deg, 0, half_step_deg])).weights
    u2 = ((np.cos(PHI)[:, None] * ws - np.sin(PHI)[:, None] * wc) ** 2).sum(axis=1)
    assert np.sqrt([u2.min(), u2.mean(), u2.max()]) == pytest.approx([low, rms, high], abs=6e-4)


@pytest.mark.parametrize("n", [3, 4, 5, 8])
def test_equal_steps_are_optimal(n):
    assert buckets(n).noise_gain == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("d_deg", [0.2, 1.0])
def test_one_wrong_step_of_three_ripples_at_twice_the_fringe_frequency(d_deg, fringes, wrap):
    # Both outer steps 120 deg + d: dphi = -(d / sqrt3) sin(2 phi); 0.577 deg at d = 1 deg, exactly 0.580.
    d = np.deg2rad(d_deg)
    frames = fringes(PHI, [-2 * np.pi / 3 - d, 0, 2 * np.pi / 3 + d])
    weights = least_squares(np.deg2rad([-120, 0, 120])).weights
    error = wrap(demodulated(weights, frames) - PHI)
    assert amplitude(error, PHI, 2) == pytest.approx(-d / np.sqrt(3), rel=0.01)
    c = np.sqrt(3) * np.sin(2 * np.pi / 3 + d) / (1 - np.cos(2 * np.pi / 3 + d))
    exact = np.arctan2(c * np.sin(PHI), np.cos(PHI))
    np.testing.assert_allclose(wrap(demodulated(weights, frames) - exact), 0, atol=1e-12)
    if d_deg == 1.0:
        assert np.rad2deg(np.abs(error).max()) == pytest.approx(0.580, abs=0.001)


@pytest.mark.parametrize(("name", "peak_deg"), [("four", 0.500), ("hariharan-5", 0.00436), ("schwider-4", 0.013)])
def test_a_linear_step_error_of_one_degree(name, peak_deg, fringes, wrap):
    # Every step 1 deg too large. Four: d/2 = 0.500 deg; Hariharan: d^2/4 = 0.00436 deg. Schwider's weights
    # are blind at first order: what is left is d^2 = 0.017 deg times a number below one.
    found = scheme(name)
    steps = np.asarray(found.phase_shifts_rad) * (91 / 90)
    error = wrap(demodulated(found.weights, fringes(PHI, steps)) - PHI)
    ripple = np.rad2deg(np.ptp(error) / 2)
    if name == "schwider-4":
        assert ripple < peak_deg
    elif name == "four":
        # Steps that begin at 0 shift the mean phase; what is left is a ripple of peak d/2.
        assert ripple == pytest.approx(peak_deg, abs=0.005)
    else:
        assert ripple == pytest.approx(peak_deg, rel=0.01)


@pytest.mark.parametrize("alpha_deg", [35.0, 45.0, 55.0])
def test_carre_does_not_care_about_the_step(alpha_deg, fringes, wrap):
    frames = fringes(PHI, np.deg2rad(alpha_deg) * np.array([-3, -1, 1, 3]))
    found = carre(frames)
    # The radicand vanishes with sin(phi): rounding may take it below zero there, and nowhere else.
    assert np.isnan(found).mean() < 0.002
    np.testing.assert_allclose(wrap(found - PHI)[~np.isnan(found)], 0, atol=1e-6)


def test_carre_needs_four_frames():
    with pytest.raises(PhaseError, match="exactly 4"):
        carre(np.zeros((3, 5)))


@pytest.mark.parametrize("share", [0.001, 0.01])
def test_one_bright_frame_ripples_once_per_fringe(share, fringes, wrap):
    # Frame 1 brighter by e: S is untouched and C gains 2 e I1 / 3, so to first order in e
    # dphi = -(2 e / 3)(A/B) sin(phi) - (e / 3) sin(2 phi).
    frames = fringes(PHI, np.deg2rad([0, 120, 240]), 120.0, 80.0)
    frames[0] *= 1 + share
    error = wrap(demodulated(scheme("three-120").weights, frames) - PHI)
    assert amplitude(error, PHI, 1) == pytest.approx(-2 * share / 3 * 1.5, rel=2 * share)
    assert amplitude(error, PHI, 2) == pytest.approx(-share / 3, rel=5 * share)


def test_clipping_costs_what_is_printed(fringes, wrap):
    # A = 140, B = 130 clipped at 255: 0.85 deg peak.
    frames = np.minimum(fringes(PHI, np.deg2rad([0, 120, 240]), 140.0, 130.0), 255)
    error = np.rad2deg(wrap(demodulated(scheme("three-120").weights, frames) - PHI))
    assert np.abs(error).max() == pytest.approx(0.85, abs=0.01)


@pytest.mark.parametrize(
    ("gamma", "peak", "rms"), [(1.1, 1.69, 1.20), (1.5, 7.97, 5.63), (2.2, 16.67, 11.75), (2.8, 22.09, 15.53)]
)
def test_gamma_ripple_is_the_closed_form(gamma, peak, rms, wrap):
    # (0.5 + 0.5 cos)^g has a_{k+1}/a_k = (g - k)/(g + k + 1); peak and rms in deg as printed.
    delta = np.deg2rad([0, 120, 240])[:, None]
    frames = (0.5 + 0.5 * np.cos(PHI + delta)) ** gamma
    error = wrap(demodulated(scheme("three-120").weights, frames) - PHI)
    assert np.rad2deg([np.abs(error).max(), error.std()]) == pytest.approx([peak, rms], abs=0.02)
    a = np.cumprod([1.0, *[(gamma - k) / (gamma + k + 1) for k in range(1, 7)]])  # a1 .. a7 over a1
    a1, a2, _, a4, a5, _, a7 = a
    exact = np.arctan2(
        -(a2 - a4) * np.sin(3 * PHI) - (a5 - a7) * np.sin(6 * PHI),
        a1 + (a2 + a4) * np.cos(3 * PHI) + (a5 + a7) * np.cos(6 * PHI),
    )
    # The printed form leaves out a8 onward: 0.012 deg.
    assert np.rad2deg(np.abs(wrap(error - exact)).max()) < 0.02


def test_the_other_sign_convention_mirrors_the_phase(fringes):
    # Frames A + B cos(phi - delta) read with steps delta give 2 pi - phi.
    delta = np.deg2rad([0, 90, 180, 270])
    _, c, s = scheme("four").weights @ fringes(PHI, -delta)
    np.testing.assert_allclose(quadrant_phase(s, c), (-PHI) % (2 * np.pi), atol=1e-9)


@pytest.mark.parametrize(
    ("steps_deg", "message"),
    [
        ([0, 120], "at least 3 are needed"),
        ([], "at least 3 are needed"),
        ([0, 120, 120], "do not determine"),
        ([0, 180, 360], "do not determine"),
        ([0, 360, 720], "do not determine"),
        ([0, 1, 2], "do not determine"),
        ([0, 120, np.nan], "not all finite"),
        ([0, 120, np.inf], "not all finite"),
    ],
)
def test_steps_that_determine_nothing_are_refused(steps_deg, message):
    with pytest.raises(PhaseError, match=message):
        least_squares(np.deg2rad(steps_deg))


@pytest.mark.parametrize("name", ["", "five", "bucket", "x-bucket", "3-buckets"])
def test_unknown_scheme_lists_the_known(name):
    with pytest.raises(PhaseError, match="hariharan-5"):
        scheme(name)


def test_radians_stated_as_degrees_are_asked_about():
    with pytest.raises(PhaseError, match="look like radians: state degrees, 0, 119.977, 240.012"):
        least_squares(np.deg2rad([0, 2.094, 4.189]))
    with pytest.raises(PhaseError) as error:
        least_squares(np.deg2rad([0, 0, 180]))
    assert "radians" not in str(error.value)
