"""Pictures and lists of points beyond the 32,767 that OpenCV resamples at once."""

import numpy as np
import pytest
from scipy import ndimage

from fringecal.detect import find_grid
from fringecal.detect.picture_samples import brightness_at

SHAPES = [(3, 70_000), (70_000, 3), (40, 50)]


@pytest.mark.parametrize("shape", SHAPES, ids=["wide", "high", "small"])
@pytest.mark.parametrize("columns", [1, 7], ids=["long list", "rows of points"])
def test_the_picture_is_sampled_anywhere(shape, columns):
    """scipy's linear interpolation is another program; OpenCV rounds places to 1/32 px."""
    rng = np.random.default_rng(4)
    image = ndimage.gaussian_filter(rng.uniform(0, 100, shape), 2.0).astype(np.float32)
    u, v = (rng.uniform(-3, size + 2, (34_000, columns)) for size in shape[::-1])
    expected = ndimage.map_coordinates(image, [v, u], order=1, mode="nearest")
    steepest = max(float(np.abs(np.diff(image, axis=axis)).max()) for axis in (0, 1))
    # two coordinates, each off by 1/64 px at most, and float32 places of 1/256 px far out
    np.testing.assert_allclose(brightness_at(image, u, v), expected, atol=2 * steepest * (1 / 64 + 1 / 256))


def _ruled(width: int, height: int, pitch: float) -> np.ndarray:
    """Draw dark lines 1.5 px wide, the first of each direction half a pitch inside."""
    columns, rows = (np.abs((np.arange(size) % pitch) - pitch / 2) < 0.75 for size in (width, height))
    picture = 200.0 - 120.0 * (columns[None] | rows[:, None])
    return ndimage.gaussian_filter(picture, 0.7) + np.random.default_rng(1).normal(0, 1.5, picture.shape)


def test_more_crossings_than_one_look_up_takes():
    """184 x 184 lines: 33,856 crossings, and more edges between them than 32,767."""
    grid = find_grid(_ruled(184 * 8, 184 * 8, 8.0))
    assert len(grid.row) >= 182**2  # lines at the very border may be left out
    along = grid.row == 90
    assert np.median(np.diff(np.sort(grid.u_px[along]))) == pytest.approx(8.0, abs=0.01)
