"""Maps: heights and errors in the plate frame, residuals and classes in the camera's picture."""

from collections.abc import Mapping

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from fringecal.records import RegularGrid, regular_grid, sample_spacing_mm
from fringecal.report.style import (
    ERROR_MAP,
    HEIGHT_MAP,
    MASKED,
    PALETTE,
    SCALE_PERCENT,
    WIDTH_IN,
    colourbar,
    image_axes,
    new_figure,
    plate_axes,
    styled,
    symmetric_limit,
)

_LONGEST_SIDE = 900  # nodes; more are finer than a report can print


@styled
def height_map(x_mm: np.ndarray, y_mm: np.ndarray, z_mm: np.ndarray, *, title: str = "") -> Figure:
    """Draw heights in the plate frame, y up; what was not measured is grey.

    Parameters
    ----------
    x_mm, y_mm, z_mm
        Coordinates and height per pixel (H, W), mm, NaN where masked.
    title
        What was measured.
    """
    return _plate_map(_thinned(x_mm, y_mm, z_mm), "height z / mm", title=title)


@styled
def error_map(
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    error_mm: np.ndarray,
    *,
    limit_mm: float | None = None,
    title: str = "",
) -> Figure:
    """Draw measured minus reference height in the plate frame on a scale symmetric about zero.

    Parameters
    ----------
    x_mm, y_mm, error_mm
        Coordinates and error per pixel (H, W), mm, NaN where masked or left out.
    limit_mm
        End of the scale; by default the 99.5th percentile of the absolute error.
    title
        What was compared with what.
    """
    limit = symmetric_limit(error_mm) if limit_mm is None else limit_mm
    # The error may jump wherever it likes: only the coordinates decide what can be resampled.
    grid = _thinned(x_mm, y_mm, error_mm, max_jump_mm=np.inf)
    return _plate_map(grid, "measured - reference / mm", (-limit, limit), colours=ERROR_MAP, title=title)


@styled
def uncertainty_map(x_mm: np.ndarray, y_mm: np.ndarray, u_mm: np.ndarray, *, title: str = "") -> Figure:
    """Draw the standard uncertainty of heights in the plate frame, from the 1st to the 99th percentile.

    Parameters
    ----------
    x_mm, y_mm, u_mm
        Coordinates and standard uncertainty of the height per pixel (H, W), mm, NaN where masked.
    title
        What was measured.
    """
    grid = _thinned(x_mm, y_mm, u_mm, max_jump_mm=np.inf)
    low, high = np.nanpercentile(u_mm, SCALE_PERCENT)
    return _plate_map(grid, "u(z) / mm", (low, high), title=title)


@styled
def residual_map(
    residual_rad: np.ndarray,
    *,
    limit_rad: float | None = None,
    label: str = "measured - model phase / rad",
    step_px: int = 1,
    title: str = "",
) -> Figure:
    """Draw the phase residual of a fit in the camera's picture, row 0 at the top.

    Parameters
    ----------
    residual_rad
        Measured minus model phase (H, W), rad, NaN where not used.
    limit_rad
        End of the symmetric scale; by default the 99.5th percentile of the absolute residual.
    label
        What the colours mean, with its unit.
    step_px
        Pixels of the picture from one value of the map to the next.
    title
        Which capture.
    """
    figure = new_figure(WIDTH_IN, 5.4)
    axes = figure.subplots()
    limit = symmetric_limit(residual_rad) if limit_rad is None else limit_rad
    axes.set_facecolor(MASKED)
    height, width = residual_rad.shape
    extent = _extent((height * step_px, width * step_px))
    image = axes.imshow(_shrunk(residual_rad), extent=extent, cmap=ERROR_MAP)
    image.set_clim(-limit, limit)
    image_axes(axes)
    axes.set_title(title)
    colourbar(axes, image, label, extend="both")
    return figure


@styled
def classification_overlay(
    picture: np.ndarray, classes: np.ndarray, names: Mapping[int, str], *, title: str = ""
) -> Figure:
    """Lay the class of each pixel over the picture it was found in, row 0 at the top.

    Parameters
    ----------
    picture
        Grey picture (H, W).
    classes
        Class number per pixel (H, W); numbers that are not in `names` stay uncoloured.
    names
        What each class number means, for example ``{1: "glass top", 2: "edge zone"}``.
    title
        Which capture.
    """
    figure = new_figure(WIDTH_IN, 5.6)
    axes = figure.subplots()
    extent = _extent(picture.shape)
    axes.imshow(_shrunk(picture), extent=extent, cmap="gray")
    codes = np.full(classes.shape, np.nan)
    for place, number in enumerate(names):
        codes[classes == number] = place
    colours = [PALETTE[place % len(PALETTE)] for place in range(len(names))]
    norm = BoundaryNorm(np.arange(len(names) + 1) - 0.5, max(len(names), 1)) if names else None
    axes.imshow(_shrunk(codes), extent=extent, cmap=ListedColormap(colours or ["none"]), norm=norm, alpha=0.5)
    image_axes(axes)
    axes.set_title(title)
    handles = [Patch(color=colour, alpha=0.6, label=name) for colour, name in zip(colours, names.values(), strict=True)]
    figure.legend(handles=handles, loc="outside lower center", ncols=max(1, min(4, len(handles))))
    return figure


def _thinned(x_mm: np.ndarray, y_mm: np.ndarray, z_mm: np.ndarray, *, max_jump_mm: float | None = None) -> RegularGrid:
    valid = np.isfinite(x_mm) & np.isfinite(y_mm) & np.isfinite(z_mm)
    x, y = np.where(valid, x_mm, np.nan), np.where(valid, y_mm, np.nan)
    coarse = max(np.ptp(x[valid]), np.ptp(y[valid])) / _LONGEST_SIDE if valid.any() else 0.0
    spacing_mm = max(sample_spacing_mm(x, y), coarse)
    return regular_grid(x, y, z_mm, spacing_mm=spacing_mm, max_jump_mm=max_jump_mm)


def _plate_map(
    grid: RegularGrid,
    label: str,
    limits: tuple[float, float] | None = None,
    *,
    colours: str = HEIGHT_MAP,
    title: str = "",
) -> Figure:
    """Draw a grid in the plate frame; without limits the scale holds every value."""
    figure = new_figure(WIDTH_IN, 5.2)
    axes = figure.subplots()
    half = grid.spacing_mm / 2
    extent = (grid.x_mm[0] - half, grid.x_mm[-1] + half, grid.y_mm[0] - half, grid.y_mm[-1] + half)
    axes.set_facecolor(MASKED)
    image = axes.imshow(grid.z_mm, origin="lower", extent=extent, cmap=colours)
    if limits is not None:
        image.set_clim(*limits)
    plate_axes(axes)
    axes.set_title(title)
    colourbar(axes, image, label, extend="neither" if limits is None else "both")
    return figure


def _shrunk(values: np.ndarray) -> np.ndarray:
    step = max(1, -(-max(values.shape) // (2 * _LONGEST_SIDE)))
    return values[::step, ::step]


def _extent(shape: tuple[int, ...]) -> tuple[float, float, float, float]:
    """Give the edges of the picture, whose top-left pixel has its centre at (0, 0)."""
    return (-0.5, shape[1] - 0.5, shape[0] - 0.5, -0.5)
