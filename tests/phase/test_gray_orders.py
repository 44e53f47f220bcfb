"""A Gray code beside the fringes: found where its edges lie, right at every pixel, refused where it does not belong."""

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from fringecal.errors import PhaseError
from fringecal.phase import Noise, demodulate, summarise
from fringecal.phase.orders.gray_orders import orders_by_gray
from fringecal.phase.orders.multi_period import PlateOrders
from fringecal.session import load_session

REAL = Path(__file__).parents[1] / "data" / "kamino_gray_code"
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


@pytest.mark.parametrize("complements", ["none", "after each", "after all"])
@pytest.mark.parametrize("blur_px", [1.0, 2.5, 4.0])
def test_edges_blurred_over_pixels_are_decided_by_the_phase(blur_px, complements, fringes, camera, rng):
    """Fringes are 16 px wide; at 4 px half of the light of every edge lies more than 2.7 px beside it."""
    map_, frames, truth = taken(fringes, camera, rng)
    at_box = np.abs(np.abs(U - 80) - 30) * (np.abs(V - 60) < 29) + 99 * (np.abs(V - 60) >= 29)
    beside_box = (at_box < 12) | ((np.abs(np.abs(V - 60) - 25) < 12) & (np.abs(U - 80) < 42))  # two codes mixed
    blurred = np.stack([ndimage.gaussian_filter(frame, (0, blur_px)) for frame in frames])
    dark = 240 - blurred
    paired = np.stack([blurred, dark], axis=1).reshape(-1, *SHAPE)
    sent = {"none": blurred, "after each": paired, "after all": np.concatenate([blurred, dark])}[complements]
    orders = orders_by_gray(map_, sent)
    off = ((orders.phase - truth) / (2 * np.pi))[~beside_box]
    known = np.isfinite(off)
    assert known.mean() > 0.95
    whole = np.round(off[known] - np.median(off[known]))
    assert np.mean(whole == 0) > 0.999


def test_edges_of_a_projected_code_that_a_response_bends(fringes, camera, rng):
    """A response of 2.2 darkens the fringes' mean to less than half of the code's white."""
    truth = 2 * np.pi * (2.3 + 11 * U / SHAPE[1])
    waves = [30 + 180 * (0.5 + 0.5 * np.cos(truth + step)) ** 2.2 for step in STEPS]
    map_ = demodulate(camera(np.stack(waves), rng, sigma=1.0), STEPS, noise=Noise(1.0))
    number = np.floor(truth / (2 * np.pi) + 0.5).astype(int)
    bits = [30 + 180 * ((number ^ (number >> 1)) >> (4 - k) & 1) for k in range(5)]
    codes = np.stack([ndimage.gaussian_filter(bit.astype(float), (0, 2.5)) for bit in bits])
    orders = orders_by_gray(map_, camera(codes, rng, sigma=2.0))
    off = (orders.phase - truth) / (2 * np.pi)
    known = np.isfinite(off)
    assert known.mean() > 0.95
    assert np.mean(np.round(off[known] - np.median(off[known])) == 0) > 0.999


def test_a_real_code_with_blurred_edges():
    """Wall and box of kamino410: a plain decoder finds one number for each fringe."""
    capture = load_session(REAL).find("object")[0]
    map_ = summarise(capture.read(), np.array(capture.phase_shifts_rad), white_level=255).map
    orders = orders_by_gray(map_, capture.read_gray())
    assert orders.cycle == 32
    assert orders.undecided < 0.02
    # The wall is smooth: from pixel to pixel the absolute phase goes on by far less than half a fringe.
    steps = np.diff(orders.phase, axis=1)
    assert np.mean(np.abs(steps[np.isfinite(steps)]) > np.pi) < 0.002


def test_displaced_edges_of_the_code_do_no_harm(fringes, camera, rng):
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
