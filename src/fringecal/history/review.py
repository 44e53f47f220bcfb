"""Evaluation of one rig's history: charts, drift and next date for each quantity, gauge studies from repeats."""

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.errors import HistoryError
from fringecal.history.charts import Baseline, Chart, baseline_of, cusum_chart, ewma_chart
from fringecal.history.drift import Drift, drift_of, jumps_of, split_at
from fringecal.history.due import Due, beyond_the_limit, due_of
from fringecal.history.entries import CHANGE, CHECK
from fringecal.history.self_starting import self_starting_deviates, self_starting_individuals
from fringecal.uncertainty import coverage_factor

Floats = NDArray[np.float64]
_STANDARD = Baseline(0.0, 1.0)  # of deviates


@dataclass(frozen=True)
class Series:
    """One quantity of one rig in the order of capture.

    `values` are deviations from the certificate where there is one, else the values themselves; `U` their expanded
    uncertainties (95 %), NaN where none is stated. `limit` is the largest permissible distance from `reference`, None
    where none is known. `calibrated` are the days at which the rig was calibrated, from the same origin as `days`.
    `signed` tells a change, which chance leaves at nought on average, from an rms, which it never does.
    """

    quantity: str
    unit: str
    captured: tuple[str, ...]
    days: Floats
    values: Floats
    U: Floats
    certified: bool
    limit: float | None
    reference: float
    calibrated: tuple[float, ...] = ()
    signed: bool = True

    @property
    def change(self) -> bool:
        """Whether the values are changes since the calibration in force, which a new one sets to zero."""
        return self.quantity.startswith(CHANGE)

    @property
    def first_in_force(self) -> int:
        """Index of the first record since the last calibration before the last record, of changes; else 0."""
        before = [day for day in self.calibrated if day < self.days[-1]]
        return int(np.searchsorted(self.days, max(before), side="right")) if self.change and before else 0


@dataclass(frozen=True)
class Review:
    """Evaluation of one quantity's history; `notes` state what could not be determined, and why.

    `charts` begin at the record `first`; `jumps` are the times of capture from which on the level is another.
    """

    series: Series
    baseline: Baseline | None
    charts: tuple[Chart, ...]
    drift: Drift | None
    due: Due
    notes: tuple[str, ...]
    first: int = 0
    jumps: tuple[str, ...] = ()

    @property
    def alarms(self) -> tuple[str, ...]:
        """Charts whose last value is beyond a limit."""
        return tuple(chart.kind for chart in self.charts if chart.alarm)

    @property
    def out(self) -> bool:
        """Whether the last value is beyond the limit."""
        series = self.series
        return series.limit is not None and abs(float(series.values[-1]) - series.reference) > series.limit


def reviews_of(
    readings: pd.DataFrame,
    quantities: Collection[str] = (),
    *,
    limit: float | None = None,
    reference: float | None = None,
    baseline: int | None = None,
) -> tuple[Review, ...]:
    """Review the quantities of one rig, each with all its records and the rig's calibrations.

    Checks are left out unless they are named: a chance, a count or a score has a limit, but is no deviation that
    drifts toward it, and judges the session that it was taken in.

    Parameters
    ----------
    readings
        Rows of `History.readings` for one rig, all quantities.
    quantities
        Those wanted; all but checks by default.
    limit, reference, baseline
        As for `series_of` and `review_series`.
    """
    named = set(readings["quantity"])
    wanted = list(quantities) or sorted(name for name in named if not name.startswith(CHECK))
    calibrated = tuple(sorted(set(readings[readings["kind"] == "calibration"]["captured"])))
    series = (
        series_of(readings[readings["quantity"] == one], limit=limit, reference=reference, calibrated=calibrated)
        for one in wanted
    )
    return tuple(review_series(one, baseline=baseline) for one in series)


