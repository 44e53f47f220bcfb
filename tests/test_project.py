"""The project as shipped: one version, a complete wheel, a clean tree, help that can be believed."""

import ast
import re
import shlex
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import typer

import fringecal
from fringecal.cli.app import VERBS, build_app
from fringecal.session import SessionDocument
from fringecal.session.document import CameraTable, CaptureTable, PhaseTable, ProjectorTable

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
IN_GIT = (ROOT / ".git").exists()
MAX_REPOSITORY_MB, MAX_DATA_MB = 18, 12
EXIT_ERROR, EXIT_USAGE = 1, 2


def run(*arguments, **options):
    return subprocess.run([*map(str, arguments)], capture_output=True, text=True, check=False, **options)


def fringecal_command(*arguments):
    return run(sys.executable, "-c", "from fringecal.cli.app import main; main()", *arguments)


# ---- one fact, one place --------------------------------------------------------------------------
def test_version_is_the_same_everywhere():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert PROJECT["project"]["version"] == fringecal.__version__
    assert re.search(r"^## \[(\d[^\]]*)\]", changelog, flags=re.MULTILINE)[1] == fringecal.__version__
    assert fringecal_command("--version").stdout.strip() == f"fringecal {fringecal.__version__}"


def test_python_version_is_one_that_the_project_allows():
    floor = re.fullmatch(r">=(\d+)\.(\d+)", PROJECT["project"]["requires-python"])
    chosen = (ROOT / ".python-version").read_text(encoding="utf-8").strip()
    assert tuple(map(int, chosen.split("."))) >= tuple(map(int, floor.groups()))


