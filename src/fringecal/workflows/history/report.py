"""The report of a rig's history: alarms first, then charts, drift and intervals, and the table of records."""

from collections.abc import Sequence
from datetime import datetime

import pandas as pd

from fringecal.history import Review, cusum_run_length, ewma_run_length, shewhart_run_length
from fringecal.records import software_versions
from fringecal.report import Fact, FigureItem, Report, Section, Table, Verdict, control_charts, drift_figure

_RUNS = (
    "Values between two false alarms, and until a change of the mean by one sigma is found, on average: single values "
    f"{shewhart_run_length():.0f} and {shewhart_run_length(1.0):.0f}, EWMA {ewma_run_length():.0f} and "
    f"{ewma_run_length(1.0):.1f}, CUSUM {cusum_run_length():.0f} and {cusum_run_length(1.0):.1f}; for known centre and "
    "sigma."
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
        sections=(_summary(reviews), *(_quantity(review) for review in reviews), _records(entries)),
        versions=software_versions(),
        command=command,
        created=created,
    )


def history_section(reviews: Sequence[Review]) -> Section:
    """Return the history's part of another report: its quantities over time, this record's value the last.

    Quantities of one record only are in the table alone: a single value is no history.
    """
    shown = [review for review in reviews if len(review.series.values) > 1]
    figures = tuple(
        FigureItem(
            f"History of {review.series.quantity}",
            control_charts(review) if review.charts else drift_figure(review),
            f"{len(review.series.values)} records of {review.series.quantity}"
            + (f"; beyond the limits: {_signals(review)}." if review.charts else ", too few for control limits."),
        )
        for review in shown
    )
    verdict = history_verdict(reviews).sentence if shown else "No earlier record of the rig holds these quantities."
    return Section("History", (verdict,), _summary(reviews).tables, figures, side_by_side=True)


def _signals(review: Review) -> str:
    return "; ".join(f"{chart.kind} {len(chart.signals)}" for chart in review.charts)


def history_verdict(reviews: Sequence[Review]) -> Verdict:
    """Say whether any chart is in alarm at its last value; a chart warns, it does not judge a tolerance."""
    charted = [review for review in reviews if review.charts]
    if not charted:
        return Verdict("info", "Too few records for a control chart.")
    alarms = [f"{review.series.quantity} ({', '.join(review.alarms)})" for review in charted if review.alarms]
    if alarms:
        return Verdict("conditionalFail", f"Out of control at the last record: {'; '.join(alarms)}.")
    return Verdict("pass", f"All {len(charted)} charted quantities are in control at the last record.")


def review_table(reviews: Sequence[Review]) -> pd.DataFrame:
    """Tabulate one row per quantity: last value, limits of control, drift, and the suggested interval."""
    return pd.DataFrame([_row(review) for review in reviews])


def _row(review: Review) -> dict[str, object]:
    series, control, drift = review.series, review.baseline, review.drift
    return {
        "quantity": series.quantity,
        "unit": series.unit or "1",
        "records": len(series.values),
        "last": series.values[-1],
        "centre": control.centre if control else None,
        "sigma": control.sigma if control else None,
        "alarms": ", ".join(review.alarms) if control else None,
        "drift per year": drift.rate.value if drift else None,
        "u(drift)": drift.rate.u if drift else None,
        "p(drift)": drift.p_value if drift else None,
        "interval / days": review.interval.days if review.interval else None,
        "method": review.interval.method if review.interval else None,
    }


def _facts(reviews: Sequence[Review]) -> tuple[Fact, ...]:
    timed = [(review.interval, review.series.quantity) for review in reviews if review.interval]
    if not timed:
        return ()
    interval, quantity = min(timed, key=lambda one: one[0].days)
    return (
        Fact("Next calibration in", f"{interval.days:.0f} days", f"{quantity}, {interval.method}: {interval.reason}"),
    )


def _summary(reviews: Sequence[Review]) -> Section:
    note = "certified quantities: deviation from the certificate; sigma: mean moving range over 1.128, of the baseline"
    formats = {"interval / days": ".0f", "p(drift)": ".2g"}
    table = Table("Quantities", review_table(reviews), note, formats, {"drift per year": "u(drift)"})
    return Section("Quantities", (_RUNS,), (table,))


def _quantity(review: Review) -> Section:
    name = review.series.quantity
    sentences = [f"{interval.method}: {interval.days:.0f} days; {interval.reason}." for interval in review.intervals]
    if review.drift is not None:
        rate, kind = review.drift.rate, "significant" if review.drift.significant else "not significant"
        sentences.insert(
            0, f"Drift {rate.value:+.3g} {rate.unit}, u = {rate.u:.2g}, {kind} (p = {review.drift.p_value:.2g})."
        )
    if review.baseline is not None:
        share = review.baseline.u_sigma_relative
        sentences.append(f"sigma from {review.baseline.size} records is known to {share:.0%}, and so are the limits.")
    figures = [
        FigureItem(
            f"{name} over time", drift_figure(review), f"{len(review.series.values)} records of {name} over time."
        )
    ]
    if review.charts:
        alt = f"Four control charts of {name}; values beyond the limits: {_signals(review)}."
        figures.append(FigureItem(f"Control charts of {name}", control_charts(review), alt))
    notes = (f"{note[0].upper()}{note[1:]}." for note in review.notes)
    return Section(name, (*sentences, *notes), (), tuple(figures))


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
