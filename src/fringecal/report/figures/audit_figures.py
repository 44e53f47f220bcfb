"""Figures of an audit: every change against its limit, and how well each single cause explains them."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fringecal.report.style import BLUE, GREY, GUIDE_PT, ORANGE, new_figure, styled

_SURE_DECADES = 1.3  # odds of 20 to 1: a cause that is no less likely is not told from the best one
_WIDEST = 3.0  # limits; what lies beyond is drawn at the edge, with its number


@styled
def change_bars(
    names: Sequence[str],
    shares: Sequence[float],
    expanded: Sequence[float],
    *,
    label: str = "change / limit; shaded: within the limit",
    title: str = "",
) -> Figure:
    """Draw changes as shares of their limits, with 95 % intervals and the limits at -1 and 1.

    Parameters
    ----------
    names
        What changed.
    shares, expanded
        Change and its expanded uncertainty over the limit, each (n,).
    label
        What the bars show.
    title
        What was compared with what.
    """
    place, value = np.arange(len(names)), np.asarray(shares, float)
    shown = np.clip(value, -_WIDEST, _WIDEST)
    figure = new_figure(7.4, 1.5 + 0.36 * len(names))
    axes = figure.subplots()
    axes.axvspan(-1, 1, color=BLUE, alpha=0.10, lw=0)
    axes.axvline(0.0, color=GREY, lw=GUIDE_PT)
    colours = [ORANGE if abs(v) > 1 else BLUE for v in value]
    axes.barh(place, shown, color=colours, height=0.55)
    near = np.abs(value) < _WIDEST
    axes.errorbar(shown[near], place[near], xerr=np.asarray(expanded, float)[near], fmt="none", color="k", capsize=3)
    for y, v in zip(place[~near], value[~near], strict=True):
        axes.annotate(
            f"{v:+.3g}", (np.sign(v) * _WIDEST, y), textcoords="offset points", xytext=(-6 * np.sign(v), 0),
            ha="right" if v > 0 else "left", va="center", fontsize=9, color="white",
        )  # fmt: skip
    axes.set_yticks(place, names)
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.set(xlim=(-1.05 * _WIDEST, 1.05 * _WIDEST), xlabel=label, title=title)
    return figure


@styled
def cause_bars(names: Sequence[str], log_odds: Sequence[float], *, title: str = "") -> Figure:
    """Draw how much less likely every cause is than the best one.

    Parameters
    ----------
    names
        Causes, the likeliest first.
    log_odds
        Difference of log evidence to the best, 0 and negative, (n,).
    title
        What was explained.
    """
    place = np.arange(len(names))
    decades = np.abs(np.asarray(log_odds, float)) / np.log(10)
    figure = new_figure(7.4, 1.5 + 0.34 * len(names))
    axes = figure.subplots()
    bars = axes.barh(place, decades + 0.3, color=[ORANGE if d < _SURE_DECADES else BLUE for d in decades], height=0.6)
    axes.bar_label(bars, labels=[f"{d:.1f}" for d in decades], padding=4, fontsize=9)
    axes.set_xscale("log")
    axes.set_xlim(0.2, 3 * max(float(decades.max(initial=1.0)), 1.0) + 1)
    axes.set_yticks(place, names)
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.set(xlabel="decades less likely than the best; orange: not distinguished (odds under 20 to 1)", title=title)
    return figure
