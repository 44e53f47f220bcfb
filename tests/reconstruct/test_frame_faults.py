"""Single frames that disagree are found, and which they are; frames that agree are not blamed."""

import numpy as np
import pytest
from scipy import ndimage

from fringecal.camera import PlateCamera
from fringecal.phase import demodulate
from fringecal.phase.demodulation.schemes import least_squares
from fringecal.projector import RigCalibration, RigModel
from fringecal.reconstruct import FrameFault, capture_held, reconstruct_height, tied_to_plate, visible_plate

SHAPE = (240, 320)
SHIFTS = np.deg2rad([0.0, 120.0, 240.0])
MODEL = RigModel(np.array([0.02, 0.78, -0.96, 0.0, 1e-4, -4e-4, -5e-4]), np.array([0.0, 1222.0, 1000.0]))
RIG = RigCalibration(PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, SHAPE), MODEL, ())
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)


def waves(*, texture=3.0, raised_mm=0.0, tilt=0.0):
    """Frames of a bare plate as real numbers, before noise and rounding; raised, and tilted by a slope along x."""
    rays = RIG.camera.rays(U, V)
    z = raised_mm + tilt * rays.ax
    paper = 100 + texture * np.random.default_rng(5).standard_normal(SHAPE)
    return paper * (1 + 0.5 * np.cos(MODEL.phase(*rays.at(z), z) + SHIFTS[:, None, None]))


def taken(wave, seed=2):
    noise = np.random.default_rng(seed).standard_normal(wave.shape)
    return np.clip(np.rint(wave + noise), 0, 255).astype(np.uint8)


def faults(frames):
    weights = least_squares(SHIFTS).weights
    return capture_held(demodulate(frames, SHIFTS), RIG, frames=frames, weights=weights).frames


@pytest.mark.parametrize("seed", range(4))
def test_frames_that_agree_are_not_blamed(seed):
    assert faults(taken(waves(), seed)) == ()


@pytest.mark.parametrize("frame", range(3))
def test_light_in_one_frame_is_placed_and_measured(frame):
    wave = waves()
    wave[frame] += 12 * np.exp(-((U - 100) ** 2 + (V - 80) ** 2) / 60**2)
    (found,) = faults(taken(wave))
    left, right, top, bottom = found.place
    assert (found.fault, found.frame) == (FrameFault.LIGHT, frame)
    assert left <= 100 <= right
    assert top <= 80 <= bottom
    assert 6 < found.size < 13  # a block's mean, below the peak


def test_a_frame_that_moved_along_the_fringes_shows_its_texture_elsewhere():
    wave = waves()
    # Fringes run along rows, so that only texture tells; smoothed to 1.5 px, whose gradient a pixel's step follows.
    paper = 100 + 12 * ndimage.gaussian_filter(np.random.default_rng(7).standard_normal((SHAPE[0], SHAPE[1] + 2)), 1.5)
    wave = np.stack([paper[:, 1:-1] * one / 100 for one in waves(texture=0.0)])
    wave[1] = paper[:, :-2] * waves(texture=0.0)[1] / 100
    found = [one for one in faults(taken(wave)) if one.fault is FrameFault.MOVED]
    assert [one.frame for one in found] == [1]
    assert found[0].size == pytest.approx(1, abs=0.3)


def test_rows_that_repeat_another_frame_are_named():
    frames = taken(waves())
    frames[2, 100:130] = frames[1, 100:130]
    found = [one for one in faults(frames) if one.fault is FrameFault.STALE_ROWS]
    assert [(one.frame, one.size) for one in found] == [(2, 1)]
    assert found[0].place[2:] == (100, 129)


def test_rows_that_are_missing_are_named():
    frames = taken(waves())
    frames[0, 40:44] = 0
    assert (FrameFault.EMPTY_ROWS, 0, (40, 43)) in [(one.fault, one.frame, one.place[2:]) for one in faults(frames)]


def test_heights_tied_to_a_raised_and_tilted_plate_lie_at_zero_with_its_uncertainty():
    frames = taken(waves(raised_mm=0.4, tilt=0.002))
    surface = reconstruct_height(demodulate(frames, SHIFTS), RIG)
    plate = visible_plate(surface, 1.0)
    tied = tied_to_plate(surface, plate, RIG)
    # On the ray z = 0.4 + 0.002 x with x along the ray: slope and height of the plane are those put in within 2 %.
    assert plate.slopes[0] == pytest.approx(0.002, rel=0.02)
    assert plate.offset_mm == pytest.approx(0.4, abs=0.01)
    assert np.nanmedian(np.abs(tied.z)) < 0.05
    left, right = (float(np.nanmean(tied.z[:, part])) for part in (slice(0, 60), slice(-60, None)))
    assert abs(left) < 0.005
    assert abs(right) < 0.005
    assert np.nanmean(tied.u_z**2) > np.nanmean(surface.u_z**2)
    everywhere = np.ones(SHAPE)
    assert tied.mean_uncertainty(everywhere) >= plate.u_mm * 0.99
