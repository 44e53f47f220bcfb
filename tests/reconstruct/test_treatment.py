"""Filters and object minus plate on surfaces of known form."""

from dataclasses import replace

import numpy as np
import pytest

from fringecal.reconstruct.height_map import HeightMap, Reason
from fringecal.reconstruct.sensitivity import Sensitivities
from fringecal.workflows.shared.treatment import Treatment, filtered_heights, minus_plate

SHAPE = (20, 30)


def surface(z, reasons=None):
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    why = np.zeros(SHAPE, np.uint8) if reasons is None else reasons
    u_r = np.full(SHAPE, 0.03)
    exact = Sensitivities((), (), np.zeros((0, 1, 1, 1)), np.zeros((1, 1, 1)), SHAPE, (0.0, 1.0))
    maps = (np.where(why == 0, m, np.nan) for m in (x, y, z, np.hypot(u_r, 0.04), u_r))
    return HeightMap(*maps, exact, why)


def test_object_minus_plate_removes_a_tilt_and_adds_the_noise_of_both():
    tilt = 0.01 * np.arange(SHAPE[1]) * np.ones(SHAPE)
    found = minus_plate(surface(5.0 + tilt), surface(tilt))
    np.testing.assert_allclose(found.z, 5.0, atol=1e-12)
    np.testing.assert_allclose(found.u_random, 0.03 * np.sqrt(2))
    np.testing.assert_allclose(found.u_z, np.sqrt(0.04**2 + 2 * 0.03**2))


def test_a_pixel_without_plate_or_object_has_no_height():
    blank = np.zeros(SHAPE, np.uint8)
    blank[3, 4], other = Reason.NO_PHASE, np.zeros(SHAPE, np.uint8)
    other[5, 6] = Reason.OUT_OF_RANGE
    found = minus_plate(surface(np.ones(SHAPE), other), surface(np.zeros(SHAPE), blank))
    assert found.reasons[3, 4] == Reason.NO_PHASE
    assert found.reasons[5, 6] == Reason.OUT_OF_RANGE
    assert np.isnan(found.z[[3, 5], [4, 6]]).all()
    assert np.isfinite(found.z).sum() == found.z.size - 2


@pytest.mark.parametrize(
    ("name", "peak", "left"),
    [("none", 9.0, 1.0), ("median", 0.0, 0.4075), ("mean", 1.0, 1 / 3)],  # order statistics of nine normal values
)
def test_filters_of_heights_are_three_by_three(name, peak, left):
    z = np.zeros(SHAPE)
    z[10, 10] = 9.0
    found = filtered_heights(surface(z), name)
    assert found.z[10, 10] == pytest.approx(peak)
    np.testing.assert_array_equal(found.u_random, surface(z).u_random)
    far = found.u_z[2:-2, 20:-2]  # from the spike, whose loss counts as well
    assert np.median(far) == pytest.approx(np.hypot(0.04, left * 0.03), rel=0.03)
    assert found.u_z[10, 10] >= (9.0 - peak) / 1.96


def test_a_plate_measured_by_the_same_wrong_model_cancels_its_error():
    wrong = replace(surface(np.ones(SHAPE)), bias=np.full(SHAPE, 0.5))
    found = minus_plate(wrong, replace(surface(np.zeros(SHAPE)), bias=np.full(SHAPE, 0.5)))
    np.testing.assert_allclose(found.u_z, 0.03 * np.sqrt(2))


def test_a_treatment_says_what_it_does():
    assert Treatment().sentence == ""
    assert Treatment("median", "mean", minus_plate=True).sentence == (
        "frames filtered (median), plate's own heights subtracted, heights filtered (mean)"
    )
