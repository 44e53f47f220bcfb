"""Reviews of a rig's history and the command that shows them."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from fringecal.cli.app import main
from fringecal.errors import HistoryError
from fringecal.history.entries import Reading
from fringecal.history.review import repeats_of, review_series, reviews_of, series_of
from fringecal.history.standing import standing_of, standing_sentences
from fringecal.history.store import open_history
from fringecal.report.html import render_html
from fringecal.workflows.history.report import history_report, history_verdict, review_table

from .conftest import make_entry

MONTHS = 30


def monthly(history, shift=0.0):
    """Thirty monthly audits: a scale that shifts after two years, and a certified step measured by two operators."""
    rng = np.random.default_rng(8)
    for month in range(MONTHS):
        scale = 0.734 + rng.normal(0, 5e-5) + (shift if month >= 24 else 0.0)
        step, block = 10 + rng.normal(0, 0.006), 20 + rng.normal(0, 0.006)
        readings = [
            Reading("scale, mean", scale, "mm/px", 1e-4, 30.0),
            Reading("Block: step of 10 mm", step, "mm", 0.01, None, 10.0, 0.003, 0.1),
            Reading("Block: step of 20 mm", block, "mm", 0.01, None, 20.0, 0.003, 0.1),
            Reading("check: noise", 0.02, "rad", 0.0, limit=0.1, decision="pass"),
        ]
        captured = f"{2024 + month // 12}-{1 + month % 12:02d}-05T08:00:00+00:00"
        operator = ("ab", "cd")[month % 2]
        history.append([make_entry(month, captured=captured, readings=readings, operator=operator)])


def review_of(history, quantity, **options):
    return review_series(series_of(history.readings("bench-1", quantity), **options))


def test_a_rig_in_control(history):
    monthly(history)
    review = review_of(history, "scale, mean")
    assert review.alarms == ()
    assert review.baseline.sigma == pytest.approx(5e-5, rel=0.5)  # 20 records: 21 % of chance
    assert not review.drift.significant
    assert (review.due.days, review.due.method) == (None, "not enough to say")
    assert "no limit is known" in review.due.reason


def test_a_shift_of_two_sigma_raises_the_alarm_of_the_slow_charts(history):
    monthly(history, shift=1.2e-4)
    review = review_of(history, "scale, mean", limit=0.001, reference=0.734)
    assert {"EWMA", "CUSUM"} <= set(review.alarms)
    for chart in review.charts[2:]:
        assert 24 <= chart.first_signal <= 29
    assert history_verdict([review]).decision == "conditionalFail"
    assert "scale, mean" in history_verdict([review]).sentence


def test_certified_quantities_are_charted_as_deviations_with_their_own_limit(history):
    monthly(history)
    review = review_of(history, "Block: step of 10 mm")
    assert abs(review.series.values).max() < 0.05
    assert review.series.limit == pytest.approx(1.959964 * np.hypot(0.01, 0.003))
    assert review.due.days >= 28  # a month, the usual interval: nothing drifts


def test_a_value_that_never_changes_has_no_chart_but_a_note(history):
    monthly(history)
    review = review_of(history, "check: noise")
    assert review.charts == ()
    assert any("all equal" in note for note in review.notes)
    assert review.series.limit is None  # of a check: no deviation could reach it


def test_few_records_give_notes_and_no_numbers(history):
    history.append([make_entry(1), make_entry(2)])
    review = review_of(history, "q1")
    assert (review.charts, review.drift, review.due.days) == ((), None, None)
    assert history_verdict([review]).decision == "info"
    assert review_table([review])["sigma"].isna().all()


def audited(history, *, rate=0.0, number=8, seed=3, calibrated=("2026-01-01", "2026-04-20")):
    """Monthly audits of a rig whose height scale drifts by `rate` per cent a year, calibrated anew on the way."""
    rng = np.random.default_rng(seed)
    days = pd.date_range("2026-01-10", periods=number, freq="31D", tz="UTC")
    made = [pd.Timestamp(day, tz="UTC") for day in calibrated]
    scale = [Reading("scale, mean", 0.734, "mm/px", 1e-4)]
    for k, day in enumerate(made):
        history.append([replace(make_entry(100 + k, captured=day.isoformat(), readings=scale), kind="calibration")])
    for k, day in enumerate(days):
        years = (day - max(one for one in made if one < day)).days / 365.25
        change = rate * years + rng.normal(0, 0.01)
        readings = [
            Reading("change of height scale", change, "%", 0.05, None, None, None, change / 0.1, 0.3, "pass"),
            Reading("check: rig as calibrated", 0.97 + 0.003 * k, limit=0.01, decision="pass"),
        ]
        history.append([make_entry(k, captured=day.isoformat(), readings=readings)])
    return history.readings("bench-1")


def test_a_healthy_rig_is_not_told_to_calibrate_now(history):
    """Seven unchanged audits, each with a chance near 1 and a limit of 0.01 below it: nothing is due for a month."""
    reviews = reviews_of(audited(history))
    assert not any(one.series.quantity.startswith("check: ") for one in reviews)
    standing = standing_of(reviews)
    assert (standing.out, standing.drifting, standing.jumped) == ((), (), ())
    assert standing.next_review.due.days >= 31
    assert "height scale" in standing_sentences(standing)[-1]
    assert standing.next_review.drift.records == 8 + 2  # every audit, and the calibrations as changes of nought


def test_a_drift_through_two_calibrations_is_due_when_it_reaches_the_limit(history):
    """0.6 % a year reach 0.3 % half a year after the calibration of April 20; the forecast's U takes some of it."""
    standing = standing_of(reviews_of(audited(history, rate=0.6, number=7)))
    review = standing.next_review
    assert standing.drifting == (review,)
    assert review.drift.rate.value == pytest.approx(0.6, abs=2.1 * review.drift.rate.u)
    reached = pd.Timestamp("2026-04-20", tz="UTC") + pd.Timedelta(days=182.6)
    assert pd.Timestamp("2026-08-15", tz="UTC") < pd.Timestamp(standing.due) < reached
    assert "U" in review.due.reason
    assert "by 9 records" in review.due.reason


