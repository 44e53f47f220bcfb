"""Figures of an audit: every change against its limit, and the probability of each single cause."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fringecal.report.style import BLUE, GREY, GUIDE_PT, ORANGE, new_figure, styled

_POSSIBLE = 5.0  # %: less likely causes are called unlikely
_LEAST_PERCENT = 0.1  # of probability: less likely causes are in the table alone
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
def cause_bars(names: Sequence[str], probabilities: Sequence[float], *, title: str = "") -> Figure:
    """Draw the probability of each cause, without those that are next to impossible.

    Parameters
    ----------
    names
        Causes, the likeliest first.
    probabilities
        Of each, (n,), 1 in all.
    title
        What was explained.
    """
    percent = 100 * np.asarray(probabilities, float)
    shown = max(int((percent >= _LEAST_PERCENT).sum()), 1)
    place = np.arange(shown)
    figure = new_figure(7.4, 1.5 + 0.34 * shown)
    axes = figure.subplots()
    bars = axes.barh(
        place, percent[:shown], color=[ORANGE if p >= _POSSIBLE else BLUE for p in percent[:shown]], height=0.6
    )
    axes.bar_label(bars, labels=[f"{p:.3g} %" for p in percent[:shown]], padding=4, fontsize=9)
    axes.set_xlim(0, 115)
    axes.set_yticks(place, names[:shown])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    others = len(names) - shown
    left = f"; {others} more below {_LEAST_PERCENT:g} % each" if others else ""
    axes.set(xlabel=f"probability / %; orange: likely or possible{left}", title=title)
    return figure
