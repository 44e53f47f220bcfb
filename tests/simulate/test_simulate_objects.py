"""Shapes of virtual targets, their edges, and printed patterns."""

import importlib.util
import sys
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest

from fringecal.errors import FringecalError
from fringecal.simulate import HeightField, RigSpec, leaf_scene, render, scene_of
from fringecal.simulate.scene.objects import BUILDERS, rounded_ridge
from fringecal.simulate.scene.printed_patterns import INK, LINES, Pattern
from fringecal.simulate.scene.scene import Scene, together
from fringecal.targets import Target, list_targets, load_target, parse_target


def rig(**sections):
    base = RigSpec(
        name="test",
        camera={
            "kind": "telecentric",
            "width_px": 201,
            "height_px": 161,
            "scale_mm_per_px": 1.0,
            "height_mm": 1500.0,
        },
        projector={"position_mm": (0.0, 1222.0, 1000.0), "pitch_mm": 8.0, "contrast": 0.8},
        light={"shading": False, "ambient": 0.0},
    )
    return base.at(**sections)


def target(kind, **sizes):
    document = {"format": 1, "kind": kind, "name": kind, "certificate": "test"}
    for key, value in sizes.items():
        document[key] = {"value": value, "u": 0.0} if key.endswith(("_mm", "_deg")) else value
    return parse_target(document)


def heights(scene, **sections):
    return render(rig(**sections), scene, noise=False).z


def test_zigzag_has_its_closed_form_profile():
    zigzag = target("zigzag", count=3, leg_mm=40.0, apex_deg=90.0, length_mm=100.0)
    z = heights(scene_of(zigzag))
    base, x = 40.0 * np.sqrt(2), np.arange(201) - 100.0
    expected = base / 2 - np.abs((x + base / 2) % base - base / 2)
    expected[np.abs(x) > 1.5 * base] = 0
    np.testing.assert_allclose(z[80], expected, atol=1e-9)
    assert np.all(z[:30] == 0)


def test_rounded_ridge_is_lower_by_the_closed_form():
    section = rounded_ridge(40.0, 90.0, 2.0)
    lowered = 2.0 * (1 / np.sin(np.pi / 4) - 1)
    assert section[:, 1].max() == pytest.approx(40 / np.sqrt(2) - lowered, abs=1e-9)


def test_rows_and_columns_are_a_quarter_turn_apart():
    scene = scene_of(target("zigzag", count=2, leg_mm=30.0, apex_deg=90.0, length_mm=60.0))
    columns, rows = heights(scene.placed(5.0, 3.0)), heights(scene.placed(5.0, 3.0, 90.0))
    assert np.ptp(columns[77, 90:120]) > 5
    assert np.ptp(rows[77, 90:120]) == pytest.approx(0.0, abs=1e-9)


def test_strips_shift_phase_by_the_closed_form():
    strips = target("strips", count=3, width_mm=10.0, gap_mm=10.0, height_mm=3.0, length_mm=120.0)
    taken, bare = (render(rig(), scene, noise=False) for scene in (scene_of(strips), Scene()))
    step = (taken.phase - bare.phase)[80, 100]
    # A point 3 mm up lies on the lamp's ray to the plate at y = -3 x 1222 / 997 = -3.677 mm: its phase
    # is the plate's there, read between the rows of y = -3 and y = -4.
    expected = np.interp(3 * 1222 / 997, [3, 4], bare.phase[[83, 84], 100]) - bare.phase[80, 100]
    assert step == pytest.approx(expected, abs=2e-3)
    assert abs(step) == pytest.approx(2 * np.pi * 3.677 / 8, rel=0.005)


def test_strips_may_differ():
    z = heights(
        scene_of(target("strips", count=2, width_mm=[19.0, 15.0], gap_mm=6.0, height_mm=[2.0, 5.0], length_mm=80.0))
    )
    assert z[80, 81] == z[80, 98] == pytest.approx(2.0)
    assert z[80, 102] == 0
    assert z[80, 106] == z[80, 119] == pytest.approx(5.0)


def test_steps_wedge_and_box_stand_as_stated():
    steps = heights(scene_of(target("steps", heights_mm=[1.0, 2.0, 4.0], width_mm=30.0, length_mm=60.0)))
    np.testing.assert_allclose(steps[80, [70, 100, 130]], [1.0, 2.0, 4.0], atol=1e-9)
    wedge = heights(scene_of(target("wedge", angle_deg=10.0, width_mm=100.0, length_mm=60.0)))
    assert wedge[80, 120] == pytest.approx(70 * np.tan(np.radians(10)), abs=1e-9)
    block = heights(scene_of(target("box", width_mm=40.0, length_mm=20.0, height_mm=7.0)))
    assert (block > 0).sum() == 41 * 21


