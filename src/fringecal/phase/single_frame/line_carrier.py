"""Phase from one picture along the lines that cross its fringes: sharp across edges that run the other way.

The Fourier method (`phase.fourier`) smooths over periods in all directions and so blurs the edges of strips. Here
each column (or row) that crosses the fringes is demodulated by itself, in a window of about one period.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from fringecal.errors import PhaseError
from fringecal.phase.demodulation.fringe_period import LEAST_CYCLES

Array = NDArray[np.float64]
Along = Literal["rows", "columns"]

_LEAST_SIDE_PX = 32  # of a picture: three periods of ten pixels
_LEAST_PERIOD_PX = 5.0  # below this a window of one period cannot tell the carrier from its mirror image
_LEVEL_PARTS = 3  # of the picture's height, over one of which its mean is taken off before the spectrum
_BAND = 1.25  # half width, as a ratio, of the band of frequencies that counts as one pitch
_ABOVE_NOISE = 2.5  # times the share that white noise would put into the band
_PEAK_SHARE = 0.3  # of all power beyond three cycles that this band must hold
_LEVEL = 1.2  # periods: standard deviation of the mean that is taken off before the fringes are demodulated
_WINDOW = 0.55  # of a period: standard deviation of the window along the line
_BETWEEN_PX = 0.7  # standard deviation of the smoothing from line to line
_NO_POWER = 1e-300  # added to a divisor: pictures without any light have no spectrum


@dataclass(frozen=True)
class LineCarrier:
    """Fringes of one picture, demodulated line by line.

    Parameters
    ----------
    along
        What the fringes run along: "rows" of the picture (they are crossed along columns), or "columns".
    period_px
        Period of the strongest frequency, along the crossing lines.
    signal
        Complex map (H, W): half of the modulation in grey levels, times exp(i phase); the phase rises with the row
        (or the column) whatever the projector's does.
    """

    along: Along
    period_px: float
    signal: NDArray[np.complex128]


def demodulate_lines(image: ArrayLike, *, along: Along | None = None) -> LineCarrier:
    """Demodulate one picture's fringes along the lines that cross them.

    Parameters
    ----------
    image
        Grey values, (H, W).
    along
        What the fringes run along; by default what shows the stronger period.

    Notes
    -----
    `C(v) = sum_k I'(v + k) g(k) exp(-i w (v + k))`, g a Gaussian of 0.55 periods, I' the picture less its mean over
    two periods; `arg C + w v` is the phase. A local frequency f instead of the carrier's w/2 pi is passed with
    `exp(-((f - w/2pi) 2 pi 0.55 / (w/2pi))^2 / 2)`: half at 34 % off.

    Raises
    ------
    PhaseError
        No fringes, or fringes finer than 5 px.

    Examples
    --------
    >>> rows = np.arange(160)[:, None] * np.ones(120)
    >>> found = demodulate_lines(100 + 50 * np.cos(2 * np.pi * rows / 12.0))
    >>> found.along, round(found.period_px, 1), round(float(2 * abs(found.signal[80, 60])), 0)
    ('rows', 12.0, 50.0)
    """
    grey = np.asarray(image, float)
    if grey.ndim != 2 or min(grey.shape) < _LEAST_SIDE_PX or not np.isfinite(grey).all():
        raise PhaseError(
            f"found a picture of shape {grey.shape}; needed: (height, width), finite, {_LEAST_SIDE_PX} px or more"
        )
    choices: tuple[Along, ...] = ("rows", "columns") if along is None else (along,)
    peaks = {choice: _strongest(grey if choice == "rows" else grey.T) for choice in choices}
    best = max(choices, key=lambda choice: peaks[choice][1])
    frequency, _, share = peaks[best]
    if share < _PEAK_SHARE:
        raise PhaseError(
            "no fringes found in the picture: neither rows nor columns have one dominant period "
            f"({100 * share:.0f} % of the power, {100 * _PEAK_SHARE:.0f} % needed). Take the picture by the "
            "projector's light, with fringes on the plate."
        )
    if frequency * _LEAST_PERIOD_PX > 1:
        raise PhaseError(
            f"fringes of {1 / frequency:.1f} px are too fine to be followed in one picture; at least "
            f"{_LEAST_PERIOD_PX:g} px are needed: use coarser fringes, or phase-shifted pictures"
        )
    signal = _demodulated(grey if best == "rows" else grey.T, frequency)
    return LineCarrier(best, 1 / frequency, signal if best == "rows" else signal.T)


def _strongest(grey: Array) -> tuple[float, float, float]:
    """Frequency along the columns in cycles/px, the power around it, and its share of all power."""
    rows = grey.shape[0]
    flat = grey - ndimage.uniform_filter1d(grey, max(3, rows // _LEVEL_PARTS) | 1, axis=0, mode="nearest")
    power = np.mean(np.abs(np.fft.rfft(flat * np.hanning(rows)[:, None], axis=0)) ** 2, axis=1) / rows**2
    power[: int(LEAST_CYCLES)] = 0
    # A pitch that changes over the field spreads the peak: what counts is the power in a band.
    total = np.concatenate([[0.0], np.cumsum(power)])
    low, high = (np.clip((np.arange(power.size) * f).astype(int), 0, power.size) for f in (1 / _BAND, _BAND))
    high = np.minimum(np.maximum(high, low) + 2, power.size)
    around = total[high] - total[np.maximum(low - 1, 0)]
    peak = int(np.argmax(around))
    near = slice(max(low[peak] - 1, 0), high[peak])
    centre = float(np.average(np.arange(power.size)[near], weights=power[near] + _NO_POWER))
    share = float(around[peak] / max(power.sum(), _NO_POWER))
    # Noise fills a wide band too: what counts as a period holds far more than the band's width.
    width = (high[peak] - low[peak]) / power.size
    return centre / rows, float(around[peak]), share if share > _ABOVE_NOISE * width else 0.0


def _demodulated(grey: Array, frequency: float) -> NDArray[np.complex128]:
    period = 1 / frequency
    rows = np.arange(grey.shape[0])[:, None]
    flat = grey - ndimage.gaussian_filter1d(grey, _LEVEL * period, axis=0, mode="nearest")
    turned = flat * np.exp(-2j * np.pi * frequency * rows)
    smooth = ndimage.gaussian_filter(turned, (_WINDOW * period, _BETWEEN_PX), mode="constant")
    return np.asarray(smooth * np.exp(2j * np.pi * frequency * rows), np.complex128)