def test_charts_of_changes_begin_with_the_calibration_in_force(history):
    review = reviews_of(audited(history, number=12), ["change of height scale"])[0]
    assert review.first == 4  # audits of January to April 13
    assert len(review.charts[0].statistic) == 12 - 4


def test_two_records_of_many_quantities_are_one_sentence(history):
    history.append([make_entry(1), make_entry(2)])
    reviews = reviews_of(history.readings("bench-1"))
    report = history_report("bench-1", history.entries("bench-1"), reviews)
    assert [section.title for section in report.sections] == ["Quantities", "Records"]
    assert len(report.sections[0].sentences) == 1
    assert "q1 (2)" in report.sections[0].sentences[0]


def test_mixed_rows_are_refused(history):
    history.append([make_entry(1), make_entry(2, rig="bench-2")])
    with pytest.raises(HistoryError, match="one rig was needed"):
        series_of(history.readings(quantity="q1"))
    with pytest.raises(HistoryError, match="no such quantity"):
        series_of(history.readings("bench-1", "q99"))


def test_repeats_are_arranged_by_part_operator_and_trial(history):
    monthly(history)
    repeats = repeats_of(history.readings("bench-1"), "Block")
    assert repeats.operators == ("ab", "cd")
    assert repeats.readings.shape == (2, 2, 15)
    rows = history.readings("bench-1", "Block: step of 20 mm")
    assert list(repeats.readings[1, 1]) == list(rows[rows["operator"] == "cd"]["value"])
    assert list(repeats.references) == [10.0, 20.0]
    with pytest.raises(HistoryError, match="it holds Block"):
        repeats_of(history.readings("bench-1"), "Blok")


def test_one_verification_is_no_study(history):
    history.append([make_entry(1, readings=[Reading("Ball: size", 50.0, "mm", 0.1, None, 50.0, 0.1)])])
    with pytest.raises(HistoryError, match="twice at least, found 1"):
        repeats_of(history.readings("bench-1"), "Ball")


