"""How every figure looks: palette, colour maps, and figures made without pyplot's global state."""

import functools
from collections.abc import Callable
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure

# Okabe and Ito 2008, "Color Universal Design": told apart with any common colour vision.
INK = "#1b1f24"
GREY = "#6b7280"
BLUE = "#0072B2"
ORANGE = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
AMBER = "#E69F00"
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, SKY, AMBER)

# Sequential for heights, diverging for signed errors, cyclic for wrapped phase; all keep their
# order of lightness in grey print.
HEIGHT_MAP = "viridis"
ERROR_MAP = "RdBu_r"
PHASE_MAP = "twilight"
MASKED = "#d4d4d8"

WIDTH_IN = 7.0
"""Width of a figure, inches: a sheet of A4 between its margins."""

SMALL_PT, GUIDE_PT, BAND_ALPHA = 8, 0.8, 0.25
"""Size of words inside a figure and width of lines that only guide the eye, points; opacity of a 95 % band, under which
curves of two bands still show."""

SCALE_PERCENT = (1, 99)
"""Percentiles of a map's values between which its colours run: single wrong pixels must not bleach it."""

_SIGNED_PERCENT = 99.5  # likewise, of the absolute values of a map with sign

RC: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.labelsize": 10.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": f"cycler('color', {list(PALETTE)})",
    "axes.grid": False,
    "axes.axisbelow": True,
    "grid.color": "#e5e7eb",
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.4,
    "image.interpolation": "nearest",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "fringecal",
}


def styled[**P](draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Run a drawing function under the house style and leave matplotlib's settings as they were."""

    @functools.wraps(draw)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(RC):
            return draw(*args, **kwargs)

    return wrapped


def new_figure(width_in: float = WIDTH_IN, height_in: float = 4.5) -> Figure:
    """Make an empty figure that spaces its own labels; draw on it inside a `styled` function."""
    return Figure(figsize=(width_in, height_in), dpi=110, layout="constrained")


def symmetric_limit(values: np.ndarray, *, percentile: float = _SIGNED_PERCENT) -> float:
    """Find the limit of a diverging scale: the percentile of the absolute finite values.

    A percentile, not the maximum, so that one bad pixel does not bleach the whole map; what lies
    beyond is drawn in the end colours, which `colourbar` marks with arrows.

    Examples
    --------
    >>> float(symmetric_limit(np.array([-2.0, 1.0, np.nan]), percentile=100))
    2.0
    """
    finite = np.abs(values[np.isfinite(values)])
    limit = float(np.percentile(finite, percentile)) if finite.size else 0.0
    return limit if limit > 0 else 1.0


def colourbar(axes: Axes, mappable: ScalarMappable, label: str, *, extend: str = "neither") -> Colorbar:
    """Add a colour bar whose label states quantity and unit."""
    figure = axes.get_figure(root=True)
    if figure is None:
        raise ValueError("axes without a figure; make them with new_figure().subplots()")
    bar = figure.colorbar(mappable, ax=axes, extend=extend, shrink=0.9, pad=0.02)
    bar.set_label(label)
    bar.outline.set_visible(False)  # type: ignore[operator]
    return bar


def plate_axes(axes: Axes) -> None:
    """Label axes as the plate frame: x to the right, y up, both in mm and to the same scale."""
    axes.set_xlabel("x / mm")
    axes.set_ylabel("y / mm")
    axes.set_aspect("equal")


def image_axes(axes: Axes) -> None:
    """Label axes as picture coordinates: column u to the right, row v down, in px."""
    axes.set_xlabel("u (column) / px")
    axes.set_ylabel("v (row) / px")
    axes.set_aspect("equal")
