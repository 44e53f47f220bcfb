"""`fringecal procedure`: a session folder that grows, is wrong, is mended, and runs."""

import json
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ARCHIVE = max((ROOT / "tests" / "records" / "archive").glob("[0-9]*"))


@pytest.fixture
def small(tmp_path) -> Path:
    """The archived session: grid, plate, strips and bars of a small virtual rig."""
    return shutil.copytree(ARCHIVE / "session", tmp_path / "session")


def states(document):
    return {step["kind"]: step["state"] for step in document["steps"] if step["kind"]}


def test_every_page_is_listed(run):
    listed = run("procedure", "list", "--json").document["procedures"]
    names = [row["name"] for row in listed]
    assert names == sorted(path.stem for path in (ROOT / "procedures").glob("*.md") if path.name != "README.md")
    shown = run("procedure", "list").stdout
    assert all(name in shown for name in names)


def test_an_empty_folder_lacks_everything(run, tmp_path):
    outcome = run("procedure", "run", "commissioning", "--session", tmp_path, "--json")
    assert outcome.code == 1
    assert outcome.document["missing"] == ["grid", "reference", "strips"]
    assert any("session.toml" in fault for fault in outcome.document["faults"])
    assert not outcome.document["ready"]


def test_a_folder_is_walked_as_it_grows(run, small):
    file, whole = small / "session.toml", (small / "session.toml").read_text()
    head, *captures = whole.split("[[capture]]")
    for have, step in ((1, 3), (2, 4)):
        file.write_text("[[capture]]".join([head, *captures[:have]]))
        outcome = run("procedure", "run", "commissioning", "--session", small)
        assert outcome.code == 1
        assert f"(step {step}), then run this again." in outcome.stdout
    file.write_text(whole)
    # A frame is broken: its step is wrong, the others stay done.
    (small / "strips-1.png").write_bytes(b"no picture")
    outcome = run("procedure", "run", "commissioning", "--session", small, "--json")
    assert outcome.code == 1
    expected = {"grid": "done", "reference": "done", "strips": "wrong", "artefact": "optional"}
    assert states(outcome.document) == expected
    shown = run("procedure", "run", "commissioning", "--session", small).stdout
    assert "5. [if you have it; bars: measured, not in the fit]" in shown
    assert "3. [done: reference]" in shown
    # The bars are there, but stay out of the calibration until they are told to take part: then that step is done.
    file.write_text(whole.replace('name = "bars"', 'name = "bars"\nuse = "calibration"'))
    outcome = run("procedure", "run", "commissioning", "--session", small, "--json")
    assert states(outcome.document) == expected | {"artefact": "done"}
    assert outcome.document["steps"][-1]["text"].startswith("Run it: fringecal commission")
    (wrong,) = [step for step in outcome.document["steps"] if step["state"] == "wrong"]
    assert "strips-1.png" in wrong["faults"][0]
    assert outcome.document["faults"] == []


def test_what_is_whole_names_its_command(run, small):
    outcome = run("procedure", "run", "scale-and-distortion", "--session", small, "--json")
    assert outcome.code == 0
    assert outcome.document["command"][:3] == ["fringecal", "grid", str(small / "grid.png")]
    outcome = run("procedure", "run", "periodic-audit", "--session", small)
    assert outcome.code == 0
    assert "--calibration" in outcome.stdout
    assert run("procedure", "run", "periodic-audit", "--session", small, "--out", "x").code == 1


def test_the_command_names_this_sessions_capture(run, small):
    file = small / "session.toml"
    file.write_text(file.read_text().replace('name = "bars"', 'name = "zigzag"'))
    outcome = run(
        "procedure", "run", "verification-on-angle-bars", "--session", small, "--calibration", ARCHIVE, "--json"
    )
    assert outcome.code == 0
    words = outcome.document["command"]
    assert words[words.index("--capture") + 1] == "zigzag"
    assert words[words.index("--calibration") + 1] == str(ARCHIVE)


def test_a_whole_session_is_run_once(run, small, tmp_path):
    out = tmp_path / "grid-check"
    assert run("procedure", "run", "scale-and-distortion", "--session", small, "--out", out).code == 0
    assert (out / "report.html").is_file()
    # A record that was made from these very files is not made again; from other files it is.
    folder = tmp_path / "calibration"
    folder.mkdir()
    shutil.copy(ARCHIVE / "calibration.json", folder)
    outcome = run("procedure", "run", "commissioning", "--session", small, "--out", folder)
    assert outcome.code == 0
    assert "Done before" in outcome.stdout
    assert [path.name for path in folder.iterdir()] == ["calibration.json"]
    record = json.loads((folder / "calibration.json").read_text())
    record["inputs"][0]["sha256"] = "0" * 64
    (folder / "calibration.json").write_text(json.dumps(record))
    from fringecal.cli.procedure import _done_before
    from fringecal.session import check_session

    assert _done_before(check_session(small), None, folder) is None


def test_an_unknown_procedure_is_met_with_the_nearest(run, small):
    outcome = run("procedure", "run", "comissioning", "--session", small)
    assert outcome.code == 1
    assert "did you mean 'commissioning'" in outcome.stderr
