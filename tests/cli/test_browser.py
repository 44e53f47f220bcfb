"""Reports in a real browser: nothing on the console, no overflow, every picture drawn, readable for everybody."""

import contextlib
import json
import re
import threading
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from fringecal.cli.app import main
from fringecal.history.entries import Entry, Reading, read_entry
from fringecal.history.review import reviews_of
from fringecal.history.standing import standing_of
from fringecal.history.store import open_history
from fringecal.report.pages.dashboard import rigs_page

ROOT = Path(__file__).parents[2]
ARCHIVE = max((ROOT / "tests" / "records" / "archive").glob("[0-9]*"))
WIDTHS_PX = (400, 1400)
PAGES = ("commission", "measured", "certificate", "history", "dashboard")

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")


@pytest.fixture(scope="module")
def reports(calibration, reconstructed, tmp_path_factory) -> dict[str, Path]:
    """One page each: with many figures, with long tables, with charts."""
    folder = tmp_path_factory.mktemp("pages")
    main_ends(["certificate", str(ARCHIVE), "--out", str(folder / "certificate"), "--draft"])
    with open_history(folder / "history.db") as history:
        history.append([entry(number) for number in range(24)])
    main_ends(["history", "chart", "--db", str(folder / "history.db"), "--out", str(folder / "history")])
    with open_history(folder / "history.db") as history:
        standing = {"bench-1": standing_of(reviews_of(history.readings()))}
        page = rigs_page(history.entries(), "history.db", standing, now=datetime(2027, 1, 1, tzinfo=UTC))
        (folder / "dashboard.html").write_text(page, encoding="utf-8")
    return {
        "dashboard": folder / "dashboard.html",
        "commission": calibration / "report.html",
        "measured": reconstructed[0] / "report.html",
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


@pytest.fixture
def two_calibrations(tmp_path, monkeypatch):
    """A served history of one rig with two calibrations, the second with a scale larger by 0.1 %."""
    serving = pytest.importorskip("werkzeug.serving", reason="the extra serve is not installed")
    from fringecal.cli.serve import dashboard

    monkeypatch.chdir(tmp_path)  # so that no page names a folder of this machine
    with open_history("history.db") as history:
        for month in (1, 2):
            document = json.loads((ARCHIVE / "calibration.json").read_text(encoding="utf-8"))
            document["session"].update(captured=f"2026-0{month}-01T08:00:00Z")
            document["camera"]["parameters"][0] *= 1.001 ** (month - 1)
            record = Path(f"calibration-{month}.json")
            record.write_text(json.dumps(document), encoding="utf-8")
            history.append([read_entry(record)])
    server = serving.make_server("127.0.0.1", 0, dashboard("history.db"), threaded=True)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/", document["session"]["rig"]
    server.shutdown()
    thread.join(30)
    server.server_close()


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
        if name == "commission":
            photograph(page, f"report-{width}")
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
    page.locator("#unfold").click()
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


def test_a_long_report_begins_with_its_verdict_and_unfolds(listening, reports):
    page, said = listening
    page.set_viewport_size({"width": 1400, "height": 900})
    page.goto(reports["commission"].as_uri())
    folds = page.locator("details")
    assert folds.count() > 5
    assert page.locator(".verdict").is_visible()
    assert page.locator("table").first.is_visible()  # what was checked
    folded = page.evaluate("document.documentElement.scrollHeight")
    summary = folds.nth(2).locator("summary")
    summary.focus()
    page.keyboard.press("Enter")
    assert folds.nth(2).locator("table, figure").first.is_visible()
    page.get_by_role("link", name="Budgets").click()  # who asks for a section sees it
    assert page.locator("section", has_text="Budgets").locator("details").last.evaluate("fold => fold.open")
    page.locator("#unfold").click()
    assert page.evaluate("document.documentElement.scrollHeight") > 3 * folded
    page.locator("#unfold").click()
    assert not any(fold.evaluate("fold => fold.open") for fold in folds.all())
    page.emulate_media(media="print")
    assert all(part.is_visible() for part in page.locator("img, table").all())
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


def test_a_measured_surface_is_read_and_turned(listening, reconstructed, photograph):
    """The value under the pointer is the one that the command has written."""
    folder, _ = reconstructed
    page, said = listening
    page.set_viewport_size({"width": 1000, "height": 800})
    page.goto((folder / "report.html").as_uri())
    page.locator("#unfold").click()
    figure = page.locator("figure").first
    figure.scroll_into_view_if_needed()
    figure.locator(".probe").hover(position={"x": 240, "y": 150})
    words = figure.locator("output").inner_text()
    x, y, z, u = (float(part) for part in re.findall(r"-?\d+\.\d+", words.replace("\N{MINUS SIGN}", "-")))
    with np.load(folder / "height.npz") as maps:
        near = np.unravel_index(np.nanargmin(np.hypot(maps["x"] - x, maps["y"] - y)), maps["x"].shape)
        around = tuple(slice(place - 2, place + 3) for place in near)  # x and y are printed to 0.1 mm of 0.5 mm a pixel
        assert np.abs(maps["z"][around] - z).min() < 6e-4
        assert np.abs(maps["u_z"][around] - u).min() < 6e-5
    assert z > 5  # on a bar, not beside it
    photograph(page, "map-under-the-pointer")
    figure = page.locator("figure", has=page.locator(".stage"))
    figure.locator(".turn").click()
    page.wait_for_function("document.querySelector('.stage').layout?.scene.camera.eye.x")
    figure.locator(".stage").focus()
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    page.evaluate("document.activeElement.blur()")
    page.wait_for_timeout(500)
    figure.scroll_into_view_if_needed()
    photograph(page, "surface-turned")
    assert [line for line in said if line.startswith(("error", "http"))] == []


def test_every_served_page_keeps_its_policy(listening, two_calibrations):
    """Home, rig, charts, record: nothing that the policy forbids is tried, and nothing is wider than a telephone."""
    page, said = listening
    address, rig = two_calibrations
    for links in ([], [rig], [rig, "Charts, drift and due dates"], [rig, "2026-02-01 08:00"]):
        page.goto(address)
        for link in links:
            page.get_by_role("link", name=link, exact=True).click()
        for width in WIDTHS_PX:
            page.set_viewport_size({"width": width, "height": 900})
            assert page.evaluate("document.documentElement.scrollWidth") <= width, links
            readable_for_everybody(page, f"{links} at {width} px")
    assert page.get_by_role("heading", level=2).first.inner_text() == "Checks"
    assert [line for line in said if not line.startswith(address)] == []


def test_the_dashboard_leads_to_a_comparison(listening, two_calibrations, photograph):
    page, said = listening
    page.set_viewport_size({"width": 1000, "height": 800})
    address, rig = two_calibrations
    page.goto(address)
    page.get_by_role("link", name=rig).click()
    assert page.get_by_role("heading", level=1).inner_text() == rig
    for width in WIDTHS_PX:
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        readable_for_everybody(page, f"the rig's page at {width} px")
    page.set_viewport_size({"width": 1000, "height": 800})
    photograph(page, "dashboard-rig")
    first, second = page.get_by_label("First"), page.get_by_label("Second")
    offered = first.locator("option").evaluate_all("options => options.map(option => option.value)")
    assert [first.input_value(), second.input_value()] == offered[::-1]  # the older one first
    page.get_by_role("button", name="Compare").click()
    assert page.get_by_role("heading", level=1).inner_text() == f"Two calibrations of {rig}"
    assert page.get_by_role("row").count() > 10
    readable_for_everybody(page, "the comparison")
    photograph(page, "two-calibrations")
    page.get_by_role("button", name="En by quantity").click()  # enlarging runs under a policy that allows no script
    assert page.locator("figure").first.bounding_box()["width"] == 1000
    page.keyboard.press("Escape")
    for width in WIDTHS_PX:
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        drawn = page.evaluate("[...document.images].map(i => i.complete && i.naturalWidth > 50)")
        assert drawn == [True] * 3
    rigs = page.get_by_role("figure").filter(has_text="The rig")
    wide = [one.bounding_box() for one in rigs.all()]
    assert wide[0]["y"] == wide[1]["y"]  # side by side
    assert wide[0]["x"] + wide[0]["width"] <= wide[1]["x"]
    assert [line for line in said if not line.startswith(address)] == []
