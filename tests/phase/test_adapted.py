"""Frames that do not fit the stated model: undone where it is sure and matters, left alone where not."""

from dataclasses import replace

import numpy as np
import pytest

from fringecal.phase import Waveform, demodulate
from fringecal.phase.demodulation import adapted
from fringecal.phase.demodulation.adapted import demodulate_adapted

SHAPE = (200, 280)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
PLATE = 2 * np.pi * (V + 0.25 * U) / 15
# Unevenly painted and lit, so that a factor on the light and an added level are different things.
PAINT = (1 - 0.4 * (U / 180 - 1) ** 2) * (1 - 0.2 * V / SHAPE[0])
STEPS = {n: 2 * np.pi * np.arange(n) / n for n in (3, 4, 5)}


def shot(steps, camera, rng, *, exponent=1.0, errors_deg=0.0, over_field_deg=0.0, lamp=1.0, blur=1.0, added=0.0):
    count = len(steps)
    per_frame = (np.broadcast_to(value, count) for value in (errors_deg, over_field_deg, lamp, blur, added))
    frames = []
    for step, error, change, light, weak, more in zip(steps, *per_frame, strict=True):
        phase = PLATE + step + np.deg2rad(error + change * (U / (SHAPE[1] - 1) - 0.5))
        wave = 2 * (0.5 + 0.5 * np.cos(phase)) ** exponent
        frames.append(PAINT * light * (30 + 85 * (1 + weak * (wave - 1))) + more)
    return camera(np.stack(frames), rng, sigma=0.7)


def ripple(phase):
    """Rms of what hangs on the phase: the mean error in 24 bins of the fringe."""
    error = np.angle(np.exp(1j * (phase - PLATE)))
    known = np.isfinite(error)
    place = (np.mod(PLATE[known], 2 * np.pi) * 24 / (2 * np.pi)).astype(int)
    means = np.bincount(place, error[known] - error[known].mean()) / np.bincount(place)
    return float(np.sqrt(np.mean(means**2)))


