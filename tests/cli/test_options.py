"""Every option of every verb, found by walking over them: what is senseless is refused in a sentence that names it."""

import math
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from fringecal.cli.app import build_app
from fringecal.cli.shared.judged_options import SIGNED, parameters_of
from fringecal.errors import FringecalError

APP = build_app()
ALL = list(parameters_of(APP))
NUMBERS = [one for one in ALL if {int, float} & set(one[2])]
PATHS = [one for one in ALL if Path in one[2]]
TEXTS = [one for one in ALL if str in one[2]]
# Senseless in every verb; the second of each is a number that Python takes for one of these.
NOT_FINITE = ("nan", "inf", "-inf", "1e999", "NaN", "-Infinity")


def name_of(parameter) -> str:
    verb, name, _, stated = parameter
    option = next((word for word in stated.param_decls or () if word.startswith("--")), name)
    return f"{' '.join(verb)} {option}"


def called(parameter, value: str):
    """Call the verb with one parameter as given, and all others that it must have filled with words."""
    verb, name, _, stated = parameter
    before, after = [], []
    for _, other, kinds, statement in (one for one in ALL if one[0] == verb):
        given = value if other == name else "1" if {int, float} & set(kinds) else "nowhere"
        if isinstance(statement, typer.models.ArgumentInfo):
            after += [given] if other == name or statement.default is ... else []
        elif other == name or statement.default is ...:
            option = next(
                iter(w for w in statement.param_decls or () if w.startswith("--")), f"--{other.replace('_', '-')}"
            )
            before.append(f"{option}={given}")
    return CliRunner().invoke(APP, [*verb, *before, "--", *after])


def demand_refused(parameter, value: str) -> None:
    found = called(parameter, value)
    assert found.exit_code == 2, (name_of(parameter), value, found.output, found.exception)
    assert isinstance(found.exception, SystemExit), found.exception
    verb, name, _, stated = parameter
    said = " ".join(found.output.replace("│", " ").split())
    options = [*(stated.param_decls or ()), f"--{name.replace('_', '-')}", name.upper(), name]
    assert any(option in said for option in options), (name_of(parameter), said)
    assert "Traceback" not in said


def test_there_is_something_to_walk_over():
    assert len(NUMBERS) > 15
    assert len(PATHS) > 40
    assert {"--limit", "--lowest-mm", "--seed", "--port"} <= {name_of(one).split()[-1] for one in NUMBERS} | {"--seed"}


@pytest.mark.parametrize("parameter", NUMBERS, ids=name_of)
def test_numbers_that_are_none(parameter):
    for value in (*NOT_FINITE, "", "x", "1,5", "0x10"):
        demand_refused(parameter, value)


@pytest.mark.parametrize("parameter", [one for one in NUMBERS if one[1] not in SIGNED], ids=name_of)
def test_negative_numbers(parameter):
    demand_refused(parameter, "-1")
    if float in parameter[2]:
        demand_refused(parameter, "-1e-300")
        if parameter[3].min is None:
            demand_refused(parameter, "0")
            demand_refused(parameter, "-0.0")


def test_only_options_that_there_are_have_a_sign():
    assert {one[1] for one in NUMBERS} >= SIGNED.keys()


def test_whole_numbers_have_a_least_one():
    for _, name, kinds, stated in NUMBERS:
        assert int not in kinds or kinds == (int,)
        assert stated.min is None or math.isfinite(stated.min), name


@pytest.mark.parametrize("parameter", PATHS, ids=name_of)
def test_empty_and_impossible_paths(parameter):
    for value in ("", "x" * 300, "folder/" + "y" * 256, "é" * 128):
        demand_refused(parameter, value)


@pytest.mark.parametrize("parameter", TEXTS, ids=name_of)
def test_empty_texts(parameter):
    for value in ("", "  "):
        demand_refused(parameter, value)


FOLDERS = [one for one in PATHS if (one[3].help or "").startswith(("Folder", "Run the verb"))]


@pytest.mark.parametrize("parameter", FOLDERS, ids=name_of)
def test_a_file_where_a_folder_is_meant(parameter, tmp_path):
    file = tmp_path / "file.txt"
    file.write_text("mine")
    found = called(parameter, str(file))
    assert found.exit_code in (1, 2)
    assert isinstance(found.exception, SystemExit | FringecalError), found.exception
    said = " ".join(f"{found.exception} {found.output}".split())
    assert found.exit_code == 2 or "folder" in said or "nowhere" in said, (
        said
    )  # the first of what is wrong here: all else leads nowhere
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]
    assert file.read_text() == "mine"
