"""Histories of simulated rigs, steady, drifting, jumping: do suggested dates hold the limit, do charts keep quiet?

    python benchmarks/rig_histories.py [number] [first seed]

Each history is drawn: 4 to 30 audits every 14 to 120 days with jitter, one to three calibrations, six changes whose
scatter is 2 to 25 % of the limit. Of a drifting rig one quantity runs off: along a line, ever slower, or as a random
walk. Of a jumping one it jumps once or twice. Every second seed is drawn, so that even and odd ones are two
populations. Values are made, not measured: no picture is drawn.
"""

import sys
from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd

from fringecal.history.charts import Baseline, cusum_chart, ewma_chart, individuals_chart
from fringecal.history.entries import Entry, Reading
from fringecal.history.review import reviews_of
from fringecal.history.standing import standing_of
from fringecal.history.store import readings_of

KINDS = ("steady", "drifting", "jumping")
QUANTITIES = 6
LIMIT = 1.0
START = datetime(2024, 1, 1, tzinfo=UTC)


def drawn_rig(kind, rng):
    """Days of audits and calibrations, scatter of each quantity, and the truth of each over the days."""
    number, gap = int(rng.integers(4, 31)), float(rng.uniform(14, 120))
    days = np.cumsum(gap * rng.uniform(0.7, 1.3, number))
    calibrated = np.sort(np.append(0.0, rng.uniform(days[0], days[-1] * 0.8, int(rng.integers(0, 3)))))
    calibrated = np.array([day for day in calibrated if np.abs(days - day).min() > 1])
    calibrated = calibrated if calibrated.size and calibrated[0] == 0 else np.append(0.0, calibrated)
    scatter = np.exp(rng.uniform(np.log(0.02), np.log(0.25), QUANTITIES))
    elapsed = days[-1] - calibrated[calibrated < days[-1]].max()
    return days, calibrated, scatter, moving(kind, elapsed, days, scatter[0], rng)


def moving(kind, elapsed, days, scatter, rng):
    """Return the true course of the first quantity as a function of the day, and what it is called."""
    sign = rng.choice([-1, 1])
    if kind == "drifting":
        # In units of the time since the last calibration: when the limit is reached.
        rate = LIMIT / (elapsed * np.exp(rng.uniform(np.log(0.8), np.log(6))))
        form = rng.choice(["line", "slower", "walk"], p=[0.5, 0.25, 0.25])
        if form == "line":
            return form, lambda t: sign * rate * np.asarray(t, float)
        if form == "slower":
            tau = days[-1] * rng.uniform(0.5, 2)
            return form, lambda t: sign * rate * tau * (1 - np.exp(-np.asarray(t, float) / tau))
        fine = np.arange(0, 6 * days[-1] + 400)
        walk = np.cumsum(rng.normal(0, rate * np.sqrt(elapsed), fine.size))
        return form, lambda t: np.interp(t, fine, walk)
    if kind == "jumping":
        at = rng.uniform(0, days[-1], int(rng.integers(1, 3)))
        sizes = sign * np.minimum(rng.uniform(4, 12, at.size) * scatter, rng.uniform(0.3, 1.1)) * rng.choice([-1, 1])
        return "jump", lambda t: (np.asarray(t, float)[..., None] >= at) @ sizes
    return "steady", lambda t: np.zeros_like(np.asarray(t, float))


def entries_of(days, calibrated, scatter, course, rng):
    """Calibrations and audits as the history holds them: changes since the calibration in force, with its error."""
    share = rng.uniform(0.3, 1.0)  # of an audit's scatter: a calibration takes more pictures
    entries, error, then = [], np.zeros(QUANTITIES), 0.0
    for day, is_calibration in sorted([(d, True) for d in calibrated] + [(d, False) for d in days]):
        captured = (START + timedelta(days=float(day))).isoformat()
        if is_calibration:
            error, then = rng.normal(0, share * scatter), day
            kind, readings = "calibration", (Reading("scale, mean", 0.7, "mm/px", 1e-4),)
        else:
            true = np.zeros(QUANTITIES)
            true[0] = float(course(day) - course(then))
            found = true + rng.normal(0, scatter) - error
            kind = "audit"
            readings = tuple(
                Reading(f"change of q{k}", x, "%", 2 * s, en=x / (4 * s), limit=LIMIT)
                for k, (x, s) in enumerate(zip(found.tolist(), scatter.tolist(), strict=True))
            )
        entries.append(Entry("rig", kind, captured, captured, f"{len(entries):064x}", "pass", readings))
    return entries, then


