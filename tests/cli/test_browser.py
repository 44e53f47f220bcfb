"""Reports in a real browser: nothing on the console, no overflow, every picture drawn, readable for everybody."""

import contextlib
from pathlib import Path

import pytest

from fringecal.cli.app import main
from fringecal.history.entries import Entry, Reading
from fringecal.history.store import open_history
from fringecal.report.dashboard import rigs_page

ROOT = Path(__file__).parents[2]
ARCHIVE = max((ROOT / "tests" / "records" / "archive").glob("[0-9]*"))
WIDTHS_PX = (400, 1400)
PAGES = ("commission", "certificate", "history", "dashboard")

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")


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
def shown(request, listening, reports):
    """A page as the browser has opened it, with everything that it said and asked for."""
    page, said = listening
    page.goto(reports[request.param].as_uri())
    return request.param, page, said


def test_pages_are_silent_and_whole(shown, photograph):
    name, page, said = shown
    for width in WIDTHS_PX:
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_timeout(50)
        # What is wider than the page scrolls in a box of its own.
        assert page.evaluate("document.documentElement.scrollWidth") <= width, f"{name} overflows at {width} px"
        photograph(page, f"{name}-{width}")
    drawn = page.evaluate("[...document.images].map(i => i.complete && i.naturalWidth > 50 && i.naturalHeight > 50)")
    assert all(drawn)
    assert len(drawn) >= (0 if name in ("certificate", "dashboard") else 1)
    assert said == [], "said on the console, or asked of the network"


def readable_for_everybody(page, where):
    found = axe.Axe().run(page)
    assert found.violations_count == 0, f"{where}:\n{found.generate_report()}"


def test_pages_are_readable_for_everybody(shown):
    name, page, _ = shown
    for width in WIDTHS_PX:
        page.set_viewport_size({"width": width, "height": 900})
        readable_for_everybody(page, f"{name} at {width} px")


@pytest.mark.parametrize("width", WIDTHS_PX)
def test_figures_are_enlarged_without_a_mouse(width, listening, reports):
    page, said = listening
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(reports["commission"].as_uri())
    assert page.locator("figure").count() == page.locator("figure button").count() > 10
    figure = page.locator("figure").last
    button, picture = figure.locator("button"), figure.locator("img")
    button.focus()
    before = page.evaluate("[scrollY, document.documentElement.scrollHeight]")
    page.keyboard.press("Enter")
    box = figure.bounding_box()
    assert (box["x"], box["y"], box["width"], box["height"]) == (0, 0, width, 900)  # the whole window
    whole = picture.bounding_box()
    assert whole["x"] + whole["width"] <= width
    assert whole["y"] + whole["height"] <= 900
    readable_for_everybody(page, f"enlarged at {width} px")
    page.keyboard.press("Shift+Tab")  # from the button to the sizes
    page.keyboard.press("ArrowRight")
    assert picture.bounding_box()["width"] == pytest.approx(2 * whole["width"], abs=1)
    assert figure.locator(".box").evaluate("box => box.scrollWidth > box.clientWidth")
    page.keyboard.press("Escape")
    assert figure.evaluate("figure => !figure.matches(':popover-open')")
    assert page.evaluate("[scrollY, document.documentElement.scrollHeight]") == before
    assert said == []


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
