"""Evaluation of one rig's history: charts, drift and interval for each quantity, gauge studies from repeats."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.errors import HistoryError
from fringecal.history.charts import (
    Baseline,
    Chart,
    baseline_of,
    cusum_chart,
    ewma_chart,
    individuals_chart,
    moving_range_chart,
)
from fringecal.history.drift import Drift, Interval, chart_interval, drift_of, staircase
from fringecal.uncertainty import coverage_factor


@dataclass(frozen=True)
class Series:
    """One quantity of one rig in the order of capture.

    `values` are deviations from the certificate where there is one, else the values themselves; `U` their expanded
    uncertainties (95 %), NaN where none is stated. `limit` is the largest permissible distance from `reference`, None
    where none is known.
    """

    quantity: str
    unit: str
    captured: tuple[str, ...]
    days: NDArray[np.float64]
    values: NDArray[np.float64]
    U: NDArray[np.float64]
    certified: bool
    limit: float | None
    reference: float


@dataclass(frozen=True)
class Review:
    """Evaluation of one quantity's history; `notes` state what could not be determined, and why."""

    series: Series
    baseline: Baseline | None
    charts: tuple[Chart, ...]
    drift: Drift | None
    intervals: tuple[Interval, ...]
    notes: tuple[str, ...]

    @property
    def alarms(self) -> tuple[str, ...]:
        """Charts whose last value is beyond a limit."""
        return tuple(chart.kind for chart in self.charts if chart.alarm)

    @property
    def interval(self) -> Interval | None:
        """The shorter of the suggested intervals."""
        return min(self.intervals, key=lambda interval: interval.days, default=None)


def series_of(readings: pd.DataFrame, *, limit: float | None = None, reference: float | None = None) -> Series:
    """Take one quantity out of the table of readings of one rig.

    Parameters
    ----------
    readings
        Rows of `History.readings` for one rig and quantity.
    limit, reference
        Largest permissible distance from the reference, in the quantity's unit. By default those of the last check;
        of a certified quantity the root sum of squares of the expanded uncertainties of value and certificate (where
        `en_score` is 1), about 0.

    Raises
    ------
    HistoryError
        There are no rows, or they mix rigs, quantities or units.
    """
    if readings.empty:
        raise HistoryError("the history holds no such quantity of this rig; `fringecal history show` lists them")
    for column in ("rig", "quantity", "unit"):
        if readings[column].nunique() > 1:
            raise HistoryError(f"one {column} was needed, found {', '.join(sorted(set(readings[column])))}")
    numbers = readings[["value", "u", "dof", "reference", "u_reference", "limit"]].astype(float)
    numbers["U"] = numbers["u"] * [coverage_factor(dof) for dof in numbers["dof"].fillna(np.inf)]
    certified = bool(numbers["reference"].notna().all())
    last, quantity = numbers.iloc[-1], str(readings["quantity"].iloc[0])
    values = numbers["value"] - numbers["reference"] if certified else numbers["value"]
    if limit is None:
        both = math.hypot(last["U"], coverage_factor() * last["u_reference"])
        limit = both if certified else float(last["limit"])
    days = pd.to_datetime(readings["captured"], utc=True, format="ISO8601")
    return Series(
        quantity,
        str(readings["unit"].iloc[0]),
        tuple(readings["captured"]),
        np.asarray((days - days.iloc[0]).dt.total_seconds() / 86400, float),
        np.asarray(values, float),
        np.asarray(numbers["U"], float),
        certified,
        limit if np.isfinite(limit) and limit > 0 else None,
        0.0 if reference is None else reference,
    )


def review_series(series: Series, *, baseline: int | None = None) -> Review:
    """Chart one quantity, fit its drift and suggest when to look again.

    Parameters
    ----------
    series
        The quantity.
    baseline
        How many of the first values were in control; 20, or all where there are fewer.
    """
    notes: list[str] = []
    control: Baseline | None = None
    charts: tuple[Chart, ...] = ()
    try:
        control = baseline_of(series.values, size=baseline)
        charts = _charts(series, control)
    except HistoryError as error:
        notes.append(f"no control chart: {error}")
    if control and any(signal < control.size for chart in charts[:2] for signal in chart.signals):
        notes.append("the baseline itself holds values beyond the limits: it was not in control")
    drift = None
    try:
        drift = drift_of(series.days, series.values, unit=series.unit)
    except HistoryError as error:
        notes.append(f"no drift: {error}")
    intervals = _intervals(series, drift, notes)
    return Review(series, control, charts, drift, intervals, tuple(notes))


def _charts(series: Series, control: Baseline) -> tuple[Chart, ...]:
    makers = (individuals_chart, moving_range_chart, ewma_chart, cusum_chart)
    return tuple(make(series.values, control) for make in makers)


def _intervals(series: Series, drift: Drift | None, notes: list[str]) -> tuple[Interval, ...]:
    if series.limit is None:
        notes.append("no interval: no limit is known for this quantity; state one")
        return ()
    found = []
    gaps = np.diff(series.days)
    if len(gaps) and gaps[-1] > 0:
        ratio = abs(series.values[-1] - series.reference) / series.limit
        found.append(staircase(float(gaps[-1]), [ratio]))
    if drift is not None:
        try:
            found.append(chart_interval(drift, series.limit, reference=series.reference))
        except HistoryError as error:
            notes.append(f"no interval from the drift: {error}")
    return tuple(found)


@dataclass(frozen=True)
class Repeats:
    """Repeated readings of one artefact's numbers: array (parts, operators, trials) with the names of its axes."""

    readings: NDArray[np.float64]
    parts: tuple[str, ...]
    operators: tuple[str, ...]
    references: NDArray[np.float64]
    unit: str


def repeats_of(readings: pd.DataFrame, artefact: str) -> Repeats:
    """Arrange the verifications of one artefact as a crossed gauge study.

    Parts are the certified numbers of the artefact (its steps, for example), trials the repeated verifications of
    each operator; where operators have different numbers of them, the first ones count.

    Parameters
    ----------
    readings
        Rows of `History.readings` of one rig.
    artefact
        Name of the target.

    Raises
    ------
    HistoryError
        No operator has verified the artefact twice.
    """
    rows = readings[readings["quantity"].str.startswith(f"{artefact}: ") & readings["reference"].notna()]
    rows = rows[rows["unit"] == "mm"].assign(operator=rows["operator"].fillna("not named"))
    if rows.empty:
        names = sorted({q.split(": ")[0] for q in readings["quantity"] if ": " in q and not q.startswith("check: ")})
        raise HistoryError(
            f"no certified numbers of {artefact!r} in the history; it holds {', '.join(names) or 'none'}"
        )
    rows = rows.assign(trial=rows.groupby(["quantity", "operator"]).cumcount())
    trials = int(rows.groupby(["quantity", "operator"]).size().unstack(fill_value=0).to_numpy().min())
    if trials < 2:
        raise HistoryError(f"every operator must verify {artefact!r} twice at least, found {trials} in common")
    kept = rows[rows["trial"] < trials].sort_values(["quantity", "operator", "trial"])
    parts, operators = (tuple(sorted(set(kept[name]))) for name in ("quantity", "operator"))
    cube = np.asarray(kept["value"], float).reshape(len(parts), len(operators), trials)
    references = np.asarray(kept.groupby("quantity")["reference"].last(), float)
    return Repeats(cube, parts, operators, references, "mm")
