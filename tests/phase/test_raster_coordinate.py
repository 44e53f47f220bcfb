"""Projector pixels counted by fringes: against the coordinate that made them, whatever zero and direction they have."""

import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.numerics import wrap
from fringecal.phase import raster_coordinate

WIDTH = 1024
NOISE = 0.03
COUNTS = tuple(WIDTH / n for n in (59, 64, 70))
WIDENING = (18.0, 144.0, 1152.0)
SOFAST = tuple(WIDTH / n for n in (0.9, 3.9, 15.9, 63.9))


def seen(low: float, high: float) -> np.ndarray:
    """Projector columns that a camera's pixels see, shape (40, 300), px."""
    return np.linspace(low, high, 300)[None, :] + np.linspace(0, 3, 40)[:, None]


def phases(x, periods, zeros=None, *, falls=False, noise=NOISE):
    zeros = np.zeros(len(periods)) if zeros is None else zeros
    rng = np.random.default_rng(7)
    way = -1 if falls else 1
    return np.array(
        [
            wrap(way * 2 * np.pi * x / p + z + noise * rng.standard_normal(x.shape))
            for p, z in zip(periods, zeros, strict=True)
        ]
    )


def found(x, periods, zeros=None, *, truly_falls=False, **stated):
    maps = phases(x, periods, zeros, falls=truly_falls)
    return raster_coordinate(maps, np.full(maps.shape, NOISE), periods, WIDTH, **stated)


def errors(x, result):
    """Errors within five standard uncertainties, as their mean; and the share beyond."""
    error = (result.px - x) / result.u_px
    near = np.abs(error) < 5
    return float(error[near].mean()), float(error[near].std()), float(1 - near.mean())


@pytest.mark.parametrize("periods", [COUNTS, WIDENING, SOFAST])
def test_columns_come_back_with_their_uncertainty(periods) -> None:
    x = seen(40, 950)
    mean, sd, beyond = errors(x, found(x, periods))
    # 12,000 pixels: the mean of their errors in units of u has a standard deviation of 0.009, their own sd of 0.006.
    assert abs(mean) < 0.05
    assert sd == pytest.approx(1, abs=0.03)
    assert beyond < 1e-3


@pytest.mark.parametrize("periods", [COUNTS, WIDENING])
def test_sines_taken_for_cosines_count_alike(periods) -> None:
    x = seen(40, 950)
    result = found(x, periods, np.full(3, -np.pi / 2))
    _, _, beyond = errors(x, result)
    assert beyond < 1e-3
    assert np.rad2deg(result.zeros_rad) == pytest.approx(np.full(3, -90), abs=0.3)


def test_zeros_that_differ_from_period_to_period_are_used_as_stated() -> None:
    x, zeros = seen(40, 950), (0.3, 1.0, -2.0)
    assert errors(x, found(x, COUNTS, zeros, zeros_rad=zeros))[2] < 1e-3


def test_zeros_found_on_one_capture_serve_the_next() -> None:
    zeros = (0.3, 1.0, -2.0)
    first = found(seen(40, 950), WIDENING, zeros)
    x = seen(300, 500)
    second = found(x, WIDENING, zeros, zeros_rad=first.zeros_rad, falls=first.falls)
    moved = np.nanmedian(first.px - seen(40, 950))
    # One constant for both, however it was found: both count from one place.
    assert np.nanmedian(second.px - x) == pytest.approx(moved, abs=0.02)
    assert np.nanmax(np.abs(second.px - x - moved)) < 0.6


def test_the_offset_of_36_deg_of_a_picture_further_on() -> None:
    x = seen(40, 950)
    offset = np.deg2rad(36)
    rising = found(x, SOFAST, np.full(4, offset), falls=False)
    assert errors(x, rising)[2] < 1e-3
    assert np.rad2deg(rising.zeros_rad) == pytest.approx(np.full(4, 36), abs=0.3)
    falling = found(x, SOFAST, truly_falls=True, falls=True)
    assert errors(x, falling)[2] < 1e-3


