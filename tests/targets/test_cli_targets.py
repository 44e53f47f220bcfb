import json

import pytest
import typer
from typer.testing import CliRunner

from fringecal.cli.targets import register
from fringecal.errors import TargetError


@pytest.fixture
def run():
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    return lambda *arguments: CliRunner().invoke(app, ["targets", *map(str, arguments)])


def test_list_names_every_target(run):
    shown = run("list")
    assert shown.exit_code == 0
    assert "glass-strips" in shown.stdout
    rows = json.loads(run("list", "--json").stdout)["targets"]
    printable = {row["target"] for row in rows if row["printable"]}
    assert printable == {"grid-10mm", "chessboard-9x6-25mm", "charuco", "dots"}


def test_show_states_and_derives(run):
    document = json.loads(run("show", "angle-bars", "--json").stdout)
    assert document["target"]["leg_mm"] == {"value": 40.0, "u": 0.02}
    assert document["derived"]["full_height_mm"]["value"] == pytest.approx(28.284271, abs=1e-6)
    assert "28.284" in run("show", "angle-bars").stdout


@pytest.mark.parametrize("name", ["glass-strips", "grid-10mm", "flat-plate", "charuco"])
def test_show_every_form(run, name):
    assert run("show", name).exit_code == 0
    assert json.loads(run("show", name, "--json").stdout)["target"]["name"]


@pytest.mark.parametrize(("suffix", "start"), [(".pdf", b"%PDF-"), (".svg", b"<?xml"), (".PDF", b"%PDF-")])
def test_draw_writes_one_whole_file(run, tmp_path, suffix, start):
    out = tmp_path / f"sheet{suffix}"
    assert run("draw", "grid-10mm", "--out", out, "--page", "A3").exit_code == 0
    assert out.read_bytes().startswith(start)
    assert [file.name for file in tmp_path.iterdir()] == [out.name]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("draw", "grid-10mm", "--out", "sheet.png"), "written as .pdf or .svg"),
        (("draw", "grid-10mm", "--out", "sheet"), "ends in nothing"),
        (("draw", "grid-10mm", "--out", "nowhere/sheet.pdf"), "cannot be written"),
        (("draw", "angle-bars", "--out", "sheet.pdf"), "not a printed pattern"),
        (("show", "nothing"), "no shipped target"),
    ],
)
def test_what_cannot_be_done_is_refused_and_leaves_nothing(run, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert isinstance(result.exception, TargetError)
    assert message in str(result.exception)
    assert not list(tmp_path.iterdir())


def test_a_failed_write_leaves_the_old_file(run, tmp_path):
    (tmp_path / "sheet.pdf").mkdir()
    result = run("draw", "grid-10mm", "--out", tmp_path / "sheet.pdf")
    assert isinstance(result.exception, TargetError)
    assert [file.name for file in tmp_path.iterdir()] == ["sheet.pdf"]


def test_help_carries_an_example(run):
    for command in ("list", "show", "draw"):
        assert f"Example: fringecal targets {command}" in run(command, "--help").stdout
