"""Frames that lie apart, lines that lie aside, noise that is shared: what was put in is found, and how large it is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from fringecal.camera import PlateCamera
from fringecal.phase import Noise, PhaseMap, PlateLook, Waveform, demodulate, neighbour_scatter
from fringecal.phase.demodulation.schemes import least_squares
from fringecal.projector import RigCalibration, RigModel
from fringecal.reconstruct import FrameFault, capture_held
from fringecal.records import Limits
from fringecal.workflows.reconstruct.frames_together import causes_in_frames, frame_checks

SHAPE = (240, 320)
MODEL = RigModel(np.array([0.02, 0.78, -0.96, 0.0, 1e-4, -4e-4, -5e-4]), np.array([0.0, 1222.0, 1000.0]))
RIG = RigCalibration(PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, SHAPE), MODEL, ())
MARGIN = 12


def shifts(number):
    return np.arange(number) * 2 * np.pi / number


def paper(levels, blur=1.0, seed=5):
    """Light from paper with texture of so many levels, which is as coarse as the optics make it."""
    rough = ndimage.gaussian_filter(
        np.random.default_rng(seed).standard_normal((SHAPE[0] + 2 * MARGIN, SHAPE[1] + 2 * MARGIN)), blur
    )
    return 100 + levels * rough / rough.std()


def wave(number, *, levels=5.0, moved=None):
    """Frames before noise and rounding; `moved` maps frames to displacements (du, dv) of the whole picture, px."""
    v, u = np.mgrid[-MARGIN : SHAPE[0] + MARGIN, -MARGIN : SHAPE[1] + MARGIN].astype(float)
    rays = RIG.camera.rays(u, v)
    phase = MODEL.phase(*rays.at(0.0), 0.0)
    frames = paper(levels) * (1 + 0.5 * np.cos(phase + shifts(number)[:, None, None]))
    for k, (du, dv) in (moved or {}).items():
        frames[k] = ndimage.shift(frames[k], (dv, du), order=3, mode="nearest")
    return frames[:, MARGIN:-MARGIN, MARGIN:-MARGIN]


def taken(frames, seed=2):
    noise = np.random.default_rng(seed).standard_normal(frames.shape)
    return np.clip(np.rint(frames + noise), 0, 255).astype(np.uint8)


def known(number, levels=5.0):
    """The rig, which knows how its bare plate looked."""
    look = PlateLook.of(demodulate(taken(wave(number, levels=levels), seed=1), shifts(number)))
    return replace(RIG, look=look)


def held(frames, rig=RIG):
    steps = shifts(len(frames))
    map_ = demodulate(frames, steps, max_residual=np.inf)
    return capture_held(map_, rig, frames=frames, weights=least_squares(steps).weights)


@pytest.mark.parametrize("number", [4, 5, 8])
def test_frames_at_rest_lie_together(number):
    motion = held(taken(wave(number))).motion
    assert not motion.apart
    assert motion.least_px < 0.1


@pytest.mark.parametrize(("number", "frame", "moved"), [(5, 2, (0.4, 0.0)), (8, 6, (0.3, 0.0)), (8, 1, (-0.5, 0.0))])
def test_a_frame_that_moved_along_the_fringes_is_named_with_its_distance(number, frame, moved):
    motion = held(taken(wave(number, moved={frame: moved}))).motion
    assert motion.apart
    assert motion.frame == frame
    # The others' mean moves by 1/N of it the other way; what all frames share stays unseen.
    assert motion.px == pytest.approx(np.hypot(*moved), rel=0.35)


def test_three_frames_are_told_apart_by_the_plates_texture_as_far_as_it_is_looked_for():
    found = held(taken(wave(3, moved={1: (4.0, 0.0)})), known(3))
    assert found.motion.apart
    assert found.motion.frame == 1
    assert found.motion.px == pytest.approx(4, abs=0.3)
    assert not held(taken(wave(3)), known(3)).motion.apart


def test_three_frames_of_a_plate_without_texture_say_that_nothing_could_be_seen():
    found = held(taken(wave(3, levels=0.0)), known(3, levels=0.0))
    check = next(iter(frame_checks(found, None, None, Limits())))
    assert found.motion is None
    assert (check.decision, check.value) == ("info", None)
    assert "could not be seen" in check.rule


def test_lines_that_lie_aside_are_counted_in_their_frame():
    # Brushed metal: its grain runs down the columns, so that a row shows where it lies.
    grain = 1 + 0.05 * ndimage.gaussian_filter1d(np.random.default_rng(4).standard_normal(SHAPE[1]), 1.0)
    frames = taken(wave(4, levels=0.0) * grain)
    for row in (20, 57, 90, 131, 200):
        frames[2, row] = np.roll(frames[2, row], 2)
    found = [one for one in held(frames).frames if one.fault is FrameFault.ROWS_MOVED]
    assert [one.frame for one in found] == [2]
    assert found[0].place[2:] == (20, 200)


def test_edges_along_rows_are_no_lines_that_lie_aside():
    frames = wave(4)
    frames[:, 80:140, 60:240] = np.roll(frames, 7, axis=2)[:, 80:140, 60:240] * 0.6
    assert not [one for one in held(taken(frames)).frames if one.fault is FrameFault.ROWS_MOVED]


def phase_map(phase):
    """A phase map of noise alone, of unit standard deviation times 0.01 rad."""
    one = np.ones(phase.shape, np.float32)
    return PhaseMap(
        phase.astype(np.float32), 50 * one, 100 * one, 0.01 * one, np.zeros(phase.shape, np.uint8), Noise(1.0)
    )


def test_neighbours_scatter_as_independent_noise_does_and_less_after_a_mean_of_three():
    noise = 0.01 * np.random.default_rng(3).standard_normal((300, 400))
    scatter, u = neighbour_scatter(phase_map(noise))
    assert scatter == pytest.approx(1, abs=5 * u)
    # (x0 - x1 - x3 + x4) / 3 against x1 - 2 x2 + x3: standard deviations 2/3 and sqrt(6).
    shared = ndimage.uniform_filter1d(noise, 3, axis=1)
    scatter, u = neighbour_scatter(phase_map(shared))
    assert scatter == pytest.approx(2 / 3 / 6**0.5, abs=5 * u)


def test_smoothed_frames_are_named_and_sound_ones_are_not():
    frames = taken(wave(4))
    smooth = np.stack([ndimage.median_filter(one, 3) for one in frames])
    rig = known(4)
    assert list(causes_in_frames(held(frames, rig), None, None, Limits())) == []
    (cause,) = causes_in_frames(held(smooth, rig), None, None, Limits())
    assert "smoothed" in cause


def test_a_picture_whose_lower_half_moved_is_torn_there():
    frames = taken(wave(4))
    frames[:, 130:] = np.roll(frames[:, 130:], 6, axis=2)
    torn = held(frames, known(4)).texture.torn
    assert torn.along == "row"
    assert abs(torn.at_px - 130) <= 60  # pieces of texture lie 48 px apart
    assert torn.px == pytest.approx(6, abs=0.2)


def test_a_second_harmonic_that_changed_is_named():
    usual = Waveform(np.array([0.01, 0.0, 0.0], complex), np.full(3, 0.001), 100)
    bent = Waveform(np.array([0.09, 0.0, 0.0], complex), np.full(3, 0.001), 100)
    found = held(taken(wave(4)))
    assert list(causes_in_frames(found, usual, usual, Limits())) == []
    (cause,) = causes_in_frames(found, bent, usual, Limits())
    assert "0.090 of the first, 0.010" in cause
