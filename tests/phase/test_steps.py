"""The steps that the frames really have: known truth in simulation, published truth in a real capture."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import Noise, carrier, demodulate, estimate_phase_shifts, fringe_period

STATED = np.deg2rad([0, 120, 240])
SHAPE = (360, 480)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
# A plate under diverging light: the period grows from about 11 to 15 px across the field.
PLATE = 2 * np.pi * 40 * V / (SHAPE[0] * (1 + 0.25 * V / SHAPE[0] + 0.03 * U / SHAPE[1])) * 0.8
SHADING = (1 - 0.3 * ((U - 200) / 300) ** 2) * (1 - 0.2 * (V - 100) / 300)


def plate(fringes, camera, rng, errors_deg, *, sigma=1.2, field=0.0, gain=(1, 1, 1), gamma=1.0):
    """Three frames, 8 bit, with wrong steps that may change over the field (deg per 100 px along u)."""
    steps = STATED + np.deg2rad(errors_deg)
    tilt = np.deg2rad(field) * (U - (SHAPE[1] - 1) / 2) / 100
    frames = [
        g * SHADING * 220 * (fringes(PLATE + k * tilt, [step], 0.5, 0.4)[0]) ** gamma
        for k, (g, step) in enumerate(zip(gain, steps, strict=True))
    ]
    return camera(np.stack(frames), rng, sigma=sigma)


def ripple(phase, truth, order):
    """Amplitude of the phase error at `order` times the fringe frequency, rad."""
    error = np.angle(np.exp(1j * (phase - truth)))
    error -= np.nanmean(error)
    return 2 * np.abs(np.nanmean(error * np.exp(-1j * order * truth)))


@pytest.mark.parametrize("errors_deg", [(0, 2.0, -1.0), (0, -1.5, 1.5), (0, 8.0, 5.0), (0, 0, 0)])
def test_hand_set_steps_are_found(errors_deg, fringes, camera, rng):
    # 8 bit, 1.2 grey levels, B = 50 to 90: within 0.05 deg, and the ripple at 2 phi that they cause
    # falls to that of a remaining error of 0.05 deg.
    frames = plate(fringes, camera, rng, errors_deg)
    found = estimate_phase_shifts(frames, STATED)
    np.testing.assert_allclose(np.rad2deg(found.errors_rad), errors_deg, atol=0.05)
    assert found.significant == (max(np.abs(errors_deg)) > 0)
    before = ripple(demodulate(frames, STATED).phase, PLATE, 2)
    after = ripple(demodulate(frames, found.phase_shifts_rad).phase, PLATE, 2)
    assert after < np.deg2rad(0.05)
    if max(np.abs(errors_deg)) > 0:
        assert after < before / 10


def test_symmetric_error_makes_the_closed_form_ripple(fringes, camera, rng):
    # 120 + d and 240 - d: -(d / sqrt3) sin(2 phi) at d = 1 deg.
    frames = plate(fringes, camera, rng, (0, 1.0, -1.0))
    assert ripple(demodulate(frames, STATED).phase, PLATE, 2) == pytest.approx(np.deg2rad(1.0) / np.sqrt(3), rel=0.03)


def test_uncertainty_holds_in_repeated_simulation(fringes, camera, rng):
    # 14 repeats, two steps each: rms of error / u within the chi-square limits of 28 draws (0.74..1.26 at
    # 95 %), widened for what the blocks have in common.
    ratios = []
    for _ in range(14):
        truth = np.array([0, *rng.normal(0, 2, 2)])
        found = estimate_phase_shifts(plate(fringes, camera, rng, truth)[:, :240, :320], STATED)
        ratios.extend((found.errors_rad - np.deg2rad(truth))[1:] / found.u_rad[1:])
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.45


def test_a_step_that_changes_over_the_field(fringes, camera, rng):
    # What a hand-turned mirror does: frame k is off by k x 0.5 deg per 100 px.
    found = estimate_phase_shifts(plate(fringes, camera, rng, (0, 1, 2), field=0.5), STATED)
    along_u, along_v = np.rad2deg(found.gradient_rad_px.T) * 100
    np.testing.assert_allclose(along_u, [0, 0.5, 1.0], atol=0.03)
    np.testing.assert_allclose(along_v, 0, atol=0.03)


def test_gain_of_a_frame_is_found_and_does_not_disturb_the_steps(fringes, camera, rng):
    found = estimate_phase_shifts(plate(fringes, camera, rng, (0, 2, -1), gain=(1.0, 1.03, 0.98)), STATED)
    expected = np.array([1.0, 1.03, 0.98]) / np.mean([1.0, 1.03, 0.98])
    np.testing.assert_allclose(found.gain_per_frame, expected, atol=0.002)
    np.testing.assert_allclose(np.rad2deg(found.errors_rad), [0, 2, -1], atol=0.05)
    # Gain moves background and modulation together: no offset is left, to a fraction of a grey level.
    np.testing.assert_allclose(found.offset_per_frame, 0, atol=0.3)


def test_gamma_does_not_look_like_a_wrong_step(fringes, camera, rng):
    found = estimate_phase_shifts(plate(fringes, camera, rng, (0, 0.5, -0.5), gamma=1.5), STATED)
    np.testing.assert_allclose(np.rad2deg(found.errors_rad), [0, 0.5, -0.5], atol=0.05)


def test_published_steps_of_a_real_capture(lens_frames):
    # Advanced iterative algorithm, published with the data's notes: 0, 90.4, 180.3, 270.1 deg, +- 0.5.
    found = estimate_phase_shifts(lens_frames, np.deg2rad([0, 90, 180, 270]))
    np.testing.assert_allclose(np.rad2deg(found.phase_shifts_rad), [0, 90.4, 180.3, 270.1], atol=0.5)


def test_too_few_fringes_or_none_is_refused(fringes, camera, rng):
    with pytest.raises(PhaseError, match="no pixel carries a phase"):
        estimate_phase_shifts(np.full((3, 64, 64), 90, np.uint8), STATED)
    coarse = camera(fringes(2 * np.pi * U / 400, STATED), rng, sigma=1)
    with pytest.raises(PhaseError, match="more fringes"):
        estimate_phase_shifts(coarse, STATED)


def test_mask_limits_where_steps_are_measured(fringes, camera, rng):
    frames = plate(fringes, camera, rng, (0, 2, -1))
    frames[:, :, 300:] = camera(plate(fringes, camera, rng, (0, -6, 6)).astype(float), rng)[:, :, 300:]
    found = estimate_phase_shifts(frames, STATED, mask=U < 300)
    np.testing.assert_allclose(np.rad2deg(found.errors_rad), [0, 2, -1], atol=0.08)


@pytest.mark.parametrize(("period_px", "direction_deg"), [(9.0, 20.0), (22.3, 180.0), (40.0, -120.0), (75.0, 90.0)])
def test_period_and_direction(period_px, direction_deg, fringes, camera, rng):
    angle = np.deg2rad(direction_deg)
    phi = 2 * np.pi * (U * np.cos(angle) + V * np.sin(angle)) / period_px
    frames = camera(fringes(phi, STATED), rng, sigma=2)
    map_ = demodulate(frames, STATED, noise=Noise(2.0))
    found = fringe_period(map_.phase, map_.valid)
    assert found.period_px == pytest.approx(period_px, rel=0.01)
    assert np.cos(np.deg2rad(found.direction_deg) - angle) > np.cos(np.deg2rad(1.0))
    single = carrier(frames[0])
    assert single.period_px == pytest.approx(period_px, rel=0.01)
    assert abs(np.cos(np.deg2rad(single.direction_deg) - angle)) > np.cos(np.deg2rad(1.0))


def test_no_fringes_no_period(rng):
    with pytest.raises(PhaseError, match="pairs of valid neighbours"):
        fringe_period(np.full((20, 20), np.nan))
    with pytest.raises(PhaseError, match="does not change"):
        fringe_period(np.ones((20, 20)))
    with pytest.raises(PhaseError, match="no fringes"):
        carrier(rng.normal(100, 3, (128, 128)))
    with pytest.raises(PhaseError, match="needed: \\(height, width\\)"):
        carrier(np.zeros((3, 64, 64)))
