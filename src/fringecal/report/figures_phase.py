"""Phase figures: the wrapped phase, its modulation and uncertainty, and why pixels are masked."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Patch

from fringecal.phase import PhaseMap, Reason
from fringecal.report.style import (
    BLUE,
    GREEN,
    HEIGHT_MAP,
    INK,
    MASKED,
    ORANGE,
    PHASE_MAP,
    PURPLE,
    SKY,
    colourbar,
    image_axes,
    new_figure,
    styled,
)

# Lower in the list wins where a pixel has several reasons: dark pixels always lack modulation too.
_REASONS = (
    (Reason.LOW_MODULATION, "low modulation", SKY),
    (Reason.DARK, "dark", INK),
    (Reason.MISFIT, "misfit", PURPLE),
    (Reason.SATURATED, "saturated", ORANGE),
    (Reason.OUTSIDE, "outside", GREEN),
)
_LONGEST_SIDE = 1800
# The cyclic scale passes through light grey and black: no phase is drawn in a colour that it lacks.
_NO_PHASE = "#8fbf8f"


@styled
def wrapped_phase(map_: PhaseMap, *, title: str = "") -> Figure:
    """Draw the wrapped phase in the camera's picture on a cyclic scale; masked pixels are green.

    Parameters
    ----------
    map_
        A demodulated set of frames.
    title
        Which capture.
    """
    figure = new_figure(7.0, 5.4)
    axes = figure.subplots()
    _phase(axes, map_)
    axes.set_title(title)
    return figure


@styled
def phase_overview(map_: PhaseMap, *, title: str = "") -> Figure:
    """Draw wrapped phase, modulation, u(phi) and the reasons of the mask side by side.

    Parameters
    ----------
    map_
        A demodulated set of frames.
    title
        Which capture.
    """
    height, width = map_.phase.shape
    figure = new_figure(10.5, min(14.0, 1.6 + 8.4 * height / width))
    (phase, modulation), (sigma, reasons) = figure.subplots(2, 2)
    _phase(phase, map_)
    phase.set_title("wrapped phase")
    _scalar(modulation, map_.modulation, "modulation B / grey levels", from_zero=True)
    modulation.set_title("modulation")
    _scalar(sigma, map_.sigma, "u(phase) / rad", from_zero=False)
    sigma.set_title("standard uncertainty of the phase")
    handles = _reasons(reasons, map_)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    figure.suptitle(title)
    return figure


def _phase(axes: Axes, map_: PhaseMap) -> None:
    """Draw a wrapped phase with its cyclic scale."""
    image = _picture(axes, map_.phase)
    axes.set_facecolor(_NO_PHASE)
    image.set(cmap=PHASE_MAP, clim=(-np.pi, np.pi))
    bar = colourbar(axes, image, "wrapped phase / rad")
    bar.set_ticks([-np.pi, -np.pi / 2, 0, np.pi / 2, np.pi], labels=["-π", "-π/2", "0", "π/2", "π"])


def _scalar(axes: Axes, values: np.ndarray, label: str, *, from_zero: bool) -> None:
    """Draw a map on a scale that ends where 99 % of its pixels do."""
    finite = values[np.isfinite(values)]
    low, high = np.percentile(finite, [1, 99]) if finite.size else (0.0, 1.0)
    image = _picture(axes, values)
    image.set(cmap=HEIGHT_MAP, clim=(0.0 if from_zero else low, high if high > 0 else 1.0))
    colourbar(axes, image, label, extend="max" if from_zero else "both")


def _reasons(axes: Axes, map_: PhaseMap) -> list[Patch]:
    """Draw one colour for each reason; return the legend, which names the share of each."""
    codes = np.zeros(map_.reasons.shape, np.uint8)
    for code, (reason, _, _) in enumerate(_REASONS, start=1):
        codes[(map_.reasons & reason) > 0] = code
    colours = [BLUE, *(colour for _, _, colour in _REASONS)]
    image = _picture(axes, codes)
    image.set(cmap=ListedColormap(colours), clim=(-0.5, len(_REASONS) + 0.5))
    shares = map_.shares()
    handles = [Patch(color=BLUE, label=f"valid {shares['valid']:.2%}")]
    for reason, name, colour in _REASONS:
        share = shares[(reason.name or "").lower()]
        if share > 0:
            handles.append(Patch(color=colour, label=f"{name} {share:.2%}"))
    axes.set_title("mask and its reasons")
    return handles


def _picture(axes: Axes, values: np.ndarray) -> AxesImage:
    """Show a map in picture coordinates, thinned to what a page can print."""
    height, width = values.shape
    step = max(1, -(-max(values.shape) // _LONGEST_SIDE))
    axes.set_facecolor(MASKED)
    image = axes.imshow(values[::step, ::step], extent=(-0.5, width - 0.5, height - 0.5, -0.5))
    image_axes(axes)
    return image
