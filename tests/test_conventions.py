"""Each convention of docs/conventions.md, pinned by a value that the opposite convention would fail."""

import datetime
import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.detect.grid.grid_search import find_grid
from fringecal.phase import demodulate
from fringecal.projector.angle.projection_angle import apparent_angle, projection_angle
from fringecal.projector.rig_model import RigModel
from fringecal.records.exports.surface_files import write_mesh
from fringecal.session import load_session, write_session
from fringecal.targets import parse_target
from fringecal.uncertainty import Estimate, en_score

ROOT = Path(__file__).parents[1]
TEXTS = {".py", ".pyi", ".md", ".json", ".toml", ".html", ".typ", ".js"}
STEPS_RAD = np.deg2rad([0.0, 120.0, 240.0])
THESIS_ANGLE_RAD = math.radians(50.7)


# ---- pictures -------------------------------------------------------------------------------------
def grid_picture(shape, first_px, pitch_px, width_px=3.0):
    """Dark lines on white; each pixel holds the share of its unit square that the lines leave free."""

    def free(n, first):
        edges = np.arange(n + 1) - 0.5  # the pixel's borders, half a pixel about its centre
        covered = sum(
            np.clip(edges[1:], line - width_px / 2, line + width_px / 2)
            - np.clip(edges[:-1], line - width_px / 2, line + width_px / 2)
            for line in np.arange(first, n, pitch_px)
        )
        return 1 - covered

    light = free(shape[0], first_px[1])[:, None] * free(shape[1], first_px[0])[None, :]
    return (40 + 180 * light).astype(np.float32)


def test_a_picture_is_rows_by_columns():
    found = find_grid(grid_picture((300, 420), first_px=(17.25, 11.5), pitch_px=40.0))
    assert found.shape == (300, 420)
    assert found.u_px.max() > 350  # 11 columns of crossings ...
    assert found.v_px.max() < 300  # ... and 8 rows


def test_pixel_centres_are_integers():
    found = find_grid(grid_picture((300, 420), first_px=(17.25, 11.5), pitch_px=40.0))
    # A picture without noise: a tenth of the half pixel that the other convention is away.
    np.testing.assert_allclose((found.u_px - 17.25 + 20) % 40, 20, atol=0.05)
    np.testing.assert_allclose((found.v_px - 11.5 + 20) % 40, 20, atol=0.05)


def written_session(folder, images, session_steps_deg, **capture):
    frames = {name: np.full((6, 8), level, np.uint8) for name, level in images.items()}
    document = {
        "format": 1,
        "rig": "pin",
        "captured": datetime.datetime(2026, 11, 22, tzinfo=datetime.UTC),
        "phase": {"steps_deg": session_steps_deg},
        "capture": [{"name": "plate", "kind": "reference", "images": list(images), **capture}],
    }
    write_session(folder, document, frames)
    return load_session(folder).captures["plate"]


def test_frames_come_in_the_order_of_the_session(tmp_path):
    capture = written_session(tmp_path / "s", {"c.png": 30, "a.png": 10, "b.png": 20}, [0.0, 120.0, 240.0])
    assert capture.read()[:, 0, 0].tolist() == [30, 10, 20]


# ---- plate frame ----------------------------------------------------------------------------------
def thesis_camera(**values):
    return PlateCamera.from_values({"scale_mm_per_px": 0.734, "height_mm": 1500.0} | values, (600, 640))


def test_the_plate_frame_starts_under_the_image_centre():
    rays = thesis_camera().rays(319.5, 299.5)
    assert (float(rays.ax), float(rays.ay)) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert thesis_camera().position_mm[2] == pytest.approx(1500.0)


def test_x_runs_right_and_y_up_in_the_picture():
    rays = thesis_camera().rays([419.5, 319.5], [299.5, 399.5])
    np.testing.assert_allclose(rays.ax, [73.4, 0.0], atol=1e-9)
    np.testing.assert_allclose(rays.ay, [0.0, -73.4], atol=1e-9)


def test_a_raised_point_is_seen_further_out():
    # Similar triangles: at z = 30 of 1500 mm the ray of x = 98 meets the plate at 98 / (1 - 30/1500) = 100.
    u, v = thesis_camera().project(98.0, 49.0, 30.0)
    assert (float(u) - 319.5, 299.5 - float(v)) == pytest.approx((100 / 0.734, 50 / 0.734))


