"""The rig to scale, from the side and from above."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Ellipse, Rectangle

from fringecal.report.style import AMBER, BLUE, GREY, GUIDE_PT, INK, ORANGE, SKY, new_figure, styled
from fringecal.uncertainty import COVERAGE

_AXES = "xyz"
_CROSS: dict[str, Any] = {"marker": "x", "color": INK, "ms": 9.0, "mew": 1.2, "zorder": 4}
# Half axis of a 95 % region over the standard uncertainty: root of the 95 % point of chi-squared with two degrees of
# freedom, 2.4477.
_K_PLANE = math.sqrt(-2 * math.log(1 - COVERAGE))


@dataclass(frozen=True)
class Pupil:
    """A pupil in the plate frame: position and standard uncertainty (3,), mm."""

    label: str
    position_mm: np.ndarray
    u_mm: np.ndarray


@styled
def rig_drawing(
    plate_mm: tuple[float, float, float, float],
    projector: Pupil,
    camera: Pupil | None,
    *,
    stated_projector: Pupil | None = None,
    stated_camera: Pupil | None = None,
    title: str = "",
) -> Figure:
    """Draw camera, projector and plate to scale with the rays that bound the field.

    The side view looks along the plate axis that the projector is not offset along, so that the
    projection angle, from the plate's normal at the origin, appears in true size.

    Parameters
    ----------
    plate_mm
        Measured field on the plate: x_min, x_max, y_min, y_max, mm.
    projector, camera
        Fitted pupils; `camera` None draws the parallel rays of a telecentric lens.
    stated_projector
        The projector where the session says it stands; ellipses are 95 % regions.
    stated_camera
        The camera where the session says it stands.
    title
        Which rig.
    """
    along = int(np.argmax(np.abs(projector.position_mm[:2])))
    figure, side, top = _make_views(along)
    for axes, plane in ((side, (along, 2)), (top, (0, 1))):
        for stated in (stated_projector, stated_camera):
            if stated is not None:
                _draw_pupil(axes, stated, plane, GREY)
        _draw_rays(axes, plane, plate_mm, projector.position_mm, AMBER)
        _draw_pupil(axes, projector, plane, ORANGE)
        if camera is not None:
            _draw_rays(axes, plane, plate_mm, camera.position_mm, SKY)
            _draw_pupil(axes, camera, plane, BLUE)
        _label_view(axes, plane)
    if camera is None:
        _draw_parallel_rays(side, along, plate_mm, float(projector.position_mm[2]))
    _draw_angle(side, projector.position_mm, along)
    side.set_title(f"from the {'lower edge' if along == 0 else 'right edge'} of the picture")
    side.plot(plate_mm[2 * along : 2 * along + 2], [0, 0], color=INK, lw=3, solid_capstyle="butt")
    top.set_title("from above")
    top.add_patch(_field(plate_mm))
    figure.suptitle(title)
    figure.legend(*side.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _make_views(along: int) -> tuple[Figure, Axes, Axes]:
    """Lay the two views one above the other for a rig that is wide in x, else side by side."""
    figure = new_figure(7.2, 8.2) if along == 0 else new_figure(7.6, 5.8)
    if along == 0:
        side, top = figure.subplots(2, 1, height_ratios=[2, 1])
    else:
        side, top = figure.subplots(1, 2, width_ratios=[3, 2])
    return figure, side, top


def _label_view(axes: Axes, plane: tuple[int, int]) -> None:
    axes.set(xlabel=f"{_AXES[plane[0]]} / mm", ylabel=f"{_AXES[plane[1]]} / mm")
    axes.set_aspect("equal")
    axes.margins(0.08)


def _field(plate_mm: tuple[float, float, float, float]) -> Rectangle:
    x_min, x_max, y_min, y_max = plate_mm
    return Rectangle((x_min, y_min), x_max - x_min, y_max - y_min, fill=False, ec=INK, lw=1.5)


def _draw_rays(
    axes: Axes, plane: tuple[int, int], plate_mm: tuple[float, ...], pupil_mm: np.ndarray, colour: str
) -> None:
    """Draw the rays from a pupil to the corners of the field and to the origin."""
    for x in plate_mm[:2]:
        for y in plate_mm[2:]:
            ends = np.array([pupil_mm, (x, y, 0.0)])
            axes.plot(ends[:, plane[0]], ends[:, plane[1]], color=colour, lw=0.7)
    chief = np.array([pupil_mm, (0.0, 0.0, 0.0)])
    axes.plot(chief[:, plane[0]], chief[:, plane[1]], color=colour, lw=1.2, ls="-.")


def _draw_parallel_rays(axes: Axes, along: int, plate_mm: tuple[float, ...], height_mm: float) -> None:
    places = np.linspace(plate_mm[2 * along], plate_mm[2 * along + 1], 5)
    axes.vlines(places, 0, height_mm, color=SKY, lw=GUIDE_PT, label="camera, telecentric")


def _draw_pupil(axes: Axes, pupil: Pupil, plane: tuple[int, int], colour: str) -> None:
    """Mark a pupil and, to scale, its 95 % region (for two free coordinates: 2.45 u)."""
    centre, u = (np.asarray(part, dtype=float)[list(plane)] for part in (pupil.position_mm, pupil.u_mm))
    axes.add_patch(Ellipse(tuple(centre), *(2 * _K_PLANE * u), color=colour, alpha=0.35, lw=0))
    # A cross over the dot: where both are in one place, both must show.
    form = {"marker": "o", "color": colour, "ms": 7.0} if colour != GREY else _CROSS
    axes.plot(*centre, ls="", label=pupil.label, **form)


def _draw_angle(axes: Axes, projector_mm: np.ndarray, along: int) -> None:
    """Draw the angle between the plate's normal and the projector's ray to the origin."""
    offset, height = float(projector_mm[along]), float(projector_mm[2])
    angle_deg = np.degrees(np.arctan2(abs(offset), height))
    radius = 0.35 * height
    start = 90.0 - angle_deg if offset > 0 else 90.0
    axes.vlines(0, 0, 1.15 * radius, color=GREY, lw=GUIDE_PT, ls=":")
    axes.add_patch(Arc((0, 0), 2 * radius, 2 * radius, theta1=start, theta2=start + angle_deg, color=INK))
    middle = np.radians(90.0 - np.copysign(angle_deg / 2, offset))
    axes.annotate(
        f"{angle_deg:.1f}°",
        (1.12 * radius * np.cos(middle), 1.12 * radius * np.sin(middle)),
        ha="center",
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1},
    )
