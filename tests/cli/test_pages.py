"""Every command of every page runs, on what the tutorial leaves behind, and writes and prints what the page says."""

import ast
import fnmatch
import html
import importlib
import json
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tomllib
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import typer
from PIL import Image
from scipy.spatial.transform import Rotation

from fringecal.cli.app import build_app

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
TUTORIAL = "docs/tutorial.md"
PAGES = [
    TUTORIAL,
    "README.md",
    *(f"procedures/{path.name}" for path in sorted((ROOT / "procedures").glob("*.md"))),
    *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md")) if path.name != "tutorial.md"),
    *(f"docs/theory/{path.name}" for path in sorted((ROOT / "docs" / "theory").glob("*.md"))),
    "targets/README.md",
]
PROGRAMS = ("fringecal", "make", "python", "pytest", "pip", "bash", "apt-get")

# What stands for something of the reader's own, and what it is here. The tutorial's folder has the rest.
PLACES = {
    "SESSION": "session",
    "FOLDER": "session",
    "SESSION/grid.png": "session/grid.png",
    "IMAGE": "session/grid.png",
    "NAME": "grid-10mm",
    "FILE.pdf": "grid.pdf",
    "calibration/calibration.json": "calibration",
}
# What would take too long, and its like that takes seconds. The thesis's rig itself runs in test_results.py.
SMALLER: dict[str, str] = {
    "fringecal simulate thesis --out session": "fringecal simulate tutorial-rig.toml --out session",
    "fringecal simulate thesis": "fringecal simulate tutorial-rig.toml --out session",
    "fringecal study --rig my-rig.toml --rigs 20 --heights 5,15,30 --out study": (
        "fringecal study --rig my-rig.toml --rigs 2 --heights 5,15,30 --out study"
    ),
    "fringecal study --rig thesis --heights 20 --rigs 60 --seed 20 --out study20": (
        "fringecal study --rig my-rig.toml --rigs 2 --heights 5,15,30 --out study"
    ),
    "fringecal certificate --template lab.toml": "fringecal certificate --template lab-to-fill-in.toml",
    "fringecal study --rigs 500 --seed 2008 --out study": (  # rigs drawn at random: tests/workflows/test_study.py
        "fringecal study --rig my-rig.toml --rigs 2 --heights 5,15,30 --out study"
    ),
    # The same with and without a history, of which the tutorial shows the longer one.
    "fringecal commission session --out calibration": (
        "fringecal commission session --out calibration --history history.db"
    ),
    "fringecal commission SESSION --out calibration": (
        "fringecal commission session --out calibration --history history.db"
    ),
    "fringecal audit SESSION --calibration calibration/calibration.json --out audit": (
        "fringecal audit moved --calibration calibration --out audit-moved"
    ),
}
# Two rigs say nothing of coverage; a lamp that was moved is what an audit is for.
CODES = {"fringecal study": {0, 3}, "fringecal audit moved": {3}}
# What runs elsewhere, and where.
ELSEWHERE = {
    "pip install .": "test_project.py builds the wheel and looks into it",
    "pip install --no-deps mrcal numpysane gnuplotlib": "the environment of these very tests",
    "apt-get install postgresql": "tests/history/test_writers.py starts the server",
    "bash benchmarks/peers.sh": "an environment of other people's programs",
}
# Kinds of files that commands write, and those that the reader brings or another rig's session has.
RESULTS = ["json", "csv", "npz", "tif", "ply", "stl", "obj", "x3p", "cameramodel", "yml", "html", "pdf", "xml", "db"]
BROUGHT = {"audit.csv", "*.cameramodel", "camera.cameramodel", "lens-rich.cameramodel", "history.csv", "*.csv"}
# What commands say, by the pages.
PRINTED = {
    "fringecal check session": "A session: every file is there",
    "fringecal procedure run": "All is there: fringecal commission session --out calibration",
    "fringecal grid session": "No lens distortion was found",
    "fringecal phase session --diagnose": "plate: the diagnostics find nothing",
    "fringecal phase 'pat0": "noise would make",
    "fringecal lens": "pictures of Chessboard",
    "fringecal audit moved": "Probable cause: projector moved",
    "fringecal history msa": "of the tolerance",
    "fringecal serve": "tutorial",
}
# The report of each bench page's own command.
REPORTS = {
    "procedures/commissioning.md": "calibration",
    "procedures/measuring-an-object.md": "leaf",
    "procedures/periodic-audit.md": "audit-moved",
    "procedures/projection-angle.md": "angle",
    "procedures/scale-and-distortion.md": "grid-check",
    "procedures/verification-on-angle-bars.md": "verification",
    "procedures/choosing-pitch-and-angle.md": "study",
}


