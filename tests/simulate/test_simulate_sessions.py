"""Rig documents, whole sessions, their truth, the analytic images and the command."""

import io
import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from fringecal.cli import simulate as verb
from fringecal.errors import FringecalError
from fringecal.session import load_session, write_session
from fringecal.simulate import (
    analytic_images,
    list_rigs,
    load_rig,
    projection_angle_deg,
    rectangle_px,
    render,
    simulate_session,
    truth_of,
    zigzag_px,
)
from fringecal.simulate.rig.rig_spec import CaptureSpec
from fringecal.simulate.scene.capture_scenes import capture_scene
from fringecal.targets import parse_target


@pytest.fixture(scope="module")
def small():
    return load_rig("thesis").at(camera={"width_px": 128, "height_px": 120, "scale_mm_per_px": 3.67})


class TestRigs:
    def test_every_shipped_rig_loads_and_knows_its_targets(self):
        assert {"thesis", "thesis-7", "oblique", "telecentric", "harder"} <= set(list_rigs())
        for name in list_rigs():
            rig = load_rig(name)
            assert rig.name == name
            assert {capture.name for capture in rig.capture} >= {"grid", "reference", "strips", "bars"}

    def test_thesis_rig_is_the_thesis_s(self):
        truth = truth_of(load_rig("thesis"))
        assert truth.scale_h == pytest.approx(0.734, abs=1e-9)
        assert truth.scale_v == pytest.approx(0.734, abs=1e-9)
        assert truth.angle_origin_deg == pytest.approx(50.7, abs=0.01)

    def test_oblique_rig_has_the_angles_of_the_independent_simulator(self):
        # Angles that another ray tracer states for a lamp at (-180, -950, 980) mm; its fringes are
        # turned by an angle that it does not state, found as 0.275 deg from its value at the origin.
        published = {
            -80: 41.614621503727605,
            -40: 42.87370253471823,
            40: 45.244356536612074,
            80: 46.35960401899094,
        }
        points = np.array([[0.0, y] for y in published])
        found = projection_angle_deg(load_rig("oblique"), points)
        np.testing.assert_allclose(found, list(published.values()), atol=0.002)

    def test_all_faults_of_a_rig_are_listed_at_once(self):
        with pytest.raises(FringecalError) as caught:
            load_rig("thesis").at(camera={"scale_mm_per_px": -1.0, "bits": 20}, noise={"reed": 1.0})
        for word in ("scale_mm_per_px", "bits", "reed"):
            assert word in str(caught.value)

    def test_steps_of_the_wrong_number_are_refused(self):
        with pytest.raises(FringecalError, match="2 values for 3 phase shifts"):
            load_rig("thesis").at(steps={"error_deg": (1.0, 2.0)})

    def test_a_projector_below_the_plate_is_refused(self):
        with pytest.raises(FringecalError, match="above the plate"):
            load_rig("thesis").at(projector={"position_mm": (0.0, 100.0, -5.0)})

    def test_unknown_names_come_with_the_nearest(self, small):
        with pytest.raises(FringecalError, match="'thesis'"):
            load_rig("thesus")
        with pytest.raises(FringecalError, match="it has grid, reference"):
            simulate_session(small, ["gird"])

    def test_a_broken_file_is_refused(self, tmp_path):
        (tmp_path / "rig.toml").write_text("camera = [")
        with pytest.raises(FringecalError, match="not valid TOML"):
            load_rig(tmp_path / "rig.toml")


