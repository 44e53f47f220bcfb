"""Interrupting a commissioning: no half file, and an older result stays as it was."""

import shutil
import signal
import subprocess
import sys
import time

import pytest

# A shell's background job starts its children with SIGINT ignored, and so might whatever runs these tests.
LISTEN = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
COMMAND = f"{LISTEN}; from fringecal.cli.app import main; main()"
PATIENCE_S = 120


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.skipif(sys.platform == "win32", reason="signals of another kind")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_an_older_result_survives(data, calibration, tmp_path, name):
    out = tmp_path / "calibration"
    shutil.copytree(calibration, out)
    before = contents(out)
    arguments = [sys.executable, "-u", "-c", COMMAND, "commission", str(data / "oblique"), "--out", str(out)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        # Into the work, not into the start of Python: its first step is printed when it begins.
        assert process.stdout.readline().strip()
        time.sleep(0.3)
        process.send_signal(getattr(signal, name))
        _, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode != 0
    assert contents(out) == before
    if name != "SIGKILL":
        word, code = {"SIGINT": ("interrupted", 130), "SIGTERM": ("terminated", 143)}[name]
        assert complaint.strip().splitlines()[-1].startswith(f"{word}: nothing was written")
        assert "Traceback" not in complaint
        assert process.returncode == code
        assert sorted(path.name for path in tmp_path.iterdir()) == ["calibration"]


@pytest.mark.usefixtures("blank_figures")
def test_a_failure_while_writing_leaves_nothing(run, data, calibration, tmp_path, monkeypatch):
    """The disk is full at the last file: what was there before stays, nothing new appears."""
    import fringecal.records.exports.surface_files as surfaces

    def full(*_arguments, **_options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(surfaces, "write_x3p", full)
    out = tmp_path / "surface"
    out.mkdir()
    (out / "height.npz").write_bytes(b"older")
    outcome = run("reconstruct", data / "oblique", "--capture", "bars", "--calibration", calibration, "--out", out)
    assert outcome.code == 1
    assert "No space left" in outcome.stderr
    assert contents(tmp_path) == {(out / "height.npz").relative_to(tmp_path): b"older"}