# ---- reading the pages ----------------------------------------------------------------------------
def verbs(group=None, path=()) -> dict[tuple[str, ...], object]:
    group = typer.main.get_command(build_app()) if group is None else group
    found = {}
    for name, command in group.commands.items():
        found[*path, name] = command
        if hasattr(command, "commands"):
            found |= verbs(command, (*path, name))
    return found


VERBS = verbs()


def commands_of(page: str) -> Iterator[str]:
    """Every command of a page: in blocks, in indented lines, and between back-ticks in a sentence."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for language, block in re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE):
        if language in ("", "sh", "console"):
            lines = block.replace("\\\n", " ").splitlines()
            yield from filter(None, (line.partition(" #")[0].strip() for line in lines))
        else:
            # Python: the lines of the README run in tests/library/test_library.py.
            assert language in ("toml", "text") or (page, language) == ("README.md", "python"), (
                f"{page}: a block of {language} that no test reads"
            )
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    indented = re.findall(r"^    (\S.*)$", prose, flags=re.MULTILINE)
    quoted = (" ".join(code.split()) for code in re.findall(r"`([^`]+)`", prose))
    for line in (*indented, *quoted):
        if re.match(rf"(?:[A-Z_]+=\S+ )*(?:{'|'.join(PROGRAMS)}) ", line) and not names_a_verb(line):
            yield line


def names_a_verb(line: str) -> bool:
    """Whether a sentence only names a verb: `fringecal study`, `fringecal history add`."""
    program, *words = line.split()
    command = VERBS.get(tuple(words)) if program == "fringecal" else None
    return command is not None and (len(words) == 1 or any(one.required for one in command.params))


def as_run(command: str) -> str:
    """The command with this folder's own names in the place of the reader's."""
    smaller = SMALLER.get(command, command)
    return shlex.join(PLACES.get(word, word) for word in shlex.split(smaller))


def options_of(script: Path) -> set[str]:
    calls = [node for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    adds = [call for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "add_argument"]
    return {arg.value for call in adds for arg in call.args if isinstance(arg, ast.Constant)}


# ---- what does not run here -----------------------------------------------------------------------
def other_commands() -> list[tuple[str, str]]:
    return [(page, line) for page in PAGES for line in commands_of(page) if not line.startswith("fringecal ")]


@pytest.mark.parametrize(("page", "command"), other_commands())
def test_commands_of_other_programs_name_what_is_there(page, command):
    """Targets of the Makefile, scripts with their options, tests; how long they take, the pages say."""
    words = [word for word in shlex.split(command) if not re.match(r"[A-Z_]+=", word)]
    program, *rest = words
    if command in ELSEWHERE:
        return
    if program == "make":
        printed = subprocess.run(["make", "--dry-run", *rest], cwd=ROOT, capture_output=True, text=True, check=False)
        assert printed.returncode == 0, printed.stderr
    elif program == "python":
        script, options = ROOT / rest[0], {word for word in rest[1:] if word.startswith("--")}
        assert script.is_file()
        known = options_of(script) if script.parent.name == "benchmarks" else set()
        assert options <= known
    elif extra := re.fullmatch(r"pip install fringecal\[(\w+)\]", command):
        assert extra[1] in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    elif program == "pytest":
        options = {word for word in rest if word.startswith("--")}
        assert all((ROOT / word).exists() for word in rest if word not in options)
        assert options <= options_of_pytest()
    else:
        pytest.fail(f"{page}: no test runs {command!r}")
    variables = re.findall(r"(FRINGECAL_\w+)=", command)
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py")) if variables else ""
    assert all(f'"{name}"' in sources for name in variables)


def options_of_pytest() -> set[str]:
    conftest = ast.parse((Path(__file__).parent / "conftest.py").read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(conftest) if isinstance(node, ast.Call)]
    adds = [call for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "addoption"]
    return {call.args[0].value for call in adds}


@pytest.mark.parametrize("page", PAGES)
def test_verbs_and_options_of_the_sentences_exist(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for words in re.findall(r"`fringecal ([a-z]+)(?: ([a-z]+))?", text):
        assert words[:1] in VERBS, words
    known = {option for command in VERBS.values() for p in command.params for option in (*p.opts, *p.secondary_opts)}
    named = set(re.findall(r"`(--[a-z-]+)", re.sub(r"`(?:python|pip|pytest|make|bash) [^`]*`", "", text)))
    scripts = {option for path in (ROOT / "benchmarks").glob("*.py") for option in options_of(path)}
    assert named <= known | scripts | {"--help", "--no-deps"}


def test_functions_that_the_pages_name_exist():
    for page in PAGES:
        for dotted in re.findall(r"`fringecal((?:\.\w+)+)`", (ROOT / page).read_text(encoding="utf-8")):
            parts = f"fringecal{dotted}".split(".")
            try:
                importlib.import_module(".".join(parts))
            except ModuleNotFoundError:
                assert hasattr(importlib.import_module(".".join(parts[:-1])), parts[-1]), f"{page}: {dotted}"


def test_the_page_of_commands_holds_every_verb_and_option():
    page = runpy.run_path(str(ROOT / "docs" / "stage.py"))["commands_page"]()
    sections = dict(re.findall(r"^## fringecal (.+?)\n(.*?)(?=^## |\Z)", page, flags=re.DOTALL | re.MULTILINE))
    ends = {words: command for words, command in VERBS.items() if not hasattr(command, "commands")}
    assert set(sections) == {" ".join(words) for words in ends}
    for words, command in ends.items():
        section = sections[" ".join(words)]
        options = {name for one in command.params for name in (*one.opts, *one.secondary_opts) if name[0] == "-"}
        assert [name for name in options if not re.search(rf"(?<![\w-]){name}(?![\w-])", section)] == [], words
        assert f"```sh\nfringecal {' '.join(words)}" in section
    assert set(re.findall(r"^\| (\d) \|", page, flags=re.MULTILINE)) == {"0", "1", "2", "3"}


# ---- the bench ------------------------------------------------------------------------------------
def prepare(folder: Path) -> None:
    """Lay out what a reader brings: a rig, board pictures, a set of two periods, the laboratory's own file."""
    shutil.copy(ROOT / "docs" / "tutorial-rig.toml", folder)
    shutil.copy(ROOT / "docs" / "tutorial-rig.toml", folder / "my-rig.toml")
    for number, picture in enumerate(sorted((DATA / "opencv_chess_left").glob("*.jpg"))[:4]):
        shutil.copy(picture, folder / f"board-{number}.jpg")
    for picture in (DATA / "kamino_object1").glob("pat0*.png"):
        grey = Image.open(picture)
        grey.crop((0, grey.height // 4, grey.width, 3 * grey.height // 4)).save(folder / picture.name)
    shutil.copy(DATA / "discorpy_grids" / "dot_pattern_05_crop.png", folder / "dots.png")
    (folder / "places.csv").write_text(places(), encoding="utf-8")
    page = (ROOT / "docs" / "certificate.md").read_text(encoding="utf-8")
    (folder / "lab.toml").write_text(re.search(r"```toml\n(.*?)```", page, flags=re.DOTALL)[1], encoding="utf-8")


def places() -> str:
    """A board's points in eight poses, as a camera and a projector without distortion have them, 0.02 px of noise."""
    rng = np.random.default_rng(5)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(9) * 12.0, np.arange(7) * 12.0))
    board = np.column_stack([x - 48, y - 36, 0 * x])
    aside = Rotation.from_rotvec([-0.1, 0.3, 0.0])
    rows = ["pose,camera_u_px,camera_v_px,projector_u_px,projector_v_px,x_mm,y_mm"]
    for k in range(8):
        turn = Rotation.from_euler("xyz", [25 * np.cos(k), 25 * np.sin(k), 20 * k], degrees=True)
        points = turn.apply(board) + [*rng.uniform(-25, 25, 2), rng.uniform(470, 560)]
        lit = aside.apply(points - [150.0, -5.0, 10.0])
        seen = 1750 * points[:, :2] / points[:, 2:] + [645, 530]
        shown = 2500 * lit[:, :2] / lit[:, 2:] + [990, 1047]
        numbers = np.column_stack([np.hstack([seen, shown]) + rng.normal(0, 0.02, (len(points), 4)), board[:, :2]])
        rows += [f"{k}," + ",".join(f"{number:.4f}" for number in row) for row in numbers]
    return "\n".join(rows) + "\n"