def two_pinholes():
    """Camera above x = 0 and projector above x = 600, both 1000 mm high; 0.1 fringes per mm on the plate.

    The projector's ray through (x, z) ends on the plate at (L x - xp z) / (L - z); its phase is 2 pi f there.
    """
    f, xp, height = 0.1, 600.0, 1000.0
    parameters = [2 * math.pi * f, 0, -2 * math.pi * f * xp / height, 0, 0, 0, -1 / height]
    model = RigModel(np.array(parameters, float), np.array([xp, 0.0, height]))
    camera = PlateCamera.from_values({"scale_mm_per_px": 1.0, "height_mm": height}, (201, 201))
    return model, camera


def test_height_and_place_of_the_two_pinhole_case():
    """The published case: X = 37, Z = 25 gives dphi = phi_obj - phi_ref = -9.666439 rad."""
    model, camera = two_pinholes()
    rays = camera.rays(*camera.project(37.0, 0.0, 25.0))
    step = model.phase(37.0, 0.0, 25.0) - model.phase(rays.ax, rays.ay, 0.0)
    assert float(step) == pytest.approx(-9.666439, abs=1e-6)
    z = model.height(model.phase(rays.ax, rays.ay, 0.0) - 9.666439, rays)
    assert float(z) == pytest.approx(25.0, abs=1e-5)  # six decimals of a phase that makes 2.6 mm per rad
    assert float(rays.at(z)[0]) == pytest.approx(37.0, abs=1e-6)  # and not 37.9487, the plate point behind it


def test_a_mesh_is_not_mirrored(tmp_path):
    v, u = np.mgrid[0:5, 0:7].astype(float)
    surface = SimpleNamespace(x=u - 3, y=2 - v, z=np.zeros((5, 7)), u_z=np.full((5, 7), 0.01))
    surface.z[0, 6] = 0.5  # top right in the picture: x and y both positive
    surface.mask = np.ones((5, 7), bool)
    text = write_mesh(tmp_path / "a.obj", surface, max_jump_mm=5.0).read_text(encoding="ascii")
    vertices = np.array(re.findall(r"^v (\S+) (\S+) (\S+)", text, flags=re.MULTILINE), float)
    faces = np.array(re.findall(r"^f (\d+)\S* (\d+)\S* (\d+)", text, flags=re.MULTILINE), int) - 1
    np.testing.assert_allclose(vertices[vertices[:, 2] > 0], [[3, 2, 0.5]])
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


# ---- phase ----------------------------------------------------------------------------------------
def frames_of(phase, background=120.0, modulation=50.0):
    phase = np.broadcast_to(phase, (4, 5))
    return background + modulation * np.cos(phase[None] + STEPS_RAD[:, None, None])


def test_sign_of_the_phase():
    found = demodulate(frames_of(0.7), STEPS_RAD)
    # float32 maps of a picture without noise
    np.testing.assert_allclose(found.phase, 0.7, atol=1e-5)
    np.testing.assert_allclose(found.modulation, 50.0, rtol=1e-5)
    np.testing.assert_allclose(found.background, 120.0, rtol=1e-5)


def test_steps_are_the_sessions_own(tmp_path):
    images = {"a.png": 10, "b.png": 20, "c.png": 30}
    stated = written_session(tmp_path / "s", images, [-120.0, 0.0, 120.0])
    assert stated.phase_shifts_rad == pytest.approx(np.deg2rad([-120.0, 0.0, 120.0]))
    overridden = written_session(tmp_path / "t", images, [0.0, 120.0, 240.0], steps_deg=[0.0, 240.0, 120.0])
    assert overridden.phase_shifts_rad == pytest.approx(np.deg2rad([0.0, 240.0, 120.0]))


@pytest.mark.parametrize(("phase", "wrapped"), [(-2.0, -2.0), (4.0, 4.0 - 2 * math.pi), (-9.0, -9.0 + 2 * math.pi)])
def test_wrapped_phase_lies_between_minus_pi_and_pi(phase, wrapped):
    np.testing.assert_allclose(demodulate(frames_of(phase), STEPS_RAD).phase, wrapped, atol=1e-5)


def test_masked_pixels_are_nan_and_say_why():
    frames = np.clip(np.rint(frames_of(0.7)), 0, 255).astype(np.uint8)
    frames[0, 1, 2] = 255  # saturated
    found = demodulate(frames, STEPS_RAD)
    assert found.phase.shape == frames.shape[1:]
    assert np.argwhere(np.isnan(found.phase)).tolist() == [[1, 2]]
    assert np.argwhere(~found.valid).tolist() == np.argwhere(found.reasons != 0).tolist() == [[1, 2]]


