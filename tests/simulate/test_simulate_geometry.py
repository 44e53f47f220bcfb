"""Virtual camera and projector against closed forms and against OpenCV."""

import cv2
import numpy as np
import pytest

from fringecal.errors import FringecalError
from fringecal.simulate import (
    RigSpec,
    apparent_angle_deg,
    load_rig,
    plate,
    plate_points,
    projection_angle_deg,
    render,
    truth_of,
)
from fringecal.simulate.rig.drawn_camera import build_camera, image_centre, project, ray
from fringecal.simulate.rig.drawn_projector import build_projector, phase_at, phase_gradient, rational_form
from fringecal.simulate.rig.truth import lens_shift_at_point_px
from fringecal.simulate.scene.objects import box
from fringecal.simulate.scene.scene import Scene


def rig(**sections):
    base = RigSpec(
        name="test",
        camera={"width_px": 161, "height_px": 121, "scale_mm_per_px": 1.0, "height_mm": 1500.0},
        projector={"position_mm": (0.0, 1222.0, 1000.0), "pitch_mm": 8.0},
    )
    return base.at(**sections)


def wrapped(phase):
    return np.angle(np.exp(1j * phase))


def three_step_phase(frames):
    # reference: I_n = A + B cos(phi + delta_n), steps 0, 120, 240 deg.
    i1, i2, i3 = frames.astype(float)
    return np.arctan2(np.sqrt(3) * (i3 - i2), 2 * i1 - i2 - i3)


class TestTriangulation:
    """Takeda's geometry: xc = 0, xp = 600, L = 1000, X = 37, Z = 25, f = 0.1/mm, all in one plane."""

    # The pixel that sees X = 37 at Z = 25 sees X L / (L - Z) on the plate; so that it is a whole one:
    SCALE = 37 * 1000 / 975 / 100

    @pytest.fixture
    def pair(self):
        spec = rig(
            camera={"width_px": 241, "height_px": 9, "scale_mm_per_px": self.SCALE, "height_mm": 1000.0},
            projector={
                "position_mm": (600.0, 0.0, 1000.0),
                "aim_mm": (600.0, 0.0),
                "across_deg": 0.0,
                "pitch_mm": 10.0,
            },
        )
        return render(spec, plate(), noise=False), render(spec, plate().on_flat(25.0), noise=False)

    def test_true_point_and_phase_difference_are_those_of_the_closed_form(self, pair):
        reference, raised = pair
        row, column = 4, 120 + 100
        assert raised.x[row, column] == pytest.approx(37.0, abs=1e-9)
        assert raised.z[row, column] == pytest.approx(25.0, abs=1e-12)
        difference = raised.phase[row, column] - reference.phase[row, column]
        assert difference == pytest.approx(-9.666439, abs=1e-6)
        assert -difference / (2 * np.pi * 0.1) == pytest.approx(15.384615, abs=1e-6)

    def test_the_pictures_say_the_same_modulo_a_fringe(self, pair):
        reference, raised = pair
        difference = three_step_phase(raised.frames) - three_step_phase(reference.frames)
        # A pixel collects light over its square: the phase read from it differs from that at its
        # centre by the gradient of brightness across it, here below 1e-4 rad.
        assert wrapped(difference[4, 220] + 9.666439) == pytest.approx(0.0, abs=3e-4)


class TestOrientation:
    """One bump in the upper right, lamp on the upper side: a mirrored picture would fail here."""

    @pytest.fixture
    def taken(self):
        scene = Scene(solids=(box((30.0, 40.0), (20.0, 35.0), 10.0),))
        return render(rig(), scene, noise=False)

    def test_bump_appears_where_x_and_y_are_positive(self, taken):
        rows, columns = np.nonzero(taken.z > 5)
        assert columns.min() > 80
        assert rows.max() < 60

    def test_x_runs_with_columns_and_y_against_rows(self, taken):
        assert np.all(np.diff(taken.x[100]) > 0)
        assert np.all(np.diff(taken.y[:, 10]) < 0)
        assert taken.x[60, 80] == pytest.approx(0.0, abs=1e-9)
        assert taken.y[60, 80] == pytest.approx(0.0, abs=1e-9)

    def test_shadow_falls_away_from_the_projector_on_plus_y(self, taken):
        rows, columns = np.nonzero(~taken.lit & (taken.surface == 0))
        top_row = np.nonzero(taken.z > 5)[0].max()
        assert rows.min() > top_row - 2
        assert columns.min() > 80

    def test_phase_rises_toward_plus_y_and_steps_add_to_it(self, taken):
        assert np.all(np.diff(taken.phase[:, 10]) < 0)
        difference = wrapped(three_step_phase(taken.frames) - taken.phase)[:, 3:30]
        # 1e-3 rad: shading over one pixel, as above; the opposite sign of the step would give up to pi.
        assert np.abs(difference).max() < 1e-3