def test_constraints_name_exact_versions_and_nothing_else():
    lines = [line for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    wrong = [line for line in lines if not re.fullmatch(r"[a-z0-9.-]+==[\w.]+( ; [\w '=<>.!()]+)?", line)]
    assert wrong == []


def test_every_dependency_is_constrained():
    groups = PROJECT["dependency-groups"]
    stated = [*PROJECT["project"]["dependencies"], *PROJECT["project"]["optional-dependencies"]["mrcal"]]
    stated += [entry for group in groups.values() for entry in group if isinstance(entry, str)]
    names = {re.match(r"[\w.-]+", entry)[0].lower().replace("_", "-") for entry in stated}
    constrained = re.findall(
        r"^([\w.-]+)==", (ROOT / "constraints.txt").read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    assert names <= set(constrained)


# ---- the wheel ------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def wheel_names(tmp_path_factory):
    """Names inside a wheel built from this tree."""
    folder = tmp_path_factory.mktemp("wheel")
    built = run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
    assert built.returncode == 0, built.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def test_the_wheel_holds_licence_targets_and_procedures(wheel_names):
    info = f"fringecal-{fringecal.__version__}.dist-info"
    wanted = {f"{info}/licenses/LICENSE"}
    for folder in ("targets", "procedures"):
        files = [path for path in (ROOT / folder).rglob("*") if path.is_file()]
        wanted |= {f"fringecal/_shared/{path.relative_to(ROOT).as_posix()}" for path in files}
    assert wanted <= wheel_names


def test_the_wheel_holds_every_file_of_the_package(wheel_names):
    package = ROOT / "src" / "fringecal"
    files = [path for path in package.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert {f"fringecal/{path.relative_to(package).as_posix()}" for path in files} <= wheel_names


# ---- the tree -------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def tracked():
    """Every tracked file that is still there."""
    if not IN_GIT:
        pytest.skip("not a git checkout: nothing is tracked")
    names = run("git", "ls-files", "-z", cwd=ROOT).stdout.split("\0")
    return [ROOT / name for name in names if name and (ROOT / name).is_file()]


def test_the_repository_stays_small(tracked):
    data = [path for path in tracked if "data" in path.relative_to(ROOT).parts]
    assert sum(path.stat().st_size for path in tracked) < MAX_REPOSITORY_MB * 1e6
    assert sum(path.stat().st_size for path in data) < MAX_DATA_MB * 1e6


def test_no_registry_host_and_no_path_of_one_machine_in_the_tree(tracked):
    # Spelled in pieces, or this file would hold them.
    hosts = ["".join(parts) for parts in (("py", "pi.org"), ("python", "hosted.org"), ("deb", ".debian"))]
    hosts.append("".join(("registry", ".npmjs")))
    folders = [f"/{name}/" for name in ("root", "work", "tmp", "home")]
    pattern = re.compile("|".join(map(re.escape, hosts)) + "|" + "|".join(rf"(?<![\w.$}}-]){f}" for f in folders))
    found = []
    for path in tracked:
        content = path.read_bytes()
        if b"\0" not in content[:8192]:
            found += [f"{path.relative_to(ROOT)}: {hit}" for hit in pattern.findall(content.decode("utf-8", "replace"))]
    assert found == []


def test_no_lock_file_is_tracked(tracked):
    assert "uv.lock" not in {path.name for path in tracked}


def test_links_between_the_pages_lead_somewhere(tracked):
    pages = [path for path in tracked if path.suffix == ".md"]
    broken = [
        f"{page.relative_to(ROOT)} -> {target}"
        for page in pages
        for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
        if not (page.parent / target).exists()
    ]
    assert broken == []


def test_tests_that_the_conventions_name_exist():
    page = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")
    assert [path for path in re.findall(r"`(tests/[\w/.]+)`", page) if not (ROOT / path).exists()] == []


# ---- the command ----------------------------------------------------------------------------------
def commands(group, path=()):
    """Every command with the words that call it."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


COMMANDS = dict(commands(typer.main.get_command(build_app())))


def test_every_verb_has_one_module_that_registers_it():
    for verb in VERBS:
        tree = ast.parse((ROOT / "src" / "fringecal" / "cli" / f"{verb}.py").read_text(encoding="utf-8"))
        assert "register" in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, verb
    assert {words[0] for words in COMMANDS} == set(VERBS)


def help_of(command):
    return f"{command.help or ''}\n{command.epilog or ''}"


@pytest.mark.parametrize("words", sorted(COMMANDS), ids=" ".join)
def test_help_shows_an_example_that_parses(words):
    command = COMMANDS[words]
    examples = re.findall(r"\b(fringecal [^\n]+)", help_of(command).partition("Example")[2])
    assert examples, f"fringecal {' '.join(words)} --help shows no Example"
    for example in examples:
        called = shlex.split(example.strip().rstrip("."))[1:]
        assert called[: len(words)] == list(words)
        command.make_context(" ".join(words), called[len(words) :], resilient_parsing=False)


@pytest.mark.parametrize("words", sorted(COMMANDS), ids=" ".join)
def test_every_verb_can_answer_a_program(words):
    options = {option for parameter in COMMANDS[words].params for option in parameter.opts}
    assert "--json" in options


def page_commands():
    """Every fringecal command line in the pages, with the backslash lines joined."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "procedures").glob("*.md"))]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages).replace("\\\n", " ")
    blocks = re.findall(r"```(?:sh|console)\n(.*?)```", text, flags=re.DOTALL)
    lines = [line.split("#")[0].strip() for block in blocks for line in block.splitlines()]
    return sorted({line for line in lines if line.startswith("fringecal ")})


def test_the_session_of_the_readme_is_one():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)
    SessionDocument.model_validate(tomllib.loads(example))


@pytest.mark.parametrize("line", page_commands())
def test_commands_of_the_pages_parse(line):
    called = shlex.split(line)[1:]
    words = next(words for words in COMMANDS if tuple(called[: len(words)]) == words)
    COMMANDS[words].make_context(" ".join(words), called[len(words) :], resilient_parsing=False)


def test_exit_codes_of_error_and_usage(tmp_path):
    missing = fringecal_command("check", tmp_path / "nowhere")
    assert missing.returncode == EXIT_ERROR
    assert "Traceback" not in missing.stderr
    assert "nowhere" in missing.stderr + missing.stdout
    assert fringecal_command("chekc").returncode == EXIT_USAGE
    assert fringecal_command("check").returncode == EXIT_USAGE


def test_every_key_of_a_session_is_documented():
    page = (ROOT / "docs" / "session.md").read_text(encoding="utf-8")
    tables = [CameraTable, ProjectorTable, PhaseTable, CaptureTable, SessionDocument]
    keys = {key for table in tables for key in table.model_fields} - {"camera", "projector", "phase", "capture"}
    assert {
        key for key in keys if f"`{key}`" not in page and f"`{key} =" not in page and f"\n{key} =" not in page
    } == set()
