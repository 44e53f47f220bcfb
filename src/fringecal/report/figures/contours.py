"""Lines of equal height over the plate."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fringecal.records import regular_grid, sample_spacing_mm
from fringecal.report.style import HEIGHT_MAP, INK, MASKED, WIDTH_IN, colourbar, new_figure, plate_axes, styled

_LONGEST_SIDE = 400  # nodes: contours of a finer grid show its noise
_LEVELS = 10  # lines, about: at round heights
_ENDS_PERCENT = (0.5, 99.5)  # of the heights, between which lines run: single wrong pixels have none


@styled
def contour_map(x_mm: np.ndarray, y_mm: np.ndarray, z_mm: np.ndarray, *, title: str = "") -> Figure:
    """Draw lines of equal height in the plate frame, y up, at round heights.

    Parameters
    ----------
    x_mm, y_mm, z_mm
        Coordinates and height per pixel (H, W), mm, NaN where masked.
    title
        What was measured.
    """
    known = np.isfinite(z_mm)
    x, y = np.where(known, x_mm, np.nan), np.where(known, y_mm, np.nan)
    coarse = max(np.ptp(x[known]), np.ptp(y[known])) / _LONGEST_SIDE
    grid = regular_grid(x, y, z_mm, spacing_mm=max(sample_spacing_mm(x, y), coarse), max_jump_mm=np.inf)
    levels = np.array(
        MaxNLocator(_LEVELS, steps=[1, 2, 5, 10]).tick_values(*np.nanpercentile(grid.z_mm, _ENDS_PERCENT))
    )
    # A line at 0 would draw the noise of the plate around the object.
    levels = levels[levels != 0] if np.count_nonzero(levels) > 1 else levels
    figure = new_figure(WIDTH_IN, 5.2)
    axes = figure.subplots()
    axes.set_facecolor(MASKED)
    filled = axes.contourf(grid.x_mm, grid.y_mm, grid.z_mm, levels=levels, cmap=HEIGHT_MAP, extend="both")
    lines = axes.contour(grid.x_mm, grid.y_mm, grid.z_mm, levels=levels, colors=INK, linewidths=0.5)
    axes.clabel(lines, fontsize=7, fmt="%g")
    plate_axes(axes)
    axes.set_title(title)
    colourbar(axes, filled, "height z / mm")
    return figure
