"""The lens as its board pictures give it: boards found, what of the field they cover, and how well it is known."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from fringecal.camera import LensFit, ViewFit
from fringecal.report.style import (
    BLUE,
    GREY,
    GUIDE_PT,
    MASKED,
    ORANGE,
    SMALL_PT,
    WIDTH_IN,
    colourbar,
    image_axes,
    new_figure,
    styled,
)

_TILE_PX = 480  # longest side of a picture as drawn
_MOST_TILES = 20  # pictures of the board: four rows on a sheet
_COLUMNS = 5
_LEVELS = 9  # of the uncertainty, by equal factors
_TILT_SCALE_DEG = 45.0  # end of the scale of tilts: boards are to be tilted by 20 to 40


@styled
def boards_overlay(pictures: Sequence[tuple[str, np.ndarray, ViewFit | None]]) -> Figure:
    """Draw the points found over the pictures of the board, and say where there is none.

    Parameters
    ----------
    pictures
        Name, grey picture (H, W), and what the fit says of it; None without a board. Of more than twenty,
        every second, third and so on is drawn.
    """
    shown = pictures[:: -(-len(pictures) // _MOST_TILES)]
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    height, width = shown[0][1].shape[:2]
    figure = new_figure(2.2 * columns, (2.2 * height / width + 0.3) * rows + 0.35)
    panels = np.ravel(figure.subplots(rows, columns, squeeze=False))
    for axes, (name, image, view) in zip(panels, shown, strict=False):
        _tile(axes, name, image, view)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    figure.legend(
        handles=[
            axes.plot([], [], ls="", marker="o", ms=4, color=ORANGE, label="point, used")[0],
            axes.plot([], [], ls="", marker="x", ms=5, color=BLUE, label="point, left out")[0],
            axes.plot([], [], color=ORANGE, lw=GUIDE_PT, label="from the board's first point on")[0],
        ],
        loc="outside lower center",
        ncols=3,
    )
    return figure


def _tile(axes: Axes, name: str, image: np.ndarray, view: ViewFit | None) -> None:
    height, width = image.shape[:2]
    step = max(1, -(-max(image.shape) // _TILE_PX))
    axes.imshow(image[::step, ::step], extent=(-0.5, width - 0.5, height - 0.5, -0.5), cmap="gray")
    axes.set(xticks=[], yticks=[])
    if view is None:
        axes.set_title(f"{name}: no board", fontsize=SMALL_PT, color=GREY)
        return
    axes.plot(*view.seen_px.T, color=ORANGE, lw=0.5, alpha=0.7)
    axes.plot(*view.seen_px.T, ls="", marker="o", ms=1.6, color=ORANGE)
    axes.plot(*view.left_out_px.T, ls="", marker="x", ms=5, color=BLUE)
    axes.set_title(f"{name}: {view.rms_px:.2f} px, {view.tilt_deg:.0f}°", fontsize=SMALL_PT)


@styled
def lens_coverage(fit: LensFit) -> Figure:
    """Draw which parts of the picture the points of the boards cover, coloured by the tilt of their board."""
    figure = new_figure(WIDTH_IN, 5.6)
    axes = figure.subplots()
    points = np.concatenate([view.seen_px for view in fit.views])
    tilts = np.concatenate([np.full(len(view.seen_px), view.tilt_deg) for view in fit.views])
    drawn = axes.scatter(
        points[:, 0], points[:, 1], c=tilts, s=7, cmap="viridis", vmin=0, vmax=max(_TILT_SCALE_DEG, float(tilts.max()))
    )
    _whole_picture(axes, fit)
    colourbar(axes, drawn, "tilt of the board / deg")
    axes.set_title(f"{len(points)} points of {len(fit.views)} boards", loc="left")
    return figure


@styled
def lens_uncertainty_map(fit: LensFit, distance_mm: float) -> Figure:
    """Draw the standard uncertainty of where a point at a distance is seen, in its worse direction, px.

    Parameters
    ----------
    fit
        The lens with the views it was fitted to.
    distance_mm
        Distance from the camera's centre; infinite for far points.
    """
    figure = new_figure(WIDTH_IN, 5.6)
    axes = figure.subplots()
    lens = fit.lens
    u = fit.uncertainty_at_px(distance_mm).reshape(lens.map_shape)
    across, down = (lens.pixels()[:, axis].reshape(lens.map_shape) for axis in (0, 1))
    # Steps by equal factors: beyond the points it grows by decades, and the middle is what matters.
    low, high = np.nanmin(u), np.nanmax(u)
    levels = np.geomspace(low, max(high, 1.01 * low), _LEVELS)
    shades = LogNorm(levels[0], levels[-1])
    axes.set_facecolor(MASKED)
    filled = axes.contourf(across, down, u, levels=levels, norm=shades, cmap="viridis")
    lines = axes.contour(across, down, u, levels=levels[1:-1], colors="white", linewidths=0.6)
    axes.clabel(lines, fmt=lambda level: f"{level:.2g}", fontsize=SMALL_PT)
    points = np.concatenate([view.seen_px for view in fit.views])
    axes.plot(*points.T, ls="", marker=".", ms=1.5, color="white", alpha=0.35)
    _whole_picture(axes, fit)
    bar = colourbar(axes, filled, "standard uncertainty of the projection / px")
    bar.set_ticks(list(levels), labels=[f"{level:.2g}" for level in levels])
    where = "far away" if np.isinf(distance_mm) else f"at {distance_mm:.0f} mm"
    axes.set_title(f"points {where}; dots: the boards' points", loc="left")
    return figure


def _whole_picture(axes: Axes, fit: LensFit) -> None:
    axes.set(xlim=(-0.5, fit.lens.width_px - 0.5), ylim=(fit.lens.height_px - 0.5, -0.5))
    image_axes(axes)
