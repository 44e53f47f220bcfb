"""What of the frames the model leaves unexplained, pixel by pixel: whether a correction helped or not.

With right phase shifts, brightness and modulation of the frames, neither background nor modulation of a pixel depends
on its phase. Wrong ones make both ripple with it, everywhere and whatever the surface's shape is, so that this also
judges what was measured on a few smooth blocks.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from fringecal.numerics import TURN
from fringecal.phase.demodulation.demodulate import PhaseMap, demodulate
from fringecal.phase.demodulation.fringe_period import FringePeriod
from fringecal.phase.demodulation.noise import Noise
from fringecal.phase.demodulation.schemes import Scheme

_PIXELS = 400_000  # that are looked at: texture of 10 % then hides a ripple of 0.001
_ORDERS = (1, 2)  # of the ripple that brightness and phase shifts make
_FRINGES_AROUND = 2.0  # over which background and modulation are averaged, for texture and light to drop out
_LEAST_PIXELS = 500  # of which a ripple can be told from chance
_OUTLIER = 0.5  # of the mean around, beyond which a pixel is an edge
_NO_LIGHT = 1e-6  # grey levels, instead of a division by 0


@dataclass(frozen=True)
class ResidualSample:
    """Rows or columns of the frames, whole along the direction in which the phase rises most.

    Parameters
    ----------
    frames
        Grey levels, (N, rows, pixels along the fringes' direction).
    around_px
        Pixels over which means are taken.
    white_level
        Saturation, grey levels.
    """

    frames: NDArray
    around_px: int
    white_level: float | None

    @classmethod
    def of(cls, frames: ArrayLike, period: FringePeriod, white_level: float | None) -> "ResidualSample":
        """Take every so many lines of the pictures."""
        grey = np.asarray(frames)
        along_u = abs(period.gradient_rad_px[0]) >= abs(period.gradient_rad_px[1])
        lines = grey if along_u else grey.transpose(0, 2, 1)
        step = max(1, lines.shape[1] * lines.shape[2] // _PIXELS)
        slope = max(np.abs(period.gradient_rad_px).max(), _NO_LIGHT)
        around = int(np.clip(round(_FRINGES_AROUND * TURN / slope), 3, lines.shape[2]))
        return cls(np.ascontiguousarray(lines[:, ::step]), around, white_level)

    def left_by(self, scheme: Scheme) -> float:
        """Return the rms by which modulation and background depend on the phase with a scheme, shares of modulation."""
        return model_residual(self._map(scheme), self.around_px)

    def _map(self, scheme: Scheme) -> PhaseMap:
        """Demodulate the sample, however large the residual."""
        return demodulate(self.frames, scheme, white_level=self.white_level, noise=Noise(1.0), max_residual=np.inf)


def model_residual(map_: PhaseMap, around_px: int) -> float:
    """Return the rms by which modulation and background depend on the phase, as shares of the modulation.

    Parameters
    ----------
    map_
        Demodulated lines, (rows, pixels across the fringes).
    around_px
        Pixels over which the mean is taken that they are compared with.
    """
    modulation = _against_around(map_.modulation, map_.valid, around_px)
    background = _against_around(map_.background, map_.valid, around_px)
    level = np.median(map_.background[map_.valid] / np.maximum(map_.modulation[map_.valid], _NO_LIGHT))
    return float(np.hypot(_dependence(modulation, map_), level * _dependence(background, map_)))


def _against_around(values: NDArray, valid: NDArray[np.bool_], around_px: int) -> NDArray[np.float64]:
    """Return values over their mean around them along the line, less 1; NaN at edges and where masked."""
    count = ndimage.uniform_filter1d(valid.astype(np.float64), around_px, axis=1)
    total = ndimage.uniform_filter1d(np.where(valid, values, 0.0), around_px, axis=1)
    share = np.where(valid, values, np.nan) / np.maximum(total / np.maximum(count, _NO_LIGHT), _NO_LIGHT) - 1
    return np.where(np.abs(share) < _OUTLIER, share, np.nan)


def _dependence(share: NDArray[np.float64], map_: PhaseMap) -> float:
    """Return the rms of what is of the phase's first and second order in values: gamma makes higher ones."""
    known = np.isfinite(share) & map_.valid
    if known.sum() < _LEAST_PIXELS:
        return 0.0
    turned = np.exp(1j * map_.phase[known].astype(np.float64))
    waves = np.stack([np.ones(turned.size), *(part for k in _ORDERS for part in ((turned**k).real, (turned**k).imag))])
    fit = np.linalg.lstsq(waves @ waves.T, waves @ share[known])[0]
    return float(np.sqrt(np.sum(fit[1:] ** 2) / 2))
