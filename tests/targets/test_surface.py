import math

import numpy as np
import pytest

from fringecal.targets import (
    BallBar,
    Box,
    Chessboard,
    Dots,
    Flat,
    LineGrid,
    Quantity,
    Scalar,
    Sphere,
    Steps,
    Strips,
    Wedge,
    Zigzag,
    list_targets,
    load_target,
)
from fringecal.targets.kinds_of_target import Artefact
from fringecal.targets.target_surface import ball_centres_mm, footprint_mm, surface_mm

SAID = {"name": "a target", "certificate": "test"}
EXACT_MM = 1e-9


def mm(value):
    return Scalar(value=value, u=0.01)


def each(*values):
    return Quantity(value=values, u=0.01)


def test_every_shipped_target_has_a_surface_and_a_footprint():
    x, y = np.meshgrid(np.linspace(-200, 200, 41), np.linspace(-250, 250, 51))
    for target in map(load_target, list_targets()):
        z = surface_mm(target, x, y)
        width, length = footprint_mm(target)
        assert z.shape == x.shape
        assert np.all(z >= 0)
        assert np.all(z[(np.abs(x) > width / 2) | (np.abs(y) > length / 2)] == 0)


def test_kinds_differ_by_their_closed_forms():
    cases = [
        (Box(**SAID, width_mm=mm(10.0), length_mm=mm(20.0), height_mm=mm(3.0)), (4.9, 9.9), 3.0),
        (Box(**SAID, width_mm=mm(10.0), length_mm=mm(20.0), height_mm=mm(3.0)), (5.1, 0.0), 0.0),
        # A slope of 3 in 4: 20 from the low edge it is 15 high.
        (
            Wedge(**SAID, angle_deg=mm(math.degrees(math.atan(3 / 4))), width_mm=mm(80.0), length_mm=mm(10.0)),
            (-20.0, 0.0),
            15.0,
        ),
        # Radius 5, 3 beside the axis: 4 above the centre, which lies 5 above the plate.
        (Sphere(**SAID, diameter_mm=mm(10.0)), (0.0, 3.0), 9.0),
        (Sphere(**SAID, diameter_mm=mm(10.0)), (4.0, 4.0), 0.0),
        (Flat(**SAID, flatness_mm=mm(0.0), height_mm=mm(7.0)), (1e4, -1e4), 7.0),
        (Flat(**SAID, flatness_mm=mm(0.0)), (1e4, -1e4), 0.0),
        (Flat(**SAID, flatness_mm=mm(0.0), height_mm=mm(7.0), width_mm=mm(4.0)), (3.0, 0.0), 0.0),
    ]
    for target, (x, y), z in cases:
        assert surface_mm(target, x, y) == pytest.approx(z, abs=EXACT_MM)


def test_strips_keep_their_own_heights_and_order():
    strips = Strips(
        **SAID,
        count=2,
        width_mm=each(2.0, 4.0),
        gap_mm=mm(1.0),
        height_mm=each(3.0, 5.0),
        length_mm=each(8.0, 6.0),
    )
    # 7 wide in all: from -3.5 to -1.5 and from -0.5 to 3.5.
    assert surface_mm(strips, [-2.0, -1.0, 0.0, 3.4, 3.6], 0.0).tolist() == [3.0, 0.0, 5.0, 5.0, 0.0]
    assert surface_mm(strips, [-2.0, 0.0], 3.5).tolist() == [3.0, 0.0]
    assert footprint_mm(strips) == (7.0, 8.0)


def test_an_upright_face_between_steps_belongs_to_the_higher_one():
    for heights, z in (((1.0, 2.0), [1.0, 2.0, 2.0]), ((2.0, 1.0), [2.0, 2.0, 1.0])):
        steps = Steps(**SAID, heights_mm=each(*heights), width_mm=mm(10.0), length_mm=mm(10.0))
        assert surface_mm(steps, [-5.0, 0.0, 5.0], 0.0).tolist() == z


def test_zigzag_ends_with_its_length():
    bars = Zigzag(**SAID, count=1, leg_mm=mm(40.0), apex_deg=mm(90.0), length_mm=mm(100.0))
    z = surface_mm(bars, 0.0, [-51.0, -49.0, 0.0, 49.0, 51.0])
    np.testing.assert_allclose(z, [0, 28.284271, 28.284271, 28.284271, 0], atol=1e-6)


def test_unequal_balls_stand_on_the_plate_at_their_spacing():
    # Radii 5 and 10: centres 5 apart in height and 12 in x are 13 apart.
    balls = BallBar(**SAID, diameters_mm=each(10.0, 20.0), spacing_mm=mm(15.0 + 1e-12))
    low, high = ball_centres_mm(balls)
    assert math.dist(low, high) == pytest.approx(15.0, abs=EXACT_MM)
    assert (low[2], high[2]) == (5.0, 10.0)
    assert low[0] - 5.0 == pytest.approx(-(high[0] + 10.0), abs=EXACT_MM)
    assert surface_mm(balls, [low[0], high[0]], 0.0) == pytest.approx([10.0, 20.0], abs=EXACT_MM)
    assert footprint_mm(balls) == pytest.approx((15.0 + math.sqrt(200.0), 20.0))


@pytest.mark.parametrize(
    ("target", "extent"),
    [
        (Chessboard(**SAID, columns=9, rows=6, square_mm=mm(25.0)), (250.0, 175.0)),
        (Dots(**SAID, columns=8, rows=11, pitch_mm=mm(20.0), diameter_mm=mm(10.0)), (150.0, 210.0)),
        (
            Dots(**SAID, columns=4, rows=11, pitch_mm=mm(20.0), diameter_mm=mm(10.0), asymmetric=True),
            (150.0, 210.0),
        ),
        (LineGrid(**SAID, pitch_mm=mm(10.0), lines=(5, 7)), (40.0, 60.0)),
        (LineGrid(**SAID, pitch_mm=mm(10.0)), (math.inf, math.inf)),
    ],
)
def test_extent_of_printed_patterns(target, extent):
    assert footprint_mm(target) == extent


@pytest.mark.parametrize("name", list_targets())
def test_points_without_a_place_have_no_height(name):
    assert np.isnan(surface_mm(load_target(name), [np.nan, 0.0], [0.0, np.nan])).all()


def test_an_unknown_kind_is_refused():
    with pytest.raises(NotImplementedError):
        surface_mm(Artefact(**SAID), 0.0, 0.0)
