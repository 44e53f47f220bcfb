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
from fringecal.records import read_board_calibration
from fringecal.records.schemas import published_schema
from fringecal.session import load_session
from fringecal.workflows.verify import artefact_checks, verify_in_volume


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


def test_the_command_writes_record_and_report_and_passes(volume_folder, board_record, tmp_path) -> None:
    result = verified(volume_folder, board_record, tmp_path / "out", "ball")
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
def test_each_artefact_agrees_with_what_was_drawn(name, certified, volume_folder, board_record) -> None:
    found = verify_in_volume(load_session(volume_folder), name, read_board_calibration(board_record))
    agree({one.name: {**vars(one), "error": one.error} for one in found.readings}, certified)
    # Of each number one interval in twenty misses; the pixels' checks are made for all of a surface.
    assert [check.decision for check in artefact_checks(found)[-2:]] == ["pass", "pass"]


def test_a_wrong_certificate_is_out_of_tolerance(volume_folder, board_record, tmp_path, monkeypatch) -> None:
    """The ball's certificate states 51 mm, a millimetre more than was drawn: exit code 3."""
    monkeypatch.setattr(verb, "write_report", lambda *_: None)
    with restated(volume_folder, lambda text: text.replace("50.0", "51.0")):
        result = verified(volume_folder, board_record, tmp_path / "out", "ball")
    assert result.exit_code == 3, result.output
    checks = {check["name"]: check["decision"] for check in json.loads(result.stdout)["checks"]}
    assert checks["size"] == "fail"


BOX = "".join(f"{side}_mm = {{ value = 9, u = 1 }}\n" for side in ("width", "length", "height"))


def test_other_artefacts_are_refused_with_the_kinds_that_are_judged(volume_folder, board_record) -> None:
    box = f'format = 1\nkind = "box"\nname = "box"\ncertificate = "none"\n{BOX}'
    with (
        restated(volume_folder, lambda _: box),
        pytest.raises(SessionError, match="flat, steps, sphere, ball-bar are judged"),
    ):
        verify_in_volume(load_session(volume_folder), "ball", read_board_calibration(board_record))


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
