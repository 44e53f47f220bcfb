"""Pictures of a study: coverage with its band, and errors over their stated uncertainties."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from fringecal.report.style import BLUE, GREY, ORANGE, WIDTH_IN, new_figure, styled
from fringecal.uncertainty import COVERAGE

_Z_MOST = 4.0  # beyond it errors are gathered in the outermost bars: by chance one in sixteen thousand
_BINS = 16  # half a standard uncertainty each


@styled
def coverage_bars(
    names: Sequence[str],
    coverage: Sequence[float],
    bands: Sequence[tuple[float, float]],
    *,
    wanted: tuple[float, float],
) -> Figure:
    """Draw the coverage of 95 % intervals with its binomial band, one row per quantity.

    Parameters
    ----------
    names
        The quantities.
    coverage
        Share of intervals that hold the true value.
    bands
        Lower and upper end of each share's 95 % band.
    wanted
        Where coverage should lie.
    """
    figure = new_figure(WIDTH_IN, 1.4 + 0.26 * len(names))
    axes = figure.subplots()
    share, ends = 100 * np.asarray(coverage, float), 100 * np.asarray(bands, float)
    place = np.arange(len(names))
    axes.axvspan(100 * wanted[0], 100 * wanted[1], color=GREY, alpha=0.15, lw=0, label="wanted")
    axes.axvline(100 * COVERAGE, color=GREY, lw=1)
    axes.hlines(place, ends[:, 0], ends[:, 1], color=BLUE, label="95 % band of a finite number of rigs")
    axes.plot(share, place, "o", color=BLUE, label="found")
    axes.set_yticks(place, names)
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.set(xlabel="95 % intervals that hold the true value / %")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


@styled
def z_histograms(scores: Mapping[str, np.ndarray]) -> Figure:
    """Draw errors over their standard uncertainties beside the standard normal density.

    Parameters
    ----------
    scores
        By panel title: errors over u.
    """
    figure = new_figure(WIDTH_IN, 2.8)
    panels = np.atleast_1d(figure.subplots(1, len(scores), sharey=True))
    edges = np.linspace(-_Z_MOST, _Z_MOST, _BINS + 1)
    at = np.linspace(-_Z_MOST, _Z_MOST, 161)
    for axes, (title, z) in zip(panels, scores.items(), strict=True):
        axes.hist(np.clip(z, -_Z_MOST, _Z_MOST), bins=edges.tolist(), density=True, color=BLUE, alpha=0.6)
        axes.plot(at, np.exp(-(at**2) / 2) / np.sqrt(2 * np.pi), color=ORANGE)
        axes.set(title=title, xlabel="error / u")
    panels[0].set_ylabel("density")
    return figure
