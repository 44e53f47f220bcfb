"""Reports as PDF, read back by PDFium, which shares no code with what sets them."""

from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pypdfium2 as pdfium
import pypdfium2.raw as pdfium_c
import pytest

from fringecal.report.pdf import render_pdf, write_pdf
from fringecal.report.structure import Fact, FigureItem, InputFile, Report, Section, Table, Verdict
from fringecal.report.style import new_figure

A4_PT = (595.28, 841.89)  # ISO 216: 210 x 297 mm
MARGIN_PT = 18 / 25.4 * 72
HOSTILE = "# * _ $x$ @ref <lab> `raw` \\n // /* */ [a](b) #panic() ~ ' \" & -- ..."


def figure(width_in=3.0, height_in=2.0, encoding="svg"):
    drawn = new_figure(width_in, height_in)
    drawn.subplots().plot([0, 1])
    return FigureItem("A line", drawn, "rises from 0 to 1", encoding)


def report(*sections, **changes):
    options = {
        "title": "Commissioning of bench-1",
        "verdict": Verdict("pass", "All checks hold."),
        "facts": (Fact("Mean scale", "0.734 mm/px", "k = 1.96"),),
        "sections": sections,
        "inputs": (InputFile("grid", "grid.png", "0123456789abcdef" * 4),),
        "versions": {"fringecal": "0.1.0"},
        "command": "fringecal commission bench --out out",
        "created": datetime(2026, 11, 22, 10, tzinfo=UTC),
    }
    return Report(**options | changes)


def opened(made):
    return pdfium.PdfDocument(render_pdf(made))


def words(document):
    pages = [page.get_textpage().get_text_bounded() for page in document]
    return " ".join(" ".join(pages).split())


def objects(page, kind):
    return [found for found in page.get_objects(max_depth=5) if found.type == kind]


def right_end_pt(page):
    """Right end of the last letter of a page."""
    text = page.get_textpage()
    return max(text.get_charbox(n)[2] for n in range(text.count_chars()))


def test_all_that_the_report_says_stands_on_sheets_of_a4():
    frame = pd.DataFrame({"line": ["A", "B"], "mean / mm": [-1 / 3, np.nan], "n": [435, 7], "ok": [True, False]})
    document = opened(report(Section("Scale", ("Lines are straight.",), (Table("Mean error", frame, "in mm"),))))
    text = words(document)
    assert document[0].get_size() == pytest.approx(A4_PT, abs=0.1)
    stands = ("Pass", "All checks hold.", "Mean scale", "0.734 mm/px", "k = 1.96", "Scale", "Lines are straight.")
    places = [text.index(part) for part in ("Commissioning of bench-1", *stands)]
    assert places == sorted(places)
    assert "A −0.3333 435 yes B – 7 no" in text
    assert "0123456789abcdef" * 4 in text
    assert "Written 2026-11-22 10:00 UTC." in text
    assert "Command: fringecal commission bench --out out" in text
    assert "fringecal 0.1.0" in text
    assert document.get_metadata_value("Title") == "Commissioning of bench-1"


def test_every_page_knows_its_number():
    document = opened(report(Section("S", figures=(figure(7, 7), figure(7, 7), figure(7, 7)))))
    assert len(document) >= 2
    for number, page in enumerate(document, start=1):
        assert f"{number} of {len(document)}" in page.get_textpage().get_text_bounded()


@pytest.mark.parametrize(
    ("decision", "said"),
    [
        ("pass", "✓ Pass"),
        ("conditionalPass", "✓? Conditional pass (not proved: see the checks)"),
        ("conditionalFail", "✗? Conditional fail (not proved: see the checks)"),
        ("fail", "✗ Fail"),
        ("info", "i For information"),
    ],
)
def test_the_decision_stands_before_its_reason_in_words(decision, said):
    text = words(opened(report(verdict=Verdict(decision, "Because."))))
    assert f"{said} Because." in text
    assert text.index("Because.") < text.index("Mean scale")


