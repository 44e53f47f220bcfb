"""Bench pages: each belongs to one function and one verb, and says what these do."""

import ast
import importlib
import re
import shlex
import tomllib
from pathlib import Path

import pytest
import typer

from fringecal.cli.app import VERBS, build_app
from fringecal.errors import FringecalError
from fringecal.records.limits import CommissionLimits
from fringecal.session.document import KINDS
from fringecal.workflows.procedure.run import parse_page

FOLDER = Path(__file__).parents[2] / "procedures"
PAGES = sorted(path for path in FOLDER.glob("*.md") if path.name != "README.md")
SECTIONS = ["Purpose", "Artefacts", "Environment", "Procedure", "What good and bad look like", "Acceptance", "Record"]


def parts(page):
    """Front matter as a table, and the text after it."""
    _, front, text = page.read_text(encoding="utf-8").split("+++\n", 2)
    return tomllib.loads(front), text


@pytest.fixture(params=PAGES, ids=lambda page: page.stem)
def page(request):
    return request.param


def test_function_and_verb_exist_and_belong_together(page):
    front, _ = parts(page)
    assert {"function", "verb"} <= set(front) <= {"function", "verb", "needs", "helps", "takes_part", "calibration"}
    module, _, name = front["function"].partition(":")
    function = getattr(importlib.import_module(module), name)
    assert callable(function)
    assert function.__module__.startswith(f"{module}."), "named by its room, whose face it stands on"
    assert front["verb"] in VERBS
    # The verb is a door to this very function.
    source = Path(importlib.import_module(f"fringecal.cli.{front['verb']}").__file__).read_text(encoding="utf-8")
    imports = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)]
    origins = [node.module for node in imports for alias in node.names if alias.name == name]
    assert [getattr(importlib.import_module(origin), name) for origin in origins] == [function]


def test_one_page_per_function_and_verb():
    fronts = [parts(page)[0] for page in PAGES]
    for key in ("function", "verb"):
        assert len({front[key] for front in fronts}) == len(PAGES)
    verbs = {"commission", "angle", "verify", "reconstruct", "audit", "grid", "study", "phase"}
    assert {front["verb"] for front in fronts} == verbs


def test_sections_in_one_order(page):
    assert re.findall(r"^## (.+)$", parts(page)[1], flags=re.MULTILINE) == SECTIONS


def test_steps_say_the_captures_that_they_ask_for(page):
    read = parse_page(page.stem, page.read_text(encoding="utf-8"))
    assert len(read.steps) >= 3
    for number, kind in {**read.needs, **read.helps}.items():
        assert f"kind {kind}" in read.steps[number - 1]
        assert kind in KINDS
    assert not set(read.needs) & set(read.helps)
    assert read.calibration == ("--calibration" in read.command)


def test_every_page_has_its_picture(page):
    pictures = re.findall(r"!\[(.+?)\]\((.+?)\)", parts(page)[1])
    assert [name for _, name in pictures] == [f"pictures/{page.stem}.png"]
    assert (FOLDER / pictures[0][1]).read_bytes().startswith(b"\x89PNG")


def test_a_page_of_another_form_is_refused():
    for text in ("# A title", "+++\nverb = 1\n+++\n# A", "+++\n[\n+++\n# A\n"):
        with pytest.raises(FringecalError, match="procedure torn"):
            parse_page("torn", text)


def test_the_command_parses(page):
    front, text = parts(page)
    (line,) = re.findall(r"```sh\n(.+?)\n```", text)
    program, verb, *arguments = shlex.split(line)
    assert (program, verb) == ("fringecal", front["verb"])
    command = typer.main.get_command(build_app(verb))
    # A group of one verb is that verb itself.
    command = getattr(command, "commands", {verb: command})[verb]
    command.make_context(verb, arguments)


def test_the_list_of_pages_is_whole():
    listed = re.findall(r"\]\((.+?\.md)\)", (FOLDER / "README.md").read_text(encoding="utf-8"))
    assert sorted(listed) == [page.name for page in PAGES]


@pytest.mark.parametrize(
    ("check", "limit"),
    [
        ("plate phase residual", CommissionLimits().plate_residual_rad),
        ("grid residual", CommissionLimits().grid_residual_px),
        ("standard uncertainty of the apparent projection angle", CommissionLimits().angle_u_deg),
        ("angle against theory", CommissionLimits().angle_en),
        ("noise of repeats over its prediction", CommissionLimits().noise_ratio),
        ("plate form beyond the model, rms", CommissionLimits().plate_form_mm),
        ("frames of a capture", CommissionLimits().frames_rad),
    ],
)
def test_limits_are_those_of_the_code(check, limit):
    _, text = parts(FOLDER / "commissioning.md")
    acceptance = text.partition("## Acceptance")[2]
    (row,) = [line for line in acceptance.splitlines() if line.startswith(f"| {check}")]
    number = re.search(r"[\d.]+", row.split("|")[2].replace("abs(En) <=", ""))
    assert float(number[0]) == limit
