"""A rig of camera and projector to scale, and the volume in which boards were, with how well points are known there."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from fringecal.report.style import (
    BLUE,
    GREY,
    GUIDE_PT,
    INK,
    MASKED,
    ORANGE,
    SCALE_PERCENT,
    SMALL_PT,
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


@dataclass(frozen=True)
class DepthSection:
    """A section through a rig's volume, in the plane of the camera's x and z, and the rig seen from above it.

    Parameters
    ----------
    x_mm, z_mm
        Where u is known, (nx,) and (nz,).
    u_mm
        Standard uncertainty of a point by the calibration, (nx, nz); NaN where camera or projector do not reach.
    limit_mm
        From which u on a point is outside the calibrated volume.
    boards_mm
        Places where boards were, (n, 3).
    projector_mm
        The projector's centre, (3,).
    edges_mm
        Ends of the rays at the left and right edge of both pictures, camera and projector, (2, 2, 3).
    baseline_mm, angle_deg
        As the report states them.
    """

    x_mm: np.ndarray
    z_mm: np.ndarray
    u_mm: np.ndarray
    limit_mm: float
    boards_mm: np.ndarray
    projector_mm: np.ndarray
    edges_mm: np.ndarray
    baseline_mm: float
    angle_deg: float


@styled
def depth_drawing(section: DepthSection) -> Figure:
    """Draw baseline and angle of a rig to scale, and how well points are known over depth."""
    figure = new_figure(WIDTH_IN, 4.2)
    axes = figure.subplots()
    drawn = axes.pcolormesh(section.z_mm, section.x_mm, section.u_mm, cmap="viridis", shading="nearest", vmin=0)
    colourbar(axes, drawn, "u of a point / mm")
    if np.nanmax(section.u_mm) > section.limit_mm:
        axes.contour(section.z_mm, section.x_mm, section.u_mm, [section.limit_mm], colors=INK, linewidths=GUIDE_PT)
    boards = section.boards_mm
    axes.plot(boards[:, 2], boards[:, 0], ".", ms=1.5, color="white", alpha=0.7)
    _devices(axes, section)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="z / mm", ylabel="x / mm")
    axes.invert_yaxis()
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _devices(axes: Axes, section: DepthSection) -> None:
    """Draw both devices with the edges of their pictures, the baseline, and the angle between their rays."""
    middle, places = section.boards_mm.mean(axis=0), (np.zeros(3), section.projector_mm)
    for place, edges, colour, name in zip(
        places, section.edges_mm, (BLUE, ORANGE), ("camera", "projector"), strict=True
    ):
        axes.plot(place[2], place[0], "o", color=colour, label=name, zorder=3)
        for end in edges:
            axes.plot([place[2], end[2]], [place[0], end[0]], color=colour, lw=GUIDE_PT, alpha=0.6)
        axes.plot([place[2], middle[2]], [place[0], middle[0]], color=colour, lw=GUIDE_PT, ls="--")
    (x0, z0), (x1, z1) = (place[[0, 2]] for place in places)
    axes.plot([z0, z1], [x0, x1], color=GREY, lw=GUIDE_PT)
    half: dict[str, Any] = {
        "fontsize": SMALL_PT,
        "color": INK,
        "bbox": {"facecolor": "white", "edgecolor": "none", "alpha": 0.7},
    }
    axes.text((z0 + z1) / 2, (x0 + x1) / 2, f"{section.baseline_mm:.1f} mm", ha="center", va="center", **half)
    between = (middle + (places[0] + places[1]) / 2 * 0.6) / 1.6
    axes.text(between[2], between[0], f"{section.angle_deg:.2f} deg", ha="center", va="center", **half)


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