def test_the_report_names_alarms_intervals_and_run_lengths(history):
    monthly(history, shift=2e-4)
    reviews = [review_of(history, name) for name in ("scale, mean", "Block: step of 10 mm")]
    page = render_html(history_report("bench-1", history.entries("bench-1"), reviews))
    for text in (
        "Out of control at the last record: scale, mean",
        "10.5",
        "Next calibration or audit due",
        "30 records",
    ):
        assert text in page


@pytest.fixture
def run(capsys):
    def command(*arguments):
        code = 0
        try:
            main(["history", *(str(a) for a in arguments)])
        except SystemExit as stop:
            code = stop.code
        return code, *capsys.readouterr()

    return command


def test_the_command_adds_shows_charts_and_exports(run, tmp_path):
    db = tmp_path / "h.db"
    with open_history(db) as history:
        monthly(history, shift=3e-4)
    code, out, _ = run("chart", "--db", db, "--quantity", "scale, mean", "--json", "--out", tmp_path / "charts")
    assert code == 3
    assert json.loads(out)["quantities"][0]["records"] == MONTHS
    assert (tmp_path / "charts" / "report.html").is_file()
    code, out, _ = run("msa", "Block", "--db", db, "--tolerance", "0.5", "--json")
    document = json.loads(out)
    assert [study["method"] for study in document["gauge"]] == ["ANOVA", "range"]
    assert document["type_one"]["Block: step of 10 mm"]["count"] == MONTHS
    assert run("export", tmp_path / "t.csv", "--db", db)[0] == 0
    assert len(pd.read_csv(tmp_path / "t.csv")) == 4 * MONTHS
    assert "0 record(s) added" in run("import", tmp_path / "t.csv", "--db", db)[1]
    assert json.loads(run("show", "--db", db, "--json")[1])["quantities"][-1]["records"] == MONTHS
    assert "bench-1" in run("show", "--db", db)[1]
    demand_values_shown(run, db)


def demand_values_shown(run, db):
    """A rig's readings come with value, U and unit: of 10 mm, u 0.01 mm, U is 0.0196 mm."""
    code, out, _ = run("show", "--db", db, "--quantity", "Block: step of 10 mm")
    assert code == 0
    rows = re.findall(r"Block: step of 10 mm +(\d+\.\d+) +(\d\.\d+) +mm", out)
    assert len(rows) == MONTHS
    assert all(len(value.partition(".")[2]) == 3 and expanded == "0.020" for value, expanded in rows)
    assert "scale, mean" in run("show", "--db", db, "--rig", "bench-1")[1]
    assert len(json.loads(run("show", "--db", db, "--values", "--json")[1])["readings"]) == 4 * MONTHS
    code, _, error = run("show", "--db", db, "--quantity", "scale")
    assert (code, "scale, mean" in error) == (1, True)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("show", "--db", "absent.db"), 1, "no history"),
        (("add", "absent.json", "--db", "h.db"), 1, "absent.json: cannot be read"),
        (("chart", "--db", "h.db", "--limit", "1"), 2, "one quantity"),
        (("chart", "--db", "h.db", "--rig", "x"), 1, "holds none"),
        (("chart", "--db", "h.db", "--since", "1.2.2026"), 2, "2026-02-01"),
        (("export", "t.ods", "--db", "h.db"), 1, ".csv or .parquet"),
    ],
)
def test_wrong_use_is_told(run, tmp_path, monkeypatch, arguments, code, message):
    monkeypatch.chdir(tmp_path)
    open_history("h.db").close()
    found, out, error = run(*arguments)
    assert found == code
    assert message in " ".join((out + error).split())


def test_an_unreachable_history_leaves_the_results_and_says_how_to_add_them(tmp_path):
    from fringecal.cli.history import append_record

    with pytest.raises(HistoryError, match="results in .* are complete"):
        append_record(tmp_path, str(tmp_path / "absent" / "h.db"))