class TestCamera:
    def test_rays_pass_through_what_opencv_projects(self):
        spec = rig(
            camera={"distortion": (-0.2, 0.05, 0.002, -0.001, 0.01), "principal_offset_px": (3.0, -2.0),
                    "scale_mm_per_px": 4.0, "height_mm": 900.0, "tilt_deg": (2.0, -1.0)}
        ).camera  # fmt: skip
        camera = build_camera(spec)
        points = np.random.default_rng(1).uniform((-250, -200, -20), (250, 200, 60), (50, 3))
        rotation = np.array(camera.axes).T
        matrix = np.array(
            [[camera.norm_px, 0, camera.centre_px[0]], [0, camera.norm_px, camera.centre_px[1]], [0, 0, 1]]
        )
        shift = -rotation @ np.array(camera.position)
        expected, _ = cv2.projectPoints(points, cv2.Rodrigues(rotation)[0], shift, matrix, np.array(spec.distortion))
        found = project(camera, points)
        np.testing.assert_allclose(found, expected.reshape(-1, 2), atol=1e-9)
        for (u, v), (x, y, z) in zip(found, points, strict=True):
            ax, ay, bx, by = ray(camera, u, v)
            # Newton's residual of 1e-14 in normalised coordinates, times a range of 1 m.
            assert (ax + bx * z, ay + by * z) == pytest.approx((x, y), abs=1e-9)

    @pytest.mark.parametrize("name", ["thesis", "oblique", "telecentric", "harder"])
    def test_plate_frame_is_defined_by_the_picture(self, name):
        spec = load_rig(name).camera
        camera = build_camera(spec)
        u, v = image_centre(spec)
        assert ray(camera, u, v)[:2] == pytest.approx((0.0, 0.0), abs=1e-9)
        assert ray(camera, u + 1e-4, v)[1] == pytest.approx(0.0, abs=1e-9)
        assert ray(camera, u, v + 1e-4)[1] < 0
        assert camera.position[2] == pytest.approx(spec.height_mm)
        truth = truth_of(load_rig(name))
        assert np.mean([truth.scale_h, truth.scale_v]) == pytest.approx(spec.scale_mm_per_px, rel=1e-9)

    def test_tilt_says_where_the_camera_stands(self):
        camera = build_camera(rig(camera={"tilt_deg": (2.0, 0.0)}).camera)
        assert camera.position[0] == pytest.approx(1500 * np.tan(np.radians(2.0)))
        assert camera.position[1] == pytest.approx(0.0, abs=1e-9)

    def test_square_on_pinhole_is_similar_triangles(self):
        x, y = plate_points(rig())
        np.testing.assert_allclose(x, np.broadcast_to(np.arange(161) - 80.0, x.shape), atol=1e-9)
        np.testing.assert_allclose(y, np.broadcast_to(60.0 - np.arange(121)[:, None], y.shape), atol=1e-9)
        raised = render(rig(), plate().on_flat(30.0), noise=False)
        np.testing.assert_allclose(raised.x, x * (1500 - 30) / 1500, atol=1e-9)

    def test_telecentric_sees_the_same_place_at_every_height(self):
        spec = rig(camera={"kind": "telecentric"})
        x, _ = plate_points(spec)
        np.testing.assert_allclose(render(spec, plate().on_flat(30.0), noise=False).x, x, atol=1e-9)

    def test_barrel_displacement_is_browns(self):
        spec = rig(camera={"distortion": (-0.08, 0.0, 0.0, 0.0, 0.0)})
        radius = np.hypot(60.0, 40.0) / 1500.0
        # f = height / scale to 1e-4 here: the lens has hardly bent at the image centre.
        assert lens_shift_at_point_px(spec, (60.0, 40.0)) == pytest.approx(0.08 * radius**3 * 1500.0, rel=1e-6)

    def test_a_lens_that_folds_the_picture_is_refused(self):
        with pytest.raises(FringecalError, match="folds"):
            build_camera(rig(camera={"distortion": (-3.0, 0, 0, 0, 0), "scale_mm_per_px": 15.0}).camera)


