"""The grid as it was found: lines over the picture, and what distortion does to it, much enlarged."""

from collections.abc import Mapping

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from fringecal.camera import DistortionTest, effect_of_neglect_px
from fringecal.detect import GridDetection, LineSection
from fringecal.report.style import (
    BLUE,
    ERROR_MAP,
    GREEN,
    GUIDE_PT,
    HEIGHT_MAP,
    INK,
    ORANGE,
    SCALE_PERCENT,
    WIDTH_IN,
    colourbar,
    image_axes,
    new_figure,
    styled,
    symmetric_limit,
)

_LONGEST_SIDE = 2400  # pixels; more are finer than a report can print, but lines are thin
_ARROW_SHARE = 0.05  # of the picture's width: length of the longest arrow before correction
_ROUND_FACTORS = (1, 2, 5)
_NAMED = 6  # crossings along the longer side whose index is written beside them, about


@styled
def grid_overlay(
    picture: np.ndarray, detection: GridDetection, *, used: np.ndarray | None = None, title: str = ""
) -> Figure:
    """Draw the found lines and crossings over their picture, with some indices (row, column).

    Parameters
    ----------
    picture
        Grey picture (H, W).
    detection
        The grid found in it.
    used
        False where the camera's fit left a crossing out (n,).
    title
        Which picture.
    """
    figure = new_figure(9.0, 7.5)
    axes = figure.subplots()
    height, width = picture.shape
    step = max(1, -(-max(picture.shape) // _LONGEST_SIDE))
    axes.imshow(picture[::step, ::step], extent=(-0.5, width - 0.5, height - 0.5, -0.5), cmap="gray")
    for family, colour in (("horizontal", ORANGE), ("vertical", BLUE)):
        lines = [line for line in detection.lines if line.family == family]
        paths = [np.stack([line.u_px, line.v_px], axis=1)[line.good] for line in lines]
        axes.add_collection(LineCollection(paths, colors=colour, linewidths=0.7))
        axes.plot([], [], color=colour, label=f"{len(lines)} {family} lines")
    axes.plot(
        detection.u_px,
        detection.v_px,
        ls="",
        marker="o",
        ms=2.2,
        mfc="none",
        mec=GREEN,
        mew=0.6,
        label=f"{len(detection.row)} crossings",
    )
    if used is not None and not used.all():
        left = detection.u_px[~used], detection.v_px[~used]
        axes.plot(*left, ls="", marker="x", ms=7, color=INK, label=f"{int((~used).sum())} left out by the fit")
    _name_some(axes, detection)
    image_axes(axes)
    axes.set_title(title)
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def _name_some(axes, detection: GridDetection) -> None:  # type: ignore[no-untyped-def]
    """Write the index beside every fifth or so crossing."""
    every = max(1, int(max(detection.row.max(), detection.column.max()) / _NAMED))
    some = (detection.row % every == 0) & (detection.column % every == 0)
    for row, column, u, v in zip(
        detection.row[some], detection.column[some], detection.u_px[some], detection.v_px[some], strict=True
    ):
        axes.annotate(
            f"{row},{column}",
            (u, v),
            (3, 3),
            textcoords="offset points",
            fontsize=6,
            color=INK,
            bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.7},
        )


@styled
def distortion_quiver(test: DistortionTest, shape: tuple[int, int], *, title: str = "") -> Figure:
    """Draw observed minus fitted crossings before and after the lens is taken out, each enlarged by its own factor.

    Parameters
    ----------
    test
        The examined distortion.
    shape
        (H, W) of the picture, px.
    title
        Which picture.
    """
    figure = new_figure(10.0, 4.8)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, residual, name in zip(
        panels,
        (test.residual_before_px, test.residual_after_px),
        ("projective only", "with the lens"),
        strict=True,
    ):
        factor = _round_factor(_ARROW_SHARE * shape[1], residual)
        _arrows(axes, test.points_px, factor * residual, shape)
        rms = float(np.sqrt(np.mean(residual**2)))
        axes.set_title(f"{name}: rms {rms:.3f} px, {factor:g} times enlarged", loc="left")
    figure.suptitle(f"{title} observed - fitted".strip())
    return figure


@styled
def residual_quiver(
    points_px: np.ndarray, residual_px: np.ndarray, shape: tuple[int, int], *, title: str = ""
) -> Figure:
    """Draw observed minus modelled crossings, enlarged by a stated factor.

    Parameters
    ----------
    points_px, residual_px
        Crossings and their residuals (n, 2), px; NaN residuals are left out.
    shape
        (H, W) of the picture, px.
    title
        Which fit.
    """
    known = np.isfinite(residual_px).all(axis=1)
    factor = _round_factor(_ARROW_SHARE * shape[1], residual_px[known])
    figure = new_figure(WIDTH_IN, 6.0)
    axes = figure.subplots()
    _arrows(axes, points_px[known], factor * residual_px[known], shape)
    axes.set_title(f"{title}, {factor:g} times enlarged", loc="left")
    return figure


def _arrows(axes, points_px: np.ndarray, arrows_px: np.ndarray, shape: tuple[int, int]) -> None:  # type: ignore[no-untyped-def]
    axes.quiver(*points_px.T, *arrows_px.T, angles="xy", scale_units="xy", scale=1, color=INK, width=0.002)
    axes.set(xlim=(-0.5, shape[1] - 0.5), ylim=(shape[0] - 0.5, -0.5))
    image_axes(axes)


@styled
def neglect_map(test: DistortionTest, shape: tuple[int, int], *, mm_per_px: float | None = None) -> Figure:
    """Colour every crossing by the error of its position when the lens is neglected.

    Parameters
    ----------
    test
        The examined distortion.
    shape
        (H, W) of the picture, px.
    mm_per_px
        Mean scale; without it the error is in px.
    """
    figure = new_figure(WIDTH_IN, 5.2)
    axes = figure.subplots()
    error = effect_of_neglect_px(test) * (mm_per_px or 1.0)
    dots = axes.scatter(
        test.points_px[:, 0], test.points_px[:, 1], c=error, s=_dot_size(len(error)), cmap=HEIGHT_MAP, vmin=0.0
    )
    axes.set(xlim=(-0.5, shape[1] - 0.5), ylim=(shape[0] - 0.5, -0.5))
    image_axes(axes)
    unit = "px" if mm_per_px is None else "mm"
    colourbar(axes, dots, f"distance from the best plane view / {unit}")
    axes.set_title(f"largest {error.max():.3g} {unit}, rms {np.sqrt(np.mean(error**2)):.3g} {unit}", loc="left")
    return figure


@styled
def scale_map(detection: GridDetection, pitch_mm: float, mm_per_px: float) -> Figure:
    """Colour the pieces of line between crossings by the error of their length from the mean scale.

    Parameters
    ----------
    detection
        The grid found in the picture.
    pitch_mm
        True length of every piece, mm.
    mm_per_px
        The mean scale.
    """
    figure = new_figure(10.0, 4.6)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    pieces = [_pieces(detection, axis) for axis in (1, 0)]
    errors = [100 * (length * mm_per_px / pitch_mm - 1) for _, length in pieces]
    limit = symmetric_limit(np.concatenate(errors))
    for axes, (middle, _), error, name in zip(panels, pieces, errors, ("rows", "columns"), strict=True):
        dots = axes.scatter(
            middle[:, 0], middle[:, 1], c=error, s=_dot_size(len(error)), cmap=ERROR_MAP, vmin=-limit, vmax=limit
        )
        axes.set(xlim=(-0.5, detection.shape[1] - 0.5), ylim=(detection.shape[0] - 0.5, -0.5))
        axes.set_title(f"along the grid's {name}", loc="left")
        image_axes(axes)
    colourbar(panels[1], dots, "error of a length by the mean scale / %", extend="both")
    return figure


def _pieces(detection: GridDetection, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Middles (m, 2) and lengths (m,), px, of the pieces between neighbouring crossings along rows or columns."""
    nodes = np.full((detection.row.max() + 1, detection.column.max() + 1, 2), np.nan)
    nodes[detection.row, detection.column] = np.stack([detection.u_px, detection.v_px], axis=1)
    nodes = np.moveaxis(nodes, axis, 0)
    step, middle = np.diff(nodes, axis=0).reshape(-1, 2), (0.5 * (nodes[1:] + nodes[:-1])).reshape(-1, 2)
    seen = np.isfinite(step[:, 0])
    return middle[seen], np.hypot(*step[seen].T)


def _dot_size(count: int) -> float:
    return float(np.clip(9000 / max(count, 1), 4, 60))


@styled
def section_plot(sections: Mapping[str, LineSection]) -> Figure:
    """Draw the brightness across the lines, with the places at which they were found.

    Parameters
    ----------
    sections
        By the name of the lines they cross.
    """
    figure = new_figure(9.0, 2.6 * len(sections))
    panels = np.atleast_1d(figure.subplots(len(sections), 1))
    for axes, (name, section) in zip(panels, sections.items(), strict=True):
        axes.plot(section.distance_px, section.grey, color=BLUE, lw=GUIDE_PT)
        axes.vlines(section.line_px, *axes.get_ylim(), color=ORANGE, lw=0.6, alpha=0.7)
        axes.set(xlabel="distance across the lines / px", ylabel="grey level", xlim=(0, section.line_px[-1]))
        axes.set_title(f"across the {name} lines; found lines marked", loc="left")
    return figure


def _round_factor(longest_px: float, residual_px: np.ndarray) -> float:
    """Largest of 1, 2, 5, 10 ... that leaves the 99th percentile arrow shorter than `longest_px`."""
    long = float(np.percentile(np.hypot(*residual_px.T), SCALE_PERCENT[1])) if len(residual_px) else 0.0
    if long <= 0:
        return 1.0
    factor = longest_px / long
    decade = 10.0 ** np.floor(np.log10(factor))
    return float(decade * max(k for k in _ROUND_FACTORS if k * decade <= factor))
