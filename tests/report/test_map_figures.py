import io

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from fringecal.errors import RecordError
from fringecal.phase.demodulation.demodulate import demodulate
from fringecal.report.figures.maps import classification_overlay, error_map, height_map, residual_map
from fringecal.report.figures.phase_figures import phase_overview
from fringecal.report.figures.surface_view import surface_view
from fringecal.report.style import BLUE, HEIGHT_MAP, MASKED, ORANGE, symmetric_limit


def pixels(figure):
    """The figure as a reader sees it: RGB, row 0 at the top."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="rgba", dpi=100)
    width, height = (int(size) for size in figure.get_size_inches() * 100)
    return np.frombuffer(buffer.getvalue(), np.uint8).reshape(height, width, 4)[..., :3] / 255


def colour_at(figure, axes, x, y):
    """Colour drawn at data coordinates of an axes."""
    picture = pixels(figure)
    scale = 100 / figure.dpi
    across, up = axes.transData.transform((x, y)) * scale
    return picture[picture.shape[0] - 1 - round(up), round(across)]


def bar_label(figure):
    return figure.axes[1].get_ylabel()


def test_heights_stand_y_up_with_units_and_the_hole_grey(scene):
    figure = height_map(*scene, title="Tower")
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel(), bar_label(figure)) == ("x / mm", "y / mm", "height z / mm")
    # 80 samples of 2 mm: the outermost centres at 79 mm, their edges 1 mm further out.
    np.testing.assert_allclose(axes.get_xlim(), (-80, 80))
    np.testing.assert_allclose(axes.get_ylim(), (-60, 60))
    top, bottom = mpl.colormaps[HEIGHT_MAP](1.0)[:3], mpl.colormaps[HEIGHT_MAP](0.0)[:3]
    np.testing.assert_allclose(colour_at(figure, axes, 65, 50), top, atol=0.01)
    np.testing.assert_allclose(colour_at(figure, axes, 65, -50), bottom, atol=0.01)
    np.testing.assert_allclose(colour_at(figure, axes, -70, -52), to_rgb(MASKED), atol=0.01)


def test_maps_of_many_pixels_are_thinned_for_print():
    column, row = np.meshgrid(np.arange(2000.0), np.arange(4.0))
    figure = height_map(column, -row, column * 0)
    assert max(figure.axes[0].images[0].get_array().shape) <= 902


def test_errors_are_red_above_and_blue_below_on_equal_scales(scene):
    x, y, z = scene
    figure = error_map(x, y, np.where(np.isnan(z), np.nan, 0.01 * x), limit_mm=0.8)
    assert figure.axes[0].images[0].get_clim() == (-0.8, 0.8)
    assert "measured - reference / mm" in bar_label(figure)
    right, left = (colour_at(figure, figure.axes[0], place, 0) for place in (75, -75))
    assert right[0] > right[2]
    assert left[2] > left[0]


def test_a_lone_outlier_does_not_bleach_the_scale():
    values = np.r_[np.linspace(-1, 1, 10_001), 1000.0, np.nan]
    # 99.5 % of |v| uniform on 0..1 lies below 0.995; the outlier shifts that by one rank.
    assert symmetric_limit(values) == pytest.approx(0.995, abs=3e-4)
    assert symmetric_limit(np.array([np.nan, 0.0])) == 1.0


def test_residuals_stand_as_in_the_picture_row_0_at_the_top():
    residual = np.zeros((60, 80))
    residual[:10] = 1.0
    figure = residual_map(residual, limit_rad=1.0)
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("u (column) / px", "v (row) / px")
    assert "rad" in bar_label(figure)
    assert axes.get_ylim() == (59.5, -0.5)
    assert axes.get_xlim() == (-0.5, 79.5)
    picture = pixels(figure)
    red = (picture[..., 0] > 0.3) & (picture[..., 1] < 0.1) & (picture[..., 2] < 0.2)
    rows, columns = np.nonzero(red[:, : picture.shape[1] // 2])
    assert rows.max() < picture.shape[0] / 2
    assert columns.size > 1000


def test_classes_are_laid_where_they_are_and_named():
    classes = np.zeros((60, 80), dtype=int)
    classes[:20, :], classes[40:, :] = 7, 3
    figure = classification_overlay(np.zeros((60, 80)), classes, {7: "glass top", 3: "edge zone"})
    axes = figure.axes[0]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["glass top", "edge zone"]
    # Half transparent over black: half of the palette's colour; nothing where no class is named.
    np.testing.assert_allclose(colour_at(figure, axes, 40, 5), np.array(to_rgb(BLUE)) / 2, atol=0.02)
    np.testing.assert_allclose(colour_at(figure, axes, 40, 55), np.array(to_rgb(ORANGE)) / 2, atol=0.02)
    np.testing.assert_allclose(colour_at(figure, axes, 40, 30), 0.0, atol=0.01)


def test_a_map_without_a_valid_pixel_is_refused(scene):
    x, y, z = scene
    with pytest.raises(RecordError, match="valid"):
        height_map(x, y, z * np.nan)
    with pytest.raises(RecordError, match="valid"):
        surface_view(x, y, z * np.nan)


def test_the_surface_view_has_true_proportions_and_units(scene):
    x, y, z = scene
    masked = np.isnan(z)
    figure = surface_view(np.where(masked, np.nan, x), np.where(masked, np.nan, y), z, exaggeration=4)
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()) == (
        "x / mm",
        "y / mm",
        "z / mm (4 times)",
    )
    bar = figure.axes[1]
    assert bar.get_ylabel() == "height z / mm"
    # A flat box or not: heights are told by more than its two ends.
    assert len([tick for tick in axes.get_zticks() if 0 <= tick <= 5]) >= 3
    box = np.array(axes._box_aspect)
    np.testing.assert_allclose(box / box[0], np.array([158, 118, 5 * 4]) / 158, rtol=1e-9)
    pixels(figure)


def test_drawing_leaves_matplotlib_as_it_was(scene):
    before = dict(mpl.rcParams)
    height_map(*scene)
    assert dict(mpl.rcParams) == before


def test_the_legend_of_a_mask_counts_every_pixel_once():
    """A fifth of the picture is dark, and so lacks modulation as well: two reasons, one colour, one share."""
    steps = np.deg2rad([0.0, 120.0, 240.0])
    phase = np.broadcast_to(np.linspace(0.0, 40.0, 100), (60, 100))
    frames = 100 + 60 * np.cos(phase + steps[:, None, None]) + np.random.default_rng(4).normal(0, 1, (3, 60, 100))
    frames[:, :, 80:] = 1.0
    map_ = demodulate(frames.round().astype(np.uint8), steps)
    shares = [float(text.get_text().split()[-1].rstrip("%")) for text in phase_overview(map_).legends[0].get_texts()]
    assert 100 * sum(map_.shares().values()) > 110
    assert sum(shares) == pytest.approx(100, abs=0.02)  # two decimals each
    assert shares[0] == pytest.approx(80, abs=2)
