"""Reports in a real browser: nothing on the console, no overflow, every picture drawn, readable for everybody."""

import contextlib
import os
import shutil
from pathlib import Path

import pytest

from fringecal.cli.app import main
from fringecal.history.entries import Entry, Reading
from fringecal.history.store import open_history
from fringecal.report.dashboard import rigs_page

ROOT = Path(__file__).parents[2]
ARCHIVE = max((ROOT / "tests" / "records" / "archive").glob("[0-9]*"))
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
WIDTHS_PX = (400, 1400)
PAGES = ("commission", "certificate", "history", "dashboard")
# Set to a folder to keep what the browser saw.
SCREENSHOTS = os.environ.get("FRINGECAL_SCREENSHOTS", "")

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")


@pytest.fixture(scope="module")
def browser():
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser on this machine: none of {', '.join(BROWSERS)}")
    with sync_api.sync_playwright() as play:
        # Root may not have Chromium's sandbox; the pages are our own files.
        opened = play.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def reports(calibration, tmp_path_factory) -> dict[str, Path]:
    """One page each: with many figures, with long tables, with charts."""
    folder = tmp_path_factory.mktemp("pages")
    main_ends(["certificate", str(ARCHIVE), "--out", str(folder / "certificate"), "--draft"])
    with open_history(folder / "history.db") as history:
        history.append([entry(number) for number in range(24)])
    main_ends(["history", "chart", "--db", str(folder / "history.db"), "--out", str(folder / "history")])
    with open_history(folder / "history.db") as history:
        (folder / "dashboard.html").write_text(rigs_page(history.entries(), "history.db"), encoding="utf-8")
    return {
        "dashboard": folder / "dashboard.html",
        "commission": calibration / "report.html",
        "certificate": folder / "certificate" / "report.html",
        "history": folder / "history" / "report.html",
    }


def main_ends(arguments: list[str]) -> None:
    """Run a command in this process; what it made is looked at, not its exit code."""
    with contextlib.suppress(SystemExit):
        main(arguments)


def entry(number: int) -> Entry:
    """One month's audit: a scale that stays, but for a scatter drawn from the number."""
    day = f"{2025 + number // 12}-{1 + number % 12:02d}-01T08:00:00+00:00"
    value = 0.734 + 1e-5 * ((7 * number) % 11 - 5)
    readings = (Reading("scale, mean", value, "mm/px", 1e-5),)
    return Entry("bench-1", "audit", day, day, f"{number:064x}", "pass", readings)


@pytest.fixture(params=PAGES)
def shown(request, browser, reports):
    """A page as the browser has opened it, with everything that it said and asked for."""
    page = browser.new_page()
    said: list[str] = []
    page.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: said.append(f"error: {error}"))
    page.on("request", lambda asked: said.append(asked.url) if asked.url.startswith(("http", "ws")) else None)
    page.goto(reports[request.param].as_uri())
    yield request.param, page, said
    page.close()


def test_pages_are_silent_and_whole(shown):
    name, page, said = shown
    for width in WIDTHS_PX:
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_timeout(50)
        # What is wider than the page scrolls in a box of its own.
        assert page.evaluate("document.documentElement.scrollWidth") <= width, f"{name} overflows at {width} px"
        if SCREENSHOTS:
            Path(SCREENSHOTS).mkdir(parents=True, exist_ok=True)
            page.screenshot(path=f"{SCREENSHOTS}/{name}-{width}.png", full_page=True)
    drawn = page.evaluate("[...document.images].map(i => i.complete && i.naturalWidth > 50 && i.naturalHeight > 50)")
    assert all(drawn)
    assert len(drawn) >= (0 if name in ("certificate", "dashboard") else 1)
    assert said == [], "said on the console, or asked of the network"


def test_pages_are_readable_for_everybody(shown):
    name, page, _ = shown
    for width in WIDTHS_PX:
        page.set_viewport_size({"width": width, "height": 900})
        found = axe.Axe().run(page)
        assert found.violations_count == 0, f"{name} at {width} px:\n{found.generate_report()}"


def test_every_table_can_be_taken_along(shown):
    name, page, _ = shown
    if name == "dashboard":
        pytest.skip("its tables are those of fringecal history export")
    links = page.locator("a.download")
    tables = page.locator("table").count()
    assert links.count() == tables > 0
    with page.expect_download() as download:
        links.first.click()
    text = Path(download.value.path()).read_text(encoding="utf-8")
    assert text.count("\n") >= 2
    assert download.value.suggested_filename.endswith(".csv")
