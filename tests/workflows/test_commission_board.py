"""A rig calibrated by a board in poses: against the virtual rig's truth, faults named, and back from its record."""

import json
import re
from dataclasses import replace

import jsonschema
import numpy as np
import pytest
import typer
from scipy import ndimage
from typer.testing import CliRunner

from fringecal.cli import commission as verb
from fringecal.cli import reconstruct as reconstruct_verb
from fringecal.errors import RecordError, SessionError
from fringecal.history import open_history
from fringecal.projector import rig_points
from fringecal.records import read_board_calibration, read_calibration, read_record, write_board_calibration
from fringecal.records.schemas import published_schema
from fringecal.session import load_session, write_session
from fringecal.simulate import flat_pose, load_raster_rig, raster_truth, simulate_raster_session
from fringecal.workflows.commission import (
    board_calibration_record,
    board_checks,
    board_report,
    commission_boards,
    is_board_session,
)
from fringecal.workflows.commission.by_board.board_numbers import depth_section
from fringecal.workflows.commission.by_board.board_run import (
    _measured,
    demand_poses,
    plate_waves,
    solved_poses,
)
from fringecal.workflows.reconstruct import measure_volume
from fringecal.workflows.shared import board_rig_of, raster_of_capture

from ..simulate.small_board_rig import POSES, small_board_rig


@pytest.fixture(scope="module")
def rig():
    return small_board_rig()


@pytest.fixture(scope="module")
def made(rig):
    return simulate_raster_session(rig, seed=4)


@pytest.fixture(scope="module")
def folder(made, tmp_path_factory):
    return write_session(
        tmp_path_factory.mktemp("boards") / "session", made.document, made.frames, extra_files=made.files
    )


@pytest.fixture(scope="module")
def found(folder):
    return commission_boards(load_session(folder))


@pytest.fixture(scope="module")
def waves(folder):
    return plate_waves(load_session(folder))


def test_camera_and_projector_are_the_virtual_rigs(found, rig) -> None:
    truth, calibrated = raster_truth(rig), found.fit.rig
    assert len(found.used) == len(POSES)
    # A residual of a twentieth of a pixel: corners to 0.03 px, coordinates to 0.02 px.
    assert found.fit.stereo_rms_px < 0.1
    error = np.array([*truth["camera"], *truth["projector"]]) - calibrated.values[:18]
    u = np.sqrt(np.diag(calibrated.covariance))
    # 21 numbers of one draw: beyond 4 u is none in 700 draws. A corner's own error is not quite normal.
    assert np.abs(error / u[:18]).max() < 4.5
    assert np.abs((np.array(truth["shift_mm"]) - calibrated.shift_mm) / u[-3:]).max() < 4.5
    assert np.linalg.norm(calibrated.centre_mm - truth["projector_position_mm"]) < 1.5  # of 260 mm


def test_checks_pass_and_what_is_not_determined_is_said(found) -> None:
    checks = {check.name: check for check in board_checks(found)}
    assert all(check.decision in ("pass", "info") for check in checks.values()), checks
    assert checks["poses used"].value == 100
    # Normals of pose-05 and pose-13, turned by -28 and -32 deg, against pose-11, by -30 about the other direction.
    assert 25 < checks["largest angle between boards"].value < 90


def test_edges_of_squares_pass_for_no_phase_shifts_that_change_over_the_field(found) -> None:
    for capture in found.captures[:2]:
        for axis in "uv":
            adapted = raster_of_capture(capture, axis).adapted
            assert adapted is not None
            assert not adapted.change_rad_px.any()


def test_the_bare_plate_gives_the_waveform(waves) -> None:
    assert set(waves) == {"u", "v"}
    # The virtual projector's response is linear, and so is the camera's.
    assert all(abs(wave.gamma - 1) < 0.05 for wave in waves.values())


def test_a_session_without_a_plate_says_what_it_lacks(found) -> None:
    session = found.session
    without = replace(session, captures={name: one for name, one in session.captures.items() if name != "plate"})
    assert "no bare plate" not in " ".join(found.notes)
    assert "no bare plate was captured" in " ".join(replace(found, session=without).notes)


def test_the_record_gives_the_rig_back(found, tmp_path) -> None:
    record = board_calibration_record(found, command=("fringecal", "commission"))
    read = read_board_calibration(write_board_calibration(record, tmp_path))
    assert read.digest_state == "fits"
    back = board_rig_of(read)
    points = found.fit.rig.volume_mm
    assert np.abs(back.project(points) - found.fit.rig.project(points)).max() < 1e-9
    assert np.array_equal(back.covariance, (found.fit.rig.covariance + found.fit.rig.covariance.T) / 2)
    for reader in (read_calibration, read_record):
        with pytest.raises(RecordError, match="a calibration by a board in poses, which `fringecal reconstruct` uses"):
            reader(tmp_path / "calibration.json")
    jsonschema.validate(json.loads((tmp_path / "calibration.json").read_text()), published_schema("board-calibration"))
    assert read.baseline_mm.value == pytest.approx(found.fit.rig.baseline_mm)


