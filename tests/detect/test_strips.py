"""Strips in synthetic phase steps whose layout is known: found, labelled, or refused."""

import time

import numpy as np
import pytest

from fringecal.detect.strips.strip_search import find_strips
from fringecal.errors import DetectionError


def scene(degrees, *, count=7, width=20.0, gap=18.0, shape=(360, 480), noise=0.03, missing=(), step=2.5, seed=0):
    """Wrapped step and true labels of strips whose normal is turned by `degrees` from +u."""
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    angle = np.radians(degrees)
    across = (u - shape[1] / 2) * np.cos(angle) + (v - shape[0] / 2) * np.sin(angle)
    place = across + (count * width + (count - 1) * gap) / 2
    index = np.floor(place / (width + gap)).astype(int)
    on = (place >= 0) & (index < count) & (place - index * (width + gap) < width) & ~np.isin(index, missing)
    value = step(u, v) if callable(step) else step
    phase = np.where(on, value, 0.0) + noise * np.random.default_rng(seed).standard_normal(shape)
    return np.angle(np.exp(1j * phase)), np.where(on, index + 1, 0)


def find(step, valid=None, *, count=7, width=20.0, gap=18.0, **options):
    valid = np.ones(step.shape, bool) if valid is None else valid
    return find_strips(step, valid, count=count, width_px=width, gap_px=gap, **options)


@pytest.mark.parametrize("degrees", [0.0, 3.0, 30.0, 61.0, 90.0, 118.0])
@pytest.mark.parametrize("noise", [0.02, 0.25])
def test_every_strip_is_labelled_and_no_plate_is(degrees, noise):
    step, truth = scene(degrees, noise=noise)
    found = find(step)
    inside = found.labels > 0
    assert np.mean(inside & (found.labels != truth)) < 1e-4
    # A margin of 2 px and a tenth of the width on both sides leaves 60 % of each strip.
    assert np.count_nonzero(inside) > 0.5 * np.count_nonzero(truth)
    turn = (found.direction_deg - degrees - 90 + 90) % 180 - 90
    assert abs(turn) < 0.2
    widths = np.ptp(found.edges_px, axis=1)
    np.testing.assert_allclose(widths, 20.0, atol=0.7)  # edges are sought in bins of half a px


def test_step_that_runs_through_whole_fringes():
    step, truth = scene(2.0, step=lambda u, v: 30 + 0.04 * v + 0.01 * u)
    found = find(step)
    inside = found.labels > 0
    assert np.mean(inside & (found.labels != truth)) < 1e-4
    assert np.count_nonzero(inside) > 0.4 * np.count_nonzero(truth)


def test_missing_strip_is_left_out():
    step, truth = scene(0.0, missing=(2,))
    found = find(step)
    assert found.seen == (1, 2, 4, 5, 6, 7)
    assert np.mean((found.labels > 0) & (found.labels != truth)) < 1e-4


def test_dirt_and_shadows_are_no_strip():
    step, truth = scene(3.0)
    rng = np.random.default_rng(5)
    valid = np.ones(step.shape, bool)
    for _ in range(40):
        v, u = rng.integers(0, 340), rng.integers(0, 460)
        step[v : v + 8, u : u + 8] = rng.uniform(-3, 3)
    edge = (truth[:, 1:] == 0) & (truth[:, :-1] > 0)
    for shift in range(5):
        valid[:, 1 + shift :][edge[:, : edge.shape[1] - shift]] = False
    found = find(step, valid)
    assert found.seen == tuple(range(1, 8))
    assert np.mean((found.labels > 0) & (found.labels != truth)) < 1e-3
    assert (found.labels[~valid] == -1).all()


def test_strips_partly_outside_the_picture():
    step, truth = scene(0.0, count=14)
    found = find(step, count=14)
    assert len(found.seen) >= 11
    shift = np.unique((found.labels - truth)[found.labels > 0])
    assert shift.size == 1  # which strip of the row is the first cannot be seen


def test_bent_strips_are_straight_in_straight_coordinates():
    v, u = np.mgrid[:360, :480].astype(float)
    bend = 3e-4 * (v - 180) ** 2  # 10 px at the rim, as much as half a strip
    straight, truth = scene(0.0)
    shifted = np.clip(np.rint(u + bend), 0, 479).astype(int)
    rows = v.astype(int)
    found = find(straight[rows, shifted], straight_px=(u + bend, v))
    assert np.mean((found.labels > 0) & (found.labels != truth[rows, shifted])) < 1e-3
    assert found.seen == tuple(range(1, 8))


@pytest.mark.parametrize("step", [0.0, 2 * np.pi])
def test_nothing_that_shows_is_refused(step):
    with pytest.raises(DetectionError, match="no strips show|do not show"):
        find(scene(0.0, step=step)[0])


def test_noise_alone_is_refused():
    noise = np.random.default_rng(1).uniform(-np.pi, np.pi, (300, 400))
    with pytest.raises(DetectionError):
        find(noise)


def test_moved_lamp_is_refused():
    v, _ = np.mgrid[:360, :480]
    step, _ = scene(0.0)
    with pytest.raises(DetectionError, match="projector"):
        find(np.angle(np.exp(1j * (step + 0.15 * v))))


def test_more_strips_than_stated_are_refused():
    with pytest.raises(DetectionError, match="more strips"):
        find(scene(0.0)[0], count=5)


def test_wrong_width_is_refused():
    with pytest.raises(DetectionError, match="px wide|do not show"):
        find(scene(0.0)[0], width=28.0, gap=10.0)


def test_too_narrow_and_too_dark_are_refused():
    step, _ = scene(0.0)
    with pytest.raises(DetectionError, match="at least 4 px"):
        find(step, width=2.0, gap=2.0)
    with pytest.raises(DetectionError, match="0 pixels"):
        find(step, np.zeros(step.shape, bool))
    with pytest.raises(DetectionError, match="one shape"):
        find(step, np.ones((3, 3), bool))


def test_large_pictures_take_no_longer_per_pixel():
    small, large = scene(3.0)[0], scene(3.0, shape=(1440, 1920), width=80.0, gap=72.0)[0]
    find(small)
    start = time.process_time()
    find(small)
    between = time.process_time()
    find(large, width=80.0, gap=72.0)
    # 16 times the pixels; processor time on a shared machine wavers by a factor of two.
    assert time.process_time() - between < 32 * (between - start)


@pytest.mark.parametrize("factor", [10 / 12, 1.0, 1.2])
@pytest.mark.parametrize("missing", [(), (1, 4)])
def test_strips_of_another_size_are_told(factor, missing):
    """A grid of 10 mm stated as 12 makes strips 20 % too narrow in px; missing strips are no other size."""
    step, _ = scene(2.0, missing=missing)
    # 161 factors from 1 / 1.6 to 1.6 stand 0.6 % apart.
    assert find(step, width=20.0 / factor, gap=18.0 / factor).size == pytest.approx(factor, rel=0.01)