def test_balls_touch_the_plate_at_their_spacing():
    z = heights(scene_of(target("ball-bar", diameters_mm=[30.0, 40.0], spacing_mm=100.0)))
    half = np.sqrt(100.0**2 - 5.0**2) / 2
    x = np.arange(201) - 100.0
    np.testing.assert_allclose(z[80, 45:55], 15 + np.sqrt(15**2 - (x[45:55] + half) ** 2), atol=1e-9)
    ball = heights(scene_of(target("sphere", diameter_mm=50.0)))
    assert ball[80, 100] == pytest.approx(50.0)
    assert ball[80, 110] == pytest.approx(25 + np.sqrt(25**2 - 10**2))


def test_sphere_shadow_ends_where_the_tangent_ray_lands():
    taken = render(
        rig(projector={"position_mm": (0.0, 1e6, 1e6)}),
        scene_of(target("sphere", diameter_mm=40.0)),
        noise=False,
    )
    shadow = ~taken.lit[:, 100] & (taken.surface[:, 100] == 0)
    # Parallel light at 45 deg: the last tangent ray lands at y = -r (1 + sqrt 2).
    assert -taken.y[shadow, 100].min() == pytest.approx(20 * (1 + np.sqrt(2)), abs=1.0)


def test_raised_and_tilted_flat():
    z = heights(Scene().on_flat(10.0, tilt_x_deg=2.0))
    np.testing.assert_allclose(z[80], 10 + np.tan(np.radians(2)) * (np.arange(201) - 100), atol=1e-9)
    assert heights(scene_of(target("flat", flatness_mm=0.0, height_mm=12.0))).min() == pytest.approx(12.0)


def test_height_field_is_bilinear_and_casts_its_shadow():
    nodes = np.zeros((41, 41))
    nodes[20, 20] = 10.0
    field = HeightField(nodes, 2.0, np.ones_like(nodes))
    taken = render(rig(projector={"position_mm": (0.0, 1e6, 3e5)}), Scene(height_field=field), noise=False)
    assert taken.z[80, 100] == pytest.approx(10.0, abs=1e-6)
    assert taken.z[80, 101] == pytest.approx(5.0, abs=1e-6)
    assert taken.z[79, 101] == pytest.approx(2.5, abs=1e-6)
    shadow = ~taken.lit[:, 100] & (taken.z[:, 100] == 0)
    # A spike of 10 mm under light that falls 0.3 mm per mm: shadow to y = -33.3 mm.
    assert -taken.y[shadow, 100].min() == pytest.approx(33.3, abs=1.0)
    turned = render(rig(), Scene(height_field=field).placed(20.0, 10.0, 30.0), noise=False)
    assert turned.z[70, 120] == pytest.approx(10.0, abs=1e-6)


@pytest.mark.parametrize("nodes", [np.zeros((1, 5)), -np.ones((4, 4)), np.full((4, 4), np.nan)])
def test_bad_height_fields_are_refused(nodes):
    with pytest.raises(FringecalError, match="height field"):
        HeightField(nodes, 1.0, np.ones_like(nodes))


def test_leaf_touches_the_plate_and_is_fully_lit():
    spec = rig(camera={"scale_mm_per_px": 2.0}, light={"shading": True})
    taken = render(spec, leaf_scene(), noise=False)
    leaf = taken.surface > 0
    assert 10.0 < taken.z.max() <= 11.0
    rim = leaf & ~(np.roll(leaf, 1, 0) & np.roll(leaf, -1, 0) & np.roll(leaf, 1, 1) & np.roll(leaf, -1, 1))
    # The edge comes down without slope: over the last pixel of 2 mm it rises by less than this.
    assert taken.z[rim].max() < 1.0
    assert taken.lit[leaf].all()


def test_edge_pixels_hold_the_covered_share():
    # A strip from x = -5.3 to 4.9 mm, darker than the plate, turned a little.
    scene = scene_of(target("box", width_mm=10.2, length_mm=100.0, height_mm=0.5)).placed(-0.2, 0.0, 1.0)
    solid = scene.solids[0]
    dark = Scene(solids=(type(solid)(solid.planes, solid.corners, 0.5),))
    frame = render(rig(projector={"position_mm": (0.0, 10.0, 1e6), "contrast": 0.0}), dark, noise=False).frames[0]
    share = 2 * (1 - frame[50:110] / frame[0, 0])
    width = share.sum(axis=1).mean()
    assert width == pytest.approx(10.2 / np.cos(np.radians(1.0)), abs=0.01)


