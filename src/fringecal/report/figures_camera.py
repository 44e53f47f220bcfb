"""The camera's grid: the crossings found in its picture, and what the camera model leaves of them."""

import numpy as np
from matplotlib.figure import Figure

from fringecal.report.style import BLUE, GREY, INK, ORANGE, image_axes, new_figure, styled

_LONGEST_SIDE = 1800
_ARROW_SHARE = 0.06  # of the picture's width: length of an arrow three rms long
_MAX_ARROWS = 1500


@styled
def crossings_overlay(
    picture: np.ndarray,
    u_px: np.ndarray,
    v_px: np.ndarray,
    *,
    used: np.ndarray | None = None,
    title: str = "",
) -> Figure:
    """Mark the grid crossings in the picture they were found in, row 0 at the top.

    Parameters
    ----------
    picture
        Grey picture (H, W).
    u_px, v_px
        Crossings (n,), px.
    used
        False where the camera fit rejected a crossing (n,).
    title
        Which capture.
    """
    keep = np.ones(len(u_px), dtype=bool) if used is None else used
    figure = new_figure(7.0, 6.0)
    axes = figure.subplots()
    height, width = picture.shape
    step = max(1, -(-max(picture.shape) // _LONGEST_SIDE))
    axes.imshow(picture[::step, ::step], extent=(-0.5, width - 0.5, height - 0.5, -0.5), cmap="gray")
    size = float(np.clip(60 / np.sqrt(max(len(u_px), 1)), 1.0, 3.0))
    axes.plot(u_px[keep], v_px[keep], ls="", marker="o", ms=size, color=ORANGE, label="crossing, used")
    if not keep.all():
        axes.plot(u_px[~keep], v_px[~keep], ls="", marker="x", ms=6, color=BLUE, label="crossing, rejected by the fit")
    image_axes(axes)
    axes.set_title(title)
    figure.legend(loc="outside lower center", ncols=2)
    return figure


@styled
def residual_arrows(
    points_px: np.ndarray, residuals_px: np.ndarray, shape: tuple[int, int], *, title: str = ""
) -> Figure:
    """Draw observed minus modelled crossings as arrows, much enlarged; the key states by how much.

    Parameters
    ----------
    points_px, residuals_px
        Crossings and their residuals (n, 2), px; NaN residuals are left out.
    shape
        (H, W) of the picture, px.
    title
        Which capture.
    """
    known = np.isfinite(residuals_px).all(axis=1)
    points, residuals = points_px[known], residuals_px[known]
    thin = max(1, -(-len(points) // _MAX_ARROWS))
    rms = float(np.sqrt(np.mean(residuals**2))) if residuals.size else 0.0
    key_px = float(f"{3 * rms:.1g}") if rms > 0 else 1.0
    figure = new_figure(7.0, 6.0)
    axes = figure.subplots()
    arrows = axes.quiver(
        *points[::thin].T,
        *residuals[::thin].T,
        angles="xy",
        scale_units="xy",
        scale=key_px / (_ARROW_SHARE * shape[1]),
        color=INK,
        width=0.0022,
    )
    axes.quiverkey(arrows, 0.9, 1.03, key_px, f"{key_px:g} px", labelpos="E", coordinates="axes")
    axes.set(xlim=(-0.5, shape[1] - 0.5), ylim=(shape[0] - 0.5, -0.5))
    centre = ((shape[1] - 1) / 2, (shape[0] - 1) / 2)
    axes.plot(*centre, ls="", marker="+", ms=9, color=GREY)
    image_axes(axes)
    axes.set_title(title, loc="left")
    return figure
