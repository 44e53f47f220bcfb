"""Repeated sets: what moved between them is named, what only looks so is not."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import compare_repeats, findings_of_repeats, mean_of_repeats
from fringecal.phase.diagnostics.finding_kinds import FindingKind

THREE = np.deg2rad([0, 120, 240])
SHAPE = (160, 200)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
PLATE = 2 * np.pi * (0.3 * V + U) / 14


def repeats(camera, rng, *, whole=(0, 0, 0), single_rad=0.0, exponent=1.0, lamp=(1, 1, 1)):
    sets = []
    for shift, light in zip(whole, lamp, strict=True):
        shaken = shift + single_rad * rng.standard_normal(3)
        wave = [
            2 * (0.5 + 0.5 * np.cos(PLATE + step + more)) ** exponent for step, more in zip(THREE, shaken, strict=True)
        ]
        sets.append(camera(light * (20 + 90 * np.stack(wave)), rng, sigma=1.0))
    return np.stack(sets)


def test_movement_of_the_whole_is_measured(camera, rng):
    found = compare_repeats(repeats(camera, rng, whole=(0, 0.06, -0.03)), THREE)
    # Mean of 32 000 pixels of 0.01 rad noise.
    np.testing.assert_allclose(found.shift_rad, [-0.01, 0.05, -0.04], atol=0.001)
    (finding,) = findings_of_repeats(found)
    assert finding.kind is FindingKind.VIBRATION_BETWEEN_REPEATS
    # Standard deviation of 0, 0.06, -0.03.
    assert finding.cost_rad == pytest.approx(np.std([0, 0.06, -0.03], ddof=1), rel=0.1)


def test_movement_of_single_frames_is_named(camera, rng):
    found = findings_of_repeats(compare_repeats(repeats(camera, rng, single_rad=0.05), THREE))
    assert [finding.kind for finding in found] == [FindingKind.VIBRATION_BETWEEN_REPEATS]


@pytest.mark.parametrize("fault", [{}, {"exponent": 2.0}, {"lamp": (1, 1.03, 0.97)}])
def test_what_all_repeats_share_is_no_movement(fault, camera, rng):
    assert findings_of_repeats(compare_repeats(repeats(camera, rng, **fault), THREE)) == ()


def test_a_repeat_that_was_only_stored_again_is_stale(camera, rng):
    sets = repeats(camera, rng)
    sets[2] = sets[1]
    found = findings_of_repeats(compare_repeats(sets, THREE))
    assert [finding.kind for finding in found] == [FindingKind.STALE_FRAME]


def test_mean_keeps_saturation():
    sets = np.full((2, 3, 4, 4), 100, np.uint8)
    sets[0, :, 0, 0] = 255
    mean = mean_of_repeats(sets, white_level=255)
    assert mean[0, 0, 0] == 255
    assert mean[0, 1, 1] == 100


def test_repeats_without_fringes_are_refused():
    with pytest.raises(PhaseError, match="in all 2 repeats"):
        compare_repeats(np.full((2, 3, 32, 32), 90, np.uint8), THREE)
    with pytest.raises(PhaseError, match="R >= 2"):
        compare_repeats(np.zeros((1, 3, 32, 32)), THREE)
