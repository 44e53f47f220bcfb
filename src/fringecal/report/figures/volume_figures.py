"""A rig of camera and projector to scale, and the volume in which boards were, with how well points are known there."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from fringecal.report.style import (
    BLUE,
    GREY,
    GUIDE_PT,
    MASKED,
    ORANGE,
    SCALE_PERCENT,
    WIDTH_IN,
    colourbar,
    image_axes,
    new_figure,
    styled,
)

_VIEWS = (((0, 2), "from above the picture"), ((1, 2), "from the picture's left"))
_AXES = "xyz"


@styled
def volume_drawing(points_mm: np.ndarray, u_mm: np.ndarray, projector_mm: np.ndarray, *, title: str = "") -> Figure:
    """Draw camera, projector and the boards' points to scale from two sides, coloured by their uncertainty.

    Parameters
    ----------
    points_mm
        Points where boards were, (n, 3), in the camera's frame.
    u_mm
        Standard uncertainty of each by the calibration, (n,).
    projector_mm
        The projector's centre there, (3,).
    title
        Which rig.
    """
    figure = new_figure(WIDTH_IN, 4.6)
    scale = Normalize(0, float(u_mm.max()))
    panels = figure.subplots(1, 2)
    for axes, (plane, name) in zip(panels, _VIEWS, strict=True):
        _view(axes, points_mm, u_mm, projector_mm, plane, scale)
        axes.set_title(name, loc="left")
    colourbar(panels[-1], ScalarMappable(scale, "viridis"), "u of a point / mm")
    figure.suptitle(title)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _view(
    axes: Axes, points: np.ndarray, u: np.ndarray, projector: np.ndarray, plane: tuple[int, int], scale: Normalize
) -> None:
    across, along = plane
    middle = points.mean(axis=0)
    for centre, colour, label in ((np.zeros(3), BLUE, "camera"), (projector, ORANGE, "projector")):
        axes.plot(centre[along], centre[across], "o", color=colour, label=label)
        axes.plot([centre[along], middle[along]], [centre[across], middle[across]], color=GREY, lw=GUIDE_PT)
    order = np.argsort(u)
    axes.scatter(points[order, along], points[order, across], c=u[order], norm=scale, s=4, cmap="viridis", lw=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=f"{_AXES[along]} / mm", ylabel=f"{_AXES[across]} / mm")
    axes.invert_yaxis()


@styled
def picture_map(values: np.ndarray, label: str, *, title: str = "") -> Figure:
    """Draw one value per pixel over the camera's picture, from the 1st to the 99th percentile; masked pixels are grey.

    Parameters
    ----------
    values
        (H, W), NaN where masked.
    label
        What is drawn, with its unit.
    title
        Of what.
    """
    figure = new_figure(WIDTH_IN, 0.4 + 0.8 * WIDTH_IN * values.shape[0] / values.shape[1])
    axes = figure.subplots()
    axes.set_facecolor(MASKED)
    low, high = np.nanpercentile(values, SCALE_PERCENT)
    drawn = axes.imshow(values, cmap="viridis", vmin=low, vmax=high, interpolation="nearest")
    image_axes(axes)
    colourbar(axes, drawn, label, extend="both")
    axes.set_title(title, loc="left")
    return figure