def with_pictures(words: list[str], folder: Path) -> list[str]:
    """What the shell makes of a command's globs."""
    return [file for word in words for file in (sorted(p.name for p in folder.glob(word)) if "*" in word else [word])]


def served(words: list[str], folder: Path) -> str:
    """Start the dashboard, ask for its first page, stop it."""
    program = [sys.executable, "-c", "from fringecal.cli.app import main; main()"]
    process = subprocess.Popen(
        [*program, *words, "--port", "0", "--json"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        text = ""
        while not text.rstrip().endswith("}"):
            line = process.stdout.readline()
            assert line, "the dashboard ended before it told its address"
            text += line
        with urllib.request.urlopen(json.loads(text)["address"], timeout=20) as page:
            return page.read().decode()
    finally:
        process.terminate()
        process.wait(timeout=20)
        process.stdout.close()


def repeat_the_step_block(folder: Path, run) -> None:
    """Two operators verify a step block three times each: the tutorial's record with readings drawn here."""
    record = json.loads((folder / "verification" / "verification.json").read_text(encoding="utf-8"))
    rng = np.random.default_rng(5)
    for number in range(6):
        record["session"] |= {"operator": "ab"[number % 2], "captured": f"2026-0{number + 1}-01T08:00:00+00:00"}
        record["target"]["name"], record["profiles"], record["checks"] = "Step block, 5 to 50 mm", [], []
        record["readings"] = [
            {"name": f"step {mm}", "unit": "mm", "measured": mm + rng.normal(0, 0.01), "reference": mm, "points": 1}
            for mm in (5, 10, 20, 30, 50)
        ]
        place = folder / f"steps-{number}"
        place.mkdir()
        (place / "verification.json").write_text(json.dumps(record), encoding="utf-8")


def move_the_lamp(folder: Path, run) -> None:
    """What the tutorial's sixth part asks the reader to try."""
    page = (ROOT / TUTORIAL).read_text(encoding="utf-8")
    moved = re.search(r"`(position_mm = \[.*?\])`", page)[1]
    rig = (folder / "tutorial-rig.toml").read_text(encoding="utf-8")
    text, count = re.subn(r"position_mm = \[.*?1000\.0\]", moved, rig)
    assert count == 1
    (folder / "moved-rig.toml").write_text(text, encoding="utf-8")
    captures = ("--captures", "grid,plate,strips", "--seed", "3")
    assert run("simulate", "moved-rig.toml", "--out", "moved", *captures).code == 0


def pictures_alone(folder: Path, run) -> None:
    """The tutorial's pictures without their session.toml."""
    (folder / "pictures").mkdir()
    for name in ("grid", "plate", "strips"):
        for picture in (folder / "session").glob(f"{name}*.png"):
            shutil.copy(picture, folder / "pictures")


# What has to happen before a command makes sense, by the command's first words.
BEFORE = {
    "fringecal audit moved": move_the_lamp,
    "fringecal history add 'steps": repeat_the_step_block,
    "fringecal new": pictures_alone,
}


def written_names(page: str) -> set[str]:
    """Names of result files on a page, as patterns: `NAME-absolute.npz`, `.ply`."""
    text = re.sub(r"^```.*?^```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    names = re.findall(rf"`([\w*-]*\.(?:{'|'.join(RESULTS)}))`", text)
    return {name.replace("NAME", "*") if name[0] != "." else f"*{name}" for name in names} - BROUGHT


def left_of_table(page: str) -> list[str]:
    """What a bench page tells the reader to look at in the report."""
    text = (ROOT / page).read_text(encoding="utf-8")
    table = re.search(r"^\| in the report .*\n\|[-|]+\n((?:\|.*\n)+)", text, flags=re.MULTILINE)
    return [row.split("|")[1].strip() for row in table[1].splitlines()] if table else []


def shown(report: Path) -> str:
    text = re.sub(r"<(script|style).*?</\1>", " ", report.read_text(encoding="utf-8"), flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", text)).lower().split())


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
def test_every_command_of_every_page_runs_and_does_what_the_page_says(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    prepare(tmp_path)
    told: dict[str, str] = {}
    for page in PAGES:
        for command in map(as_run, filter(lambda line: line.startswith("fringecal "), commands_of(page))):
            if command in told or command in ELSEWHERE:
                continue
            for needed, make in BEFORE.items():
                if command.startswith(needed):
                    make(tmp_path, run)
            words = with_pictures(shlex.split(command)[1:], tmp_path)
            if words[0] == "serve":
                told[command] = served(words, tmp_path)
                continue
            outcome = run(*words)
            allowed = next((codes for start, codes in CODES.items() if command.startswith(start)), {0})
            assert outcome.code in allowed, (page, command, outcome.stdout, outcome.stderr)
            told[command] = outcome.stdout
        written = {path.name for path in tmp_path.rglob("*")}
        absent = [name for name in written_names(page) if not fnmatch.filter(written, name)]
        assert absent == [], f"{page} names files that no command wrote"
        if page == TUTORIAL:
            the_tutorial_kept_its_promises(told)
    for start, phrase in PRINTED.items():
        texts = [text for command, text in told.items() if command.startswith(start)]
        assert any(phrase in " ".join(text.split()) for text in texts), (start, phrase, texts)
    for page, folder in REPORTS.items():
        text = shown(tmp_path / folder / "report.html")
        assert [label for label in left_of_table(page) if label.lower() not in text] == [], page


def the_tutorial_kept_its_promises(told: dict[str, str]) -> None:
    """The angle, bars that agree, an audit that finds chance alone, the same numbers again, a draft."""
    record = json.loads(Path("calibration/calibration.json").read_text(encoding="utf-8"))
    angle = record["projection"]["angle"]
    assert abs(angle["value"] - 50.7) < 3 * angle["u"] + 0.01  # 50.706 deg by the rig's own numbers
    causes = sorted(record["budgets"]["projection.angle"], key=lambda row: -row["percent"])
    assert ["principal point" in causes[0]["label"], "strip" in causes[1]["label"]] == [True, True]
    verification = json.loads(Path("verification/verification.json").read_text(encoding="utf-8"))
    assert len(verification["profiles"]) == 5
    assert all(abs(profile["en"]) <= 1 for profile in verification["profiles"])
    rows = {row["model"]: row for row in verification["models"]}
    assert rows["constant-angle"]["max_percent"] > 3 * rows["projective"]["max_percent"]
    commissioning, audit, history, again, report = (
        next(text for command, text in told.items() if command.startswith(f"fringecal {start}"))
        for start in ("commission", "audit", "history show", "rerun", "certificate")
    )
    assert "To measure next" in commissioning
    assert "the difference is within what chance explains" in audit
    assert "3 record(s)" in history
    assert "to the last digit" in again
    assert "DRAFT" in report
