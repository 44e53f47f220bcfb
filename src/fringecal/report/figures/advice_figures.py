"""Pictures of the predicted uncertainty of heights, and of the gain by one more artefact."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from fringecal.report.style import GREY, HEIGHT_MAP, PALETTE, WIDTH_IN, colourbar, new_figure, styled


@styled
def forecast_bars(causes_mm: Mapping[float, Mapping[str, float]], *, title: str = "") -> Figure:
    """Draw what each source contributes to the uncertainty of heights, side by side for every height.

    Parameters
    ----------
    causes_mm
        By height in mm: contribution of each source to the standard uncertainty, mm.
    title
        Which rig.
    """
    labels = list(dict.fromkeys(label for causes in causes_mm.values() for label in causes))
    figure = new_figure(WIDTH_IN, 1.8 + 0.5 * len(labels))
    axes = figure.subplots()
    size = 0.8 / len(causes_mm)
    for i, (height, causes) in enumerate(causes_mm.items()):
        place = np.arange(len(labels)) + (i - (len(causes_mm) - 1) / 2) * size
        values = [causes.get(label, np.nan) for label in labels]
        axes.barh(place, values, height=size, color=PALETTE[i % len(PALETTE)], label=f"height {height:g} mm")
    axes.set_xscale("log")
    axes.set_yticks(np.arange(len(labels)), labels)
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.set(xlabel="contribution to the standard uncertainty of a height / mm", title=title)
    figure.legend(loc="outside lower center", ncols=len(causes_mm))
    return figure


@styled
def field_uncertainty(u_px: np.ndarray, v_px: np.ndarray, u_mm: np.ndarray, *, title: str = "") -> Figure:
    """Draw the standard uncertainty of one height over the camera's picture.

    Parameters
    ----------
    u_px, v_px
        Pixels, shape (n, m).
    u_mm
        Standard uncertainty there, mm.
    title
        Which height.
    """
    figure = new_figure(6.4, 5.0)
    axes = figure.subplots()
    image = axes.pcolormesh(u_px, v_px, u_mm, shading="gouraud", cmap=HEIGHT_MAP)
    axes.set(xlabel="u / px", ylabel="v / px", title=title, aspect="equal")
    axes.invert_yaxis()
    colourbar(axes, image, "u(z) / mm, noise of pixels left out")
    return figure


@styled
def gain_lines(
    names: Sequence[str], heights_mm: Sequence[float], before_mm: Sequence[float], after_mm: Sequence[Sequence[float]]
) -> Figure:
    """Draw the standard uncertainty of heights as it is, and as each proposed artefact would make it.

    Parameters
    ----------
    names
        The proposals.
    heights_mm
        Heights asked.
    before_mm
        Standard uncertainty of each height now, mm.
    after_mm
        The same with each proposal, one row per proposal.
    """
    figure = new_figure(WIDTH_IN, 4.2)
    axes = figure.subplots()
    axes.plot(heights_mm, before_mm, "o-", color=GREY, label="now")
    for i, (name, values) in enumerate(zip(names, after_mm, strict=True)):
        axes.plot(heights_mm, values, "o-", color=PALETTE[i % len(PALETTE)], label=f"with {name}")
    axes.set_yscale("log")
    axes.set(xlabel="height / mm", ylabel="standard uncertainty / mm")
    axes.grid(visible=True)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