class TestSession:
    def test_it_can_be_written_and_loaded(self, small, tmp_path):
        made = simulate_session(small, seed=1)
        write_session(tmp_path / "s", made.document, made.frames, extra_files=made.files)
        session = load_session(tmp_path / "s")
        assert list(session.captures) == ["grid", "reference", "strips", "bars", "leaf"]
        for name, capture in session.captures.items():
            assert np.array_equal(capture.read(), made.captures[name].frames)

    def test_rig_with_its_own_targets_writes_them(self, tmp_path):
        rig = load_rig("oblique").at(camera={"width_px": 128, "height_px": 104, "scale_mm_per_px": 2.5})
        made = simulate_session(rig, ["grid", "reference", "strips"], seed=1)
        write_session(tmp_path / "s", made.document, made.frames, extra_files=made.files)
        session = load_session(tmp_path / "s")
        assert session.captures["strips"].target.count == 8
        assert session.captures["grid"].target.lines == (23, 23)

    def test_a_capture_does_not_depend_on_the_others_taken(self, small):
        alone = simulate_session(small, ["bars"], seed=4)
        among = simulate_session(small, ["reference", "bars"], seed=4)
        assert np.array_equal(alone.frames["bars-1.png"], among.frames["bars-1.png"])
        assert not np.array_equal(
            simulate_session(small, ["bars"], seed=5).frames["bars-1.png"], alone.frames["bars-1.png"]
        )

    def test_what_was_measured_by_hand_is_wrong_by_its_uncertainty(self, small):
        heights = [
            simulate_session(small.at(camera={"width_px": 16, "height_px": 16}), ["reference"], seed=s)
            .document["camera"]["height_mm"]["value"] for s in range(60)
        ]  # fmt: skip
        # 60 draws: the sd of their sd is 9 %.
        assert np.std(heights) == pytest.approx(5.0, rel=0.35)

    def test_truth_has_the_keys_of_the_independent_sessions(self, small):
        made = simulate_session(small, ["reference", "bars"], seed=1)
        document = json.loads(made.files["truth/truth.json"])
        keys = "name scale_h scale_v k1 verdict distortion_at_corner_px angle_origin_deg projector camera"
        for key in f"{keys} grid_pitch angle_x angle_y zmax".split():
            assert key in document
        assert document["angle_y"]["0"] == document["angle_origin_deg"]
        maps = np.load(io.BytesIO(made.files["truth/truth.npz"]))
        for key in ("bars", "lit", "x", "y"):
            assert maps[key].shape == (120, 128)
        assert maps["bars"].max() == pytest.approx(40 / np.sqrt(2), abs=3.67)

    def test_dirt_darkens_a_sheet_by_the_area_of_its_specks(self):
        sheet = CaptureSpec(name="sheet", kind="grid", dirt=30)
        rig = load_rig("telecentric").at(
            camera={"width_px": 200, "height_px": 200, "vignetting": 0.0},
            light={"room_gradient": (0.0, 0.0)},
            surface={"smooth": 0.0, "speckle": 0.0},
        )
        scene = capture_scene(rig, sheet, None)
        picture = render(rig, scene, noise=False, light="room").frames[0]
        area_mm2 = np.sum(1 - picture / picture.max()) / 0.92 * 0.734**2
        expected = np.pi * np.sum(scene.pattern.specks[:, 2] ** 2)
        # Specks may overlap one another or the picture's rim: a few percent of 30 specks.
        assert area_mm2 == pytest.approx(expected, rel=0.05)

    def test_true_artefacts_may_differ_from_what_is_stated(self, small):
        taller = parse_target({"format": 1, "kind": "strips", "name": "s", "certificate": "t", "count": 1,
                               "width_mm": {"value": 60.0, "u": 0}, "height_mm": {"value": 3.1, "u": 0},
                               "length_mm": {"value": 200.0, "u": 0}})  # fmt: skip
        made = simulate_session(small, ["strips"], seed=1, targets={"strips": taller})
        assert made.captures["strips"].z.max() == pytest.approx(3.1)
        assert made.document["capture"][0]["target"] == "glass-strips"


class TestAnalyticImages:
    @pytest.mark.parametrize("angle_deg", [45.0, 50.7])
    def test_rectangle_shifts_fringes_by_height_times_tangent(self, angle_deg):
        images = analytic_images(rectangle_px((200, 240), height_px=30.0), angle_deg=angle_deg, pitch_px=16.0)
        i1, i2, i3 = images.frames
        phase = np.arctan2(np.sqrt(3) * (i3 - i2), 2 * i1 - i2 - i3)
        shift = np.angle(np.exp(1j * (phase[100, 0] - phase[100, 120]))) % (2 * np.pi)
        expected = 2 * np.pi * 30 * np.tan(np.radians(angle_deg)) / 16 % (2 * np.pi)
        assert shift == pytest.approx(expected, abs=1e-9)

    def test_images_span_eight_bits_about_the_thesis_s_amplitude(self):
        frames = analytic_images(zigzag_px((120, 300)), angle_deg=45.0).frames
        np.testing.assert_allclose(frames.mean(axis=0), 127.5, atol=1e-9)
        assert frames.min() >= 0
        assert frames.max() <= 255
        assert frames.max() > 250

    def test_zigzag_has_flanks_of_half_its_apex(self):
        z = zigzag_px((100, 200), period_px=60.0, apex_deg=80.0)
        assert z.max() == pytest.approx(30 / np.tan(np.radians(40)), abs=1.0)
        assert np.abs(np.diff(z[50]))[75:85] == pytest.approx(1 / np.tan(np.radians(40)))
        assert np.all(z[0] == 0)

    def test_nonsense_is_refused(self):
        with pytest.raises(FringecalError, match="90"):
            analytic_images(np.zeros((4, 4)), angle_deg=95.0)
        with pytest.raises(FringecalError, match="does not fit"):
            zigzag_px((40, 40), period_px=80.0)


class TestCommand:
    @pytest.fixture
    def run(self):
        app = typer.Typer()
        verb.register(app)
        app.command(name="other")(lambda: None)
        return lambda *words: CliRunner().invoke(app, ["simulate", *words])

    def test_it_writes_a_session_and_reports_in_json(self, run, tmp_path):
        result = run("thesis", "--out", str(tmp_path / "s"), "--captures", "reference", "--json")
        assert result.exit_code == 0
        report = json.loads(result.stdout)
        assert report["images"] == ["reference-0.png", "reference-1.png", "reference-2.png"]
        assert load_session(tmp_path / "s").rig == "thesis"
        assert (tmp_path / "s" / "truth" / "truth.npz").is_file()

    def test_it_prints_a_table_for_people(self, run, tmp_path):
        result = run("thesis", "--out", str(tmp_path / "s"), "--captures", "reference")
        assert "50.705 deg" in result.stdout

    def test_unknown_rigs_are_errors(self, run, tmp_path):
        result = run("nonsense", "--out", str(tmp_path / "s"))
        assert isinstance(result.exception, FringecalError)
