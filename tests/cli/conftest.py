"""The command as a user meets it: one rig commissioned once, and broken copies of its session for each test."""

import contextlib
import io
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest
from PIL import Image

from fringecal.cli.app import main

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def pytest_addoption(parser):
    parser.addoption("--screenshots", metavar="DIR", help="Folder for the pictures that the documentation shows.")


@dataclass(frozen=True)
class Outcome:
    """What a command left on the two streams, and its exit code."""

    code: int
    stdout: str
    stderr: str

    @property
    def document(self):
        return json.loads(self.stdout)


@pytest.fixture
def run(capfd):
    """Run a command in this process, streams caught."""

    def command(*arguments) -> Outcome:
        capfd.readouterr()
        try:
            main([str(a) for a in arguments])
            code = 0
        except SystemExit as stop:
            code = stop.code
        return Outcome(code, *capfd.readouterr())

    return command


@pytest.fixture
def blank_figures(monkeypatch):
    """Blank pictures in the place of figures, for a command whose figures another test has drawn."""
    from fringecal.report import views

    from .victims import blank

    monkeypatch.setattr(views, "_encoded", blank)


@pytest.fixture(scope="session")
def data(request) -> Path:
    return request.config.rootpath / "tests" / "data"


def made_by(*arguments) -> dict:
    """Run a command that must succeed, and return what it prints with --json."""
    stdout = io.StringIO()
    with contextlib.redirect_stdout(stdout), pytest.raises(SystemExit) as stop:
        main([*map(str, arguments), "--json"])
    assert stop.value.code == 0
    return json.loads(stdout.getvalue())


@pytest.fixture(scope="session")
def commissioned(data, tmp_path_factory) -> tuple[Path, dict]:
    """Commission the oblique rig once, since it takes a while."""
    folder = tmp_path_factory.mktemp("cli") / "calibration"
    return folder, made_by("commission", data / "oblique", "--out", folder)


@pytest.fixture(scope="session")
def reconstructed(data, calibration, tmp_path_factory) -> tuple[Path, dict]:
    """Measure the bars on the oblique rig once: the folder, and what was printed."""
    folder = tmp_path_factory.mktemp("cli") / "surface"
    arguments = ("--capture", "bars", "--calibration", calibration / "calibration.json", "--highest-mm", "25")
    arguments += ("--also", "ply", "--also", "las", "--also", "gwy")
    return folder, made_by("reconstruct", data / "oblique", *arguments, "--out", folder)


@pytest.fixture(scope="session")
def calibration(commissioned) -> Path:
    """Folder with the calibration of the oblique rig."""
    return commissioned[0]


@pytest.fixture(scope="session")
def printed(commissioned) -> dict:
    """What commissioning printed with --json."""
    return commissioned[1]


@pytest.fixture
def session(data, tmp_path) -> Path:
    """A copy of the oblique session to be broken, without its truth."""
    return Path(
        shutil.copytree(data / "oblique", tmp_path / "session", ignore=shutil.ignore_patterns("truth*", "README.md"))
    )


@pytest.fixture(scope="session")
def browser():
    """A headless Chromium."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser on this machine: none of {', '.join(BROWSERS)}")
    with sync_api.sync_playwright() as play:
        # Root may not have Chromium's sandbox; the pages are our own files.
        opened = play.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def listening(browser):
    """An empty page, and what it will say on its console or ask of the network."""
    page = browser.new_page()
    said: list[str] = []
    page.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: said.append(f"error: {error}"))
    page.on("request", lambda asked: said.append(asked.url) if asked.url.startswith(("http", "ws")) else None)
    yield page, said
    page.close()


@pytest.fixture
def photograph(request):
    """Take a picture of a page for the documentation, where `--screenshots DIR` asks for it."""

    def take(page, name):
        named = request.config.getoption("--screenshots", default=None)
        if named:
            folder = request.config.invocation_params.dir / named
            folder.mkdir(parents=True, exist_ok=True)
            # 200 colours are enough for a page, and take a third of the room.
            few = Image.open(io.BytesIO(page.screenshot())).convert("RGB").quantize(200, dither=Image.Dither.NONE)
            few.save(folder / f"{name}.png", optimize=True)

    return take
