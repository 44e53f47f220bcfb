import math

import cv2
import numpy as np
import pytest

from fringecal.targets import Charuco, Scalar, Zigzag
from fringecal.targets.geometry import (
    asymmetric_dots_mm,
    board_points_mm,
    grid_points_mm,
    strip_edges_mm,
    zigzag_base_mm,
    zigzag_edge_distance_mm,
    zigzag_feet_mm,
    zigzag_height,
    zigzag_height_mm,
    zigzag_profile_mm,
    zigzag_ridges_mm,
)

# Rounding of double precision on lengths below a metre.
EXACT_MM = 1e-9
# A bar of the triangle 5, 5, 6: half its base 3, its height 4, its apex 2 asin(3/5); its inscribed circle has
# radius 1.5, touches the legs 2 from the apex (1.2 beside the axis, at height 2.4) and ends at height 3.
LEG, APEX = 5.0, 2 * math.degrees(math.asin(3 / 5))


def test_bars_of_the_thesis():
    # Two 40 mm sides of a square: height and half base are half its diagonal, 40 / sqrt(2).
    assert zigzag_height_mm(40.0, 90.0) == pytest.approx(28.284271, abs=1e-6)
    assert zigzag_base_mm(40.0, 90.0) == pytest.approx(56.568542, abs=1e-6)


def test_apex_is_the_angle_between_the_legs():
    assert zigzag_height_mm(LEG, APEX) == pytest.approx(4.0, abs=EXACT_MM)
    assert zigzag_base_mm(LEG, APEX) == pytest.approx(6.0, abs=EXACT_MM)


def test_feet_and_ridges_alternate():
    np.testing.assert_allclose(zigzag_feet_mm(3, LEG, APEX), [-9, -3, 3, 9], atol=EXACT_MM)
    np.testing.assert_allclose(zigzag_ridges_mm(3, LEG, APEX), [-6, 0, 6], atol=EXACT_MM)
    np.testing.assert_allclose(zigzag_ridges_mm(2, LEG, APEX), [-3, 3], atol=EXACT_MM)


def test_profile_along_two_bars():
    x = [-7, -6, -4.5, -3, -1.5, 0, 0.75, 3, 6, 60]
    z = [0, 0, 2, 4, 2, 0, 1, 4, 0, 0]
    np.testing.assert_allclose(zigzag_profile_mm(x, 2, LEG, APEX), z, atol=EXACT_MM)


def test_rounded_ridge_is_the_inscribed_circle():
    assert zigzag_height_mm(LEG, APEX, ridge_radius_mm=1.5) == pytest.approx(3.0, abs=EXACT_MM)
    x = [0.0, 0.9, 1.2, 2.25]
    z = [3.0, 1.5 + 1.2, 2.4, 1.0]  # the circle about (0, 1.5); its touching point; the flank
    np.testing.assert_allclose(zigzag_profile_mm(x, 1, LEG, APEX, ridge_radius_mm=1.5), z, atol=EXACT_MM)


def test_profile_of_an_independent_simulation():
    # Four bars with 30 mm legs at 90 deg, ray traced by another program: highest point 21.213203435596427 mm.
    x = np.linspace(-90, 90, 18001)
    assert zigzag_profile_mm(x, 4, 30.0, 90.0).max() == pytest.approx(21.213203435596427, abs=0.01)


def test_edge_distance_counts_ridges_valleys_and_feet():
    x = [-6.5, -6.0, -5.0, -3.0, -1.4, 0.5]
    np.testing.assert_allclose(zigzag_edge_distance_mm(x, 2, LEG, APEX), [0.5, 0, 1, 0, 1.4, 0.5], atol=EXACT_MM)


def test_profile_keeps_the_shape_and_passes_nan_on():
    z = zigzag_profile_mm([[0.0, np.nan]], 1, LEG, APEX)
    assert z.shape == (1, 2)
    assert np.isnan(z[0, 1])


@pytest.mark.parametrize("radius_mm", [None, 5.0])
def test_uncertainty_of_the_full_height_against_sampling(radius_mm):
    ridge = Scalar(value=radius_mm, u=0.5) if radius_mm else None
    bars = Zigzag(
        name="bars",
        certificate="test",
        count=5,
        leg_mm=Scalar(value=40.0, u=0.02),
        apex_deg=Scalar(value=90.0, u=0.05),
        length_mm=Scalar(value=350.0, u=0.5),
        ridge_radius_mm=ridge,
    )
    rng = np.random.default_rng(20081)
    drawn = [
        zigzag_height_mm(leg, apex, ridge_radius_mm=radius)
        for leg, apex, radius in zip(
            rng.normal(40.0, 0.02, 20_000),
            rng.normal(90.0, 0.05, 20_000),
            rng.normal(radius_mm or 0, 0.5 if radius_mm else 0, 20_000),
            strict=True,
        )
    ]
    # The spread of 20 000 draws is itself known to 1 / sqrt(2 n) = 0.5 %; four times that.
    assert zigzag_height(bars).u == pytest.approx(np.std(drawn), rel=0.02)


def test_twelve_strips_of_the_thesis_span_230_mm():
    edges = strip_edges_mm([10.0] * 12, [10.0] * 11)
    assert edges[0].tolist() == [-115.0, -105.0]
    assert edges[-1].tolist() == [105.0, 115.0]


def test_unequal_strips_are_centred_as_a_whole():
    # 2 + 1 + 4 + 3 + 6 = 16 from edge to edge.
    np.testing.assert_allclose(strip_edges_mm([2, 4, 6], [1, 3]), [[-8, -6], [-5, -1], [2, 8]])
    np.testing.assert_allclose(strip_edges_mm([5], []), [[-2.5, 2.5]])


def test_rows_of_a_grid_are_counted_downward():
    x, y = grid_points_mm([[3, -1]], [[2, 4]], 2.5)
    assert x.tolist() == [[7.5, -2.5]]
    assert y.tolist() == [[-5.0, -10.0]]


def test_charuco_corners_are_those_of_opencv_with_y_up():
    board = Charuco(
        name="b",
        certificate="test",
        squares=(7, 10),
        square_mm=Scalar(value=25.0, u=0.0),
        marker_mm=Scalar(value=18.0, u=0.0),
        dictionary="DICT_5X5_100",
    )
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    theirs = cv2.aruco.CharucoBoard(board.squares, 25.0, 18.0, dictionary).getChessboardCorners()
    ours = board_points_mm(board.squares[0] - 1, board.squares[1] - 1, board.square_mm.value)
    # OpenCV counts y down from the board's top left corner; its points are single precision.
    np.testing.assert_allclose(ours[:, 0], theirs[:, 0] - 7 * 12.5, atol=1e-4)
    np.testing.assert_allclose(ours[:, 1], 10 * 12.5 - theirs[:, 1], atol=1e-4)


def test_asymmetric_dots_follow_opencv():
    # OpenCV's calibration sample: point j of row i at ((2 j + i % 2) spacing, i spacing), y down.
    columns, rows, pitch = 4, 11, 20.0
    theirs = np.array([((2 * j + i % 2) * pitch, i * pitch) for i in range(rows) for j in range(columns)])
    ours = asymmetric_dots_mm(columns, rows, pitch)
    np.testing.assert_allclose(ours[:, 0] - ours[0, 0], theirs[:, 0])
    np.testing.assert_allclose(ours[0, 1] - ours[:, 1], theirs[:, 1])
    np.testing.assert_allclose(ours.min(axis=0) + ours.max(axis=0), 0, atol=EXACT_MM)
