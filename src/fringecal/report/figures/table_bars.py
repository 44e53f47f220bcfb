"""Bars beside the tables: shares of a budget, errors of models and filters."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fringecal.report.style import BAND_ALPHA, BLUE, GREY, GUIDE_PT, ORANGE, WIDTH_IN, new_figure, styled


@styled
def budget_bars(labels: Sequence[str], percents: Sequence[float], *, title: str = "") -> Figure:
    """Draw an uncertainty budget as bars, the largest share of the variance on top.

    Parameters
    ----------
    labels
        Name of each source of uncertainty.
    percents
        Its share of the variance, percent; negative where correlation cancels.
    title
        The quantity and its standard uncertainty.
    """
    order = np.argsort(percents, kind="stable")
    shares = np.asarray(percents, dtype=float)[order]
    figure = new_figure(WIDTH_IN, 1.5 + 0.32 * len(labels))
    axes = figure.subplots()
    bars = axes.barh(np.arange(len(labels)), shares, color=BLUE, height=0.65)
    axes.bar_label(bars, labels=[f"{share:.1f} %" for share in shares], padding=4, fontsize=9)
    axes.set_yticks(np.arange(len(labels)), [labels[place] for place in order])
    axes.tick_params(axis="y", length=0)
    low, high = shares.min(initial=0.0), max(shares.max(initial=0.0), 1.0)
    room = 0.15 * (high - low)  # for the numbers at the ends of the bars
    axes.set_xlim(low - room if low < 0 else 0.0, high + room)
    axes.set(xlabel="share of the variance / %", title=title)
    return figure


@styled
def comparison_bars(
    names: Sequence[str],
    mean: Sequence[float],
    sd: Sequence[float],
    max_abs: Sequence[float],
    *,
    unit: str = "% of full height",
    title: str = "",
) -> Figure:
    """Compare height models, or combinations of filters, by their errors: mean, scatter, largest.

    Parameters
    ----------
    names
        Name of each model or combination.
    mean, sd, max_abs
        Mean error, standard deviation and largest absolute error of each, in `unit`.
    unit
        Unit of all three.
    title
        Which artefact.
    """
    place = np.arange(len(names))
    figure = new_figure(WIDTH_IN, 1.7 + 0.42 * len(names))
    axes = figure.subplots()
    axes.barh(place, max_abs, color=BLUE, alpha=BAND_ALPHA, height=0.7, label="largest absolute error")
    axes.errorbar(
        mean,
        place,
        xerr=sd,
        color=ORANGE,
        fmt="o",
        ms=5,
        capsize=3,
        label="mean error, one standard deviation",
    )
    axes.axvline(0.0, color=GREY, lw=GUIDE_PT)
    axes.set_yticks(place, names)
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.set(xlabel=f"height error / {unit}", title=title)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
