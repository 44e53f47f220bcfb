"""Maps and surfaces of a report in a real browser: read under the pointer, moved by keys, turned, printed."""

import io
import re

import numpy as np
import pytest
from matplotlib.image import imread

from fringecal.report.figures.maps import height_map, residual_map
from fringecal.report.figures.surface_view import surface_view
from fringecal.report.html import write_html
from fringecal.report.readable import Layer, readable_picture, readable_plate
from fringecal.report.structure import FigureItem, Live, Report, Section, Verdict

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")

PITCH_MM = 0.5
NODES = 101
SMALL = {"width": 640, "height": 480}  # software draws every pixel of a surface
TO_THE_MIDDLE = """(box, [x, y]) => box.scrollTo(
    x * box.scrollWidth - box.clientWidth / 2, y * box.scrollHeight - box.clientHeight / 2)"""
STEP_MM = 319 * PITCH_MM / (NODES - 1)
# Software that stands in for a graphics card says how slow it is; that is no error.
ERRORS = re.compile(r"^(error|http|ws)")
PICTURE_CHANGES = 0.02  # share of pixels; a view turned by 30 degrees differs in far more, an idle one in none


def height_of(x, y):
    """A hill and a slope, without symmetry."""
    return 12 * np.exp(-((x - 30) ** 2 + (y + 20) ** 2) / 800) + 0.02 * x


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    column, row = np.meshgrid(np.arange(320), np.arange(240))
    x, y = PITCH_MM * (column - 159.5), -PITCH_MM * (row - 119.5)
    dark = (x < -50) & (y > 30)
    x_mm, y_mm, z_mm = (np.where(dark, np.nan, part) for part in (x, y, height_of(x, y)))
    layers = (Layer("z", "mm", z_mm), Layer("u(z)", "mm", np.where(dark, np.nan, 0.0123), 4))
    values = readable_plate(x_mm, y_mm, layers, masks={"too dark": dark}, longest_side=NODES)
    residual = 0.001 * (column - 100.0) + 0.0 * row
    downwards = readable_picture(Layer("r", "rad", residual))
    figures = (
        FigureItem("Height", height_map(x_mm, y_mm, z_mm), "a hill", "png", Live(values)),
        FigureItem("Residual", residual_map(residual), "a slope", "png", Live(downwards)),
        FigureItem("Surface", surface_view(x_mm, y_mm, z_mm, exaggeration=2), "a hill", "png", Live(values, 2.0)),
    )
    report = Report("A hill", Verdict("info", "Heights of a hill."), (), (Section("Height", (), (), figures),))
    return write_html(report, tmp_path_factory.mktemp("maps") / "report.html").as_uri()


@pytest.fixture
def page(listening, page_file):
    opened, said = listening
    opened.goto(page_file)
    yield opened
    assert [line for line in said if ERRORS.match(line)] == []


def point_at(page, caption, share_x, share_y):
    """Point at a share of a map's axes and return what the page says of that place."""
    figure = page.locator("figure", has=page.locator("figcaption", has_text=caption))
    field = figure.locator(".probe")
    field.scroll_into_view_if_needed()
    figure.locator(".box").evaluate(TO_THE_MIDDLE, [share_x, share_y])
    box = field.bounding_box()
    page.mouse.move(box["x"] + share_x * box["width"], box["y"] + share_y * box["height"])
    return figure.locator("output").inner_text()


def numbers(words):
    return [float(number) for number in re.findall(r"-?\d+\.?\d*", words.replace("\N{MINUS SIGN}", "-"))]


@pytest.mark.parametrize("width", [400, 1400])
@pytest.mark.parametrize(("share_x", "share_y"), [(0.9, 0.8), (0.6, 0.6), (0.5, 0.1)])
def test_the_height_under_the_pointer_is_the_one_that_was_drawn(page, width, share_x, share_y):
    page.set_viewport_size({"width": width, "height": 900})
    words = point_at(page, "Height", share_x, share_y)
    assert re.fullmatch(r"x \S+ mm, y \S+ mm: z \S+ mm, u\(z\) 0\.0123 mm", words), words
    x, y, z, _ = numbers(words)
    # The axes span 320 x 240 pixels, y up; a node lies within half a step of the pointer, which stands on a whole
    # pixel of the screen, at most 0.4 mm.
    reach = STEP_MM / 2 + 0.4
    assert x == pytest.approx((share_x - 0.5) * 320 * PITCH_MM, abs=reach)
    assert y == pytest.approx((0.5 - share_y) * 240 * PITCH_MM, abs=reach)
    # The value is that of the nearest pixel, half a pixel's diagonal away at most, on a slope below 0.4.
    assert z == pytest.approx(height_of(x, y), abs=0.4 * PITCH_MM)


