"""A measured surface seen obliquely from above."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fringecal.errors import RecordError
from fringecal.report.style import HEIGHT_MAP, new_figure, styled

_FACETS_PER_SIDE = 160  # more are finer than the picture shows
_TICKS, _FLAT_TICKS = 5, 3  # of the height, and on a flat box
_FLAT = 0.25  # of the longest side: a box that is lower is flat
_LEAST_SIDE = 0.02  # of the longest side: a box without height cannot be drawn


@styled
def surface_view(
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    z_mm: np.ndarray,
    *,
    exaggeration: float = 1.0,
    stride: int | None = None,
    unit: str = "mm",
    title: str = "",
) -> Figure:
    """Draw a surface in three dimensions, the viewer at the lower edge of the picture.

    Parameters
    ----------
    x_mm, y_mm, z_mm
        Plate-frame coordinates per pixel (H, W), mm, NaN where masked.
    exaggeration
        Factor by which heights are stretched against x and y; stated in the axis label.
    stride
        Draw every stride-th row and column; by default about 160 facets along the longer side.
    unit
        Of all three coordinates.
    title
        What was measured.

    Raises
    ------
    RecordError
        No pixel is valid.
    """
    step = stride or max(1, max(z_mm.shape) // _FACETS_PER_SIDE)
    x, y, z = (part[::step, ::step] for part in (x_mm, y_mm, z_mm))
    if not np.isfinite(z).any():
        raise RecordError("no pixel of the surface is valid; there is nothing to draw, check its mask")
    figure = new_figure(8.0, 5.0)
    axes: Any = figure.add_subplot(projection="3d")
    low, high = np.nanmin(z), np.nanmax(z)
    # A facet with NaN in z is not drawn, but its x and y must be finite.
    drawn = axes.plot_surface(
        np.nan_to_num(x, nan=np.nanmean(x)),
        np.nan_to_num(y, nan=np.nanmean(y)),
        z,
        rcount=z.shape[0],
        ccount=z.shape[1],
        cmap=HEIGHT_MAP,
        vmin=low,
        vmax=high,
        linewidth=0,
        antialiased=False,
        clip_on=False,  # the box may reach beyond its axes
    )
    spans = np.array([np.nanmax(part) - np.nanmin(part) for part in (x, y, z)])
    axes.set_box_aspect(np.maximum(spans * (1, 1, exaggeration), _LEAST_SIDE * spans.max()), zoom=1.1)
    # On a flat box more ticks would overlap; the colours tell heights between them.
    axes.zaxis.set_major_locator(MaxNLocator(_FLAT_TICKS if spans[2] * exaggeration < _FLAT * spans.max() else _TICKS))
    bar = figure.colorbar(drawn, ax=axes, shrink=0.6, pad=0.12)  # beside the label of the axis
    bar.set_label(f"height z / {unit}")
    axes.view_init(elev=32, azim=-65)
    stretched = "" if exaggeration == 1 else f" ({exaggeration:g} times)"
    axes.set(xlabel=f"x / {unit}", ylabel=f"y / {unit}", zlabel=f"z / {unit}{stretched}", title=title)
    return figure
