"""Verification in the volume of a rig with a board's calibration: by the command, against the virtual rig's truth."""

import json
from contextlib import contextmanager

import jsonschema
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from fringecal.cli import verify as verb
from fringecal.errors import SessionError
from fringecal.projector import BOARD_RIG_NAMES
from fringecal.records import BoardCalibrationRecord, read_board_calibration, write_board_calibration
from fringecal.records.schemas import published_schema
from fringecal.session import load_session, write_session
from fringecal.simulate import load_raster_rig, raster_truth, simulate_raster_session
from fringecal.workflows.shared import inputs_of, session_note
from fringecal.workflows.verify import artefact_checks, verify_in_volume

SIZE = (360, 288)
SMALL = {"width_px": SIZE[0], "height_px": SIZE[1], "focal_px": 675.0, "principal_offset_px": (1.5, -0.9)}
PLACES = {
    "ball": ((0.0, 0.0, 630.0), (4.0, -6.0, 0.0)),
    "bar": ((0.0, 0.0, 620.0), (-6.0, 9.0, 25.0)),
    "flat": ((0.0, 0.0, 600.0), (14.0, -10.0, 0.0)),
    "block": ((0.0, 0.0, 620.0), (-10.0, 8.0, 30.0)),
}
ABOUT = {"format": 1, "certificate": "virtual"}
TARGETS = {
    "ball": {"kind": "sphere", "diameter_mm": {"value": 50.0, "u": 0.0005}},
    "bar": {"kind": "ball-bar", "diameters_mm": {"value": [50.0, 50.0], "u": 0.0005},
            "spacing_mm": {"value": 130.0, "u": 0.0005}},
    "flat": {"kind": "flat", "flatness_mm": {"value": 0.0, "u": 0.0005}},
    "block": {"kind": "steps", "heights_mm": {"value": [10.0, 20.0, 30.0], "u": 0.001},
              "width_mm": {"value": [30.0] * 3, "u": 0.01}, "length_mm": {"value": 80.0, "u": 0.05}},
}  # fmt: skip


@pytest.fixture(scope="module")
def rig():
    """The shipped rig with small pictures, and artefacts in poses of their own."""
    captures = [
        {"name": name, "kind": "artefact", "target": ABOUT | {"name": name} | TARGETS[name],
         "position_mm": at, "turn_deg": turn}
        for name, (at, turn) in PLACES.items()
    ]  # fmt: skip
    return load_raster_rig("dlp-small").at(camera=SMALL, capture=captures)


@pytest.fixture(scope="module")
def folder(rig, tmp_path_factory):
    made = simulate_raster_session(rig, seed=5)
    return write_session(tmp_path_factory.mktemp("volume") / "session", made.document, made.frames,
                         extra_files=made.files)  # fmt: skip


@pytest.fixture(scope="module")
def calibration(rig, folder, tmp_path_factory):
    """The record that a board would give: the truth, known as well as fifteen poses tell it."""
    truth, session = raster_truth(rig), load_session(folder)
    u = np.array([0.05, 0.05, 0.1, 0.1, 1e-3, 5e-3, 1e-5, 1e-5, 1e-4] * 2 + [1e-5] * 3 + [0.01] * 3)
    values = np.array([*truth["camera"], *truth["projector"], 0.0, 0.0, 0.0, *truth["shift_mm"]])
    # The records' order of Brown's terms is k1, k2, p1, p2, k3, as the truth's.
    corners = [(x, y, z) for x in (-60.0, 60.0) for y in (-45.0, 45.0) for z in (540.0, 660.0)]
    rasters = [
        {"axis": axis, "extent_px": extent, "periods_px": [extent / n for n in rig.fringes.fringes],
         "zeros_rad": [0.0] * 3, "falls": False}
        for axis, extent in (("u", 640), ("v", 360))
    ]  # fmt: skip
    number = {"value": 260.0, "u": 0.02, "unit": "mm"}
    record = BoardCalibrationRecord(
        software={"fringecal": "test"}, session=session_note(session), inputs=inputs_of(session, only=()),
        image={"width": SIZE[0], "height": SIZE[1], "white_level": 255}, columns=640, rows=360, names=BOARD_RIG_NAMES,
        parameters=tuple(values.tolist()), rotation=truth["rotation"], covariance=np.diag(u**2).tolist(),
        camera_rms_px=0.03, projector_rms_px=0.03, stereo_rms_px=0.04, camera_s_px=0.03, projector_s_px=0.03,
        axes=("u", "v"), raster=rasters, poses=(),
        volume={"points_mm": corners, "u_least_mm": 0.01, "u_largest_mm": 0.02},
        baseline_mm=number, angle_deg=number | {"unit": "deg"},
    )  # fmt: skip
    return write_board_calibration(record, tmp_path_factory.mktemp("calibration"))


