"""The projection angle over the field: measured and apparent, against theory."""

import numpy as np
from matplotlib.figure import Figure

from fringecal.report.style import BLUE, GREY, INK, ORANGE, new_figure, styled


@styled
def angle_plot(
    position_mm: np.ndarray,
    angle_deg: np.ndarray,
    u_deg: np.ndarray,
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
    angle_deg, u_deg
        Projection angle from the plate's normal and its standard uncertainty (n,), deg.
    theory_deg
        The angle that the stated positions give (n,), deg.
    apparent_deg
        The angle that fringe breaks show to the camera, its own angle included (n,), deg.
    position_label
        What runs along the axis, with its unit.
    title
        Which strips or which fit.
    """
    figure = new_figure(7.0, 4.4)
    axes = figure.subplots()
    if theory_deg is not None:
        axes.plot(position_mm, theory_deg, color=INK, lw=1.2, ls="--", label="theory, from stated positions")
    if apparent_deg is not None:
        axes.plot(
            position_mm,
            apparent_deg,
            color=ORANGE,
            marker="s",
            ms=3.5,
            lw=0.8,
            label="apparent, camera's angle included",
        )
    axes.errorbar(
        position_mm,
        angle_deg,
        yerr=1.96 * np.asarray(u_deg),
        color=BLUE,
        fmt="o",
        ms=4,
        lw=1.0,
        capsize=2.5,
        label="measured projection angle, 95 %",
    )
    axes.grid(visible=True, axis="y")
    axes.set(xlabel=position_label, ylabel="angle from the plate's normal / deg", title=title)
    axes.axvline(0.0, color=GREY, lw=0.6, ls=":")
    figure.legend(loc="outside lower center", ncols=2)
    return figure
