"""Right order at every pixel, on scenes whose true phase is written down; nothing leaks from the mask."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import beat_period, beat_phase, order_error_rate, unwrap, unwrap_temporal

SHAPE = (240, 320)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
SMOOTH = 40 * np.exp(-((U - 160) ** 2 + (V - 110) ** 2) / 5000) + 0.35 * V + 0.05 * U


def share_of_right_order(found, truth):
    """Share of pixels of each piece whose order agrees with that of most of the piece."""
    orders = np.rint((found.phase - truth) / (2 * np.pi))
    right = 0
    for label in range(1, found.n_pieces + 1):
        piece = orders[found.pieces == label]
        right += (piece == np.median(piece)).sum()
    return right / np.isfinite(found.phase).sum()


@pytest.mark.parametrize(("sigma", "least"), [(0.0, 1.0), (0.3, 1.0), (0.6, 0.999)])
def test_smooth_surface_with_noise(sigma, least, rng, wrap):
    # At 0.3 rad a difference of neighbours passes pi at 5 sigma: none among 150 000 edges matters, as a
    # wrong edge is only used if all four of a pixel are wrong. At 0.6 rad single pixels may be wrong.
    truth = SMOOTH + sigma * rng.standard_normal(SHAPE)
    found = unwrap(wrap(truth))
    assert found.n_pieces == 1
    assert share_of_right_order(found, truth) >= least
    np.testing.assert_allclose(wrap(found.phase - truth), 0, atol=1e-9)


def test_first_pixel_keeps_its_wrapped_value(wrap):
    found = unwrap(wrap(SMOOTH + 2.0))
    assert found.phase[0, 0] == pytest.approx(wrap(SMOOTH[0, 0] + 2.0))


def test_holes_and_nan_never_reach_a_neighbour(rng, wrap):
    wrapped = wrap(SMOOTH)
    holes = rng.random(SHAPE) < 0.1
    holes[100:140, 150:200] = True
    dirty = np.where(holes, np.where(rng.random(SHAPE) < 0.5, np.nan, np.inf), wrapped)
    with_nan = unwrap(dirty)
    with_mask = unwrap(np.where(holes, rng.uniform(-9e9, 9e9, SHAPE), wrapped), ~holes)
    for found in (with_nan, with_mask):
        assert np.isnan(found.phase[holes]).all()
        assert (found.pieces[holes] == 0).all()
        assert np.isfinite(found.phase[~holes]).all()
        assert (found.pieces[~holes] > 0).all()
        assert share_of_right_order(found, SMOOTH) == 1.0
    np.testing.assert_array_equal(with_nan.phase, with_mask.phase)


def test_pieces_are_the_connected_parts_of_the_mask(rng, wrap):
    from scipy import ndimage

    valid = rng.random(SHAPE) < 0.55
    found = unwrap(wrap(SMOOTH), valid)
    expected, n = ndimage.label(valid)
    assert found.n_pieces == n
    np.testing.assert_array_equal(found.pieces, expected)


def test_a_tear_does_not_spoil_the_rest(wrap):
    # A shear of up to 3 fringes that begins at a point: both of its sides are right, joined round the end.
    truth = SMOOTH + np.where((U > 160) & (V > 120), 0.15 * (V - 120), 0.0)
    valid = np.abs(U - 160) + 200 * (V < 110) > 1.0
    found = unwrap(wrap(truth), valid)
    assert share_of_right_order(found, truth) == 1.0


def test_quality_decides_which_way_is_taken(wrap):
    # A band of worthless but valid phase cuts the picture, but for a bridge on the right: only the quality
    # can lead the path over the bridge.
    worthless = (np.abs(V - 120) < 5) & (U < 290)
    wrapped = wrap(np.where(worthless, 2.5 * np.sin(7.7 * U * V), 0.3 * U))
    found = unwrap(wrapped, quality=np.where(worthless, 0.01, 50.0))
    orders = np.rint((found.phase - 0.3 * U) / (2 * np.pi))[~worthless]
    assert (orders == 0).all()


@pytest.mark.parametrize("quality", [np.zeros(SHAPE), np.full(SHAPE, np.nan), np.full(SHAPE, 7.0), -np.ones(SHAPE)])
def test_a_quality_that_says_nothing_still_unwraps(quality, wrap):
    assert share_of_right_order(unwrap(wrap(SMOOTH), quality=quality), SMOOTH) == 1.0


@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (50, 1), (2, 2), (3, 40)])
def test_tiny_maps(shape, wrap):
    truth = 0.9 * np.arange(shape[0] * shape[1], dtype=float).reshape(shape) % 50
    found = unwrap(wrap(truth) if min(shape) == 1 else wrap(0.1 * truth))
    assert found.phase.shape == shape
    assert np.isfinite(found.phase).all()
    assert found.n_pieces == 1


def test_nothing_valid_gives_nothing():
    found = unwrap(np.full((20, 30), np.nan))
    assert found.n_pieces == 0
    assert np.isnan(found.phase).all()


def test_agrees_with_numpy_along_a_line(rng, wrap):
    line = np.cumsum(rng.uniform(-2.5, 2.5, 4000))
    np.testing.assert_allclose(unwrap(wrap(line)[None]).phase[0], np.unwrap(wrap(line)), atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros(5),), "needs \\(height, width\\)"),
        ((np.zeros((0, 5)),), "needs \\(height, width\\)"),
        ((np.zeros((4, 5)), np.ones((5, 4))), "valid has shape"),
    ],
)
def test_wrong_shapes_are_refused(arguments, message):
    with pytest.raises(PhaseError, match=message):
        unwrap(*arguments)


def test_wrong_quality_is_refused():
    with pytest.raises(PhaseError, match="quality has shape"):
        unwrap(np.zeros((4, 5)), quality=np.ones(3))


@pytest.mark.parametrize(("sigma", "ratio"), [(0.3, 8.0), (0.1, 8.0), (0.2, 5.0), (0.05, 3.0)])
def test_share_of_wrong_orders_is_as_predicted(sigma, ratio, rng, wrap):
    truth = rng.uniform(0, 2 * np.pi * ratio, 400_000)
    coarse = truth / ratio + sigma * rng.standard_normal(truth.size)
    fine = wrap(truth + sigma * rng.standard_normal(truth.size))
    wrong = np.abs(unwrap_temporal(coarse, fine, ratio) - truth) > np.pi
    predicted = float(order_error_rate(sigma, sigma, ratio))
    assert wrong.mean() == pytest.approx(predicted, abs=4 * np.sqrt(predicted / truth.size) + 1e-9)


def test_published_rate_of_wrong_orders():
    # Noise 0.3 rad, ratio 8: 19.4 % wrong.
    assert order_error_rate(0.3, 0.3, 8.0) == pytest.approx(0.194, abs=5e-4)


def test_heterodyne_gives_absolute_phase_over_steps(rng, wrap):
    # Periods 200/3 and 100 px beat at 200 px; steps of any height are right within one beat.
    x = rng.uniform(0, 199, 5000)
    fine, coarse = 2 * np.pi * x / (200 / 3), 2 * np.pi * x / 100
    beat = beat_phase(wrap(fine), wrap(coarse))
    ratio = beat_period(200 / 3, 100.0) / (200 / 3)
    np.testing.assert_allclose(unwrap_temporal(beat, wrap(fine), ratio), fine, atol=1e-9)


def test_temporal_keeps_nan_in_its_place():
    found = unwrap_temporal(np.array([np.nan, 1.0]), np.array([0.5, 2.0]), 2.0)
    assert np.isnan(found[0])
    assert found[1] == 2.0


@pytest.mark.parametrize("ratio", [1.0, 0.5, np.nan, -3.0])
def test_temporal_refuses_nonsense(ratio):
    with pytest.raises(PhaseError, match="ratio of periods"):
        unwrap_temporal(np.zeros(3), np.zeros(3), ratio)
    with pytest.raises(PhaseError, match="they must be equal"):
        unwrap_temporal(np.zeros(3), np.zeros(4), 2.0)
    with pytest.raises(PhaseError, match="no beat"):
        beat_period(100.0, 50.0)


@pytest.mark.parametrize("sigma", [0.1, 0.3])
@pytest.mark.parametrize("tear", [9.0, -12.0])
def test_a_tear_that_nothing_masks(sigma, tear, rng, wrap):
    # The edge of a tear looks harmless wherever its height is a whole number of fringes. Good neighbours must be
    # joined round its end before such places are crossed; other orders of joining lose a tenth of the picture
    # and more (scikit-image: 50 to 99.9 % right on such scenes).
    v, u = V / SHAPE[0], U / SHAPE[1]
    truth = SMOOTH + np.where((u > 0.45 + 0.1 * v) & (v > 0.3), tear * (v - 0.3), 0.0)
    truth = truth + sigma * rng.standard_normal(SHAPE)
    assert share_of_right_order(unwrap(wrap(truth)), truth) > 0.95


def test_single_precision_gives_the_same_orders(rng, wrap):
    wrapped = wrap(SMOOTH + 0.2 * rng.standard_normal(SHAPE)).astype(np.float32)
    np.testing.assert_allclose(unwrap(wrapped).phase, unwrap(wrapped.astype(float)).phase, atol=1e-6)


def test_threads_change_nothing(rng, wrap):
    # Rows are joined in strips at once; 0.8 rad of noise makes the order of joining matter.
    import numba

    wrapped = wrap(SMOOTH + 0.8 * rng.standard_normal(SHAPE))
    many, before = unwrap(wrapped), numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = unwrap(wrapped)
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(one.phase, many.phase)
    np.testing.assert_array_equal(one.pieces, many.pieces)


def test_what_is_too_large_for_a_phase_is_masked(wrap):
    wrapped = wrap(SMOOTH)
    wrapped[7, 9] = 1e300
    found = unwrap(wrapped)
    assert found.pieces[7, 9] == 0
    assert share_of_right_order(found, SMOOTH) == 1.0
