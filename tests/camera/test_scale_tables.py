"""The thesis's scale tables on detections made from closed forms."""

import math

import numpy as np
import pytest

from fringecal.camera.distortion.grid_scale import thesis_scale
from fringecal.detect.grid.grid_search import GridDetection
from fringecal.detect.grid.line_profile import LineProfile
from fringecal.errors import DetectionError
from fringecal.uncertainty.estimates import Estimate

PITCH = Estimate(10.0, 0.01, "mm", "pitch")


def detection(place, rows=15, columns=21):
    """Crossings at place(column, row) in px, without lines."""
    row, column = (a.ravel() for a in np.mgrid[:rows, :columns])
    u, v = place(column, row)
    return GridDetection(
        row, column, u * 1.0, v * 1.0, np.full(row.size, 0.01), (), (400, 500), "dark", LineProfile(2.0, 0.5)
    )


def test_square_on_grid_gives_both_factors_and_no_error():
    found = thesis_scale(detection(lambda c, r: (20 + 13.0 * c, 30 + 13.5 * r)), PITCH)
    assert found.horizontal.value == pytest.approx(10 / 13.0, rel=1e-12)
    assert found.vertical.value == pytest.approx(10 / 13.5, rel=1e-12)
    assert found.mean.value == pytest.approx(0.5 * (10 / 13.0 + 10 / 13.5), rel=1e-12)
    # No scatter: only the pitch's 0.1 % is left, common to all three.
    for factor in (found.horizontal, found.vertical, found.mean):
        assert factor.u == pytest.approx(1e-3 * factor.value, rel=1e-6)
    # The mean of unequal factors errs by half their difference in each direction.
    expected = 100 * (found.mean.value * 13.5 / 10 - 1)
    assert found.largest_error_percent == pytest.approx(expected, rel=1e-9)


def test_turned_grid_has_the_same_factor():
    c, s = math.cos(0.3), math.sin(0.3)
    found = thesis_scale(detection(lambda i, j: (13 * (c * i - s * j) + 90, 13 * (s * i + c * j))), PITCH)
    assert found.mean.value == pytest.approx(10 / 13.0, rel=1e-12)
    assert abs(found.largest_error_percent) < 1e-9


def test_scatter_counts_in_u():
    rng = np.random.default_rng(5)
    means = []
    for _ in range(200):
        shift = rng.normal(0, 0.2, 21)
        moved = detection(lambda i, j, shift=shift: (13.0 * i + shift[i], 13.0 * j))
        means.append(thesis_scale(moved, Estimate(10.0, 0.0)).horizontal)
    spread = np.std([m.value for m in means])
    # Neighbouring distances share a line, so their mean scatters less than sd / sqrt(n) says: a safe u.
    assert spread < np.median([m.u for m in means])


def test_check_points_are_not_those_of_the_factor():
    # Only the outer thirds of the vertical lines are 1 % further apart.
    def place(i, j):
        outer = (j < 5) | (j >= 10)
        return 13.0 * (i - 10) * np.where(outer, 1.01, 1.0) + 200, 13.0 * j

    found = thesis_scale(detection(place), PITCH)
    assert found.horizontal.value == pytest.approx(10 / 13.0, rel=1e-12)
    table = found.horizontal_errors
    expected = 100 * (1.01 * 13.0 / 10 * found.mean.value - 1)
    assert table["error_percent"].to_numpy() == pytest.approx(expected, abs=1e-9)
    assert set(table["part"]) == {"first third", "last third"}


def test_wider_spans_as_far_as_the_grid_reaches():
    table = thesis_scale(detection(lambda i, j: (13.0 * i, 13.0 * j), columns=8), PITCH).vertical_lines
    assert sorted(table["span"].unique()) == [1, 2, 5]
    assert len(table[table["span"] == 5]) == 3


def test_too_few_lines_are_refused():
    with pytest.raises(DetectionError, match="neighbouring lines"):
        thesis_scale(detection(lambda i, j: (13.0 * i, 13.0 * j), rows=9, columns=2), PITCH)
