"""Frames that were compressed in squares of 8 px are told from noise, ridges and edges as the camera gives them."""

import cv2
import numpy as np
import pytest

from fringecal.phase import FindingKind, diagnose
from fringecal.phase.diagnostics.compression import square_contrast

STEPS = np.deg2rad([0.0, 120.0, 240.0])
SHAPE = (240, 320)
NOISE = 1.0


def frames(relief_rad=0.0, *, noise=NOISE, seed=0):
    """Fringes of 14 px over a plate, or over a relief given as its phase, with white noise, in 8 bits."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    phase = 2 * np.pi * (v + 0.15 * u) / 14 + relief_rad
    drawn = 110 + 70 * np.cos(phase + STEPS[:, None, None])
    return np.clip(np.rint(drawn + noise * rng.standard_normal(drawn.shape)), 0, 255).astype(np.uint8)


def jpeg(pictures, quality):
    """Store as JPEG and read again, by OpenCV's codec."""
    stored = (cv2.imencode(".jpg", one, [cv2.IMWRITE_JPEG_QUALITY, quality])[1] for one in pictures)
    return np.stack([cv2.imdecode(one, cv2.IMREAD_GRAYSCALE) for one in stored])


def ridges(distance_px):
    """Flanks of a zig-zag whose ridges stand so many px apart, and steps between strips on top."""
    u = np.arange(SHAPE[1])
    flanks = np.abs((u % (2 * distance_px)) - distance_px) * 0.08
    return (flanks + 1.4 * ((u // distance_px) % 2))[None, :]


SCENES = [0.0, ridges(16), ridges(24), ridges(37)]


@pytest.mark.parametrize("relief", SCENES, ids=["plate", "16 px", "24 px", "37 px"])
@pytest.mark.parametrize("seed", [1, 3])
def test_white_noise_has_the_same_power_wherever_squares_begin(relief, seed):
    """Also where edges stand at multiples of 8 px: along them, squares are alike."""
    clean = frames(relief, seed=seed)
    assert square_contrast(clean) == pytest.approx(1.0, abs=0.04)
    found = diagnose(clean, STEPS, white_level=255.0)
    assert FindingKind.COMPRESSED not in {one.kind for one in found.findings}
    # Of edges every 16 px no part of the picture is free: there the note of rough or smoothed surfaces stands.
    if relief is not SCENES[1]:
        assert not any("smoothed" in note for note in found.notes)


@pytest.mark.parametrize("quality", [95, 85, 70, 40])
@pytest.mark.parametrize("relief", SCENES, ids=["plate", "16 px", "24 px", "37 px"])
def test_jpeg_is_found_on_plates_ridges_and_edges(relief, quality):
    found = diagnose(jpeg(frames(relief), quality), STEPS, white_level=255.0)
    assert FindingKind.COMPRESSED in {one.kind for one in found.findings}


def test_the_finding_says_by_how_much_the_noise_is_understated():
    """Rounding is all that is left between neighbours, 0.29 grey levels, of a noise of 1: threefold."""
    (found,) = [
        one
        for one in diagnose(jpeg(frames(), 95), STEPS, white_level=255.0).findings
        if one.kind is FindingKind.COMPRESSED
    ]
    times = float(found.how_large.rpartition(" about ")[2].split()[0])
    assert 1.8 < times < 4
    # u(phase) = sqrt(2/3) sigma / B, of what JPEG leaves of the noise.
    assert 0.3 * np.sqrt(2 / 3) / 70 < found.cost_rad < 1.2 * np.sqrt(2 / 3) / 70


def test_pictures_without_noise_are_no_compressed_ones():
    """Rounding is white as well."""
    assert square_contrast(frames(noise=0.0)) == pytest.approx(1.0, abs=0.03)


def test_of_small_pictures_nothing_is_said():
    assert np.isnan(square_contrast(frames()[:, :32, :32]))
