"""Control charts over time: individuals, EWMA and CUSUM above one another, and the drift."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from fringecal.history import YEAR_DAYS, Chart, Review, Series
from fringecal.report.style import AMBER, BAND_ALPHA, BLUE, GREEN, GREY, GUIDE_PT, INK, ORANGE, new_figure, styled

_TITLES = {
    "individuals": "Single values, within what those before them leave (3 sigma)",
    "EWMA": "Exponentially weighted moving average of the deviates",
    "CUSUM": "Cumulative sums of the deviates, up and down",
}

_AHEAD = 0.25  # of the years that the history spans: as far as its line is carried on
_PLACES = 60  # of that line and its band
_FAR_LIMIT = 20  # times the largest deviation, from which on a limit would shrink the values to a line


@styled
def control_charts(review: Review) -> Figure:
    """Draw the control charts of one quantity above one another, signals marked and numbered by their record.

    Parameters
    ----------
    review
        With charts.
    """
    figure = new_figure(8.0, 2.1 * len(review.charts) + 0.6)
    panels = figure.subplots(len(review.charts), 1, sharex=True, squeeze=False)[:, 0]
    times = _times(review.series)[review.first :]
    for axes, chart in zip(panels, review.charts, strict=True):
        _draw(axes, times, chart)
        axes.set_title(_TITLES[chart.kind], loc="left")
        axes.set_ylabel(_label(review.series, chart), wrap=True)
    _date_axis(panels[-1])
    panels[0].plot([], [], color=ORANGE, ls="--", label="control limit")
    panels[0].plot([], [], color=ORANGE, marker="D", ls="", mfc="none", ms=8, label="beyond it")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.suptitle(review.series.quantity)
    return figure


def _draw(axes: Axes, times: np.ndarray, chart: Chart) -> None:
    axes.plot(times, chart.statistic, color=BLUE, marker="o", ms=3)
    axes.axhline(chart.centre, color=GREY, lw=GUIDE_PT)
    if chart.second is not None:
        axes.plot(times, chart.second, color=GREEN, marker="v", ms=3)
    for limit in (chart.upper, chart.lower):
        if limit is not None:
            axes.plot(times, limit, color=ORANGE, ls="--", lw=1)
    beyond = list(chart.signals)
    worst = chart.statistic[beyond]
    if chart.second is not None:
        worst = np.where(worst > chart.upper[beyond], worst, chart.second[beyond])
    axes.plot(times[beyond], worst, color=ORANGE, marker="D", ls="", mfc="none", ms=8)
    axes.margins(y=0.12)
    axes.ticklabel_format(axis="y", useOffset=False)


@styled
def drift_figure(review: Review) -> Figure:
    """Draw one quantity over time with the stated 95 % intervals, its line, and its permissible band.

    Parameters
    ----------
    review
        Of any quantity; the line is drawn where a drift could be fitted.
    """
    series = review.series
    figure = new_figure(8.0, 3.6)
    axes = figure.subplots()
    times = _times(series)
    axes.errorbar(
        times, series.values, yerr=np.nan_to_num(series.U), fmt="o", ms=4, color=BLUE, ecolor=GREY, capsize=2,
        label="record, bar U (95 %)",
    )  # fmt: skip
    if review.drift is not None:
        _draw_line(axes, times, review)
    if series.limit is not None and _worth_showing(series):
        for sign in (-1, 1):
            axes.axhline(series.reference + sign * series.limit, color=ORANGE, ls="--", lw=1)
        axes.plot([], [], color=ORANGE, ls="--", label="limit")
    axes.set(ylabel=_label(series, None), title=series.quantity)
    _date_axis(axes)
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def _draw_line(axes: Axes, times: np.ndarray, review: Review) -> None:
    drift, series = review.drift, review.series
    if drift is None:
        return
    years = np.linspace(-drift.span_years, _AHEAD * drift.span_years, _PLACES)
    forecasts = [drift.at(float(year)) for year in years]
    when = times.max() + (years * YEAR_DAYS * 86400e9).astype("timedelta64[ns]")
    low, high = np.array([one.interval_95 for one in forecasts]).T
    axes.plot(when, [one.value for one in forecasts], color=INK, lw=1.2, label=f"drift, {series.unit or '1'} per year")
    axes.fill_between(when, low, high, color=AMBER, alpha=BAND_ALPHA, lw=0, label="95 % of single records")


def _worth_showing(series: Series) -> bool:
    """Tell whether limits would not shrink the values to a line."""
    reach = np.abs(series.values - series.reference).max()
    return series.limit is not None and series.limit < _FAR_LIMIT * max(reach, 1e-300)


def _times(series: Series) -> np.ndarray:
    return pd.to_datetime(list(series.captured), utc=True, format="ISO8601").tz_localize(None).to_numpy()


def _label(series: Series, chart: Chart | None) -> str:
    of_deviates = {"EWMA": "EWMA / sigma", "CUSUM": "CUSUM / sigma"}
    if chart is not None and chart.kind in of_deviates:
        return of_deviates[chart.kind]
    return f"{'deviation' if series.certified else 'value'} / {series.unit or '1'}"


def _date_axis(axes: Axes) -> None:
    locator = AutoDateLocator()
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
