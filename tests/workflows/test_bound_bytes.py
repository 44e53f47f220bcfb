"""A file that is replaced meanwhile enters no record: what is hashed are the very bytes that were used."""

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from fringecal.camera.lens.brown_lens import Lens
from fringecal.errors import RecordError, SessionError
from fringecal.guarded import bytes_of
from fringecal.records.calibration_record import read_calibration, write_calibration
from fringecal.records.exports.cameramodel import lens_text
from fringecal.records.kinds_of_record import read_record
from fringecal.records.verification_record import CalibrationUsed
from fringecal.session import load_session
from fringecal.workflows.lens import known_lens
from fringecal.workflows.rerun import run as again
from fringecal.workflows.shared import calibration_of, inputs_of

ARCHIVE = Path(__file__).parents[1] / "records" / "archive" / "0.1.0"
ROOT = Path(__file__).parents[2]


def sha(content):
    return hashlib.sha256(content).hexdigest()


@pytest.fixture
def session(tmp_path):
    """The archived session with a target and a camera model of its own."""
    folder = shutil.copytree(ARCHIVE / "session", tmp_path / "session")
    shutil.copy(ROOT / "targets" / "grid-10mm.toml", folder / "own.toml")
    text = (folder / "session.toml").read_text()
    text = text.replace('"grid-10mm"', '"own.toml"').replace("[camera]", '[camera]\nmodel = "l.cameramodel"', 1)
    (folder / "session.toml").write_text(text)
    return folder


def hostile(monkeypatch, folder, *modules):
    """Let every text file of a folder be replaced once it has been read; return the hashes of what was read."""
    seen = {}

    def read_and_replaced(path, most):
        content = bytes_of(path, most)
        if Path(path).parent == folder and Path(path).name not in seen:
            seen[Path(path).name] = sha(content)
            Path(path).write_bytes(content + b"\n# of another time\n")
        return content

    for module in modules:
        monkeypatch.setattr(f"fringecal.{module}.bytes_of", read_and_replaced)
    return seen


def test_a_session_is_bound_to_the_bytes_that_were_read(session, monkeypatch):
    values = np.array([800.0, 800, 140, 100, 0, 0, 0, 0, 0])
    stated = Lens(values, np.zeros((9, 9)), 280, 200, covariance_known=False)
    (session / "l.cameramodel").write_text(lens_text(stated))
    read = hostile(monkeypatch, session, "session.parse", "session.model_file", "targets.target_files")
    loaded = load_session(session)
    inputs = {file.file: file.sha256 for file in inputs_of(loaded)}
    assert {name: inputs[name] for name in ("session.toml", "own.toml", "l.cameramodel")} == {
        name: read[name] for name in ("session.toml", "own.toml", "l.cameramodel")
    }
    assert sha((session / "own.toml").read_bytes()) != inputs["own.toml"]  # the file is another by now
    (session / "l.cameramodel").write_text(lens_text(stated).replace("800", "900"))
    assert known_lens(loaded).lens["fx_px"] == 800


def test_a_frame_that_was_replaced_is_refused(session):
    (session / "session.toml").write_text((ARCHIVE / "session" / "session.toml").read_text())
    loaded = load_session(session)
    shutil.copy(session / "reference-1.png", session / "reference-0.png")
    with pytest.raises(SessionError, match="changed since the session was checked"):
        loaded.one("reference").read()


def test_a_calibration_is_named_by_the_bytes_that_were_read(tmp_path):
    file = Path(shutil.copy(ARCHIVE / "calibration.json", tmp_path))
    before = sha(file.read_bytes())
    calibration = read_calibration(tmp_path)
    file.write_text("{}")
    assert CalibrationUsed.of(calibration, file) == CalibrationUsed(file="calibration.json", sha256=before)
    with pytest.raises(ValueError, match="not read from a file"):
        CalibrationUsed.of(calibration.model_validate(calibration.model_dump()), file)


def test_a_rerun_refuses_what_was_replaced_between_hash_and_reading(tmp_path, monkeypatch):
    folder = shutil.copytree(ARCHIVE / "session", tmp_path / "session")
    written, _ = read_record(ARCHIVE)
    demand = again.demand_inputs

    def then_replaced(*arguments):
        demand(*arguments)
        with (folder / "session.toml").open("a") as stream:
            stream.write("# of another time\n")

    monkeypatch.setattr(again, "demand_inputs", then_replaced)
    with pytest.raises(RecordError, match=r"session\.toml changed while it was read"):
        again.rerun(written, folder)


def test_an_edited_calibration_is_not_used_and_one_without_digest_is(tmp_path):
    calibration_of(read_calibration(ARCHIVE))  # written before there were digests
    file = write_calibration(read_calibration(ARCHIVE), tmp_path)
    calibration_of(read_calibration(file))
    document = json.loads(file.read_text())
    document["rig"]["parameters"][1] *= 1.05
    file.write_text(json.dumps(document))
    with pytest.raises(RecordError, match="calibration was edited after it was written"):
        calibration_of(read_calibration(file))