def test_the_report_shows_both_pictures_and_the_volume(found) -> None:
    report = board_report(found)
    figures = [figure.caption for section in report.sections for figure in section.figures]
    volume = ["Volume of the calibration", "Uncertainty over depth, baseline and angle"]
    assert figures == [*volume, "Residuals in the camera", "Residuals in the projector"]


def test_the_section_over_depth_is_known_where_both_devices_reach(found) -> None:
    rig = found.fit.rig
    section = depth_section(rig)
    assert section.u_mm.shape == (len(section.x_mm), len(section.z_mm))
    y = (rig.volume_mm[:, 1].min() + rig.volume_mm[:, 1].max()) / 2
    middle = np.array([[np.median(section.boards_mm[:, 0]), y, np.median(section.boards_mm[:, 2])]])
    i, k = (int(np.argmin(np.abs(a - b))) for a, b in ((section.x_mm, middle[0, 0]), (section.z_mm, middle[0, 2])))
    points = rig_points(rig, rig.camera.project(middle), rig.project(middle))
    assert section.u_mm[i, k] == pytest.approx(float(np.sqrt(np.trace(points.covariance_mm2[0]))), rel=0.05)
    # The camera's left edge passes its picture's first column: beyond it nothing is known.
    left, _ = section.edges_mm[0]
    assert rig.camera.project(left[None])[0, 0] == pytest.approx(0, abs=1e-6)
    assert rig.project(section.edges_mm[1][:1])[0, 0] == pytest.approx(0, abs=1e-6)
    outside = section.x_mm < left[0] * section.z_mm[-1] / left[2] - 1
    assert np.isnan(section.u_mm[outside, -1]).all()


def test_the_command_writes_record_camera_and_report(found, folder, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("fringecal.cli.shared.by_board.commission_boards", lambda *_, **__: found)
    app = typer.Typer()
    app.callback()(lambda: None)
    verb.register(app)
    run = ["commission", str(folder), "--out", str(tmp_path / "out"), "--history", str(tmp_path / "h.sqlite"), "--json"]
    result = CliRunner().invoke(app, run)
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["format"] == "fringecal-board-calibration/1"
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"calibration.json", "camera.cameramodel", "report.html"} <= names
    with open_history(str(tmp_path / "h.sqlite"), create=False) as history:
        baseline = history.readings(quantity="baseline").iloc[-1]
    assert baseline["kind"] == "calibration"
    assert baseline["value"] == pytest.approx(found.fit.rig.baseline_mm)


def test_a_pose_whose_board_moved_is_left_aside_with_the_reason(found) -> None:
    rng = np.random.default_rng(3)
    spoilt = found.posed[3]
    pose = spoilt.pose
    # Between the axes the board turned a little: one axis is off by what no pose explains.
    moved = pose.projector_px + np.array([0, 1]) * rng.normal(0, 1.5, (len(pose.board_mm), 1))
    posed = tuple(replace(one, pose=replace(pose, projector_px=moved)) if one is spoilt else one for one in found.posed)
    left, fit = solved_poses(found.session, found.captures, posed)
    (aside,) = [one for one in left if one.pose is None]
    assert aside.name == spoilt.name
    assert "did the board move between the frames" in aside.reason
    assert len(fit.poses) == len(POSES) - 1
    assert fit.stereo_rms_px < 0.1


def _turned(table, frames):
    for file in (*table["images"], *table["white"], *table["black"]):
        frames[file] = np.ascontiguousarray(frames[file][::-1, ::-1])


def _exchanged(table, _):
    half = len(table["images"]) // 2
    table["images"] = table["images"][half:] + table["images"][:half]


def _reversed(table, _):
    sets = [table["images"][k : k + 3] for k in range(0, len(table["images"]), 3)]
    table["images"] = [file for one, two, three in sets for file in (one, three, two)]


def _shuffled(table, _):
    one, two, three, four, *rest = table["images"]
    table["images"] = [four, two, three, one, *rest]


def _hidden(table, frames):
    for file in (*table["images"], *table["white"], *table["black"]):
        frames[file] = frames[file].copy()
        frames[file][:, 70:] = 255


CAPTURE_FAULTS = {
    "pictures turned": (_turned, "its pictures are turned by 180 degrees"),
    "axes exchanged": (_exchanged, "its axes are exchanged"),
    "steps reversed": (_reversed, "its phase falls along u and v|did the board move"),
    "frames shuffled": (_shuffled, "did the board move|do not fit the stated periods"),
    "glare": (_hidden, "no board: .* of the picture is saturated"),
}


