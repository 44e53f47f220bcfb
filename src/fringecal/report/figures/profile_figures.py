"""Sections through a surface: measured against reference, and the error below."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fringecal.report.style import AMBER, BAND_ALPHA, BLUE, GREY, GUIDE_PT, INK, new_figure, styled, symmetric_limit
from fringecal.uncertainty import coverage_factor

_K_95 = coverage_factor()  # a single pixel's u is taken as exactly known


@styled
def profile_plot(
    position_mm: np.ndarray,
    measured_mm: np.ndarray,
    reference_mm: np.ndarray,
    u_mm: np.ndarray,
    *,
    left_out: np.ndarray | None = None,
    position_label: str = "x / mm",
    title: str = "",
) -> Figure:
    """Draw a measured profile on its reference with a 95 % band, and its error along the profile below.

    Parameters
    ----------
    position_mm
        Position along the profile (n,), mm.
    measured_mm, reference_mm
        Heights (n,), mm, NaN where there is none.
    u_mm
        Standard uncertainty of the measured heights (n,), mm; the band is the 95 % interval.
    left_out
        True at points of edge zones, which statistics leave out (n,); they are shaded.
    position_label
        What runs along the axis, with its unit.
    title
        Name and place of the profile.
    """
    figure = new_figure(7.4, 5.2)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    half = _K_95 * u_mm
    error_mm = measured_mm - reference_mm
    above.fill_between(
        position_mm,
        measured_mm - half,
        measured_mm + half,
        color=BLUE,
        alpha=BAND_ALPHA,
        lw=0,
        label="95 % interval",
    )
    above.plot(position_mm, reference_mm, color=INK, lw=1.0, ls="--", label="reference")
    above.plot(position_mm, measured_mm, color=BLUE, label="measured")
    above.set_ylabel("height z / mm")
    above.set_title(title)
    below.fill_between(position_mm, error_mm - half, error_mm + half, color=BLUE, alpha=BAND_ALPHA, lw=0)
    below.axhline(0.0, color=GREY, lw=GUIDE_PT)
    below.plot(position_mm, error_mm, color=BLUE, lw=1.0)
    below.set(xlabel=position_label, ylabel="error / mm")
    _limit_to_kept(below, error_mm, half, left_out)
    for axes in (above, below):
        _shade(axes, position_mm, left_out)
    figure.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


@styled
def sections_plot(
    positions_mm: Sequence[np.ndarray],
    heights_mm: Sequence[np.ndarray],
    u_mm: Sequence[np.ndarray],
    names: Sequence[str],
    *,
    position_label: str = "x / mm",
    title: str = "",
) -> Figure:
    """Draw sections through a surface one below the other on equal scales, each with its 95 % band.

    Parameters
    ----------
    positions_mm, heights_mm, u_mm
        Position along each section, heights and their standard uncertainties, mm; NaN leaves a gap.
    names
        Name and place of each section.
    position_label
        What runs along the axis, with its unit.
    title
        What was measured.
    """
    figure = new_figure(7.4, 1.0 + 1.7 * len(names))
    panels = figure.subplots(len(names), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, x, z, u, name in zip(panels, positions_mm, heights_mm, u_mm, names, strict=True):
        half = _K_95 * u
        axes.fill_between(x, z - half, z + half, color=BLUE, alpha=BAND_ALPHA, lw=0, label="95 % interval")
        axes.plot(x, z, color=BLUE, lw=1.0, label="measured")
        axes.grid(visible=True, axis="y")
        axes.set_title(name, loc="left", fontsize=9.5)
        axes.set_ylabel("z / mm")
    panels[-1].set_xlabel(position_label)
    figure.suptitle(title)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _limit_to_kept(axes: Axes, error_mm: np.ndarray, half: np.ndarray, left_out: np.ndarray | None) -> None:
    """Let the points that count set the scale of the error, not the edges that are left out."""
    kept = slice(None) if left_out is None else ~left_out
    limit = 1.15 * symmetric_limit(np.concatenate([(error_mm - half)[kept], (error_mm + half)[kept]]), percentile=100)
    axes.set_ylim(-limit, limit)


def _shade(axes: Axes, position_mm: np.ndarray, left_out: np.ndarray | None) -> None:
    if left_out is None or not left_out.any():
        return
    axes.fill_between(
        position_mm,
        0,
        1,
        where=left_out,
        transform=axes.get_xaxis_transform(),
        color=AMBER,
        alpha=0.18,
        lw=0,
        label="edge zone, left out",
    )