class TestProjector:
    def test_pitch_and_direction_hold_at_the_origin(self):
        place = {"position_mm": (-300.0, 800.0, 900.0), "aim_mm": (40.0, -20.0)}
        spec = rig(projector={**place, "across_deg": 77.0, "distortion": (-0.1, 0.02)}).projector
        gradient = phase_gradient(build_projector(spec), np.zeros(3))
        assert np.hypot(*gradient[:2]) == pytest.approx(2 * np.pi / 8.0, rel=1e-12)
        assert np.degrees(np.arctan2(gradient[1], gradient[0])) == pytest.approx(77.0, abs=1e-9)

    def test_gradient_is_the_derivative_of_phase(self):
        projector = build_projector(rig(projector={"distortion": (-0.1, 0.02), "aim_mm": (40.0, -20.0)}).projector)
        point, h = np.array([60.0, -80.0, 12.0]), 1e-3
        steps = h * np.eye(3)
        central = [(phase_at(projector, *(point + s)) - phase_at(projector, *(point - s))) / (2 * h) for s in steps]
        np.testing.assert_allclose(phase_gradient(projector, point), central, rtol=1e-7)

    def test_seven_numbers_give_the_phase_anywhere(self):
        projector = build_projector(rig(projector={"phase_at_origin_rad": 0.7}).projector)
        n1, n2, n3, n0, d1, d2, d3 = rational_form(projector)
        for x, y, z in np.random.default_rng(2).uniform(-200, 200, (20, 3)):
            expected = (n1 * x + n2 * y + n3 * z + n0) / (d1 * x + d2 * y + d3 * z + 1)
            assert phase_at(projector, x, y, z) == pytest.approx(expected, abs=1e-9)

    def test_points_on_one_projector_ray_share_their_phase(self):
        projector = build_projector(rig(projector={"distortion": (-0.05, 0.0)}).projector)
        lamp, foot = np.array([0.0, 1222.0, 1000.0]), np.array([70.0, -90.0, 0.0])
        raised = foot + 0.04 * (lamp - foot)
        assert phase_at(projector, *raised) == pytest.approx(phase_at(projector, *foot), abs=1e-9)

    def test_angle_across_fringes_is_that_of_the_ray_in_the_plane_of_triangulation(self):
        points = np.array([[0.0, y] for y in (-150.0, -50.0, 0.0, 50.0, 150.0)])
        expected = np.degrees(np.arctan((1222.0 - points[:, 1]) / 1000.0))
        np.testing.assert_allclose(projection_angle_deg(rig(), points), expected, atol=1e-9)

    @pytest.mark.parametrize(
        ("camera", "height_mm", "table_deg"),
        [
            ({"kind": "telecentric", "height_mm": 1000.0}, 1000.0, (53.99, 52.45, 50.78, 49.00, 47.07)),
            ({"height_mm": 1000.0}, 1000.0, (50.78,) * 5),
            ({"height_mm": 1000.0}, 2000.0, (48.95, 49.86, 50.74, 51.59, 52.41)),
            ({"height_mm": 1000.0}, 500.0, (54.08, 52.53, 50.87, 49.08, 47.14)),
        ],
    )
    def test_apparent_angle_of_3_mm_strips_is_that_of_similar_triangles(self, camera, height_mm, table_deg):
        xp = height_mm * np.tan(np.radians(50.7))
        spec = rig(camera=camera, projector={"position_mm": (xp, 0.0, height_mm), "across_deg": 0.0})
        x, seen_at = np.array([-150.0, -75.0, 0.0, 75.0, 150.0]), spec.camera.height_mm
        # The table is `s / Z = (X - x_c) / (H_c - Z) + (x_p - X) / (H_p - Z)` of a strip of Z = 3 mm; the function
        # gives the limit of a low one.
        camera_part = 0.0 if spec.camera.kind == "telecentric" else x / (seen_at - 3)
        shown = np.degrees(np.arctan(camera_part + (xp - x) / (height_mm - 3)))
        np.testing.assert_allclose(shown, table_deg, atol=0.006)
        low = apparent_angle_deg(spec, np.column_stack([x, 0 * x]))
        # From height 3 to 0 tan(angle) changes by 3 / 500 of itself at most: 0.17 deg.
        np.testing.assert_allclose(low, table_deg, atol=0.18)
