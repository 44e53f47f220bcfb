"""The projection angle over the field: measured and apparent, against theory."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from fringecal.projector import Breaks, RigCalibration, projection_angle
from fringecal.report.style import (
    BLUE,
    GREY,
    GUIDE_PT,
    HEIGHT_MAP,
    INK,
    ORANGE,
    SMALL_PT,
    WIDTH_IN,
    colourbar,
    image_axes,
    new_figure,
    plate_axes,
    styled,
)

_PALE = 0.45  # the picture behind its fringe breaks: full black and white would hide them
_NEAR_BREAKS = 40  # breaks in the enlarged part of the picture


@styled
def angle_plot(
    position_mm: np.ndarray,
    angle_deg: np.ndarray,
    U_deg: np.ndarray,
    *,
    theory_deg: np.ndarray | None = None,
    apparent_deg: np.ndarray | None = None,
    position_label: str = "x / mm",
    title: str = "",
) -> Figure:
    """Draw the projection angle along the field with 95 % error bars, theory as a line.

    Parameters
    ----------
    position_mm
        Place on the plate (n,), mm.
    angle_deg, U_deg
        Projection angle from the plate's normal and its expanded uncertainty, 95 % (n,), deg.
    theory_deg
        The angle that the stated positions give (n,), deg; or (n, 2) with its expanded uncertainty, 95 %.
    apparent_deg
        The angle that fringe breaks show to the camera, its own angle included (n,), deg.
    position_label
        What runs along the axis, with its unit.
    title
        Which strips or which fit.
    """
    figure = new_figure(WIDTH_IN, 4.4)
    axes = figure.subplots()
    if theory_deg is not None:
        _draw_theory(axes, position_mm, np.asarray(theory_deg, float).reshape(len(position_mm), -1))
    if apparent_deg is not None:
        axes.plot(
            position_mm,
            apparent_deg,
            color=ORANGE,
            marker="s",
            ms=3.5,
            mfc="none",
            lw=GUIDE_PT,
            zorder=1.5,
            label="apparent, camera's angle included",
        )
    axes.errorbar(
        position_mm,
        angle_deg,
        yerr=np.asarray(U_deg),
        color=BLUE,
        fmt="o",
        ms=4,
        lw=1.0,
        capsize=2.5,
        zorder=3,
        label="measured projection angle, 95 %",
    )
    axes.grid(visible=True, axis="y")
    axes.set(xlabel=position_label, ylabel="angle from the plate's normal / deg", title=title)
    axes.axvline(0.0, color=GREY, lw=0.6, ls=":")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _draw_theory(axes: Axes, position_mm: np.ndarray, theory_deg: np.ndarray) -> None:
    """Draw theory as a line, with its 95 % band where its uncertainty is given."""
    order = np.argsort(position_mm)
    place, value = position_mm[order], theory_deg[order, 0]
    axes.plot(place, value, color=INK, lw=1.2, ls="--", label="theory, from stated positions")
    if theory_deg.shape[1] > 1:
        half = theory_deg[order, 1]
        axes.fill_between(place, value - half, value + half, color=GREY, alpha=0.2, lw=0, label="theory, 95 %")


@styled
def breaks_overlay(picture: np.ndarray, breaks: Breaks, *, rows: bool = True) -> Figure:
    """Draw fringe breaks over the picture of the strips: all of them, and enlarged those about the middle.

    Parameters
    ----------
    picture
        Grey values (H, W).
    breaks
        What was read.
    rows
        True where the fringes run along rows: fringe shifts are then along columns.
    """
    figure = new_figure(9.0, 5.0)
    whole, near = figure.subplots(1, 2)
    for axes, size in ((whole, 2.0), (near, 7.0)):
        axes.imshow(picture, cmap="gray", alpha=_PALE)
        _draw_breaks(axes, breaks, rows=rows, size=size)
        image_axes(axes)
    middle = np.median(breaks.u_px), np.median(breaks.v_px)
    distance = np.maximum(np.abs(breaks.u_px - middle[0]), np.abs(breaks.v_px - middle[1]))
    reach = float(np.sort(distance)[min(_NEAR_BREAKS, distance.size - 1)]) + 2.0
    near.set_xlim(middle[0] - reach, middle[0] + reach)
    near.set_ylim(middle[1] + reach, middle[1] - reach)
    near.set_title("enlarged, about the middle")
    whole.set_title(f"{np.count_nonzero(breaks.used)} fringe breaks")
    figure.legend(*near.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _draw_breaks(axes: Axes, breaks: Breaks, *, rows: bool, size: float) -> None:
    back = np.column_stack([np.zeros_like(breaks.shift_px), breaks.shift_px])
    on_strip = np.column_stack([breaks.u_px, breaks.v_px])
    on_plate = on_strip - (back if rows else back[:, ::-1])
    used = breaks.used
    axes.add_collection(LineCollection(list(np.stack([on_plate, on_strip], axis=1)[used]), colors=INK, lw=0.2 * size))
    for points, chosen, colour, marker, label in (
        (on_plate, used, BLUE, "o", "the fringe on the plate, extrapolated under the strip"),
        (on_strip, used, ORANGE, "o", "the same fringe on the strip"),
        (on_strip, ~used, INK, "x", "left out"),
    ):
        edge = {"mec": "white", "mew": 0.1 * size} if marker == "o" else {"mew": 0.3 * size}
        axes.plot(*points[chosen].T, marker, color=colour, ms=size, ls="", label=label, **edge)


@styled
def angle_field(calibration: RigCalibration, field_mm: tuple[float, float, float, float], breaks: Breaks) -> Figure:
    """Draw lines of equal projection angle over the plate, and the angles at fringe breaks as dots of the same scale.

    Parameters
    ----------
    calibration
        The rig.
    field_mm
        x_min, x_max, y_min, y_max of the field.
    breaks
        Dots at the feet of the projector's rays.
    """
    figure = new_figure(6.6, 5.4)
    axes = figure.subplots()
    x, y = np.meshgrid(np.linspace(*field_mm[:2], 80), np.linspace(*field_mm[2:], 80))
    angle = np.degrees(projection_angle(calibration.model, x, y))
    scale = Normalize(float(angle.min()), float(angle.max()))
    lines = axes.contour(x, y, angle, levels=9, linewidths=1.2, norm=scale, cmap=HEIGHT_MAP)
    axes.clabel(lines, fmt="%.1f°", fontsize=SMALL_PT, colors=INK)
    used = breaks.used
    dots = axes.scatter(
        breaks.x_mm[used], breaks.y_mm[used], c=breaks.angle_deg[used], s=12, lw=0, norm=scale, cmap=HEIGHT_MAP
    )
    colourbar(axes, dots, "angle from the plate's normal / deg")
    plate_axes(axes)
    return figure