def test_a_phase_that_falls_is_told_where_it_would_leave_the_projector() -> None:
    x = seen(40, 950)
    result = found(x, SOFAST, truly_falls=True)
    assert result.falls
    assert errors(x, result)[2] < 1e-3


def test_where_the_cycle_is_the_picture_the_direction_is_open_and_mirrored_is_the_other() -> None:
    x = seen(40, 950)
    result = found(x, COUNTS, truly_falls=True)
    assert not result.falls
    # cos(2 pi n (W - x) / W) is cos(2 pi n x / W) for whole n: nothing in the picture says which it is.
    assert np.nanmedian(np.abs(result.mirrored().px - x)) < 0.1


def test_one_long_period_counts_alone_and_one_short_does_not() -> None:
    x = seen(40, 950)
    maps = phases(x, (1100.0,))
    result = raster_coordinate(maps, np.full(maps.shape, NOISE), (1100.0,), WIDTH)
    assert errors(x, result)[2] < 1e-3
    with pytest.raises(PhaseError, match=r"repeats within the projector's 1024 px"):
        raster_coordinate(maps, np.full(maps.shape, NOISE), (200.0,), WIDTH)


@pytest.fixture(scope="module")
def facet(request):
    """Frames of a facet seen in a screen, made linear by the measured response, with the published answer."""
    data = np.load(request.config.rootpath / "tests" / "data" / "opencsp_sofast" / "facet.npz")
    levels = np.argsort(data["response_camera"])
    linear = np.interp(data["frames"], data["response_camera"][levels], data["response_display"][levels])
    mask = data["expected_mask"].astype(bool)
    return linear.reshape(2, 4, 4, *mask.shape), data["fringe_counts"], mask, data["expected_fraction_xy"]


@pytest.mark.parametrize(("axis", "row", "falls", "offset_deg"), [("y", 1, False, 36), ("x", 0, True, 0)])
def test_real_frames_give_the_published_screen_position(facet, axis, row, falls, offset_deg) -> None:
    linear, counts, mask, published = facet
    # Four steps of a quarter: I0 - I2 = 2 B cos(phi), I3 - I1 = 2 B sin(phi).
    frames = linear[0 if axis == "y" else 1]
    maps = np.where(mask, np.arctan2(frames[:, 3] - frames[:, 1], frames[:, 0] - frames[:, 2]), np.nan)
    extent = 1000.0  # of the screen, in units of a thousandth of it
    found = raster_coordinate(maps, np.full(maps.shape, 0.02), extent / counts, extent, falls=falls)
    position = found.px[mask] / extent
    assert np.isfinite(position).all()
    # The published answer agrees with the frames to 1e-5 rad of the finest period, which is 2.5e-8 of the screen.
    assert np.sqrt(np.mean((position - published[row]) ** 2)) < 1e-4
    assert np.rad2deg(found.zeros_rad) == pytest.approx(np.full(4, offset_deg), abs=1)


@pytest.mark.parametrize(("axis", "row", "falls", "offset_deg"), [("y", 1, False, 36), ("x", 0, True, 0)])
def test_real_frames_give_it_without_any_response_too(request, axis, row, falls, offset_deg) -> None:
    """Four steps are blind to the even harmonics of a gamma, and the shortest fringe is a 64th of the screen."""
    data = np.load(request.config.rootpath / "tests" / "data" / "opencsp_sofast" / "facet.npz")
    mask = data["expected_mask"].astype(bool)
    frames = data["frames"].astype(float).reshape(2, 4, 4, *mask.shape)[0 if axis == "y" else 1]
    maps = np.where(mask, np.arctan2(frames[:, 3] - frames[:, 1], frames[:, 0] - frames[:, 2]), np.nan)
    extent = 1000.0
    found = raster_coordinate(maps, np.full(maps.shape, 0.02), extent / data["fringe_counts"], extent, falls=falls)
    position = found.px[mask] / extent
    assert np.sqrt(np.mean((position - data["expected_fraction_xy"][row]) ** 2)) < 1e-4
    assert np.rad2deg(found.zeros_rad) == pytest.approx(np.full(4, offset_deg), abs=1)