def test_characters_of_the_markup_print_as_they_are():
    frame = pd.DataFrame({HOSTILE: [HOSTILE], "n": [1]})
    everywhere = report(
        Section(
            HOSTILE, (HOSTILE,), (Table(HOSTILE, frame, HOSTILE),), (FigureItem(HOSTILE, figure().figure, HOSTILE),)
        ),
        title=HOSTILE,
        subtitle=HOSTILE,
        verdict=Verdict("fail", HOSTILE),
        facts=(Fact(HOSTILE, HOSTILE, HOSTILE),),
        inputs=(InputFile(HOSTILE, HOSTILE, HOSTILE),),
        versions={HOSTILE: HOSTILE},
        command=HOSTILE,
    )
    text = words(opened(everywhere)).replace(" ", "")
    # Title, subtitle, verdict, fact 3, section 2, table 4, figure, inputs 3, command, versions 2.
    assert text.count(HOSTILE.replace(" ", "")) >= 18


def test_control_characters_print_as_spaces():
    assert "one two three" in words(opened(report(title="one\x00two\nthree")))


def test_figures_stand_in_it_as_lines_or_as_picture():
    for_lines = opened(report(Section("S", figures=(figure(),))))[0]
    assert len(objects(for_lines, pdfium_c.FPDF_PAGEOBJ_PATH)) > 5
    assert objects(for_lines, pdfium_c.FPDF_PAGEOBJ_IMAGE) == []
    (picture,) = objects(
        opened(report(Section("S", figures=(figure(encoding="png"),))))[0], pdfium_c.FPDF_PAGEOBJ_IMAGE
    )
    assert picture.get_px_size() == (360, 240)  # 3 x 2 inches of 120 px


@pytest.mark.parametrize(("width_in", "height_in"), [(14.0, 3.0), (4.0, 20.0), (7.0, 4.5)])
def test_figures_are_whole(width_in, height_in):
    document = opened(report(Section("S", figures=(figure(width_in, height_in, "png"),))))
    (picture,) = [found for page in document for found in objects(page, pdfium_c.FPDF_PAGEOBJ_IMAGE)]
    left, bottom, right, top = picture.get_bounds()
    assert left >= MARGIN_PT - 1
    assert right <= A4_PT[0] - MARGIN_PT + 1
    assert bottom > MARGIN_PT
    assert top <= A4_PT[1] - MARGIN_PT + 1
    assert (right - left) / (top - bottom) == pytest.approx(width_in / height_in, rel=1e-3)


@pytest.mark.parametrize("columns", [3, 12, 45])
def test_tables_stay_on_the_sheet_however_wide(columns):
    values = np.random.default_rng(1).normal(size=(3, columns))
    frame = pd.DataFrame(values, columns=[f"deviation {n} / mm" for n in range(columns)])
    frame.insert(0, "line", ["first", "second", "third"])
    document = opened(report(Section("S", tables=(Table("Wide", frame),))))
    assert max(right_end_pt(page) for page in document) <= A4_PT[0] - MARGIN_PT + 1
    text = words(document)
    for value in values.ravel():
        assert f"{value:.4g}".replace("-", "−") in text


def test_a_word_longer_than_the_sheet_breaks():
    long = "/data/" + "x" * 300
    frame = pd.DataFrame({"file": [long], "n": [1]})
    page = report(
        Section("S", (long,), (Table("Files", frame),)), facts=(Fact("Folder", long),), command=long, subtitle=long
    )
    document = opened(page)
    assert max(right_end_pt(sheet) for sheet in document) <= A4_PT[0] - MARGIN_PT + 1
    letters = words(document).replace(" ", "").replace("\u200b", "").replace("\ufffe", "")
    assert letters.count("x" * 300) == 5


def test_a_long_table_repeats_its_head_on_every_sheet():
    frame = pd.DataFrame({"crossing": range(200), "error / px": np.linspace(0, 1, 200)})
    document = opened(report(Section("S", tables=(Table("Crossings", frame),)), inputs=()))
    assert len(document) > 2
    assert words(document).count("error / px") == len(document)


def test_tables_and_reports_may_be_empty(tmp_path):
    hollow = (Table("Nothing", pd.DataFrame()), Table("No rows", pd.DataFrame({"a": [], "b": []})))
    assert "No rows a b" in words(opened(report(Section("S", tables=hollow))))
    path = write_pdf(Report("Nothing", Verdict("info", "No capture was given.")), tmp_path / "r.pdf")
    assert "No capture was given." in words(pdfium.PdfDocument(path))
    assert [file.name for file in tmp_path.iterdir()] == ["r.pdf"]


@pytest.mark.parametrize("created", [None, datetime(2026, 11, 22, 10, tzinfo=UTC)])
def test_equal_reports_give_equal_bytes(created):
    first, second = (render_pdf(report(Section("S", figures=(figure(),)), created=created)) for _ in range(2))
    assert first == second
