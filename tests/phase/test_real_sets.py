"""The diagnostics and the corrections over every real phase-shifted set of tests/data."""

import cv2
import numpy as np
import pytest

from fringecal.phase import diagnose, fringe_period, least_squares
from fringecal.phase.demodulation.adapted import demodulate_adapted
from fringecal.phase.demodulation.demodulate import demodulate
from fringecal.phase.demodulation.model_residual import ResidualSample

# What is known of each without fringecal (README.md of each folder): steps, files, names that may be raised.
SETS = {
    # The only one that was stored as JPEG.
    "lens board": (
        "fpp_tools_lens",
        (0, 90, 180, 270),
        "lens_orig_{:03d}.jpg",
        (0, 90, 180, 270),
        {"third harmonic", "compressed frames"},
    ),
    "wall and box, short": ("kamino_object1", (-120, 0, 120), "pat{:02d}.png", (0, 1, 2), {"gamma"}),
    "wall and box, long": ("kamino_object1", (-120, 0, 120), "pat{:02d}.png", (3, 4, 5), {"gamma"}),
    "wall, raised to 0.75": ("kamino_gamma_plane", (-120, 0, 120), "pat{:02d}.png", (0, 1, 2), {"gamma"}),
    "wall, raised to 1.25": ("kamino_gamma_plane", (-120, 0, 120), "pat{:02d}.png", (3, 4, 5), {"gamma"}),
    # Means under a Gaussian of many fringes: the first frame's background is 1.1 to 1.6 % above the second's.
    "wall and Gray code": ("kamino_gray_code", (-120, 0, 120), "pat{:02d}.png", (3, 4, 5), {"gamma", "lamp drift"}),
    # The true phase shifts are not the stated ones.
    "drawn plate": ("oblique", (0, 120, 240), "reference-{}.png", (0, 1, 2), {"wrong steps"}),
    "drawn strips": ("oblique", (0, 120, 240), "strips-{}.png", (0, 1, 2), {"wrong steps"}),
    "drawn bars": ("oblique", (0, 120, 240), "bars-{}.png", (0, 1, 2), {"wrong steps"}),
}
LEAST_COST_RAD = 0.004
"""Cost from which a finding is named; those of harmonics from 0.012 rad."""


def real_set(request, name):
    """Read frames and phase shifts of a set; every second pixel of every second row of the large ones."""
    folder, steps, pattern, numbers, names = SETS[name]
    root = request.config.rootpath / "tests" / "data" / folder
    frames = np.stack([cv2.imread(str(root / pattern.format(k)), cv2.IMREAD_GRAYSCALE) for k in numbers])
    step = 2 if frames.shape[2] > 1500 else 1
    return frames[:, ::step, ::step], np.deg2rad(steps), names


@pytest.mark.parametrize("name", SETS)
def test_no_false_name_no_useless_alarm_and_every_correction_lowers_the_residual(name, request):
    frames, steps, expected = real_set(request, name)
    found = diagnose(frames, steps)
    assert {finding.kind.value for finding in found.findings} == expected
    for finding in found.findings:
        if finding.kind.value == "compressed frames":  # of noise, which is no ripple
            continue
        assert finding.cost_rad > (0.012 if finding.kind.value in ("gamma", "third harmonic") else LEAST_COST_RAD)
    adapted = demodulate_adapted(frames, steps)
    shifts = np.asarray(adapted.scheme.phase_shifts_rad)
    if adapted.scheme.name != "equalised" and np.array_equal(shifts, steps):
        return
    before = demodulate(frames, steps, max_residual=np.inf)
    sample = ResidualSample.of(frames, fringe_period(before.phase, before.valid), None)
    assert sample.left_by(adapted.scheme) < sample.left_by(least_squares(steps))
    assert np.mean(shifts) == pytest.approx(np.mean(steps), abs=1e-6)  # the mean of the phase is kept
