"""`fringecal audit` as a user meets it, on the oblique rig."""

import json
import re

import pytest
from jsonschema import Draft202012Validator

from fringecal.history.review import series_of
from fringecal.history.store import open_history
from fringecal.records.schemas import published_schema


def test_the_calibrations_own_session_is_no_proof_of_anything(run, data, calibration, tmp_path):
    out, db = tmp_path / "audit", tmp_path / "history.db"
    outcome = run("audit", data / "oblique", "--calibration", calibration, "--out", out, "--history", db, "--json")
    assert outcome.code == 0
    Draft202012Validator(published_schema("audit")).validate(outcome.document)
    assert json.loads((out / "audit.json").read_text()) == outcome.document
    assert outcome.document["changed"] is False
    assert outcome.document["verdict"] != "pass"
    assert outcome.document["sentence"].startswith(
        "The pictures of grid, reference, strips, bars are the calibration's"
    )
    assert outcome.document["captures"] == ["grid", "reference", "strips", "bars"]
    assert any(check["name"].startswith("mean error") for check in outcome.document["checks"])
    assert {"report.html", "tables", "figures"} <= {path.name for path in out.iterdir()}
    demand_in_history(run, out, db, outcome.document)


def demand_every_check_shown(printed):
    """What the verdict counts stands in the tables, and the warning before them."""
    assert printed.index("WARNING: The pictures of grid") < printed.index("Change since the calibration")
    counted = int(re.search(r"\((\d+) checks", printed)[1])
    outcomes = re.findall(r" (?:pass|conditionalPass|conditionalFail|fail) *$", printed, re.MULTILINE)
    assert len(outcomes) == counted


def demand_in_history(run, out, db, record):
    """The audit stands in the history, each change once, with the laboratory's limit."""
    assert run("history", "add", out, "--db", db, "--json").document == {"added": 0}
    shown = run("history", "show", "--db", db, "--json").document
    assert [entry["kind"] for entry in shown["entries"]] == ["audit"]
    quantities = [row["quantity"] for row in shown["quantities"]]
    for change in record["changes"]:
        assert quantities.count(f"change of {change['name']}") == 1
        assert f"check: change of {change['name']}" not in quantities
    with open_history(db) as history:
        rows = history.readings(quantity="change of scale")
    row = rows.iloc[0]
    (scale,) = [change for change in record["changes"] if change["name"] == "scale"]
    for column in ("value", "u", "unit", "limit", "en", "decision"):
        assert row[column] == scale[column]
    # The laboratory's limit for the change is what the charts take.
    assert series_of(rows).limit == scale["limit"]


@pytest.mark.usefixtures("blank_figures")
def test_a_limit_of_the_laboratory_decides(run, session, calibration, tmp_path):
    (session / "limits.toml").write_text("format = 1\n[audit]\nnoise_percent = 1e-9\nmodulation_percent = 1e-9\n")
    outcome = run("audit", session, "--calibration", calibration, "--out", tmp_path / "audit")
    assert outcome.code in {0, 3}
    demand_every_check_shown(outcome.stdout)
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
