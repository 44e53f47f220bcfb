"""`fringecal certificate` as a user meets it, on an archived record."""

import re
import tomllib
from pathlib import Path

import pytest

from fringecal.records.laboratory import missing_in, read_laboratory

ROOT = Path(__file__).parents[2]
ARCHIVE = max((ROOT / "tests" / "records" / "archive").glob("[0-9]*"))


@pytest.fixture
def lab(tmp_path) -> Path:
    """The example of docs/certificate.md."""
    (text,) = re.findall(r"```toml\n(.+?)```", (ROOT / "docs" / "certificate.md").read_text(encoding="utf-8"), re.S)
    assert tomllib.loads(text)["format"] == 1
    (tmp_path / "lab.toml").write_text(text, encoding="utf-8")
    return tmp_path / "lab.toml"


def test_the_documented_file_leaves_nothing_open(lab):
    assert missing_in(read_laboratory(lab)) == ()


def test_a_report_is_written_whole(run, lab, tmp_path):
    out = tmp_path / "certificate"
    outcome = run("certificate", ARCHIVE, "--lab", lab, "-o", out, "--json")
    assert outcome.code == 0, outcome.stderr
    assert outcome.document["number"] == "2026-117"
    assert not outcome.document["draft"]
    assert {"certificate.xml", "report.html", "report.pdf", "tables"} == {path.name for path in out.iterdir()}
    assert (out / "report.pdf").read_bytes().startswith(b"%PDF")


def test_what_is_missing_is_named_and_nothing_is_written(run, tmp_path):
    out = tmp_path / "certificate"
    outcome = run("certificate", ARCHIVE / "calibration.json", "-o", out)
    assert outcome.code == 1
    assert "laboratory.name: name of the laboratory" in outcome.stderr
    assert not out.exists()


def test_a_draft_says_what_is_missing(run, tmp_path):
    out = tmp_path / "draft"
    outcome = run("certificate", ARCHIVE, "-o", out, "--draft")
    assert outcome.code == 0
    assert "not stated: item.serial" in outcome.stdout
    assert "DRAFT" in (out / "certificate.xml").read_text(encoding="utf-8")
