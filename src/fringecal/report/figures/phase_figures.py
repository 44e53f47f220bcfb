"""Phase figures: the wrapped phase, its uncertainty, why pixels are masked, and the diagnostics."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Patch

from fringecal.phase import Diagnosis, PhaseMap, Reason
from fringecal.report.style import (
    AMBER,
    BLUE,
    GREEN,
    GREY,
    GUIDE_PT,
    HEIGHT_MAP,
    INK,
    MASKED,
    ORANGE,
    PHASE_MAP,
    PURPLE,
    SCALE_PERCENT,
    SKY,
    WIDTH_IN,
    colourbar,
    image_axes,
    new_figure,
    styled,
)

# Lower in the list wins where a pixel has several reasons: dark pixels always lack modulation too.
_REASONS = (
    (Reason.LOW_MODULATION, "low modulation", SKY),
    (Reason.DARK, "dark", INK),
    (Reason.MISFIT, "large residual", PURPLE),
    (Reason.SATURATED, "saturated", ORANGE),
    (Reason.OUTSIDE, "outside", GREEN),
)
_LONGEST_SIDE = 1800  # pixels; more are finer than a report can print, and phase must not be averaged
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
    figure = new_figure(WIDTH_IN, 5.4)
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


@styled
def diagnostics_overview(diagnosis: Diagnosis, *, title: str = "") -> Figure:
    """Draw the diagnostics: ripple against phase and by order, waveform, each frame.

    Parameters
    ----------
    diagnosis
        What `fringecal.phase.diagnose` found.
    title
        Which capture.
    """
    figure = new_figure(10.5, 7.4)
    (error, ripple), (wave, frames) = figure.subplots(2, 2)
    _error(error, diagnosis)
    _ripple(ripple, diagnosis)
    _wave(wave, diagnosis)
    _frames(frames, diagnosis)
    names = ", ".join(dict.fromkeys(kind.text for kind in diagnosis.kinds())) or "nothing found"
    figure.suptitle(f"{title}: {names}" if title else names)
    return figure


_LEAST_RIPPLE_RAD = 0.02  # of a scale: what is smaller matters little, and must not look large
_CAUSES = {1: "lamp drift", 2: "phase shifts"}
_PHASE_TICKS = ([-np.pi, -np.pi / 2, 0, np.pi / 2, np.pi], ["-π", "-π/2", "0", "π/2", "π"])


def _error(axes: Axes, diagnosis: Diagnosis) -> None:
    """Draw the error of the phase over one fringe, as the stated model leaves it."""
    axes.set_title("ripple of the phase over one fringe")
    if not diagnosis.ripple:
        _nothing(axes)
        return
    phase = np.linspace(-np.pi, np.pi, 361)
    error = np.sum([(r * np.exp(-1j * k * phase)).real for k, r in diagnosis.ripple.items()], axis=0)
    axes.axhline(0, color=INK, linewidth=GUIDE_PT)
    axes.plot(phase, error, color=BLUE, label=f"rms {error.std():.4f} rad")
    largest = max(_LEAST_RIPPLE_RAD, 1.4 * float(np.abs(error).max()))
    axes.set_ylim(-largest, largest)
    axes.set_xticks(*_PHASE_TICKS)
    axes.set_xlabel("phase / rad")
    axes.set_ylabel("phase error / rad")
    axes.legend(loc="upper right")


def _ripple(axes: Axes, diagnosis: Diagnosis) -> None:
    """Draw the amplitude of each order of ripple, with the usual cause of each."""
    axes.set_title("ripple by order")
    if not diagnosis.ripple_rad:
        _nothing(axes)
        return
    # N phase shifts turn harmonics N - 1 and N + 1 of the fringes into a ripple of order N.
    n = len(diagnosis.phase_shifts.stated_rad) if diagnosis.phase_shifts is not None else 3
    causes = _CAUSES | {n: "gamma"}
    orders, amplitudes = zip(*diagnosis.ripple_rad.items(), strict=True)
    places = range(len(orders))
    axes.bar(places, amplitudes, color=[ORANGE if k in causes else GREY for k in orders], width=0.6)
    axes.set_xticks(list(places), [f"{k}\n{causes.get(k, '')}" for k in orders])
    axes.set_xlabel("order: periods per fringe, and usual cause")
    axes.set_ylabel("amplitude / rad")
    axes.set_ylim(0, max(_LEAST_RIPPLE_RAD, 1.1 * max(amplitudes)))


def _wave(axes: Axes, diagnosis: Diagnosis) -> None:
    """Draw the waveform from its measured harmonics beside a cosine."""
    axes.set_title("waveform")
    if diagnosis.wave is None:
        _nothing(axes)
        return
    angle = np.linspace(-np.pi, np.pi, 361)
    shape = np.cos(angle)
    for order, share in enumerate(diagnosis.wave.ratios, start=2):
        shape = shape + (share * np.exp(1j * order * angle)).real
    axes.plot(angle, np.cos(angle), color=GREY, linestyle="--", label="cosine")
    axes.plot(angle, shape, color=BLUE, label=f"measured (exponent {diagnosis.wave.gamma:.2f})")
    axes.set_xticks(*_PHASE_TICKS)
    axes.set_xlabel("phase from the crest / rad")
    axes.set_ylabel("intensity / modulation")
    axes.legend(loc="lower center")


def _frames(axes: Axes, diagnosis: Diagnosis) -> None:
    """Draw by how much each frame differs from the stated one: phase shift and modulation."""
    axes.set_title("each frame")
    steps = diagnosis.phase_shifts
    if steps is None:
        _nothing(axes)
        return
    places = np.arange(len(steps.stated_rad))
    error, u = np.rad2deg(steps.errors_rad), np.rad2deg(steps.u_rad)
    axes.bar(
        places - 0.2, error, 0.36, yerr=2 * u, color=BLUE, ecolor=INK, label="phase shift - stated / deg (bars: 2 u)"
    )
    axes.bar(places + 0.2, 100 * (steps.gain_per_frame - 1), 0.36, color=AMBER, label="modulation - mean / %")
    axes.axhline(0, color=INK, linewidth=GUIDE_PT)
    largest = max(1.0, np.abs(error).max(), 100 * np.abs(steps.gain_per_frame - 1).max())
    axes.set_ylim(-1.2 * largest, 1.6 * largest)  # room for the legend
    axes.set_xticks(places, [f"{k + 1}" for k in places])
    axes.set_xlabel("frame")
    axes.set_ylabel("deg or %")
    axes.legend(loc="upper left")


def _nothing(axes: Axes) -> None:
    """Say that there is nothing to draw."""
    axes.text(0.5, 0.5, "not measured", ha="center", va="center", color=GREY, transform=axes.transAxes)
    axes.set_xticks([])
    axes.set_yticks([])


def _phase(axes: Axes, map_: PhaseMap) -> None:
    """Draw a wrapped phase with its cyclic scale."""
    image = map_picture(axes, map_.phase)
    axes.set_facecolor(_NO_PHASE)
    image.set(cmap=PHASE_MAP, clim=(-np.pi, np.pi))
    bar = colourbar(axes, image, "wrapped phase / rad")
    bar.set_ticks([-np.pi, -np.pi / 2, 0, np.pi / 2, np.pi], labels=["-π", "-π/2", "0", "π/2", "π"])


def _scalar(axes: Axes, values: np.ndarray, label: str, *, from_zero: bool) -> None:
    """Draw a map on a scale that ends where 99 % of its pixels do."""
    finite = values[np.isfinite(values)]
    low, high = np.percentile(finite, SCALE_PERCENT) if finite.size else (0.0, 1.0)
    image = map_picture(axes, values)
    image.set(cmap=HEIGHT_MAP, clim=(0.0 if from_zero else low, high if high > 0 else 1.0))
    colourbar(axes, image, label, extend="max" if from_zero else "both")


def _reasons(axes: Axes, map_: PhaseMap) -> list[Patch]:
    """Draw one colour for each reason; return the legend with the share of the picture that each colour covers."""
    codes = np.zeros(map_.reasons.shape, np.uint8)
    for code, (reason, _, _) in enumerate(_REASONS, start=1):
        codes[(map_.reasons & reason) > 0] = code
    colours = [BLUE, *(colour for _, _, colour in _REASONS)]
    image = map_picture(axes, codes)
    image.set(cmap=ListedColormap(colours), clim=(-0.5, len(_REASONS) + 0.5))
    axes.set_title("mask, one reason for each pixel")
    names = ("valid", *(name for _, name, _ in _REASONS))
    return [
        Patch(color=colour, label=f"{name} {share:.2%}")
        for code, (name, colour) in enumerate(zip(names, colours, strict=True))
        if (share := float((codes == code).mean())) > 0 or code == 0
    ]


def map_picture(axes: Axes, values: np.ndarray) -> AxesImage:
    """Show a map in picture coordinates, thinned to what a page can print."""
    height, width = values.shape
    step = max(1, -(-max(values.shape) // _LONGEST_SIDE))
    axes.set_facecolor(MASKED)
    image = axes.imshow(values[::step, ::step], extent=(-0.5, width - 0.5, height - 0.5, -0.5))
    image_axes(axes)
    return image
