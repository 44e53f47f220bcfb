"""A Gray code beside the fringes: found where its edges lie, right at every pixel, refused where it does not belong."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.phase import Noise, demodulate
from fringecal.phase.orders.gray_orders import orders_by_gray
from fringecal.phase.orders.multi_period import PlateOrders

SHAPE = (120, 180)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
ON_BOX = (np.abs(U - 80) < 30) & (np.abs(V - 60) < 25)
STEPS = np.deg2rad([0, 120, 240])


def taken(fringes, camera, rng, *, start=-np.pi, per_fringe=1, falling=False, step=3.4, bits=5, blur=0.0):
    """Give phase map, code frames and true phase of a box on a plate; the code goes on at the phase `start`."""
    truth = 2 * np.pi * (2.3 + 11 * U / SHAPE[1] + 0.2 * V / SHAPE[0] + np.where(ON_BOX, step, 0.0))
    map_ = demodulate(camera(fringes(truth, STEPS), rng, sigma=1.0), STEPS, noise=Noise(1.0))
    moved = truth + blur * np.sin(0.7 * U + 0.4 * V)  # an edge that is not where it should be
    number = np.floor((moved - start) / (2 * np.pi) * per_fringe).astype(int)
    number = 2**bits - 1 - number if falling else number
    gray = number ^ (number >> 1)
    frames = np.stack([40 + 160 * (gray >> (bits - 1 - k) & 1) for k in range(bits)]).astype(float)
    return map_, camera(frames, rng, sigma=2.0), truth


@pytest.mark.parametrize("start", [-np.pi, 0.0, 1.0, 3.0])
@pytest.mark.parametrize(("per_fringe", "falling"), [(1, False), (1, True), (2, False)])
def test_every_pixel_has_its_order_wherever_the_code_goes_on(start, per_fringe, falling, fringes, camera, rng):
    map_, frames, truth = taken(fringes, camera, rng, start=start, per_fringe=per_fringe, falling=falling)
    orders = orders_by_gray(map_, frames)
    off = (orders.phase - truth) / (2 * np.pi)
    assert orders.cycle == 32 // per_fringe
    assert orders.undecided < 2e-3
    np.testing.assert_allclose(off[np.isfinite(off)], np.round(np.nanmedian(off)), atol=0.05)


def test_blurred_edges_of_the_code_do_no_harm(fringes, camera, rng):
    map_, frames, truth = taken(fringes, camera, rng, blur=0.6)
    orders = orders_by_gray(map_, frames)
    assert orders.asked > 0.1
    off = (orders.phase - truth) / (2 * np.pi)
    np.testing.assert_allclose(off[np.isfinite(off)], np.round(np.nanmedian(off)), atol=0.05)


def test_two_captures_are_counted_alike(fringes, camera, rng):
    (plate, code, flat), (box, its_code, truth) = (taken(fringes, camera, rng, step=s) for s in (0.0, 3.4))
    tie = PlateOrders.of(orders_by_gray(plate, code), flat)
    found = orders_by_gray(box, its_code)
    off = (found.phase + 2 * np.pi * tie.number_for(found) - truth) / (2 * np.pi)
    off -= 32 * np.rint(off / 32)
    np.testing.assert_allclose(off[np.isfinite(off)], 0, atol=0.05)


def test_a_code_that_does_not_belong_is_refused(fringes, camera, rng):
    map_, frames, _ = taken(fringes, camera, rng)
    for wrong, message in (
        (frames[::-1], "numbers for each fringe|goes on"),
        (np.zeros_like(frames), "increases by one at 0 pixels"),
        (frames[:, :50], "found Gray-code frames"),
    ):
        with pytest.raises(PhaseError, match=message):
            orders_by_gray(map_, wrong)
