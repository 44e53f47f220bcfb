"""The check verb: what it prints for people and for programs."""

import json
from typing import Any

import jsonschema
import pytest
import typer
from typer.testing import CliRunner

from fringecal.cli.check import register
from fringecal.session import check_report, check_schema
from fringecal.session.check_document import published_schema

Bench = Any  # the fixture of conftest.py


@pytest.fixture
def app() -> typer.Typer:
    made = typer.Typer()
    made.callback()(lambda: None)
    register(made)
    return made


def test_the_published_schema_is_the_model_s() -> None:
    # To renew it: write json.dumps(check_schema(), indent=2) and a newline to schema/check.schema.json.
    assert published_schema() == json.dumps(check_schema(), indent=2) + "\n"


def test_the_schema_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(json.loads(published_schema()))


def test_json_of_a_sound_session(bench: Bench, app: typer.Typer) -> None:
    result = CliRunner().invoke(app, ["check", str(bench.folder), "--json"])
    assert result.exit_code == 0
    report = json.loads(result.stdout)
    jsonschema.validate(report, json.loads(published_schema()))
    assert report["ok"] is True
    strips = report["captures"][2]
    assert (strips["width_px"], strips["height_px"], strips["bits"], strips["white_level"]) == (
        48,
        40,
        8,
        255,
    )
    assert strips["steps_deg"] == [0.0, 120.0, 240.0]
    assert [image["file"] for image in strips["images"]] == ["strips-0.png", "strips-1.png", "strips-2.png"]


def test_json_of_a_broken_session(bench: Bench, app: typer.Typer) -> None:
    bench.put("bars-1.png", b"")
    bench.document["rigg"] = "x"
    bench.save()
    result = CliRunner().invoke(app, ["check", str(bench.folder), "--json"])
    assert result.exit_code == 1
    report = json.loads(result.stdout)
    jsonschema.validate(report, json.loads(published_schema()))
    assert report["ok"] is False
    assert [fault["found"] for fault in report["faults"]] == ['unknown key "rigg"', "an empty file (0 bytes)"]


def test_a_report_that_leaves_something_out_is_not_valid(bench: Bench) -> None:
    report = check_report(bench.check()).model_dump(mode="json")
    del report["faults"]
    with pytest.raises(jsonschema.ValidationError, match="faults"):
        jsonschema.validate(report, json.loads(published_schema()))


def test_a_sound_session_is_shown_as_a_table(bench: Bench, app: typer.Typer) -> None:
    result = CliRunner().invoke(app, ["check", str(bench.folder)], env={"COLUMNS": "160"})
    assert result.exit_code == 0
    for words in ("grid", "Grid paper", "strips", "Twelve glass", "48 x 40"):
        assert words in result.stdout


def test_a_folder_that_is_not_there(bench: Bench, app: typer.Typer) -> None:
    result = CliRunner().invoke(app, ["check", str(bench.folder / "nowhere")])
    assert result.exit_code == 1
    assert "is not there" in result.stderr
