"""Lines on the pixel raster, against sheets that are integrated over every pixel in closed form."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from fringecal.camera.distortion.crossing_scatter import CrossingNoise
from fringecal.camera.distortion.distortion_test import examine_distortion
from fringecal.detect.grid.grid_search import find_grid
from fringecal.detect.grid.line_profile import LineProfile
from fringecal.detect.grid.line_scatter import LineScatter

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SHAPE = (320, 400)
CASES = [(1.2, 0.2), (1.5, 0.4), (2.0, 0.2), (3.0, 1.0)]


@pytest.fixture(scope="module")
def sheets():
    spec = importlib.util.spec_from_file_location("exact_sheets", BENCHMARKS / "exact_sheets.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclass looks there for its own module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def raster_sheets(sheets):
    """Sheets nearly along the pixels, spacings within 0.03 px of whole numbers, and what was found in each."""
    found = []
    for seed, (width, blur) in enumerate(CASES):
        rng = np.random.default_rng([15, seed])
        sheet = sheets.Sheet(
            width, blur, 34 + rng.uniform(-0.03, 0.03), rng.uniform(-0.5, 0.5), tuple(rng.uniform(0, 34, 2))
        )
        found.append((sheet, find_grid(sheets.picture(sheet, SHAPE, rng))))
    return found


def errors(sheet, grid):
    seen = np.stack([grid.u_px, grid.v_px], axis=1)
    return seen - sheet.crossings(*sheet.nearest(*seen.T, SHAPE), SHAPE)


def test_exact_sheet_is_the_mean_of_many_points(sheets):
    sheet = sheets.Sheet(1.2, 0.3, 9.3, 17.0, (0.3, -0.2))
    v, u = np.mgrid[:12, :14].astype(float)
    steps = (np.arange(60) + 0.5) / 60 - 0.5
    total = np.zeros(v.shape)
    for a in steps:
        for b in steps:
            places = sheet.places(u + a, v + b, v.shape)
            off = places - 9.3 * np.rint(places / 9.3)
            one, other = (sheets.blurred_line(part, 1.2, 0.3) for part in off)
            total += one + other - one * other
    # The midpoint rule on 60 points to the side: h^2 / 24 of the second derivative, which is below 30.
    np.testing.assert_allclose(sheets.ink_shares(sheet, v.shape), total / 3600, atol=4e-4)


@pytest.mark.parametrize("rotation_deg", [0.0, 0.03, 12.0, 45.0])
def test_profile_of_a_slanted_pixel(sheets, rotation_deg):
    sheet = sheets.Sheet(1.7, 0.3, 40.0, rotation_deg)
    x, slant = np.linspace(-4, 4, 81), float(np.sin(np.radians(rotation_deg)))
    profile = LineProfile(1.7, 0.3)
    # A slant below 0.001 counts as none: its box widens the line's variance by 1e-7 px^2.
    np.testing.assert_allclose(profile.height(x, slant), sheets.collected_line(x, sheet), atol=1e-6)
    numeric = (profile.height(x + 1e-5, slant) - profile.height(x - 1e-5, slant)) / 2e-5
    np.testing.assert_allclose(profile.slope(x, slant), numeric, atol=1e-6)


def test_width_and_blur_are_those_drawn(raster_sheets):
    for sheet, grid in raster_sheets:
        # Cubic interpolation made 1.6 px of 1.2 px; a hundredth of what the pixel itself measures is allowed.
        assert grid.profile.width_px == pytest.approx(sheet.width_px, abs=0.05)
        assert grid.profile.blur_px == pytest.approx(sheet.blur_px, abs=0.03)


def test_crossings_scatter_as_their_covariance_says(raster_sheets):
    for sheet, grid in raster_sheets:
        error = errors(sheet, grid)
        noise = CrossingNoise(grid.row, grid.column, grid.sigma_px, grid.scatter)
        z = noise.whitening()(error - error.mean(axis=0))
        # About 180 values: their rms is known to 5 %, and the points' own u to as much.
        assert z.std() == pytest.approx(1.0, abs=0.2)


def test_no_sheet_is_called_bent(raster_sheets):
    tests = [examine_distortion(grid) for _, grid in raster_sheets]
    # 5 % each: two of four in 1.4 % of cases; the misfit was 3 to 13 with the profile of interpolated sections.
    assert sum(test.verdict != "none" for test in tests) <= 1
    assert all(test.misfit == pytest.approx(1.0, abs=0.2) for test in tests)
    # What it would have seen: a few hundredths of a pixel at the corner.
    assert all(test.detection_limit_px < 0.02 for test in tests)


def test_sharp_lines_all_in_one_place_of_their_pixels(sheets):
    # Every line passes its pixels at one phase, and those of the pyramid: a coarse place rounded there is 3 px off.
    sheet, shape = sheets.Sheet(1.2, 0.2, 40.0, 0.0, (3.3, 7.1)), (500, 600)
    grid = find_grid(sheets.picture(sheet, shape, np.random.default_rng(1)))
    seen = np.stack([grid.u_px, grid.v_px], axis=1)
    error = seen - sheet.crossings(*sheet.nearest(*seen.T, shape), shape)
    assert len(grid.row) == 12 * 15
    # Width and blur are not determined, and with them the common place; every crossing beside it is.
    assert np.abs(error).max() < 0.1
    assert (error - error.mean(axis=0)).std() < 0.01


def test_whitening_of_lines_with_gaps_is_the_inverse_root_of_their_covariance():
    row, column = (index.ravel() for index in np.mgrid[:3, :6])
    kept = np.flatnonzero((row != 1) | (column != 2))
    row, column = row[kept], column[kept]
    by_lag = np.array([2.0, -0.5, 0.2, 0.1])
    bands = np.broadcast_to(by_lag, (len(kept), 2, 4))
    scatter = LineScatter(np.broadcast_to(np.eye(2)[::-1], (len(kept), 2, 2)), bands, np.zeros((0, len(kept), 2)))
    whitened = CrossingNoise(row, column, np.ones(len(kept)), scatter).whitening()
    # Normals: horizontal lines err along v, vertical ones along u.
    for family, (line, place, axis) in enumerate(((row, column, 1), (column, row, 0))):
        gap = np.abs(place[:, None] - place[None, :])
        together = (line[:, None] == line[None, :]) & (gap < 4)
        covariance = np.where(together, by_lag[np.minimum(gap, 3)], 0.0)
        shifts = np.zeros((len(kept), 2, len(kept)))
        shifts[:, axis] = np.eye(len(kept))
        root = whitened(shifts)[:, family]
        np.testing.assert_allclose(root @ covariance @ root.T, np.eye(len(kept)), atol=1e-7)
