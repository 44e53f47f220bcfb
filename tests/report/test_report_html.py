import base64
import gzip
import io
import re
from datetime import UTC, datetime
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from fringecal.report.figures.maps import height_map
from fringecal.report.figures.surface_view import surface_view
from fringecal.report.html import folded, render_html, write_html
from fringecal.report.readable import Layer, readable_plate
from fringecal.report.structure import Fact, FigureItem, InputFile, Live, Report, Section, Table, Verdict
from fringecal.report.style import new_figure


class Outline(HTMLParser):
    """What a page holds: elements with attributes, and whether every tag was closed in order."""

    VOID = frozenset({"meta", "link", "img", "input"})

    def __init__(self, page):
        super().__init__()
        self.elements, self.open, self.words = [], [], []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]

    def text(self):
        return " ".join(" ".join(self.words).split())


def plot(encoding="svg"):
    figure = new_figure(3, 2)
    figure.subplots().plot([0, 1])
    return FigureItem("A line", figure, 'rises from "0" to 1', encoding)


def example(decision="pass", **changes):
    frame = pd.DataFrame({"name": ["A", "<B> & C"], "mean / mm": [-1 / 3, np.nan], "n": [435, 7], "ok": [True, False]})
    sections = (
        Section(
            "Scale",
            ("Lines <b>straight</b>.",),
            (Table("Mean error", frame, "in mm"),),
            (plot(), plot("png")),
        ),
        Section("Empty"),
        Section("Angle", figures=(plot(),)),
    )
    options = {
        "title": "Commissioning <bench-1>",
        "verdict": Verdict(decision, "All checks hold."),
        "facts": (Fact("Mean scale", "0.734 mm/px", "k = 1.96"),),
        "sections": sections,
        "inputs": (InputFile("grid", "grid.png", "ab" * 32),),
        "versions": {"fringecal": "0.1.0"},
        "command": "fringecal commission bench --out out",
        "created": datetime(2026, 11, 22, 10, tzinfo=UTC),
    }
    return Report(**options | changes)


def test_the_page_is_well_formed_and_asks_for_nothing_from_outside():
    outline = Outline(render_html(example()))
    addresses = [
        value for _, attributes in outline.elements for key, value in attributes.items() if key in {"src", "href"}
    ]
    assert addresses
    assert all(address.startswith(("data:", "#")) for address in addresses)
    assert "script" not in {tag for tag, _ in outline.elements}
    assert not re.search(r"url\(|@import", render_html(example()))


def test_text_is_escaped():
    page = render_html(example())
    assert "Lines &lt;b&gt;straight&lt;/b&gt;." in page
    assert "<B> & C" in Outline(page).text()
    assert "<title>Commissioning &lt;bench-1&gt;</title>" in page