@pytest.mark.parametrize("width", [400, 1400])
@pytest.mark.parametrize("enlarged", [False, True])
def test_what_is_read_is_what_is_seen_there(page, width, enlarged):
    """Along a line through the masked corner, grey places have no value and coloured ones have one."""
    page.set_viewport_size({"width": width, "height": 900})
    figure = page.locator("figure").first
    if enlarged:
        figure.locator("button").click()
    figure.locator(".probe").scroll_into_view_if_needed()
    page.mouse.move(0, 0)
    frame = figure.locator(".box").bounding_box()
    shot = imread(io.BytesIO(page.screenshot()))[..., :3]
    picture = figure.locator("img").bounding_box()
    # Places by the picture, not by what lies over it: 0.2 to 0.45 of its width, at a quarter of its height.
    row = picture["y"] + 0.25 * picture["height"]
    grey, masked = [], []
    for column in picture["x"] + picture["width"] * np.linspace(0.2, 0.45, 80):
        if frame["x"] < column < frame["x"] + frame["width"] - 1:
            page.mouse.move(column, row)
            masked.append("no value (too dark)" in figure.locator("output").inner_text())
            grey.append(np.ptp(shot[int(row), int(column)]) < 0.1)
    assert 10 < sum(grey) < len(grey) - 10
    assert np.sum(np.array(grey) != masked) <= 2  # at the border, where a node lies to either side


def test_pictures_are_read_in_pixels_downwards(page):
    u, v, residual = numbers(point_at(page, "Residual", 0.75, 0.25))
    assert (u, v) == (pytest.approx(240, abs=2), pytest.approx(60, abs=2))
    assert residual == pytest.approx(0.001 * (u - 100), abs=6e-4)  # three digits are shown


def test_a_finger_reads_the_map_and_still_scrolls_the_page(browser, page_file):
    context = browser.new_context(has_touch=True, is_mobile=True, viewport={"width": 400, "height": 700})
    page = context.new_page()
    page.goto(page_file)
    figure = page.locator("figure").first
    box = figure.locator(".probe").bounding_box()
    page.touchscreen.tap(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    x, y, z, _ = numbers(figure.locator("output").inner_text())
    assert (x, y) == pytest.approx((0, 0), abs=STEP_MM / 2 + 0.4)
    assert z == pytest.approx(height_of(x, y), abs=0.4 * PITCH_MM)
    assert figure.locator(".probe").evaluate("field => getComputedStyle(field).touchAction") == "auto"
    context.close()


def test_arrow_keys_move_the_place(page):
    field = page.locator(".probe").first
    field.focus()
    page.keyboard.press("ArrowRight")
    output = page.locator("output").first
    x0, y0, *_ = numbers(output.inner_text())
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Shift+ArrowRight")
    x1, y1, z1, _ = numbers(output.inner_text())
    # Both places are printed to 0.1 mm.
    assert (x1 - x0, y1 - y0) == (pytest.approx(10 * STEP_MM, abs=0.11), pytest.approx(STEP_MM, abs=0.11))
    assert z1 == pytest.approx(height_of(x1, y1), abs=0.4 * PITCH_MM)


def test_an_enlarged_map_is_read_as_well(page):
    figure = page.locator("figure").first
    figure.locator("button").click()
    figure.locator("[value='4']").check()
    x, y, z, _ = numbers(point_at(page, "Height", 0.9, 0.9))
    # A pixel of the screen is 0.05 mm here.
    assert (x, y) == (pytest.approx(64, abs=STEP_MM / 2 + 0.1), pytest.approx(-48, abs=STEP_MM / 2 + 0.1))
    assert z == pytest.approx(height_of(x, y), abs=0.4 * PITCH_MM)


def seen(stage):
    """The stage as colours (rows, columns, 3)."""
    return imread(io.BytesIO(stage.screenshot()))[..., :3]


def differing(first, second):
    """Share of the pixels in which two pictures of one size differ visibly."""
    assert first.shape == second.shape
    return np.mean(np.abs(first - second).max(axis=2) > 0.1)


def azimuth_deg(eye):
    return np.degrees(np.arctan2(eye["y"], eye["x"]))


def elevation_deg(eye):
    return np.degrees(np.arcsin(eye["z"] / distance(eye)))


def distance(eye):
    return np.linalg.norm([eye[axis] for axis in "xyz"])


def turning(page):
    """Put the surface on its stage and wait until it is drawn."""
    figure = page.locator("figure").last
    figure.locator(".turn").click()
    stage = figure.locator(".stage")
    stage.locator("canvas").first.wait_for(timeout=30_000)
    page.wait_for_function("document.querySelector('.stage').layout?.scene.camera.eye.x")
    stage.scroll_into_view_if_needed()
    page.wait_for_timeout(200)
    return figure, stage


def test_a_surface_is_turned_by_dragging_and_by_keys(page):
    page.set_viewport_size(SMALL)
    figure, stage = turning(page)
    assert not figure.locator("img").is_visible()
    first = seen(stage)
    coloured = np.mean(np.ptp(first, axis=2) > 0.2)
    assert coloured > 0.1  # the surface fills a part of its stage
    box = stage.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + 150, middle[1], steps=5)
    page.mouse.up()
    page.wait_for_timeout(200)
    dragged = seen(stage)
    assert differing(first, dragged) > PICTURE_CHANGES
    stage.focus()
    page.keyboard.press("Home")
    eye = "document.querySelector('.stage').layout.scene.camera.eye"
    start = page.evaluate(eye)
    for key in ("ArrowRight", "ArrowRight", "ArrowRight", "ArrowUp", "+"):
        page.keyboard.press(key)
    moved = page.evaluate(eye)
    assert azimuth_deg(moved) - azimuth_deg(start) == pytest.approx(30)
    assert elevation_deg(moved) - elevation_deg(start) == pytest.approx(10)
    assert distance(moved) / distance(start) == pytest.approx(0.9)
    page.wait_for_timeout(200)
    assert differing(dragged, seen(stage)) > PICTURE_CHANGES
    figure.locator(".turn").click()
    assert figure.locator("img").is_visible()
    assert not stage.is_visible()


