"""Pieces of the reports against closed forms."""

import math

import numpy as np
import pandas as pd
import pytest

from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.records.parts import Check
from fringecal.report.report_files import figures_of, tables_of
from fringecal.report.structure import FigureItem, Report, Section, Table, Verdict
from fringecal.report.style import new_figure
from fringecal.uncertainty.budgets import combined
from fringecal.uncertainty.components import UncertaintyComponent
from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.influences import Influence
from fringecal.workflows.commission.camera_section import local_scale, local_scale_table
from fringecal.workflows.commission.residual_section import StripResiduals, cell_means, scattered
from fringecal.workflows.reconstruct.report import section_rows
from fringecal.workflows.shared.sections.report_parts import budget_table, concise, severest


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [
        # JCGM 100:2008, 7.2.2 prints 100,021 47(35) g for m = 100,021 47 g with u = 0,35 mg.
        (100.02147, 0.00035, "100.02147(35) g"),
        (1500.3, 5.04, "1500.3(5.0) g"),
        (1222.1, 123.4, "1222(123) g"),
        (-0.00017, 0.0049, "-0.0002(49) g"),
        (0.734, 0.0, "0.734 g"),
        (1.0, math.inf, "1 g"),
    ],
)
def test_estimates_print_as_the_guide_prints_them(value, u, text):
    assert concise(Estimate(value, u, "g")) == text


@pytest.mark.parametrize(
    ("decisions", "answer"),
    [
        ((), "info"),
        (("info",), "info"),
        (("pass", "info"), "pass"),
        (("pass", "conditionalPass"), "conditionalPass"),
        (("conditionalPass", "conditionalFail"), "conditionalFail"),
        (("pass", "fail", "conditionalFail"), "fail"),
    ],
)
def test_the_severest_check_decides(decisions, answer):
    assert severest([Check(name=str(n), decision=d) for n, d in enumerate(decisions)]) == answer


def test_a_budget_is_sorted_and_its_shares_add_up():
    effects = {"small": 3.0, "large": -4.0}
    small, large = (UncertaintyComponent(Influence.INPUT, u, detail=name) for name, u in effects.items())
    frame = budget_table("b", combined(0.7, (small, large), unit="mm/px")).frame
    assert list(frame["source of uncertainty"]) == ["large", "small"]
    # 3-4-5: the variances are 9 and 16 of 25.
    assert frame["share of the variance / %"].tolist() == pytest.approx([64.0, 36.0])
    assert frame["contribution / (mm/px)"].tolist() == [4.0, 3.0]


def test_equal_captions_get_files_of_their_own():
    def section():
        figure = new_figure(2, 1)
        figure.subplots().plot([0, 1])
        table = Table("Error / mm", pd.DataFrame({"a": [1 / 3]}))
        return Section("s", (), (table,), (FigureItem("A line", figure, "a line"),))

    report = Report("t", Verdict("info", ""), sections=(section(), section(), section()))
    assert list(tables_of(report)) == ["error-mm.csv", "error-mm-2.csv", "error-mm-3.csv"]
    assert list(figures_of(report)) == ["a-line.svg", "a-line-2.svg", "a-line-3.svg"]
    assert all(content.startswith(b"<?xml") for content in figures_of(report).values())
    assert tables_of(report)["error-mm.csv"]["a"][0] == 1 / 3


def test_a_report_without_tables_gives_no_files():
    empty = Report("t", Verdict("info", ""))
    assert tables_of(empty) == {}
    assert figures_of(empty) == {}


def test_the_scale_of_a_tilted_camera_grows_as_its_distance():
    # Pinhole tilted about y only: along v the scale on the plate is proportional to the depth of the plate point.
    tilt, height = 0.1, 1000.0
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": height, "tilt_x_rad": tilt}, (400, 600))
    axis = np.array([math.tan(tilt), 0.0, 1.0]) / math.hypot(math.tan(tilt), 1.0)
    for u in (20.0, 299.5, 580.0):
        x = float(camera.rays(u, 199.5).ax)
        depth = float((camera.position_mm - np.array([x, 0.0, 0.0])) @ axis)
        # 1e-6: the scale is a difference over one pixel of a curve that bends by parts in 1e7 over it.
        assert local_scale(camera, u, 199.5)[1] == pytest.approx(depth / camera.focal_px, rel=1e-6)


def test_barrel_distortion_makes_the_mean_factor_err_most_in_the_corners():
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 1000.0, "k1": -0.2}, (400, 600))
    frame = local_scale_table(camera, 0.5).frame.set_index("place")
    error = frame[["error along u / %", "error along v / %"]].abs().max(axis=1)
    assert error.idxmax() in {"top left", "top right", "bottom left", "bottom right"}
    # A picture that shrinks outward shows more mm per px there: the mean factor gives too little.
    assert frame.loc["middle left", "error along u / %"] < 0
    assert error["middle centre"] < 0.01


def test_cell_means_cut_short_at_the_border_and_leave_out_nan():
    values = np.arange(12.0).reshape(3, 4)
    values[0, 0] = np.nan
    assert cell_means(values, 2)[0].tolist() == [pytest.approx((1 + 4 + 5) / 3), (2 + 3 + 6 + 7) / 4]
    assert cell_means(values, 2)[1].tolist() == [(8 + 9) / 2, (10 + 11) / 2]
    assert np.isnan(cell_means(np.full((4, 4), np.nan), 2)).all()


def test_points_are_averaged_in_the_cell_they_lie_in():
    u, v = np.array([4.0, 5.0, 9.0, 2.0, 9.0]), np.array([4.0, 5.0, 7.0, 5.0, 8.0])
    residual = np.array([1.0, 3.0, 7.0, 50.0, 50.0])  # the last two in the picture's border of 3 px
    points = StripResiduals(Estimate(3.0, 0.01, "mm"), np.ones(5, np.int16), u, v, residual, residual)
    picture = scattered((points,), (11, 13), 2)
    assert picture.shape == (6, 7)
    assert picture[2, 2] == 2.0
    assert picture[3, 4] == 7.0
    assert np.isfinite(picture).sum() == 2


def test_sections_lie_where_heights_are():
    mask = np.zeros((10, 3), bool)
    mask[4, 1] = True
    assert section_rows(mask) == (4,)
