"""The desk of `fringecal serve` in a real browser: a folder is dropped in, checked, run, and its verdict read."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from fringecal.history.store import open_history

WIDTHS_PX = (400, 1400)
PATIENCE_MS = 180_000  # the machine may be busy: a commissioning takes 15 s of its time

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
pytest.importorskip("flask", reason="the extra serve is not installed")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="ends the server by a signal")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """The command itself in a process of its own, over an empty history; its address."""
    folder = tmp_path_factory.mktemp("serve")
    (folder / "tmp").mkdir()
    open_history(folder / "history.db").close()
    command = [sys.executable, "-m", "fringecal", "serve", "--db", "history.db", "--port", "0", "--json"]
    one_thread = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}  # others need the machine too
    environment = os.environ | one_thread | {"TMPDIR": str(folder / "tmp")}
    with (
        (folder / "log").open("w") as log,
        subprocess.Popen(
            command, cwd=folder, stdout=subprocess.PIPE, stderr=log, text=True, env=environment
        ) as process,
    ):
        text = ""
        while not text.endswith("}\n"):
            line = process.stdout.readline()
            assert line, "the server ended"
            text += line
        yield json.loads(text)["address"]
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
    assert list((folder / "tmp").iterdir()) == []  # uploads and results are gone
    asked = (folder / "log").read_text()
    assert "GET /sessions" in asked
    assert "token" not in asked


@pytest.fixture
def page(browser, server):
    """A page as a reader has it who opened the printed address, and what its console said."""
    context = browser.new_context()
    page = context.new_page()
    said = []
    page.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: said.append(f"error: {error}"))
    page.goto(server)
    yield page, said
    context.close()


def good_for_everybody(page, name):
    """Check a page for accessibility and overflow."""
    for width in WIDTHS_PX:
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width, f"{name} overflows at {width} px"
        found = axe.Axe().run(page)
        assert found.violations_count == 0, f"{name} at {width} px:\n{found.generate_report()}"
    page.set_viewport_size({"width": 1000, "height": 700})


@pytest.mark.slow
def test_a_session_is_sent_checked_and_commissioned(page, data, photograph, server):
    page, said = page
    assert "token" not in page.url
    page.get_by_role("link", name="Check and run a session").click()
    good_for_everybody(page, "sessions")
    # With its README and truth, which the page leaves out.
    page.get_by_label("Session folder").set_input_files(data / "oblique")
    page.get_by_role("button", name="Send and check").click()
    page.get_by_text("The session may be used.").wait_for(timeout=PATIENCE_MS)
    assert page.locator("h1").inner_text() == "oblique"
    good_for_everybody(page, "session")
    commission = page.locator(".verbs section", has_text="commission")
    commission.get_by_label("append to the history").check()
    commission.get_by_role("button").click()
    page.get_by_role("button", name="Stop").wait_for()
    page.locator("#log", has_text="writing the report").wait_for(timeout=PATIENCE_MS)
    photograph(page, "serve-run")
    good_for_everybody(page, "run")
    page.get_by_role("heading", name="Results").wait_for(timeout=PATIENCE_MS)
    assert page.locator(".decision").inner_text().startswith("Pass")
    good_for_everybody(page, "ended")
    assert "PASS" in page.locator("#log").inner_text()
    with page.expect_download() as download:
        page.get_by_role("link", name="calibration.json").click()
    record = json.loads(Path(download.value.path()).read_text(encoding="utf-8"))
    assert record["session"]["rig"] == "oblique"
    page.get_by_role("link", name="report.html").click()
    assert page.evaluate("origin") == "null"  # of no site: it has no cookie of ours
    assert page.locator("figure img").count() > 10
    assert said == []
    page.go_back()
    page.get_by_role("link", name="This session").click()
    assert page.locator("h3").all_inner_texts() == ["commission", "verify", "audit"]
    good_for_everybody(page, "session with a calibration")
    page.goto(server)
    page.get_by_role("link", name="oblique").click()
    assert page.locator("tbody tr").count() == 1


def test_a_folder_is_dropped_and_its_faults_are_told(page, data, tmp_path, photograph):
    page, said = page
    folder = tmp_path / "dropped"
    shutil.copytree(data / "oblique", folder, ignore=shutil.ignore_patterns("truth*", "strips-1.png"))
    (folder / "grid.png").write_bytes((folder / "grid.png").read_bytes()[:5000])
    page.get_by_role("link", name="Check and run a session").click()
    box = page.locator("#drop").bounding_box()
    session = page.context.new_cdp_session(page)
    dragged = {"items": [], "files": [str(folder)], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        session.send("Input.dispatchDragEvent", {"type": kind, "x": box["x"] + 20, "y": box["y"] + 20, "data": dragged})
    page.get_by_text("The session cannot be used yet.").wait_for(timeout=PATIENCE_MS)
    assert page.locator("h1").inner_text() == "dropped"
    faults = page.locator("table").inner_text()
    assert "truncated PNG" in faults
    assert "strips-1.png" in faults
    assert page.get_by_role("button").count() == 0
    photograph(page, "serve-faults")
    good_for_everybody(page, "faults")
    assert said == []


def test_it_works_without_script(browser, server, data, tmp_path):
    folder = tmp_path / "plain"
    shutil.copytree(data / "oblique", folder, ignore=shutil.ignore_patterns("truth*", "README.md", "bars-*"))
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(server)
    page.get_by_role("link", name="Check and run a session").click()
    page.get_by_label("Session folder").set_input_files(folder)
    page.get_by_role("button", name="Send and check").click()
    page.get_by_text("The session cannot be used yet.").wait_for(timeout=PATIENCE_MS)
    assert page.locator("h1").inner_text() == "plain"
    assert "bars-0.png" in page.locator("table").inner_text()
    context.close()


def test_a_folder_that_is_no_session_is_refused_on_the_page(page, tmp_path):
    page, _ = page
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / "README.md").write_text("nothing")
    page.get_by_role("link", name="Check and run a session").click()
    page.get_by_label("Session folder").set_input_files(tmp_path / "none")
    page.get_by_role("button", name="Send and check").click()
    assert "no file of a session" in page.locator("#told").inner_text()
    (tmp_path / "none" / "grid.toml").write_text("")
    page.get_by_label("Session folder").set_input_files(tmp_path / "none")
    page.get_by_role("button", name="Send and check").click()
    page.get_by_text("no session.toml was sent").wait_for()