def history_of(seed):
    """One history: its kind and form, reviews, and whether the date that they give holds the limit."""
    rng = np.random.default_rng(seed)
    kind = KINDS[(seed // 2) % 3]
    days, calibrated, scatter, (form, course) = drawn_rig(kind, rng)
    entries, then = entries_of(days, calibrated, scatter, course, rng)
    readings = pd.concat([readings_of(one).astype(object) for one in entries], ignore_index=True)
    reviews = [one for one in reviews_of(readings) if one.series.quantity.startswith("change")]
    standing = standing_of(reviews)
    found = {"seed": seed, "kind": kind, "form": form, "usual": float(np.median(np.diff(days)))}
    found["in_force"] = int((days > then).sum())
    if standing.due is None:
        return found | {"method": "not enough to say", "days": np.nan, "holds": None}, reviews
    ahead = (standing.due - START).total_seconds() / 86400
    at = np.linspace(days[-1], max(ahead, days[-1]), 50)
    reached = np.abs(course(at) - course(then)).max()
    review = standing.next_review
    more = {"method": review.due.method, "days": review.due.days, "quantity": review.series.quantity}
    return found | more | {"holds": bool(reached <= LIMIT) or review.due.days == 0}, reviews


def alarms(seed, reviews):
    """Records judged and beyond the limits of each chart, and the same of charts with known centre and sigma."""
    rng = np.random.default_rng((seed, 1))
    rows = []
    for review in reviews:
        if not review.charts:
            continue
        known = rng.normal(size=len(review.charts[0].statistic))
        normal = Baseline(0.0, 1.0)
        charts = (make(known, normal).signals for make in (individuals_chart, ewma_chart, cusum_chart))
        rows += [
            (chart.kind, len(known), len(chart.signals), bool(chart.signals), len(twin), len(twin) > 0)
            for chart, twin in zip(review.charts, charts, strict=True)
        ]
    return rows


def main(number=200, first=0):
    results, rows = [], []
    for seed in range(first, first + 2 * number, 2):
        found, reviews = history_of(seed)
        results.append(found)
        if found["kind"] == "steady":
            rows += alarms(seed, reviews)
    table = pd.DataFrame(results)
    for kind, group in table.groupby("kind"):
        dated = group[group["days"].notna()]
        print(f"{kind}: {len(group)} histories, {len(dated)} with a date")
        print(f"  the limit holds until the date: {int(dated['holds'].sum())} of {len(dated)}")
        short = dated[dated["days"] < 0.99 * dated["usual"]]
        told = short["method"].value_counts().to_dict()
        print(f"  sooner than the usual interval: {len(short)} of {len(dated)} {told}")
        share = (dated["days"] / dated["usual"]).quantile([0.25, 0.5, 0.75])
        print(f"  date over the usual interval, quartiles: {share.round(2).tolist()}")
        print(f"  methods {group['method'].value_counts().to_dict()}")
        if kind == "drifting":
            print(dated.groupby("form")["holds"].agg(["sum", "size"]).to_string())
    print("steady rigs, charts: share of records beyond the limits, of series with any; (with known centre and sigma)")
    charts = pd.DataFrame(rows, columns=["kind", "records", "beyond", "any", "known", "any_known"])
    for kind, group in charts.groupby("kind"):
        records = group["records"].sum()
        print(
            f"  {kind}: {100 * group['beyond'].sum() / records:.2f} % ({100 * group['known'].sum() / records:.2f} %), "
            f"{100 * group['any'].mean():.1f} % ({100 * group['any_known'].mean():.1f} %) of {len(group)}"
        )
    return table


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
