import numpy as np
import pytest

from fringecal.report.figures.angle_figures import angle_plot
from fringecal.report.figures.profile_figures import profile_plot
from fringecal.report.figures.rig_drawing import Pupil, rig_drawing
from fringecal.report.figures.table_bars import budget_bars, comparison_bars

PLATE = (-200.0, 200.0, -150.0, 150.0)


def lines(axes):
    return {line.get_label(): line for line in axes.lines}


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_profile_shows_both_curves_the_band_and_the_error():
    x = np.linspace(-10, 10, 41)
    reference, u = np.abs(x), np.full(41, 0.1)
    measured = reference + 0.05
    left_out = np.abs(x) < 1
    measured[left_out] += 3.0
    figure = profile_plot(x, measured, reference, u, left_out=left_out, title="C")
    above, below = figure.axes
    assert (above.get_ylabel(), below.get_ylabel()) == ("height z / mm", "error / mm")
    assert below.get_xlabel() == "x / mm"
    np.testing.assert_array_equal(lines(above)["measured"].get_ydata(), measured)
    np.testing.assert_array_equal(lines(above)["reference"].get_ydata(), reference)
    band = below.collections[0].get_paths()[0].vertices
    # 1.96 u about an error of 0.05 mm where the point counts.
    outer = band[np.abs(band[:, 0]) > 1]
    assert outer[:, 1].max() == pytest.approx(0.05 + 0.196, abs=1e-4)
    assert outer[:, 1].min() == pytest.approx(0.05 - 0.196, abs=1e-4)
    # Points that are left out (3 mm off) are shaded and do not set the scale.
    assert below.get_ylim()[1] < 0.5
    assert "edge zone, left out" in legend(figure)


def test_a_profile_with_gaps_is_drawn():
    x = np.arange(5.0)
    figure = profile_plot(x, np.where(x == 2, np.nan, x), x, np.full(5, 0.1))
    assert np.isnan(lines(figure.axes[0])["measured"].get_ydata()[2])
    assert "edge zone, left out" not in legend(figure)


def test_angles_have_95_percent_bars_and_state_their_convention():
    x = np.array([-100.0, 0.0, 100.0])
    figure = angle_plot(x, 50.7 - x / 60, np.full(3, 0.1), theory_deg=50.8 - x / 60)
    axes = figure.axes[0]
    assert axes.get_ylabel() == "angle from the plate's normal / deg"
    segments = axes.collections[0].get_segments()
    np.testing.assert_allclose([np.ptp(segment[:, 1]) for segment in segments], 2 * 0.1, rtol=1e-3)
    assert any("theory" in text for text in legend(figure))
    assert not any("apparent" in text for text in legend(figure))


def test_a_budget_has_its_largest_share_on_top():
    figure = budget_bars(["noise", "strip height", "correlated"], [20.0, 85.0, -5.0], title="z")
    axes = figure.axes[0]
    widths = [bar.get_width() for bar in axes.patches]
    assert widths == [-5.0, 20.0, 85.0]  # bars are stacked from the bottom up
    assert [text.get_text() for text in axes.get_yticklabels()] == ["correlated", "noise", "strip height"]
    assert axes.get_xlabel().endswith("/ %")
    low, high = axes.get_xlim()
    assert low < -5.0
    assert high > 85.0


def test_models_are_compared_in_the_order_given():
    figure = comparison_bars(["projective", "constant-angle"], [0.05, 0.4], [0.2, 6.0], [0.7, 12.3])
    axes = figure.axes[0]
    assert [bar.get_width() for bar in axes.patches] == [0.7, 12.3]
    assert axes.yaxis_inverted()
    assert axes.get_xlabel() == "height error / % of full height"


@pytest.mark.parametrize(("position", "names"), [((0.0, 1222.0, 1000.0), "yz"), ((-1222.0, 0.0, 1000.0), "xz")])
def test_the_rig_is_drawn_to_scale_with_its_angle(position, names):
    projector = Pupil("projector, fitted", np.array(position), np.full(3, 5.0))
    camera = Pupil("camera", np.array([0.0, 0.0, 1500.0]), np.full(3, 5.0))
    figure = rig_drawing(PLATE, projector, camera, title="bench-1")
    side, top = figure.axes
    assert (side.get_xlabel(), side.get_ylabel()) == tuple(f"{name} / mm" for name in names)
    assert (top.get_xlabel(), top.get_ylabel()) == ("x / mm", "y / mm")
    assert side.get_aspect() == top.get_aspect() == 1.0
    # atan(1222 / 1000) = 50.706 degrees
    assert [text.get_text() for text in side.texts] == ["50.7°"]
    marks = lines(side)["projector, fitted"].get_xydata()[0]
    np.testing.assert_allclose(marks, (position["xy".index(names[0])], 1000.0))
    # The 95 % region of two free coordinates reaches sqrt(chi2) = 2.448 u to each side.
    assert side.patches[0].width == pytest.approx(2 * 2.4477 * 5.0, rel=1e-4)


def test_a_stated_place_and_a_telecentric_camera_are_drawn():
    fitted = Pupil("projector, fitted", np.array([0.0, 1234.0, 1000.0]), np.full(3, 5.0))
    stated = Pupil("projector, stated", np.array([0.0, 1222.0, 1000.0]), np.full(3, 3.0))
    figure = rig_drawing(PLATE, fitted, None, stated_projector=stated)
    assert set(legend(figure)) == {"projector, fitted", "projector, stated", "camera, telecentric"}
