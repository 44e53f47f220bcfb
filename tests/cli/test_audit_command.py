"""`fringecal audit` as a user meets it, on the oblique rig."""

import json

from jsonschema import Draft202012Validator

from fringecal.records.schemas import published_schema


def test_the_calibrations_own_session_passes(run, data, calibration, tmp_path):
    out = tmp_path / "audit"
    outcome = run("audit", data / "oblique", "--calibration", calibration, "--out", out, "--json")
    assert outcome.code == 0
    Draft202012Validator(published_schema("audit")).validate(outcome.document)
    assert json.loads((out / "audit.json").read_text()) == outcome.document
    assert outcome.document["changed"] is False
    assert outcome.document["captures"] == ["grid", "reference", "strips", "bars"]
    assert any(check["name"].startswith("mean error") for check in outcome.document["checks"])
    assert {"report.html", "tables", "figures"} <= {path.name for path in out.iterdir()}


def test_a_limit_of_the_laboratory_decides(run, session, calibration, tmp_path):
    (session / "limits.toml").write_text("format = 1\n[audit]\nnoise_percent = 1e-9\nmodulation_percent = 1e-9\n")
    outcome = run("audit", session, "--calibration", calibration, "--out", tmp_path / "audit")
    assert outcome.code in {0, 3}
    stated = tmp_path / "own.toml"
    stated.write_text("format = 1\n[audit]\nnoise = 2\n")
    refused = run("audit", session, "--calibration", calibration, "--out", tmp_path / "b", "--limits", stated)
    assert refused.code == 1
    assert "noise_percent" in refused.stderr


def test_a_calibration_of_a_newer_format_is_refused(run, session, calibration, tmp_path):
    document = json.loads((calibration / "calibration.json").read_text())
    newer = tmp_path / "newer.json"
    newer.write_text(json.dumps(document | {"format": "fringecal-calibration/2"}))
    outcome = run("audit", session, "--calibration", newer, "--out", tmp_path / "audit")
    assert outcome.code == 1
    assert "newer" in outcome.stderr
    assert not (tmp_path / "audit").exists()
