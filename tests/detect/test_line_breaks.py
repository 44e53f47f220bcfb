"""Breaks of one line: drawn ones in closed form, and a photographed coin and cube (tests/data/tis_laser_line)."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage

from fringecal.detect.fringes.line_breaks import line_breaks
from fringecal.errors import DetectionError

DATA = Path(__file__).parents[1] / "data" / "tis_laser_line"


def green(name):
    (path,) = DATA.glob(f"{name}*.jpg")
    return cv2.imread(str(path))[:, :, 1]


def drawn(shift=25.3, *, columns=(100, 220), slope=0.01, dark=(), noise=2.0, seed=0):
    u, v = np.arange(320), np.arange(160)[:, None]
    centre = 60.4 + slope * u + np.where((u >= columns[0]) & (u < columns[1]), shift, 0.0)
    grey = 180 * np.exp(-(((v - centre) / 2.5) ** 2) / 2)
    for low, high in dark:
        grey[:, low:high] = 0
    return grey + 8 + noise * np.random.default_rng(seed).standard_normal(grey.shape)


@pytest.mark.parametrize("shift", [25.3, -18.7])
def test_a_drawn_break_has_its_shift_and_its_columns(shift):
    (found,) = line_breaks(drawn(shift)).breaks
    assert found.shift_px == pytest.approx(shift, abs=0.05)  # 0.02 px of noise in a column, 120 columns
    assert (found.from_px, found.to_px) == pytest.approx((100, 219), abs=2)


def test_dark_columns_are_no_break():
    found = line_breaks(drawn(0.0, dark=((40, 90), (200, 260))))
    assert found.breaks == ()
    assert np.isnan(found.centre_px[50:80]).all()
    assert found.base == pytest.approx((60.4, 0.01), abs=0.05)


def test_the_coins_break_over_the_frames():
    found = [line_breaks(green(name)).breaks for name in ("440", "470", "490", "510")]
    shifts, sigmas = (np.array([getattr(one, name) for (one,) in found]) for name in ("shift_px", "sigma_px"))
    assert np.mean(shifts) == pytest.approx(66.9, abs=0.4)
    # The coin is in relief by 1.7 px: along the line its level rises from 66.2 to 68.3, and where the line crosses
    # its letters (490: 67.5) the middle of all columns lies higher. That belongs to the stated sigma.
    assert np.all(np.abs(shifts - 66.9) < 2 * sigmas)
    assert np.all(sigmas < 0.8)  # 2 px of relief over eight parts


@pytest.mark.parametrize("name", ["340-145825", "340-145939", "380", "550"])
def test_holes_shadow_and_room_light_make_no_break(name):
    assert line_breaks(green(name)).breaks == ()


@pytest.mark.parametrize("name", ["671-144107", "671-144245"])
def test_the_cubes_break_over_exposures(name):
    (found,) = line_breaks(green(name)).breaks
    # By hand 297.1 to 299.6 px; bloom moves the bright one.
    assert 297 <= found.shift_px <= 300.5


@pytest.mark.parametrize(
    "picture", [np.zeros((60, 80)), np.full((60, 80), 200.0), np.zeros((3, 80)), np.full((60, 80), np.nan)]
)
def test_no_line_is_refused(picture):
    with pytest.raises(DetectionError):
        line_breaks(picture)


def blurred(shift, flank_px, *, peak=120.0, slope=0.01, noise=1.0, seed=0, block=(150, 320)):
    """Draw a break whose flanks are blurred along the line, so that it nowhere jumps."""
    u, v = np.arange(480), np.arange(160)[:, None]
    step = ndimage.gaussian_filter1d(np.where((u >= block[0]) & (u < block[1]), shift, 0.0), flank_px)
    grey = peak * np.exp(-(((v - 70.2 - slope * (u - 240) - step) / 2.0) ** 2) / 2)
    grey = grey + 3 + noise * np.random.default_rng(seed).standard_normal(grey.shape)
    return np.clip(np.rint(grey), 0, 255)


@pytest.mark.parametrize("shift", [7.0, -7.0, 25.0])
@pytest.mark.parametrize("flank_px", [4.0, 10.0])
@pytest.mark.parametrize("slope", [0.0, 0.03])
def test_a_break_with_blurred_flanks_is_one(shift, flank_px, slope):
    # Half-way up the flanks, at 150 and 320; the plateau is reached 2.5 flanks further in.
    (found,) = line_breaks(blurred(shift, flank_px, slope=slope)).breaks
    assert found.shift_px == pytest.approx(shift, abs=0.15)
    assert 150 - flank_px < found.from_px < 150 + 2.5 * flank_px
    assert 320 - 2.5 * flank_px < found.to_px < 320 + flank_px


@pytest.mark.parametrize("shift", [5.0, -8.7])
def test_a_break_to_one_side_of_the_middle_does_not_tilt_the_base(shift):
    trace = line_breaks(blurred(shift, 2.0, slope=-0.023, block=(160, 370)))
    assert trace.breaks[0].shift_px == pytest.approx(shift, abs=0.15)
    assert trace.base[1] == pytest.approx(-0.023, abs=0.001)


@pytest.mark.parametrize("peak", [3.0, 6.0])
def test_a_dark_frame_is_read(peak):
    (found,) = line_breaks(blurred(20.0, 1.0, peak=peak, noise=0.3)).breaks
    assert found.shift_px == pytest.approx(20, abs=0.3)


@pytest.mark.parametrize("name", ["340-145825", "380", "440", "490", "550", "671-144107"])
def test_a_twenty_fifth_of_the_exposure_shows_the_same(name):
    bright = line_breaks(green(name)).breaks
    dark = line_breaks(np.rint(green(name) / 25)).breaks
    assert [one.shift_px for one in dark] == pytest.approx([one.shift_px for one in bright], abs=0.3)


@pytest.mark.parametrize("seed", range(6))
def test_dark_frames_without_a_line_are_refused(seed):
    rng = np.random.default_rng(seed)
    ground = np.linspace(0, rng.uniform(0, 3), 200)[:, None] + np.linspace(0, rng.uniform(0, 3), 400)
    with pytest.raises(DetectionError, match="no bright line"):
        line_breaks(np.clip(np.rint(ground + rng.normal(0, rng.uniform(0.1, 2), ground.shape)), 0, 255))