def series_of(
    readings: pd.DataFrame,
    *,
    limit: float | None = None,
    reference: float | None = None,
    calibrated: Collection[str] = (),
) -> Series:
    """Take one quantity out of the table of readings of one rig.

    Parameters
    ----------
    readings
        Rows of `History.readings` for one rig and quantity.
    limit, reference
        Largest permissible distance from the reference, in the quantity's unit. By default that of the last record;
        of a certified quantity the root sum of squares of the expanded uncertainties of value and certificate (where
        `en_score` is 1), about 0; of a check none.
    calibrated
        Times at which the rig was calibrated.

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
    numbers = readings[["value", "u", "dof", "reference", "u_reference", "limit", "en"]].astype(float)
    numbers["U"] = numbers["u"] * [coverage_factor(dof) for dof in numbers["dof"].fillna(np.inf)]
    certified = bool(numbers["reference"].notna().all())
    quantity = str(readings["quantity"].iloc[0])
    values = numbers["value"] - numbers["reference"] if certified else numbers["value"]
    limit = _limit(numbers.iloc[-1], quantity, certified) if limit is None else limit
    days = pd.to_datetime(readings["captured"], utc=True, format="ISO8601")
    made = pd.to_datetime(pd.Series(list(calibrated), dtype=object), utc=True, format="ISO8601")
    return Series(
        quantity,
        str(readings["unit"].iloc[0]),
        tuple(readings["captured"]),
        _days(days, days.iloc[0]),
        np.asarray(values, float),
        np.asarray(numbers["U"], float),
        certified,
        limit if np.isfinite(limit) and limit > 0 else None,
        0.0 if reference is None else reference,
        tuple(_days(made, days.iloc[0])),
        bool(numbers["en"].notna().all()),
    )


def _days(times: pd.Series, first: pd.Timestamp) -> Floats:
    return np.asarray((times - first).dt.total_seconds() / 86400, float)


def _limit(last: pd.Series, quantity: str, certified: bool) -> float:
    """Return the limit of the last record; NaN where there is none that a deviation could reach."""
    if certified:
        return math.hypot(last["U"], coverage_factor() * last["u_reference"])
    return math.nan if quantity.startswith(CHECK) else float(last["limit"])


def review_series(series: Series, *, baseline: int | None = None) -> Review:
    """Chart one quantity, fit its drift and say when to look again.

    Parameters
    ----------
    series
        The quantity.
    baseline
        How many of the first values, known to be in control, judge those after them; by default each value is judged
        by all before it.
    """
    notes: list[str] = []
    first = series.first_in_force
    control: Baseline | None = None
    charts: tuple[Chart, ...] = ()
    try:
        charts = _charts(series.values[first:], baseline)
        control = baseline_of(series.values[first:], size=baseline)
    except HistoryError as error:
        notes.append(f"no control chart: {error}" + (" since the last calibration" if first else ""))
    if baseline and any(signal < baseline for chart in charts for signal in chart.signals):
        notes.append("the baseline itself holds values beyond the limits: it was not in control")
    days, values, parts = _track(series)
    jumps = jumps_of(days, values, parts=parts)
    drift, due = _forecast(series, days, values, split_at(parts, jumps), len(jumps))
    if drift is None:
        notes.append(f"no drift: {due.reason}")
    times = tuple(series.captured[int(np.searchsorted(series.days, days[k]))] for k in jumps)
    return Review(series, control, charts, drift, due, tuple(notes), first, times)


def _charts(values: Floats, baseline: int | None) -> tuple[Chart, ...]:
    deviates = self_starting_deviates(values, size=baseline)
    single = self_starting_individuals(values, size=baseline)
    return single, ewma_chart(deviates, _STANDARD), cusum_chart(deviates, _STANDARD)


def _track(series: Series) -> tuple[Floats, Floats, NDArray[np.int_]]:
    """Return days, values and parts of all records: a calibration ends a part, and is itself a change of nought."""
    if not (series.change or series.certified):
        return series.days, series.values, np.zeros(len(series.days), int)
    parts = np.searchsorted(np.asarray(series.calibrated), series.days, side="left")
    if not (series.change and series.signed):
        return series.days, series.values, parts
    begun = [k for k in range(1, len(series.calibrated) + 1) if k in set(parts)]
    days = np.concatenate([series.days, [series.calibrated[k - 1] for k in begun]])
    values = np.concatenate([series.values, np.full(len(begun), series.reference)])
    parts = np.concatenate([parts, np.array(begun, int)])
    order = np.lexsort((days, parts))
    return days[order], values[order], parts[order]


def _forecast(
    series: Series, days: Floats, values: Floats, parts: NDArray[np.int_], jumps: int
) -> tuple[Drift | None, Due]:
    """Fit the line through all records, and say when it reaches the limit."""
    try:
        drift = drift_of(days, values, parts=parts, unit=series.unit)
    except HistoryError as error:
        return None, _without_line(series, str(error))
    if series.limit is None:
        return drift, Due(None, "not enough to say", "no limit is known for this quantity; state one")
    off = series.values - series.reference
    return drift, due_of(series.days, off, series.limit, drift, reference=series.reference, jumps=jumps)


def _without_line(series: Series, why: str) -> Due:
    """Too few records: only one beyond its limit says anything."""
    last = float(series.values[-1]) - series.reference
    if series.limit is not None and abs(last) > series.limit:
        return beyond_the_limit(last, series.limit, series.unit)
    return Due(None, "not enough to say", why)


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