def verified(folder, calibration, out, name):
    app = typer.Typer()
    app.callback()(lambda: None)
    verb.register(app)
    run = ["verify", str(folder), "--capture", name, "--calibration", str(calibration), "--out", str(out)]
    return CliRunner().invoke(app, [*run, "--json"])


def agree(readings, certified) -> None:
    """One draw each: of ten numbers none is beyond three u in 37 of 38 draws, and the rig is the true one."""
    for number, value in certified.items():
        reading = readings[number]
        assert reading["reference"] == pytest.approx(value)
        assert abs(reading["error"]) < 3 * np.hypot(reading["u_measured"], reading["u_reference"]), number
        assert reading["u_measured"] < 0.1, number


def test_the_command_writes_record_and_report_and_passes(folder, calibration, tmp_path) -> None:
    result = verified(folder, calibration, tmp_path / "out", "ball")
    assert result.exit_code == 0, result.output
    document = json.loads((tmp_path / "out" / "verification.json").read_text())
    jsonschema.validate(document, published_schema("verification"))
    agree({one["name"]: one for one in document["readings"]}, {"size": 50.0})
    assert {check["decision"] for check in document["checks"]} == {"pass"}
    assert document["height_model"] == "inverse camera"
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.parametrize(
    ("name", "certified"),
    [
        ("bar", {"spacing": 130.0, "ball 1: size": 50.0, "ball 2: size": 50.0}),
        ("flat", {"bow along columns": 0.0, "bow along rows": 0.0, "twist": 0.0}),
        ("block", {"step of 10 mm": 10.0, "step of 20 mm": 20.0, "step of 30 mm": 30.0}),
    ],
)
def test_each_artefact_agrees_with_what_was_drawn(name, certified, folder, calibration) -> None:
    found = verify_in_volume(load_session(folder), name, read_board_calibration(calibration))
    agree({one.name: {**vars(one), "error": one.error} for one in found.readings}, certified)
    # Of each number one interval in twenty misses; the pixels' checks are made for all of a surface.
    assert [check.decision for check in artefact_checks(found)[-2:]] == ["pass", "pass"]


def test_a_wrong_certificate_is_out_of_tolerance(folder, calibration, tmp_path, monkeypatch) -> None:
    """The ball's certificate states 51 mm, a millimetre more than was drawn: exit code 3."""
    monkeypatch.setattr(verb, "write_report", lambda *_: None)
    with restated(folder, lambda text: text.replace("50.0", "51.0")):
        result = verified(folder, calibration, tmp_path / "out", "ball")
    assert result.exit_code == 3, result.output
    checks = {check["name"]: check["decision"] for check in json.loads(result.stdout)["checks"]}
    assert checks["size"] == "fail"


BOX = "".join(f"{side}_mm = {{ value = 9, u = 1 }}\n" for side in ("width", "length", "height"))


def test_other_artefacts_are_refused_with_the_kinds_that_are_judged(folder, calibration) -> None:
    box = f'format = 1\nkind = "box"\nname = "box"\ncertificate = "none"\n{BOX}'
    with restated(folder, lambda _: box), pytest.raises(SessionError, match="flat, steps, sphere, ball-bar are judged"):
        verify_in_volume(load_session(folder), "ball", read_board_calibration(calibration))


@contextmanager
def restated(folder, change):
    """The ball's certificate as it would be otherwise, for a while."""
    target = folder / "t-ball.toml"
    text = target.read_text()
    try:
        target.write_text(change(text))
        yield
    finally:
        target.write_text(text)