# ---- angles ---------------------------------------------------------------------------------------
def collimated_from_above_in_the_picture(pitch_mm=8.0):
    """Parallel light from the +y side: while it falls by z it runs z tan(angle) toward -y."""
    k = 2 * math.pi / pitch_mm
    return RigModel(np.array([0, k, -k * math.tan(THESIS_ANGLE_RAD), 0, 0, 0, 0]), np.full(3, np.inf))


def test_projection_angle_is_from_the_normal():
    model = collimated_from_above_in_the_picture()
    assert float(projection_angle(model, 0.0, 0.0)) == pytest.approx(THESIS_ANGLE_RAD)
    diverging, _ = two_pinholes()
    assert float(projection_angle(diverging, 0.0, 0.0)) == pytest.approx(math.atan(0.6))
    assert float(projection_angle(diverging, 100.0, 0.0)) == pytest.approx(math.atan(0.5))


def test_a_fringe_on_a_strip_shifts_toward_the_lamp():
    model = collimated_from_above_in_the_picture()
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.5}, (101, 101), telecentric=True)
    shift_mm = 3.0 * math.tan(THESIS_ANGLE_RAD)
    assert shift_mm == pytest.approx(3.665, abs=5e-4)  # from the plate it would be 2.455
    line_on_the_plate = model.phase(0.0, 0.0, 0.0)
    seen_toward_the_lamp = camera.rays(*camera.project(0.0, shift_mm, 3.0))
    assert float(model.height(line_on_the_plate, seen_toward_the_lamp)) == pytest.approx(3.0)


def test_apparent_angle_adds_the_cameras_own():
    """With camera and projector equally high the apparent angle is the same all over the field (d/L)."""
    model, camera = two_pinholes()
    for x_mm in (-80.0, 0.0, 80.0):
        assert math.tan(float(apparent_angle(model, camera, x_mm, 0.0))) == pytest.approx(0.6)
        assert math.tan(float(projection_angle(model, x_mm, 0.0))) == pytest.approx((600 - x_mm) / 1000)


# ---- numbers and their doubt ----------------------------------------------------------------------
def test_half_width_is_not_a_standard_uncertainty():
    stated = {"format": 1, "kind": "sphere", "name": "ball", "certificate": "nominal"}
    height = {"value": 25.0, "half_width": 0.03, "distribution": "rectangular"}
    ball = parse_target(stated | {"diameter_mm": height})
    assert ball.diameter_mm.u == pytest.approx(0.0173205, abs=1e-7)


def test_coverage_factor_follows_the_degrees_of_freedom():
    # GUM table G.2: t(95 %) is 2.26 for 9 degrees of freedom and 1.960 for infinitely many.
    assert Estimate(1.0, 0.1, dof=9).expanded(0.95).k == pytest.approx(2.26, abs=0.005)
    assert Estimate(1.0, 0.1).expanded(0.95).k == pytest.approx(1.960, abs=0.0005)
    assert Estimate(1.0, 0.1).expanded(0.95).coverage == 0.95


def test_en_is_formed_by_the_stated_expanded_uncertainties():
    # GUM table G.2: t(95 %) is 2.57 for 5 degrees of freedom. With a plain 2 it would be 1.34, with t for both 1.04.
    found, reference = Estimate(20.03, 0.010, dof=5), Estimate(20.0, 0.005)
    assert en_score(found, reference) == pytest.approx(0.03 / math.hypot(2.57 * 0.010, 1.96 * 0.005), abs=1e-3)
    named = re.compile(r"\bk ?= ?2\b(?!, 3)")  # the harmonics of a wave are counted from 2
    files = (path for folder in ("src", "docs") for path in (ROOT / folder).rglob("*") if path.suffix in TEXTS)
    lines = [(p.name, line) for p in files for line in p.read_text(encoding="utf-8").splitlines() if named.search(line)]
    assert lines == []


# ---- the page itself ------------------------------------------------------------------------------
def test_every_test_that_the_page_names_exists():
    page = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(test_\w+)`", page))
    here = {name for name in globals() if name.startswith("test_")}
    assert here - {"test_every_test_that_the_page_names_exists"} == named
