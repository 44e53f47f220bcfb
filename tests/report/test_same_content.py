"""The page and the sheets of one report say the same."""

from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest

from fringecal.records.parts import Check
from fringecal.report.html import render_html
from fringecal.report.pdf import render_pdf
from fringecal.report.structure import Fact, FigureItem, InputFile, Report, Section, Table, Verdict
from fringecal.report.style import new_figure
from fringecal.workflows.shared.sections.report_parts import checks_table

from .reading import letters, letters_of_sheets, texts_of_page


def full_report():
    checks = [
        Check(name=f"check number {n}", value=0.1 * n, u=0.01, expanded=0.02, limit=1.0, unit="mm", decision=decision)
        for n, decision in enumerate(("pass", "conditionalPass", "conditionalFail", "fail", "info"), start=1)
    ]
    wide = pd.DataFrame(np.arange(36.0).reshape(2, 18) / 7, columns=[f"quantity {n} / mm" for n in range(18)])
    drawn = new_figure(3, 2)
    drawn.subplots().plot([0, 1])
    sections = (
        Section("Checks", ("What was held against its limit.",), (checks_table(checks),)),
        Section("Wide", (), (Table("More columns than a sheet", wide, "split by columns"),)),
        Section("Drawn", (), (), (FigureItem("A straight line", drawn, "rises from 0 to 1"),)),
    )
    return Report(
        "Commissioning of bench-1",
        Verdict("fail", "One check failed."),
        (Fact("Mean scale", "0.7340(2) mm/px", "k = 1.96"),),
        sections,
        (InputFile("grid", "grid.png", "ab" * 32),),
        {"fringecal": "0.1.0"},
        subtitle="captured on a Sunday",
        command="fringecal commission bench --out out",
        created=datetime(2026, 11, 22, 10, tzinfo=UTC),
    )


@pytest.fixture(scope="module")
def both():
    report = full_report()
    return texts_of_page(render_html(report)), letters_of_sheets(render_pdf(report))


def test_every_text_of_the_page_stands_on_the_sheets(both):
    page, printed = both
    # 5 checks, 2 wide rows and 1 file give more than 80 cells: the reader of the page works.
    assert len(page) > 80
    assert [text for text in page if text not in printed] == []


def test_headings_and_captions_are_as_many_on_both(both):
    _, printed = both
    for section in full_report().sections:
        assert letters(section.title) in printed
        for item in (*section.tables, *section.figures):
            assert printed.count(letters(item.caption)) == 1, item.caption


def test_what_stands_only_on_the_page_would_be_found(both):
    page, printed = both
    assert letters("One check failed, and nobody was told.") not in printed
    assert letters("check number 4") in page