class TestPrintedPatterns:
    @pytest.mark.parametrize("angle_deg", [0.0, 0.7, 5.0, 20.0])
    def test_grid_lines_lie_where_they_should(self, angle_deg):
        grid = target("line-grid", pitch_mm=20.0, line_width_mm=0.9, lines=[7, 5])
        scene = scene_of(grid).placed(0.37, -0.21, angle_deg)
        # Sharper optics would alias: the centroid of a line 0.9 px wide is then off by up to 0.015 px.
        frame = render(rig(camera={"defocus_px": 0.5}), scene, noise=False, light="room").frames[0]
        ink = 1 - frame / frame[0, 0]
        slope = np.tan(np.radians(angle_deg))
        columns, errors = np.arange(201), []
        for row in range(84, 96):
            # The middle vertical line crosses a row where (x - x0) cos + (y - y0) sin = 0.
            centre = 100 + 0.37 - (80.0 - row + 0.21) * slope
            near = np.abs(columns - centre) < 4.5
            errors.append(np.sum(columns[near] * ink[row, near]) / np.sum(ink[row, near]) - centre)
            width = ink[row, near].sum() / 0.92 * np.cos(np.radians(angle_deg))
            assert width == pytest.approx(0.9, abs=0.02)
        # Sampling scatters a row's centroid by 0.004 px; the line as a whole is free of bias.
        assert np.abs(errors).max() < 0.015
        assert abs(np.mean(errors)) < 0.002

    def test_grid_has_its_number_of_lines_and_fills_the_field_by_default(self):
        grid = target("line-grid", pitch_mm=20.0, line_width_mm=2.0, lines=[7, 5])
        row = render(rig(), scene_of(grid), noise=False, light="room").frames[0][70]
        assert np.sum(np.diff((row < 100).astype(int)) == 1) == 7
        full = scene_of(target("line-grid", pitch_mm=20.0), field_mm=(200.0, 160.0)).pattern
        assert full.counts == (10, 8)

    def test_light_lines_and_heavy_lines(self):
        sizes = {"pitch_mm": 20.0, "line_width_mm": 2.0, "heavy_width_mm": 6.0}
        grid = target("line-grid", polarity="light", lines=[5, 5], heavy_every=2, **sizes)
        row = render(rig(), scene_of(grid), noise=False, light="room").frames[0][70]
        assert row[100] > 5 * row[110]
        assert row[102] > 5 * row[110]
        assert row[122] < 0.2 * row[100]

    def test_chessboard_and_dots(self):
        board = render(
            rig(),
            scene_of(target("chessboard", columns=3, rows=2, square_mm=20.0)),
            noise=False,
            light="room",
        )
        frame = board.frames[0] / board.frames[0].max()
        assert frame[80 - 20, 100 - 30] < 0.1
        assert frame[80 - 20, 100 - 10] > 0.9
        assert frame[80 + 35, 100] > 0.9
        dots = render(
            rig(),
            scene_of(target("dots", columns=3, rows=2, pitch_mm=30.0, diameter_mm=12.0)),
            noise=False,
            light="room",
        )
        share = 1 - dots.frames[0] / dots.frames[0].max()
        # Six discs of known area, each pixel holding its share of ink, which is 0.92 darker.
        assert share.sum() / 0.92 == pytest.approx(6 * np.pi * 36, rel=2e-3)
        assert share[95, 130] > 0.9

    @pytest.mark.parametrize(
        ("columns", "rows", "dictionary", "turn_deg"),
        [(7, 10, "DICT_5X5_100", 0.0), (6, 5, "DICT_4X4_50", 20.0), (6, 5, "DICT_4X4_50", 180.0)],
    )
    def test_opencv_finds_every_corner_of_a_charuco_in_its_place(self, columns, rows, dictionary, turn_deg):
        board = target("charuco", squares=[columns, rows], square_mm=10.0, marker_mm=7.2, dictionary=dictionary)
        scale = 0.3
        camera = {"width_px": 385, "height_px": 385, "scale_mm_per_px": scale, "defocus_px": 0.5}
        scene = scene_of(board).placed(3.0, -2.0, turn_deg)
        frame = render(rig(camera=camera), scene, noise=False, light="room").frames[0]
        known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
        detector = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard((columns, rows), 10.0, 7.2, known))
        corners, ids, _, markers = detector.detectBoard(np.round(frame).astype(np.uint8))
        assert sorted(markers.ravel()) == list(range(columns * rows // 2))
        assert sorted(ids.ravel()) == list(range((columns - 1) * (rows - 1)))
        # OpenCV numbers inner corners row by row from the top left.
        row, column = np.divmod(ids.ravel(), columns - 1)
        x, y = 10.0 * (column - (columns - 2) / 2), -10.0 * (row - (rows - 2) / 2)
        c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        u, v = 192 + (c * x - s * y + 3.0) / scale, 192 - (s * x + c * y - 2.0) / scale
        # What OpenCV's corner refinement reaches on a picture of 8 bits.
        assert np.abs(corners.reshape(-1, 2) - np.column_stack([u, v])).max() < 0.1

    def test_bits_of_one_colour_join_without_a_seam(self):
        board = target("charuco", squares=[3, 3], square_mm=40.0, marker_mm=30.0, dictionary="DICT_4X4_50")
        frame = render(rig(), scene_of(board), noise=False, light="room").frames[0]
        # The marker above the middle: its border of 5 mm is black all along, y = 50 to 55 mm.
        border = frame[80 - 54 : 80 - 51, 100 - 13 : 100 + 14]
        assert border == pytest.approx(0.08 * frame.max(), rel=1e-6)

    @pytest.mark.parametrize("rows", [2, 3])
    def test_boards_begin_with_a_dark_square_at_the_top_left(self, rows):
        board = target("chessboard", columns=3, rows=rows, square_mm=20.0)
        frame = render(rig(), scene_of(board), noise=False, light="room").frames[0]
        assert frame[80 - 10 * rows, 100 - 30] < 0.1 * frame.max()


@pytest.mark.parametrize("name", list_targets())
def test_every_shipped_target_can_be_drawn(name):
    drawn = render(rig(), scene_of(load_target(name), field_mm=(201.0, 161.0)), noise=False, light="room")
    seen = (drawn.surface > 0).any() or drawn.frames[0].min() < 0.5 * drawn.frames[0].max()
    assert seen or name == "flat-plate"


def test_every_kind_of_target_can_be_drawn():
    kinds = {get_args(model.model_fields["kind"].annotation)[0] for model in get_args(get_args(Target)[0])}
    assert kinds == {*BUILDERS, "line-grid"}


def test_several_targets_stand_together():
    ball = scene_of(target("sphere", diameter_mm=20.0))
    block = scene_of(target("box", width_mm=20.0, length_mm=20.0, height_mm=5.0))
    z = heights(together([ball.placed(-40.0, 0.0), block.placed(40.0, 0.0)]))
    assert z[80, 60] == pytest.approx(20.0)
    assert z[80, 140] == pytest.approx(5.0)


def exact_sheets():
    path = Path(__file__).parents[2] / "benchmarks" / "exact_sheets.py"
    spec = importlib.util.spec_from_file_location("exact_sheets", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclass looks there for its own module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("width_px", [0.1, 0.5, 1.2, 5.0])
@pytest.mark.parametrize(("blur_px", "angle_deg"), [(0.2, 0.0), (0.5, 30.0)])
def test_lines_are_as_dark_as_exact_integration_says(width_px, blur_px, angle_deg):
    x, y, spacing = 0.31, -0.17, 19.97
    spec = rig(camera={"width_px": 121, "height_px": 101, "scale_mm_per_px": 1.0, "defocus_px": blur_px})
    scene = Scene(pattern=Pattern(LINES, (41, 41), spacing, width_px).placed(x, y, np.radians(angle_deg)))
    frame = render(spec, scene, noise=False, light="room").frames[0]
    ink = ((1 - frame / frame.max()) / (1 - INK))[8:-8, 8:-8]
    # The plate's y runs against v, so that its turn is the other way round in the picture.
    cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    exact = exact_sheets()
    sheet = exact.Sheet(width_px, blur_px, spacing, -angle_deg, (cosine * x + sine * y, sine * x - cosine * y))
    expected = exact.ink_shares(sheet, frame.shape)[8:-8, 8:-8]
    # 89 points of a pixel err by 0.03 of the contrast at most, where a line that is thinner than their spots passes the
    # fewest; ink ends over 0.25 px, which lowers the peak of a line
    # half as wide by 0.025.
    assert ink == pytest.approx(expected, abs=0.045)
    assert ink.sum() / expected.sum() == pytest.approx(1.0, abs=0.01)
