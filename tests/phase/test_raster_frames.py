"""Coordinates of a projector from frames of nested periods in one pass."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import Noise, raster_of_frames

STEPS = np.deg2rad([0.0, 120.0, 240.0])
EXTENT, PERIODS = 912.0, (912.0, 152.0, 38.0)


def truth() -> np.ndarray:
    v, u = np.mgrid[:80, :700]
    return 20 + 1.2 * u + 5 * np.sin(v / 20)


def frames_of(px: np.ndarray, period: float, *, zero: float = 0.0, sign: int = 1, noise: float = 0.0) -> np.ndarray:
    phase = sign * 2 * np.pi * px / period + zero
    clean = 110 + 70 * np.cos(phase + STEPS[:, None, None])
    return clean + noise * np.random.default_rng(3).standard_normal(clean.shape)


def test_exact_frames_give_the_coordinate_back():
    """Single precision of the arctangent is 5e-6 rad, of the coordinate 1e-4 px."""
    found = raster_of_frames([frames_of(truth(), p) for p in PERIODS], STEPS, PERIODS, EXTENT, noise=Noise(1.0))
    assert np.abs(found.px - truth()).max() < 3e-4
    assert found.u_px == pytest.approx(38 / (2 * np.pi) * np.sqrt(2 / 3) / 70, rel=1e-3)


def test_order_of_the_sets_zeros_and_a_falling_phase_are_heeded():
    zeros = (0.4, -1.1, 2.0)
    sets = [frames_of(truth(), p, zero=z, sign=-1) for p, z in zip(PERIODS, zeros, strict=True)]
    found = raster_of_frames(
        sets[::-1], STEPS, PERIODS[::-1], EXTENT, zeros_rad=zeros[::-1], falls=True, noise=Noise(1.0)
    )
    assert np.abs(found.px - truth()).max() < 3e-4


def test_scatter_is_what_u_says():
    sets = [np.clip(np.rint(frames_of(truth(), p, noise=1.5)), 0, 255).astype(np.uint8) for p in PERIODS]
    found = raster_of_frames(sets, STEPS, PERIODS, EXTENT)
    ratio = (found.px - truth()) / found.u_px
    assert np.isfinite(ratio).all()
    assert ratio.std() == pytest.approx(1.0, rel=0.1)


def test_pixels_whose_order_is_not_sure_have_none():
    """Noise of 12 levels: the longest period is then known to 20 px, more than half a fringe of 38 allows."""
    px, two = truth(), (912.0, 38.0)
    found = raster_of_frames([frames_of(px, p, noise=12.0) for p in two], STEPS, two, EXTENT, noise=Noise(12.0))
    assert not np.isfinite(found.px).any()


def test_saturated_and_dark_pixels_have_none():
    sets = [np.rint(frames_of(truth(), p)).astype(np.uint8) for p in PERIODS]
    sets[1][0, 10, 20], sets[2][:, 30, 40] = 255, 9
    found = raster_of_frames(sets, STEPS, PERIODS, EXTENT, noise=Noise(1.0))
    assert np.isnan(found.px[10, 20])
    assert np.isnan(found.px[30, 40])
    assert np.isfinite(found.px).sum() == found.px.size - 2


def test_periods_that_only_meet_by_beats_are_refused():
    with pytest.raises(PhaseError, match="repeats within"):
        raster_of_frames([frames_of(truth(), p) for p in (40.0, 38.0)], STEPS, (40.0, 38.0), EXTENT)
