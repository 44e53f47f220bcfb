"""Lamp drift and steps that change over the field, undone: what is left is measured against the true phase."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import (
    correct_phase_shifts,
    demodulate,
    demodulate_strips,
    equalise,
    estimate_phase_shifts,
    least_squares,
)

THREE = np.deg2rad([0, 120, 240])
SHAPE = (240, 320)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
PLATE = 2 * np.pi * (V + 0.3 * U) / 17
SHADING = 1 - 0.3 * (U / 200 - 1) ** 2


def shot(camera, rng, *, errors_deg=(0, 2, -1), over_field_deg=(0, 4, -3), gain=(1, 1.03, 0.98), offset=(0, 0, 0)):
    frames = []
    for k in range(3):
        step = THREE[k] + np.deg2rad(errors_deg[k] + over_field_deg[k] * (U / (SHAPE[1] - 1) - 0.5))
        frames.append(gain[k] * SHADING * (110 + 70 * np.cos(PLATE + step)) + offset[k])
    return camera(np.stack(frames), rng, sigma=1.0)


def ripple(phase, order, where=...):
    error = np.angle(np.exp(1j * (phase - PLATE)))[where]
    return 2 * np.abs(np.nanmean((error - np.nanmean(error)) * np.exp(-1j * order * PLATE[where])))


def test_lamp_and_uneven_steps_together(camera, rng):
    frames = shot(camera, rng)
    found = estimate_phase_shifts(frames, THREE)
    scheme = equalise(found)
    level = demodulate(frames, scheme)
    good = correct_phase_shifts(level, scheme, found.gradient_rad_px)
    # Before: 3 % of a frame is 0.045 rad at order 1, and 2 to 4 deg 0.02 to 0.04 rad at order 2, left and right.
    raw = demodulate(frames, THREE)
    assert ripple(raw.phase, 1) > 0.03
    for side in (U < 80, U > 240):
        assert ripple(raw.phase, 2, side) > 0.01
        assert ripple(level.phase, 2, side) > 0.01
        for order in (1, 2, 3):
            assert ripple(good.phase, order, side) < 0.001


def test_an_offset_is_stray_light(camera, rng):
    # 4 grey levels on one frame of B = 70 ((2/3) 4/70 = 0.04 rad at order 1).
    frames = shot(camera, rng, errors_deg=(0, 0, 0), over_field_deg=(0, 0, 0), gain=(1, 1, 1), offset=(0, 4, 0))
    found = estimate_phase_shifts(frames, THREE)
    np.testing.assert_allclose(
        found.offset_per_frame - found.offset_per_frame.mean(), [-4 / 3, 8 / 3, -4 / 3], atol=0.15
    )
    assert ripple(demodulate(frames, THREE).phase, 1) > 0.03
    assert ripple(demodulate(frames, equalise(found)).phase, 1) < 0.002


@pytest.mark.parametrize("n", [3, 4, 6])
def test_known_gains_and_offsets_are_exact(n, fringes, rng):
    steps = 2 * np.pi * np.arange(n) / n
    gains, offsets = rng.uniform(0.9, 1.1, n), rng.uniform(-5, 5, n)
    frames = gains[:, None, None] * fringes(PLATE, steps) + offsets[:, None, None]
    found = demodulate(frames, least_squares(steps, gains=gains, offsets=offsets))
    np.testing.assert_allclose(np.angle(np.exp(1j * (found.phase - PLATE))), 0, atol=1e-5)
    np.testing.assert_allclose(found.modulation, 80, rtol=1e-5)
    np.testing.assert_allclose(found.background, 120, rtol=1e-5)
    assert found.valid.all()  # and no residual: the model knows gains and offsets too


@pytest.mark.parametrize("gains", [[1, 1], [1, 1, np.nan], np.ones((3, 1))])
def test_gains_that_do_not_fit_are_refused(gains):
    with pytest.raises(PhaseError, match="one finite number per frame"):
        least_squares(THREE, gains=gains)


def test_strips_give_what_the_whole_gives(camera, rng, fringes):
    frames = camera(np.tile(fringes(PLATE, THREE), (1, 3, 1)), rng, sigma=1.0)
    whole = demodulate(frames, THREE)
    rows = 0
    for strip, map_ in demodulate_strips(list(frames), THREE, rows=200):
        np.testing.assert_array_equal(map_.phase, whole.phase[strip])
        np.testing.assert_array_equal(map_.modulation, whole.modulation[strip])
        rows += strip.stop - strip.start
    assert rows == whole.phase.shape[0]


def test_strips_read_a_file_that_stays_on_disk(tmp_path, camera, rng, fringes):
    import tracemalloc

    height, width = 8000, 500
    files = []
    for k, frame in enumerate(camera(fringes(np.tile(PLATE[:200, :250], (40, 2)), THREE), rng, sigma=1.0)):
        frame.tofile(tmp_path / f"{k}.raw")
        files.append(np.memmap(tmp_path / f"{k}.raw", np.uint8, "r", shape=(height, width)))
    next(demodulate_strips(files, THREE, rows=100))  # compiled and warm
    tracemalloc.start()
    for _ in demodulate_strips(files, THREE, rows=100):
        pass
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # One strip needs 20 bytes a pixel, the noise's sample of at most 400 000 pixels about 100 of each; the whole
    # would take 20 bytes of 4 million pixels. What is held does not grow with the picture's height.
    assert peak < 45e6


@pytest.mark.parametrize("frames", [[], [np.zeros((9, 9))] * 2, [np.zeros((9, 9))] * 2 + [np.zeros((9, 8))]])
def test_strips_refuse_what_does_not_fit(frames):
    with pytest.raises(PhaseError, match="one frame per phase shift"):
        next(demodulate_strips(frames, THREE))
