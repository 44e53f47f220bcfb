"""Figures of fringe orders: the phase within its cycle, the absolute phase, and a section through it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fringecal.numerics import TURN
from fringecal.phase import AbsolutePhase, FringeOrders
from fringecal.report.figures.phase_figures import map_picture
from fringecal.report.style import BLUE, GREY, HEIGHT_MAP, PHASE_MAP, colourbar, new_figure, styled


@styled
def orders_overview(orders: FringeOrders, absolute: AbsolutePhase, *, title: str = "") -> Figure:
    """Draw the phase within its cycle, the absolute phase, and a section along the row that shows most of it.

    Parameters
    ----------
    orders
        Orders within a cycle.
    absolute
        The same counted over the picture.
    title
        Which capture.
    """
    height, width = orders.phase.shape
    figure = new_figure(10.5, min(14.0, 3.6 + 5.0 * height / width))
    grid = figure.add_gridspec(2, 2, height_ratios=[5.0 * height / width, 2.4])
    cycle, whole = (figure.add_subplot(grid[0, k]) for k in (0, 1))
    _map(cycle, orders.phase / TURN, "fringe within the cycle", (-0.5, orders.cycle - 0.5), PHASE_MAP)
    by = f"{len(orders.ratios) + 1} periods, cycle" if orders.ratios else "Gray code"
    cycle.set_title(f"orders by {by} of {orders.cycle} fringes")
    known = absolute.phase[np.isfinite(absolute.phase)] / TURN
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    _map(whole, absolute.phase / TURN, "absolute phase / fringes", (low, high), HEIGHT_MAP)
    whole.set_title("counted over the picture" + ("" if absolute.in_one_cycle else ": the largest piece"))
    _section(figure.add_subplot(grid[1, :]), orders, absolute)
    figure.suptitle(title)
    return figure


def _map(axes: Axes, values: NDArray, label: str, limits: tuple[float, float], colours: str) -> None:
    """Draw a map with its scale."""
    image = map_picture(axes, values)
    image.set(cmap=colours, clim=limits)
    colourbar(axes, image, label)


def _section(axes: Axes, orders: FringeOrders, absolute: AbsolutePhase) -> None:
    """Draw one row: counted over the picture, and what is known within a cycle only."""
    row = int(np.isfinite(orders.phase).sum(axis=1).argmax())
    axes.plot(orders.phase[row] / TURN, ".", color=GREY, markersize=1.5, label="within the cycle")
    axes.plot(absolute.phase[row] / TURN, ".", color=BLUE, markersize=1.5, label="absolute")
    axes.set_xlabel("u / px")
    axes.set_ylabel("fringes")
    axes.set_title(f"row {row}")
    axes.legend(loc="best", markerscale=6)