@pytest.mark.parametrize("fault", list(CAPTURE_FAULTS))
def test_a_capture_with_a_fault_is_left_aside_by_its_name(found, made, waves, tmp_path, fault) -> None:
    spoil, words = CAPTURE_FAULTS[fault]
    tables = [dict(one) for one in made.document["capture"] if one["name"] in (POSES[0], POSES[4])]
    frames = dict(made.frames)
    spoil(tables[1], frames)
    folder = write_session(tmp_path / "s", {**made.document, "capture": tables}, frames, extra_files=made.files)
    (_, bad), _ = _measured(load_session(folder).find("board"), waves, lambda _: None)
    posed = tuple(bad if one.name == bad.name else one for one in found.posed)
    left, fit = solved_poses(found.session, found.captures, posed)
    (aside,) = [one for one in left if one.pose is None]
    assert aside.name == POSES[4]
    assert re.search(words, aside.reason), aside.reason
    assert fit.stereo_rms_px < 0.1


def test_captures_of_one_axis_that_share_a_pose_are_one_pose(found, made, waves, tmp_path) -> None:
    document = {**made.document, "capture": [dict(one) for one in made.document["capture"] if one["name"] in POSES[:3]]}
    for table in list(document["capture"]):
        half = len(table["images"]) // 2
        rows = {**table, "name": f"{table['name']}-v", "axes": ["v"], "images": table["images"][half:]}
        white, black = rows.pop("white"), rows.pop("black")  # a picture belongs to one capture
        assert (white, black) == (table["white"], table["black"])
        document["capture"].append(rows | {"pose": table["name"]})
        table.update(axes=["u"], images=table["images"][:half], pose=table["name"])
    folder = write_session(tmp_path / "s", document, made.frames, extra_files=made.files)
    session = load_session(folder)
    captures = [capture for capture in session.find("board") if capture.counted_axes]
    assert len(captures) == 6
    together, _ = _measured(captures, waves, lambda _: None)
    assert [one.name for one in together] == POSES[:3]
    for one, whole in zip(together, found.posed, strict=False):
        assert np.isfinite(one.pose.projector_px).sum() >= 0.95 * np.isfinite(whole.pose.projector_px).sum()
        assert np.nanmax(np.abs(one.pose.projector_px - whole.pose.projector_px)) < 0.05
    doubled = [*captures, replace(captures[0], name="again")]
    with pytest.raises(SessionError, match="have fringes along the same axis"):
        _measured(doubled, waves, lambda _: None)


def test_too_few_poses_say_what_is_wrong_with_each(found) -> None:
    posed = [one.aside("no board: blurred") if k > 1 else one for k, one in enumerate(found.posed)]
    with pytest.raises(SessionError, match=r"2 of 6 poses of the board can be used, 3 are needed") as error:
        demand_poses(posed)
    assert str(error.value).count("no board: blurred") == 4


def test_a_block_is_measured_over_the_plate_with_its_u(found, made, folder, tmp_path) -> None:
    record = board_calibration_record(found)
    over = measure_volume(load_session(folder), "block", record)
    assert (over.plate, over.heights is not None) == ("plate", True)
    truth = made.captures["block"].points_mm
    rotation, _ = flat_pose(load_raster_rig("dlp-small").capture_named("plate"))
    height = np.einsum("i,ihw->hw", rotation[:, 2], truth - np.array([0.0, 0.0, 600.0])[:, None, None])
    # Well inside a tread or the plate: no pixel mixes two surfaces.
    flat = ndimage.maximum_filter(height, 7) - ndimage.minimum_filter(height, 7) < 0.01
    use = flat & over.heights.mask & made.captures["block"].lit
    error = (over.heights.z - height)[use] / over.heights.u_z[use]
    assert use.sum() > 2000
    # One calibration's error is common to all pixels: within 3 u nearly all of them are, of one draw.
    assert np.mean(np.abs(error) < 3) > 0.95
    treads = (over.heights.z - height)[use & (height > 5)]
    assert abs(float(np.median(treads))) < 0.15  # of 10 to 30 mm, from pictures of 200 x 160 px
    write_board_calibration(record, tmp_path)
    app = typer.Typer()
    app.callback()(lambda: None)
    reconstruct_verb.register(app)
    run = ["reconstruct", str(folder), "--capture", "block", "--calibration", str(tmp_path / "calibration.json")]
    result = CliRunner().invoke(app, [*run, "--out", str(tmp_path / "out"), "--json"])
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    assert summary["frame"] == "plate"
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"points.npz", "height.npz", "height.ply", "report.html"} <= names
    refused = CliRunner().invoke(app, [*run, "--out", str(tmp_path / "o"), "--minus-plate"])
    assert refused.exit_code == 2


def test_only_sessions_with_boards_under_fringes_are_calibrated_so(folder) -> None:
    assert is_board_session(load_session(folder))
