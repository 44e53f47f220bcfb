"""The grid as it was found: lines over the picture, and what distortion does to it, much enlarged."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from fringecal.camera.distortion import DistortionTest
from fringecal.detect.grid import GridDetection
from fringecal.report.style import BLUE, GREEN, INK, ORANGE, image_axes, new_figure, styled

_LONGEST_SIDE = 2400
_ARROW_SHARE = 0.05  # of the picture's width: length of the longest arrow before correction
_ROUND_FACTORS = (1, 2, 5)


@styled
def grid_overlay(picture: np.ndarray, detection: GridDetection, *, title: str = "") -> Figure:
    """Draw the found lines and crossings over their picture, with some indices (row, column).

    Parameters
    ----------
    picture
        Grey picture (H, W).
    detection
        The grid found in it.
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
    _name_some(axes, detection)
    image_axes(axes)
    axes.set_title(title)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _name_some(axes, detection: GridDetection) -> None:  # type: ignore[no-untyped-def]
    """Write the index beside every fifth or so crossing."""
    every = max(1, int(max(detection.row.max(), detection.column.max()) / 6))
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
    """Draw observed minus fitted crossings before and after the lens is taken out, enlarged by one factor.

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
    factor = _round_factor(_ARROW_SHARE * shape[1], test.residual_before_px)
    for axes, residual, name in zip(
        panels,
        (test.residual_before_px, test.residual_after_px),
        ("projective only", "with the lens"),
        strict=True,
    ):
        axes.quiver(
            *test.points_px.T,
            *(factor * residual).T,
            angles="xy",
            scale_units="xy",
            scale=1,
            color=INK,
            width=0.002,
        )
        rms = float(np.sqrt(np.mean(residual**2)))
        axes.set(xlim=(-0.5, shape[1] - 0.5), ylim=(shape[0] - 0.5, -0.5))
        axes.set_title(f"{name}: rms {rms:.3f} px", loc="left")
        image_axes(axes)
    figure.suptitle(f"{title} residuals, {factor:g} times enlarged".strip())
    return figure


def _round_factor(longest_px: float, residual_px: np.ndarray) -> float:
    """Largest of 1, 2, 5, 10 ... that leaves the 99th percentile arrow shorter than `longest_px`."""
    long = float(np.percentile(np.hypot(*residual_px.T), 99)) if len(residual_px) else 0.0
    if long <= 0:
        return 1.0
    factor = longest_px / long
    decade = 10.0 ** np.floor(np.log10(factor))
    return float(decade * max(k for k in _ROUND_FACTORS if k * decade <= factor))