def test_everybody_can_use_it(page):
    page.set_viewport_size({"width": 400, "height": 700})
    figure, stage = turning(page)
    for width, enlarged in ((400, False), (1400, False), (1400, True), (400, True)):
        page.set_viewport_size({"width": width, "height": 700})
        if figure.evaluate("figure => figure.matches(':popover-open')") != enlarged:
            figure.locator("[popovertarget]").click()
            assert figure.bounding_box()["width"] == width
        page.wait_for_timeout(300)
        found = axe.Axe().run(page)
        assert found.violations_count == 0, found.generate_report()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        drawn, place = (part.bounding_box() for part in (stage.locator(".svg-container"), stage))
        assert (drawn["width"], drawn["height"]) == pytest.approx((place["width"], place["height"]), abs=2)


def test_a_surface_has_axes_with_units_and_its_gaps_and_leaves_paper_alone(page):
    page.set_viewport_size(SMALL)
    _, stage = turning(page)
    words = stage.inner_text()
    data = page.evaluate("(({x, y, z}) => ({x, y, z}))(document.querySelector('.stage').data[0])")
    z = np.array(data["z"], dtype=float)
    x, y = np.meshgrid(data["x"], data["y"])
    dark = (x < -51) & (y > 31)
    assert np.isnan(z[dark]).all()
    lit = np.isfinite(z)
    assert lit.mean() > 0.9
    np.testing.assert_allclose(z[lit], height_of(x, y)[lit], atol=0.4 * PITCH_MM)
    scene = page.evaluate("document.querySelector('.stage').layout.scene")
    titles = [scene[f"{axis}axis"]["title"]["text"] for axis in "xyz"]
    assert titles == ["x / mm", "y / mm", "z / mm (2 times)"]
    assert "z / mm" in words  # the scale of colours
    page.emulate_media(media="print")
    assert [image.is_visible() for image in page.locator("img").all()] == [True] * 3
    for hidden in (".stage", ".probe", ".reading", ".tools"):
        assert not any(part.is_visible() for part in page.locator(hidden).all()), hidden


def test_without_a_script_the_pictures_are_there_and_nothing_is_dead(browser, page_file):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(page_file)
    assert [image.is_visible() for image in page.locator("img").all()] == [True] * 3
    assert not any(part.is_visible() for part in page.locator(".probe, .stage, .turn, .reading").all())
    page.locator("figure button").first.click(position={"x": 5, "y": 5})  # enlarging needs none
    assert page.locator("figure").first.bounding_box()["width"] == page.viewport_size["width"]
    context.close()


def test_a_browser_without_webgl_says_so_and_keeps_the_picture(listening, page_file):
    page, said = listening
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null;")
    page.goto(page_file)
    figure = page.locator("figure").last
    figure.locator(".turn").click()
    figure.get_by_text("cannot turn the surface: it has no WebGL").wait_for()
    assert figure.locator("img").is_visible()
    assert not figure.locator(".turn").is_visible()
    assert said == []
