"""The thesis's own methods against closed forms: what its rules give, and where they fail."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.thesis import count_fields, quadrant_phase


def wrap(phase):
    return np.angle(np.exp(1j * phase))


def test_quadrant_table_is_atan2_and_undefined_at_the_origin():
    # The printed table, one line per case, t = atan|N/D| = 30 deg or the axis itself.
    n = np.array([1, 1, 1, 0, -1, -1, -1, 0]) * 0.5
    d = np.array([1, 0, -1, -1, -1, 0, 1, 1]) * np.sqrt(3) / 2
    expected = [30, 90, 150, 180, 210, 270, 330, 0]
    np.testing.assert_allclose(np.rad2deg(quadrant_phase(n, d)), expected, atol=1e-9)
    assert np.isnan(quadrant_phase(0.0, 0.0))
    phi = np.linspace(-np.pi, np.pi, 3601)[:-1] + 1e-4
    y, x = np.sin(phi), np.cos(phi)
    np.testing.assert_allclose(quadrant_phase(y, x), np.arctan2(y, x) % (2 * np.pi), atol=1e-12)


def test_counting_fields_needs_the_repair_where_the_surface_turns_back():
    # Rising all the way, both rules are right; on a fold the plain rule goes on counting upward.
    rising = 0.4 * np.arange(200.0)[:, None] + np.zeros((200, 3))
    for rule in ("plain", "regions"):
        np.testing.assert_allclose(count_fields(wrap(rising), rule=rule), rising, atol=1e-9)
    fold = 30 - 0.4 * np.abs(np.arange(200.0) - 75)[:, None] + np.zeros((200, 3))
    right = count_fields(wrap(fold), rule="regions") - fold
    np.testing.assert_allclose(right, right[0, 0], atol=1e-9)
    wrong = count_fields(wrap(fold), rule="plain") - fold
    np.testing.assert_allclose(wrong[:70], right[0, 0], atol=1e-9)
    assert np.abs(wrong[-1, 0] - right[0, 0]) > 2 * np.pi
    np.testing.assert_allclose(count_fields(wrap(fold).T, axis=1).T, count_fields(wrap(fold)))


def test_a_count_ends_at_a_gap():
    rising = 0.4 * np.arange(60.0)[:, None]
    valid = np.ones_like(rising, bool)
    valid[[0, 30]] = False
    found = count_fields(wrap(rising), valid)
    np.testing.assert_array_equal(np.isfinite(found[:, 0]), (np.arange(60) > 0) & (np.arange(60) < 30))
    with pytest.raises(PhaseError, match='"plain" or "regions"'):
        count_fields(rising, rule="other")
