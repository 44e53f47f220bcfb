"""Phase from one picture by the Fourier transform: for what does not hold still for three."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from fringecal.errors import PhaseError
from fringecal.phase.demodulation.demodulate import (
    MAX_SIGMA_RAD,
    MIN_MODULATION_SHARE,
    TYPICAL_PERCENTILE,
    PhaseMap,
    Reason,
    single_precision,
)
from fringecal.phase.demodulation.fringe_period import FringePeriod, carrier
from fringecal.phase.demodulation.noise import ROUNDING_SIGMA, Noise

_ROUNDING = Noise(ROUNDING_SIGMA)
_NO_MODULATION = 1e-12  # grey levels, for pixels without any: u(phi) is then large, and not infinite


def fourier_phase(
    image: ArrayLike, *, period: FringePeriod | None = None, width: float = 0.5, noise: Noise = _ROUNDING
) -> PhaseMap:
    """Demodulate one picture with a carrier of fringes.

    Parameters
    ----------
    image
        Grey values, (H, W), finite.
    period
        Fringe period and direction in which the phase rises; by default from the spectrum's peak, and then the
        direction is known modulo 180 deg only.
    width
        Half width of the filter as a share of the carrier's frequency, below 1: how fast the phase may change.
    noise
        The camera's noise, for u(phi).

    Returns
    -------
    PhaseMap
        Phase of `I = A + B cos(phi)`, B and A (all smoothed by the filter), u(phi) of the noise; pixels less than
        one period from the border are `OUTSIDE`.

    Notes
    -----
    A Hann-shaped window H around the carrier is cut from the spectrum (Takeda et al., J. Opt. Soc. Am. 72 (1982)
    156); `u(phi) = sqrt(2 mean(H^2)) sigma / B`. Slopes that move the local frequency out of the window, and
    edges, are lost or smoothed: use shifted frames where the object holds still.

    Raises
    ------
    PhaseError
        No periodic pattern, or a width that is not between 0 and 1.
    """
    grey = np.asarray(image, np.float64)
    if not 0 < width < 1:
        raise PhaseError(f"found a filter width of {width}; needed: a share of the carrier between 0 and 1")
    found = carrier(grey) if period is None else period
    per_px = np.array(found.gradient_rad_px) / (2 * np.pi)
    level = grey.mean()
    spectrum = fft.fft2(grey - level)
    v = fft.fftfreq(grey.shape[0])[:, None]
    u = fft.fftfreq(grey.shape[1])
    reach = width * float(np.hypot(*per_px))
    window = _hann(np.hypot(u - per_px[0], v - per_px[1]) / reach)
    signal = 2 * fft.ifft2(spectrum * window)
    background = level + fft.ifft2(spectrum * _hann(np.hypot(u, v) / reach)).real
    return _as_map(signal, background, float(np.mean(window**2)), found.period_px, noise)


def _hann(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 1 at distance 0, falling to 0 at 1."""
    return np.where(distance < 1, 0.5 + 0.5 * np.cos(np.pi * np.minimum(distance, 1)), 0.0)


def _as_map(
    signal: NDArray[np.complex128], background: NDArray[np.float64], power: float, period_px: float, noise: Noise
) -> PhaseMap:
    """Put the complex fringes into a phase map, with its reasons."""
    modulation = np.abs(signal)
    sigma = np.sqrt(2 * power) * noise.sigma(background) / np.maximum(modulation, _NO_MODULATION)
    floor = MIN_MODULATION_SHARE * float(np.percentile(modulation, TYPICAL_PERCENTILE))
    low = (modulation < floor) | (sigma > MAX_SIGMA_RAD)
    margin = int(np.ceil(period_px))
    inside = np.zeros(signal.shape, bool)
    inside[margin : signal.shape[0] - margin, margin : signal.shape[1] - margin] = True
    reasons = (np.where(low, Reason.LOW_MODULATION, 0) | np.where(inside, 0, Reason.OUTSIDE)).astype(np.uint8)
    valid = reasons == 0
    return PhaseMap(
        single_precision(np.where(valid, np.angle(signal), np.nan)),
        modulation.astype(np.float32),
        background.astype(np.float32),
        np.where(valid, sigma, np.nan).astype(np.float32),
        reasons,
        noise,
    )
