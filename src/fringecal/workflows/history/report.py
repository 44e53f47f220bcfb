"""The report of a rig's history: alarms first, then charts, drift and intervals, and the table of records."""

from collections.abc import Sequence
from datetime import datetime

import pandas as pd

from fringecal.history import (
    Review,
    cusum_run_length,
    due_date,
    ewma_run_length,
    rate_text,
    shewhart_run_length,
    standing_of,
    standing_sentences,
)
from fringecal.records import software_versions
from fringecal.report import Fact, FigureItem, Report, Section, Table, Verdict, control_charts, drift_figure

_CHARTS = 3  # of each quantity
_NAMED = 12  # quantities with too few records that are named: the table of records holds all
_RUNS = (
    "Values between two false alarms, and until a change of the mean by one sigma is found, on average: single values "
    f"{shewhart_run_length():.0f} and {shewhart_run_length(1.0):.0f}, EWMA {ewma_run_length():.0f} and "
    f"{ewma_run_length(1.0):.1f}, CUSUM {cusum_run_length():.0f} and {cusum_run_length(1.0):.1f}. Each value "
    "is judged by all before it, so that this holds from the first records on; a change in few records is found later."
)


def history_report(
    rig: str,
    entries: pd.DataFrame,
    reviews: Sequence[Review],
    *,
    command: str = "",
    created: datetime | None = None,
) -> Report:
    """Return the report of a rig's history.

    Parameters
    ----------
    rig
        Name of the rig.
    entries
        Its rows of `History.entries`.
    reviews
        One per quantity.
    command, created
        As for `commission_report`.
    """
    return Report(
        title=f"History of {rig}",
        subtitle=f"{len(entries)} records, {entries['captured'].iloc[0][:10]} to {entries['captured'].iloc[-1][:10]}",
        verdict=history_verdict(reviews),
        facts=_facts(reviews),
        sections=(_summary(reviews), *_quantities(reviews), _records(entries)),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _quantities(reviews: Sequence[Review]) -> tuple[Section, ...]:
    """One section for each quantity that has a chart or a line, the most urgent first."""
    shown = [one for one in reviews if one.charts or one.drift]
    return tuple(_quantity(one) for one in sorted(shown, key=_urgency))


def history_section(reviews: Sequence[Review]) -> Section:
    """Return the history's part of another report: its quantities over time, this record's value the last.

    Quantities of too few records for a chart or a line are one sentence.
    """
    shown = [review for review in reviews if review.charts or review.drift]
    figures = tuple(
        FigureItem(
            f"History of {review.series.quantity}",
            control_charts(review) if review.charts else drift_figure(review),
            f"{len(review.series.values)} records of {review.series.quantity}"
            + (f"; beyond the limits: {_signals(review)}." if review.charts else ", too few for control limits."),
        )
        for review in shown
    )
    summary = _summary(reviews)
    said = (
        standing_sentences(standing_of(reviews)) if shown else ("Too few records of the rig for a chart or a drift.",)
    )
    return Section("History", (*said, *summary.sentences[1:]), summary.tables, figures, side_by_side=True)


def _signals(review: Review) -> str:
    return "; ".join(f"{chart.kind} {len(chart.signals)}" for chart in review.charts)


def history_verdict(reviews: Sequence[Review]) -> Verdict:
    """Say what is out, what drifts and what is due; a chart warns, it does not judge a tolerance."""
    standing = standing_of(reviews)
    sentence = " ".join(standing_sentences(standing))
    if standing.state == "too few records":
        return Verdict("info", f"Too few records for a control chart. {sentence}")
    if standing.out or standing.alarming:
        return Verdict("conditionalFail", sentence)
    quiet = f"All quantities on charts ({standing.charts // _CHARTS}) are in control at the last record. "
    return Verdict("pass", (quiet if standing.charts else "") + sentence)


def review_table(reviews: Sequence[Review]) -> pd.DataFrame:
    """Tabulate one row per quantity: last value, limits of control, drift, and when it is due; what is out first."""
    return pd.DataFrame([_row(review) for review in sorted(reviews, key=_urgency)])


def _urgency(review: Review) -> tuple[bool, bool, float]:
    """Order quantities: out, then in alarm, then by the days until they are due."""
    days = review.due.days
    return not review.out, not review.alarms, float("inf") if days is None else days


def _row(review: Review) -> dict[str, object]:
    series, control, drift = review.series, review.baseline, review.drift
    return {
        "quantity": series.quantity,
        "state": _state(review),
        "unit": series.unit or "1",
        "records": len(series.values),
        "last": series.values[-1],
        "limit": series.limit,
        "centre": control.centre if control else None,
        "sigma": control.sigma if control else None,
        "alarms": ", ".join(review.alarms) if review.charts else None,
        "drift per year": drift.rate.value if drift else None,
        "u(drift)": drift.rate.u if drift else None,
        "p(drift)": drift.p_value if drift else None,
        "interval / days": review.due.days,
        "due": f"{due:%Y-%m-%d}" if (due := due_date(review)) else None,
        "method": review.due.method,
    }


def _state(review: Review) -> str:
    if review.out:
        return "out of its limit"
    if review.alarms:
        return "out of control"
    return "in control" if review.charts else "too few for a chart"


def _facts(reviews: Sequence[Review]) -> tuple[Fact, ...]:
    standing = standing_of(reviews)
    names = {"Out of its limit": standing.out, "In alarm": standing.alarming, "Drifts": standing.drifting}
    counted = tuple(
        Fact(name, str(len(found)) if found else "none", "; ".join(one.series.quantity for one in found))
        for name, found in names.items()
    )
    first = standing.next_review
    when = "not enough to say" if standing.due is None else f"{standing.due:%Y-%m-%d}"
    when = "now" if first is not None and first.due.days == 0 else when
    by = f"by {first.series.quantity}" if first is not None else ""
    return (Fact("Next calibration or audit due", when, by), *counted)


def _summary(reviews: Sequence[Review]) -> Section:
    standing = standing_of(reviews)
    shown = [one for one in reviews if one not in standing.too_few]
    note = "certified quantities: deviation from the certificate; sigma: mean moving range over 1.128"
    formats = {"interval / days": ".0f", "p(drift)": ".2g", "limit": "g"}
    table = Table("Quantities", review_table(shown), note, formats, {"drift per year": "u(drift)"})
    alone = f"Chance alone raises one alarm on these {standing.charts} charts in about every "
    chance = (f"{alone}{standing.records_between_false_alarms:.0f} records.",) if standing.charts else ()
    sentences = (*((_RUNS, *chance) if standing.charts else ()), *_few(standing.too_few))
    return Section("Quantities", sentences, (table,) if shown else ())


def _few(reviews: Sequence[Review]) -> tuple[str, ...]:
    """Name in one line what has too few records to be said anything about."""
    if not reviews:
        return ()
    named = ", ".join(f"{one.series.quantity} ({len(one.series.values)})" for one in reviews[:_NAMED])
    more = f" and {len(reviews) - _NAMED} more" if len(reviews) > _NAMED else ""
    return (f"Too few records to say anything: {named}{more}.",)


def _quantity(review: Review) -> Section:
    name = review.series.quantity
    sentences = [_due_words(review)]
    if review.drift is not None:
        kind = "significant" if review.drift.significant else "not significant"
        sentences.insert(0, f"Drift {rate_text(review.drift)}: {kind} (p = {review.drift.p_value:.2g}).")
    if review.jumps:
        sentences.append(f"Another level since {', '.join(day[:10] for day in review.jumps)}.")
    figures = [
        FigureItem(
            f"{name} over time", drift_figure(review), f"{len(review.series.values)} records of {name} over time."
        )
    ]
    if review.charts:
        alt = f"Control charts of {name}; values beyond the limits: {_signals(review)}."
        figures.append(FigureItem(f"Control charts of {name}", control_charts(review), alt))
    notes = (f"{note[0].upper()}{note[1:]}." for note in review.notes)
    return Section(name, (*sentences, *notes), (), tuple(figures))


def _due_words(review: Review) -> str:
    due = due_date(review)
    when = "not enough to say" if due is None else ("now" if review.due.days == 0 else f"{due:%Y-%m-%d}")
    return f"Due: {when} ({review.due.method}); {review.due.reason}." if due else f"Due: {when}; {review.due.reason}."


def _records(entries: pd.DataFrame) -> Section:
    named = {
        "captured": "captured",
        "kind": "kind",
        "decision": "verdict",
        "operator": "operator",
        "temperature_degC": "temperature / degC",
        "minutes_since_power_on": "after power-on / min",
        "source": "source",
    }
    frame = entries[list(named)].set_axis(list(named.values()), axis=1)
    return Section("Records", (), (Table("Records in the history", frame),))