def test_a_reader_without_eyes_gets_the_same():
    outline = Outline(render_html(example()))
    assert outline.all("html") == [{"lang": "en"}]
    assert [image["alt"] for image in outline.all("img")] == ['rises from "0" to 1'] * 3
    assert {head["scope"] for head in outline.all("th")} == {"col", "row"}
    ids = [attributes["id"] for _, attributes in outline.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    for table in outline.all("table"):
        assert table["aria-labelledby"] in ids
    scrolling = [box for box in outline.all("div") if box.get("class") == "box"]
    assert all(box["tabindex"] == "0" for box in scrolling)


def test_every_figure_can_be_enlarged_by_a_button_that_names_it():
    outline = Outline(render_html(example()))
    figures = outline.all("figure")
    assert len({figure["id"] for figure in figures}) == len(outline.all("img")) == 3
    assert all("popover" in figure for figure in figures)
    assert [button["popovertarget"] for button in outline.all("button")] == [figure["id"] for figure in figures]
    assert outline.text().count("Enlarge Close A line") == 3
    groups = [choice["name"] for choice in outline.all("input") if "checked" in choice]
    assert len(set(groups)) == len(groups) == 3


def test_values_of_maps_stand_in_the_page_once_with_the_place_of_their_axes(scene):
    x, y, z = scene
    known = [np.where(np.isnan(z), np.nan, part) for part in scene]
    values = readable_plate(*known[:2], (Layer("z", "mm", z),))
    flat = FigureItem("Height", height_map(x, y, z), "map", "png", Live(values))
    turned = FigureItem("Surface", surface_view(*known), "view", "png", Live(values, 2.0))
    page = render_html(example(sections=(Section("Height", (), (), (flat, plot(), turned)),)))
    outline = Outline(page)
    scripts = [script.get("id") for script in outline.all("script")]
    assert scripts == ["values-1", "plotly", None]
    assert not any("src" in script for script in outline.all("script"))
    (probe,) = [box for box in outline.all("div") if box.get("class") == "probe"]
    (stage,) = [box for box in outline.all("div") if box.get("class") == "stage"]
    assert probe["data-values"] == stage["data-values"] == "values-1"
    assert stage["data-stretch"] == "2.0"
    # 80 x 60 pixels of 2 mm about the origin: the axes end half a pixel beyond the last centres, y up.
    assert [float(limit) for limit in probe["data-limits"].split()] == pytest.approx([-80, 80, 60, -60])
    # Equal scales: the box's sides in px of a 7.0 x 5.2 inch picture are as 4 to 3.
    share = {side: float(part.rstrip("%")) for side, part in re.findall(r"(\w+): ([\d.]+%)", probe["style"])}
    assert share["width"] * 7.0 / (share["height"] * 5.2) == pytest.approx(4 / 3, abs=1e-3)
    # What is hidden until a script shows it would be dead without one.
    assert all("hidden" in part for part in (probe, stage))
    packed = re.search(r'id="plotly">([^<]*)<', page).group(1)
    library = gzip.decompress(base64.b64decode(packed)).decode()
    assert "plotly.js" in library[:100]
    assert "MIT license" in library[:300]


def test_numbers_are_printed_short_and_downloaded_whole():
    outline = Outline(render_html(example()))
    assert "A −0.3333 435 yes" in outline.text()
    assert "<B> & C – 7 no" in outline.text()
    link = next(entry for entry in outline.all("a") if entry.get("download") == "mean-error.csv")
    csv = base64.b64decode(link["href"].split("base64,")[1])
    frame = pd.read_csv(io.BytesIO(csv))
    assert frame["mean / mm"][0] == -1 / 3
    assert list(frame["name"]) == ["A", "<B> & C"]


def test_a_format_is_obeyed():
    frame = pd.DataFrame({"name": ["A"], "angle / deg": [50.706]})
    table = Table("T", frame, formats={"angle / deg": ".2f"})
    assert "A 50.71" in Outline(render_html(example(sections=(Section("S", tables=(table,)),)))).text()


def test_figures_are_pictures_of_the_kind_they_say():
    images = Outline(render_html(example())).all("img")
    svg, png = (base64.b64decode(images[place]["src"].split("base64,")[1]) for place in (0, 1))
    assert b"<svg" in svg[:1000]
    assert png.startswith(b"\x89PNG")
    assert (images[0]["width"], images[0]["height"]) == ("288", "192")  # 3 x 2 inches of 96 px


def test_equal_reports_give_equal_bytes():
    assert render_html(example()) == render_html(example())


@pytest.mark.parametrize(
    ("decision", "word"),
    [("pass", "Pass"), ("conditionalPass", "Conditional pass"), ("conditionalFail", "Conditional fail"),
     ("fail", "Fail"), ("info", "For information")],
)  # fmt: skip
def test_the_verdict_stands_first_and_in_words(decision, word):
    outline = Outline(render_html(example(decision)))
    text = outline.text()
    assert text.index(word) < text.index("All checks hold.") < text.index("Mean scale") < text.index("Lines")
    assert {"class": f"verdict {decision}", "aria-label": "Verdict"} in outline.all("section")


def luminance(colour):
    parts = np.array([int(colour[place : place + 2], 16) for place in (1, 3, 5)]) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ (
        0.2126,
        0.7152,
        0.0722,
    )


@pytest.mark.parametrize("name", ["ink", "soft", "link"])
def test_lettering_has_the_contrast_of_wcag_aa(name):
    # WCAG 2.2, 1.4.3: (L1 + 0.05) / (L2 + 0.05) at least 4.5, here on the page's darkest background.
    page = render_html(example())
    colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", page))
    assert (luminance(colours["back"]) + 0.05) / (luminance(colours[name]) + 0.05) >= 4.5


def test_an_empty_report_is_a_page_too(tmp_path):
    path = write_html(Report("Nothing", Verdict("info", "No capture was given.")), tmp_path / "r.html")
    assert "No capture was given." in Outline(path.read_text(encoding="utf-8")).text()
    assert [file.name for file in tmp_path.iterdir()] == ["r.html"]


@pytest.mark.parametrize(
    ("sizes", "expected"), [((5, 5), (False, False)), ((0, 7, 0, 1, 4), (False, False, False, True, True))]
)
def test_a_long_report_is_folded_after_the_first_that_it_shows(sizes, expected):
    """Ten tables in all are read as they stand; of more, those beyond the fifth wait, but never the first section."""
    table = Table("T", pd.DataFrame({"a": [1.0]}))
    report = Report("R", Verdict("pass", "All."), (), tuple(Section("S", (), (table,) * size) for size in sizes))
    assert folded(report) == expected
    assert render_html(report).count("<details>") == sum(expected)
