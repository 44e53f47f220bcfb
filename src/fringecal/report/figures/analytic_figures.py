"""An object drawn by formula and read back: image, phase, height and sections in one figure."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fringecal.report.figures.phase_figures import map_picture
from fringecal.report.style import (
    AMBER,
    BLUE,
    GREY,
    GUIDE_PT,
    HEIGHT_MAP,
    PHASE_MAP,
    SMALL_PT,
    colourbar,
    new_figure,
    styled,
)


@styled
def analytic_overview(
    image: np.ndarray,
    phase_rad: np.ndarray,
    height_px: np.ndarray,
    true_px: np.ndarray,
    *,
    rows: Sequence[int],
    title: str = "",
) -> Figure:
    """Draw the first image, the wrapped phase, the height read from it, and sections on what was drawn.

    Parameters
    ----------
    image, phase_rad, height_px, true_px
        Grey values, wrapped phase, height read and height drawn, (H, W).
    rows
        Picture rows of the sections.
    title
        Which object.
    """
    figure = new_figure(10.0, 8.0)
    (picture, phase), (height, sections) = figure.subplots(2, 2)
    _map(picture, image, "gray", "first of three images / grey levels")
    _map(phase, phase_rad, PHASE_MAP, "wrapped phase / rad")
    _map(height, height_px, HEIGHT_MAP, "height read / px")
    for row in rows:
        picture.axhline(row, color=AMBER, lw=GUIDE_PT)
    _sections(sections, height_px, true_px, rows)
    figure.suptitle(title)
    return figure


def _map(axes: Axes, values: np.ndarray, colours: str, label: str) -> None:
    shown = map_picture(axes, values)
    shown.set(cmap=colours, clim=(float(np.nanmin(values)), float(np.nanmax(values))))
    colourbar(axes, shown, label)


def _sections(axes: Axes, height_px: np.ndarray, true_px: np.ndarray, rows: Sequence[int]) -> None:
    """Draw the sections one above the other, what was drawn as a broad line under what was read."""
    apart = 1.5 * max(float(np.ptp(true_px)), 1.0)
    for place, row in enumerate(rows):
        first = place == 0
        axes.plot(true_px[row] + place * apart, color=GREY, lw=3.5, alpha=0.5, label="drawn" if first else None)
        axes.plot(height_px[row] + place * apart, color=BLUE, lw=1.0, label="read" if first else None)
        axes.annotate(f"row {row}", (2, place * apart), xytext=(0, 3), textcoords="offset points", fontsize=SMALL_PT)
    axes.set(xlabel="u / px", ylabel="height / px, sections set apart")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