FAULTS = {
    "gamma": {"exponent": 1.4},
    "strong gamma": {"exponent": 2.2},
    "steps": {"errors_deg": (0, 3, -3)},
    "lamp": {"lamp": (1, 1.05, 0.97)},
    "vibration": {"blur": (1, 0.85, 1)},
    "black level": {"added": (0, 5, -2)},
    "all at once": {"exponent": 1.4, "errors_deg": (0, 3, -2), "lamp": (1, 1.05, 0.97), "over_field_deg": (0, 3, -4)},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_the_frames_show_is_undone(fault, camera, rng):
    frames = shot(STEPS[3], camera, rng, **FAULTS[fault])
    found = demodulate_adapted(frames, STEPS[3])
    # Bins of 2300 pixels of 0.01 rad noise hold 0.0002; 0.003 is what the procedure leaves alone.
    assert ripple(demodulate(frames, STEPS[3]).phase) > 0.015
    assert ripple(found.map.phase) < 0.003
    assert found.undone


@pytest.mark.parametrize("n", [3, 4, 5])
def test_a_clean_set_is_left_as_it_is(n, camera, rng):
    frames = shot(STEPS[n], camera, rng)
    found = demodulate_adapted(frames, STEPS[n])
    assert found.undone == ()
    np.testing.assert_array_equal(found.map.phase, demodulate(frames, STEPS[n]).phase)


def test_four_frames_of_strong_gamma_are_no_misfit(camera, rng):
    # A second harmonic of 29 % leaves a residual beyond the 15 % that a pixel may have; its cause is known.
    frames = shot(STEPS[4], camera, rng, exponent=2.2)
    assert demodulate(frames, STEPS[4]).valid.mean() < 0.5
    assert demodulate_adapted(frames, STEPS[4]).map.valid.mean() > 0.99


def test_a_third_harmonic_is_not_called_gamma(camera, rng):
    """Four frames see a third harmonic as one of the first that turns the other way: 5 % of it, 0.05 rad at most."""
    phase = PLATE + STEPS[4][:, None, None]
    frames = PAINT * (100 + 85 * (np.cos(phase) - 0.05 * np.cos(3 * phase)))
    found = demodulate_adapted(camera(frames, rng, sigma=0.7), STEPS[4])
    assert "third -5" in found.undone[0]
    assert not any("gamma" in sentence for sentence in found.undone)
    assert ripple(found.map.phase) < 0.003
    bent = demodulate_adapted(shot(STEPS[4], camera, rng, exponent=2.2), STEPS[4])
    assert any("gamma was corrected (exponent 2." in sentence for sentence in bent.undone)


def test_the_plates_wave_serves_where_an_object_hides_it(camera, rng):
    plate = demodulate_adapted(shot(STEPS[3], camera, rng, exponent=1.5), STEPS[3]).found_wave
    few = shot(STEPS[3], camera, rng, exponent=1.5)[:, :40, :40]  # too few fringes to see it there
    found = demodulate_adapted(few, STEPS[3], wave=plate)
    assert "found on the plate" in found.undone[0]
    error = np.angle(np.exp(1j * (found.map.phase - PLATE[:40, :40])))
    # 0.01 rad noise; uncorrected the ripple of exponent 1.5 is 5.6 deg = 0.1 rad rms.
    assert np.nanstd(error) < 0.02


def test_a_wave_that_is_no_longer_true_is_not_used(camera, rng):
    # The camera's gamma was switched off since the plate was taken.
    old = Waveform(np.array([0.15, 0.02, 0], complex), np.full(3, 0.001), 60)
    found = demodulate_adapted(shot(STEPS[3], camera, rng), STEPS[3], wave=old)
    assert found.undone == ()
    assert ripple(found.map.phase) < 0.003
    changed = demodulate_adapted(shot(STEPS[3], camera, rng, exponent=2.0), STEPS[3], wave=old)
    assert "no longer fits" in changed.undone[0]
    assert ripple(changed.map.phase) < 0.003


def test_filtered_frames_get_the_same_corrections(camera, rng):
    frames = shot(STEPS[3], camera, rng, exponent=1.5, errors_deg=(0, 3, -3), over_field_deg=(0, 3, -4))
    found = demodulate_adapted(frames, STEPS[3])
    np.testing.assert_array_equal(found.again(frames, white_level=None).phase, found.map.phase)


def test_without_fringes_nothing_is_known(rng):
    found = demodulate_adapted(rng.integers(90, 110, (3, 64, 64)).astype(np.uint8), STEPS[3])
    assert found.phase_shifts is None
    assert found.notes


def test_the_mean_of_the_phase_is_kept_where_phase_shifts_are_corrected(camera, rng):
    # Errors without a mean: with the first frame taken as exact the phase would shift by its -0.04 rad.
    errors = np.array([-2.4, 3.1, -0.7])
    found = demodulate_adapted(shot(STEPS[3], camera, rng, errors_deg=errors), STEPS[3])
    error = np.angle(np.exp(1j * (found.map.phase - PLATE)))
    # 0.01 rad noise of 56,000 pixels; the phase shifts' u of some 0.05 deg is common to all.
    assert np.nanmean(error) == pytest.approx(0, abs=0.002)
    used = np.rad2deg(np.array(found.scheme.phase_shifts_rad) - STEPS[3])
    np.testing.assert_allclose(used, errors, atol=0.15)


def test_phase_shifts_that_cost_next_to_nothing_are_left_as_stated(camera, rng):
    # 0.3 deg in one of four frames: significant, and 0.001 rad of ripple.
    found = demodulate_adapted(shot(STEPS[4], camera, rng, errors_deg=(0, 0.3, 0, 0)), STEPS[4])
    assert found.phase_shifts.significant
    assert found.undone == ()


def test_phase_shifts_that_explain_the_frames_no_better_are_not_used(camera, rng, monkeypatch):
    # What blocks beside edges say of the phase shifts, 114 deg where 120 are true, holds nowhere else.
    frames = shot(STEPS[3], camera, rng)
    honest = adapted.phase_shifts_and_blocks

    def misled(*args, **kwargs):
        found, blocks = honest(*args, **kwargs)
        return replace(found, phase_shifts_rad=found.stated_rad + np.deg2rad([0, -6, 0])), blocks

    monkeypatch.setattr(adapted, "phase_shifts_and_blocks", misled)
    found = demodulate_adapted(frames, STEPS[3])
    assert found.undone == ()
    assert "explains the frames no better: " in found.notes[0]
    assert ripple(found.map.phase) < 0.003
    # And where they are true they are used.
    wrong = shot(STEPS[3], camera, rng, errors_deg=(0, -6, 0))
    assert "deg were used" in demodulate_adapted(wrong, STEPS[3]).undone[0]


@pytest.mark.parametrize(("fringe_px", "thinned"), [(48.0, True), (14.0, False)])
def test_large_pictures_of_long_fringes_are_measured_on_fewer_pixels(fringe_px, thinned):
    """Every second pixel of fringes of 48 px, and all of 14 px: the phase shifts are the true ones either way."""
    v, u = np.mgrid[:400, :600].astype(float)
    true = np.deg2rad([0.0, 124.0, 238.0])
    noise = np.random.default_rng(8).standard_normal((3, *u.shape))
    frames = 110 + 70 * np.cos(2 * np.pi * (u + 0.3 * v) / fringe_px + true[:, None, None]) + noise
    rules = replace(adapted.ADAPTATION_RULES, most_pixels=6e4)
    assert (adapted._thinning(frames, STEPS[3], None, rules) > 1) is thinned
    found = demodulate_adapted(frames, STEPS[3], rules=rules).phase_shifts
    apart = (found.phase_shifts_rad - found.phase_shifts_rad[0]) - true
    assert np.abs(apart[1:] / found.u_rad[1:]).max() < 4.5  # of four, one in 40,000 draws is beyond
    assert found.u_rad.max() < 0.01
