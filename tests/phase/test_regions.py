"""Unwrapping over folds and edges: a bent sheet with open ends, strips, and a piece that touches nothing."""

import numpy as np
import pytest

from fringecal.phase.unwrapping.regions import unwrap_regions

SHAPE = (260, 320)


def zigzag(slope):
    """Step of a zig-zag of four bars of 40 px on a plate: folds along columns, edges at both ends."""
    u = np.arange(SHAPE[1]) - 80
    foot = u % 40
    profile = np.where((u >= 0) & (u < 160), slope * np.minimum(foot, 40 - foot), 0.0)
    step = np.zeros(SHAPE)
    step[60:200] = profile
    return step


def noisy(step, noise_rad, seed=0):
    rng = np.random.default_rng(seed)
    return np.angle(np.exp(1j * (step + noise_rad * rng.standard_normal(step.shape))))


@pytest.mark.parametrize(("noise_rad", "least"), [(0.0, 0.99), (0.1, 0.99), (0.3, 0.95)])
@pytest.mark.parametrize("slope", [0.35, 0.5])
def test_zigzag_with_open_ends_hangs_on_its_feet(noise_rad, least, slope):
    truth = zigzag(slope)
    found = unwrap_regions(noisy(truth, noise_rad), np.ones(SHAPE, bool))
    plate = np.median((found.phase - truth)[:40])
    right = np.abs(found.phase - plate - truth) < np.pi
    # Rows at the open ends lie within the filter's reach of an edge; the rest must be right.
    inner = np.r_[0:55, 65:195, 205:260]
    assert np.mean(right[inner]) > least


def test_strips_are_pieces_of_their_own():
    step = np.zeros(SHAPE)
    for left in (40, 120, 200):
        step[:, left : left + 40] = -8.0 - 0.3 * np.arange(SHAPE[0])[:, None]
    found = unwrap_regions(noisy(step, 0.05), np.ones(SHAPE, bool))
    # The step passes a whole fringe on the way: joining there would be a guess.
    for left in (40, 120, 200):
        strip = found.phase[5:-5, left + 6 : left + 34] - step[5:-5, left + 6 : left + 34]
        assert np.ptp(np.round(strip / (2 * np.pi))) == 0
        assert found.pieces[130, left + 20] != found.pieces[130, left - 10]


def test_an_isolated_piece_stays_its_own():
    valid = np.ones(SHAPE, bool)
    valid[80:180, 100:220] = False
    valid[100:160, 120:200] = True
    step = np.zeros(SHAPE)
    step[100:160, 120:200] = 5.0
    found = unwrap_regions(noisy(step, 0.05), valid)
    assert found.pieces[130, 160] not in (0, found.pieces[10, 10])
    assert (found.pieces[~valid] == 0).all()
    assert np.isnan(found.phase[~valid]).all()


def test_smooth_phase_is_one_piece():
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    truth = 1e-3 * ((u - 160) ** 2 + (v - 130) ** 2)
    found = unwrap_regions(noisy(truth, 0.1), np.ones(SHAPE, bool))
    assert found.n_pieces == 1
    offset = found.phase - truth
    assert np.ptp(np.round(offset / (2 * np.pi) - np.median(offset) / (2 * np.pi))) == 0


def test_nothing_valid_gives_nothing():
    found = unwrap_regions(np.zeros(SHAPE), np.zeros(SHAPE, bool))
    assert found.n_pieces == 0
    assert np.isnan(found.phase).all()
