"""What an audit says first: by how much heights are wrong, what to do, and how likely each cause is."""

from types import SimpleNamespace

import pytest

from fringecal.records import Check
from fringecal.report.html import render_html
from fringecal.report.structure import Report, Section, Verdict
from fringecal.workflows.audit.consequences import consequence_sentence
from fringecal.workflows.audit.sentences import cause_probabilities
from fringecal.workflows.shared import checks_table


def check(name, decision, value=1.0, **more):
    return Check(name=name, value=value, limit=0.3, unit="%", decision=decision, **more)


def test_heights_come_first_and_what_to_do_last():
    checks = [
        check("blur of the grid's lines", "pass"),
        check("change of contrast of the fringes", "fail", -40.0),
        check("change of scale", "fail", 0.5, u=0.01),
        check("change of height scale, on the strips", "fail", 0.41, u=0.02),
        check("mean error, pooled", "fail", 1.4, score="En"),
        check("change of modulation", "fail", 0.31),
    ]
    said = consequence_sentence(checks)
    assert said.startswith("Heights +0.410 % wrong, limit 0.3 %; Lengths along the plate +0.500 % wrong")
    assert said.endswith(
        "contrast of the fringes -40 %, limit 0.3 %; and 2 more: do not measure with this calibration."
    )


def test_doubt_asks_for_another_look_and_a_pass_for_nothing():
    assert consequence_sentence([check("rig as calibrated", "conditionalPass")]) == ""
    doubtful = consequence_sentence([check("change of height scale, on the strips", "conditionalFail", 0.31, u=0.05)])
    assert doubtful.startswith("Not proved to be within limits: Heights +0.310 % wrong, limit 0.3 %;")
    assert doubtful.endswith("audit again or calibrate before you measure.")


def test_what_did_not_pass_stands_on_top_and_is_marked():
    checks = [check("a", "pass"), check("b", "info"), check("c", "fail"), check("d", "conditionalPass")]
    table = checks_table(checks)
    assert list(table.frame["check"]) == ["c", "d", "a", "b"]
    page = render_html(Report("T", Verdict("fail", "S."), sections=(Section("Checks", (), (table,)),)))
    assert page.index('<tr class="fail"><th scope="row">c') < page.index('<tr class="pass"><th scope="row">a')


def test_probabilities_of_causes_are_those_of_their_odds():
    """Odds of e to 1 and e^3 to 1."""
    fits = [SimpleNamespace(log_evidence=value) for value in (-10.0, -11.0, -13.0)]
    first, second, third = cause_probabilities(fits)
    assert first + second + third == pytest.approx(1)
    assert first / second == pytest.approx(2.718282, rel=1e-6)
    assert first / third == pytest.approx(20.085537, rel=1e-6)
