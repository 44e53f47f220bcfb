"""`fringecal certificate` as a user meets it, on an archived record."""

import re
import tomllib
from pathlib import Path

import pytest

from fringecal.records.certificates.laboratory import Laboratory, missing_in, read_laboratory

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


def test_the_template_states_nothing_and_asks_for_everything(run, tmp_path):
    file = tmp_path / "lab.toml"
    assert run("certificate", "--template", file).code == 0
    assert missing_in(read_laboratory(file)) == missing_in(Laboratory())
    refused = run("certificate", ARCHIVE, "--lab", file, "-o", tmp_path / "out")
    assert refused.code == 1
    assert "item.serial" in refused.stderr
    # What somebody has filled in is not written over.
    assert run("certificate", "--template", file).code == 1
    assert run("certificate").code == 2


def test_a_template_that_is_filled_in_leaves_nothing_open(run, lab, tmp_path):
    """Each empty value takes the one that the documented file states under the same key; the comments stay."""
    file, stated = tmp_path / "mine.toml", tomllib.loads(lab.read_text(encoding="utf-8"))
    run("certificate", "--template", file)
    lines, table = [], {}
    for line in file.read_text(encoding="utf-8").splitlines():
        if heading := re.match(r"\[+(\w+)\]", line):
            table = stated[heading[1]]
            table = table[0] if isinstance(table, list) else table
        elif (key := line.partition(" = ")[0]) in table and not line.startswith("signs"):
            value = table[key]
            line = f"{key} = {value if isinstance(value, list) else repr(str(value))}"
        lines.append(line)
    file.write_text("\n".join(lines), encoding="utf-8")
    filled = read_laboratory(file)
    assert missing_in(filled) == ()
    assert filled.person[0].name == "A. Author"
    assert filled.conditions.temperature_degC == (20.1, 20.9)
