"""The camera's noise: what is stated, or what the pictures themselves show."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from fringecal.errors import PhaseError
from fringecal.numerics import UNIFORM_SD, robust_sd
from fringecal.phase.demodulation.schemes import Scheme, least_squares

ROUNDING_SIGMA = UNIFORM_SD
"""Standard deviation of rounding to whole grey levels."""

LEAST_SIDE_PX = 16
"""Shorter side of a picture whose noise is estimated: three times the length of the filter that sees it, px."""

MAX_SAMPLE_PIXELS = 400_000
"""Pixels from which the noise is estimated: it is then known to about 0.2 %."""

BAND_ROWS = 32
"""Rows of one of the bands that make up the sample, px: a band loses four of them at its seams."""

_FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
_LEAST_BACKGROUND = 0.15  # of the brightest background: where it is weaker, I / A is no longer linear in the noise
_BIN_PIXELS, _MOST_BINS = 2000, 12  # of one brightness: a variance known to 5 %, and bins enough for a straight line
_LEAST_SPREAD = 0.05  # of the mean brightness: over a smaller range a line's two coefficients cannot be distinguished
_LEAST_VARIANCE = 1e-12  # grey levels squared: frames without any noise must not divide by 0


@dataclass(frozen=True)
class Noise:
    """Variance of a grey value: `var(I) = gain I + read_sigma^2`.

    Parameters
    ----------
    read_sigma
        Standard deviation at I = 0, grey levels; rounding to whole levels is part of it.
    gain
        Shot noise: grey levels of variance per grey level (1 / electrons per level).
    """

    read_sigma: float
    gain: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite([self.read_sigma, self.gain]).all() and min(self.read_sigma, self.gain) >= 0):
            raise PhaseError(
                f"noise of read_sigma {self.read_sigma}, gain {self.gain} is impossible; "
                "both must be finite and not negative"
            )

    def sigma(self, grey: ArrayLike) -> NDArray[np.float64]:
        """Return the standard deviation at a grey value, grey levels."""
        return np.sqrt(self.gain * np.maximum(np.asarray(grey, np.float64), 0) + self.read_sigma**2)


def estimate_noise(
    frames: ArrayLike, phase_shifts_rad: ArrayLike | Scheme, *, white_level: float | None = None
) -> Noise:
    """Estimate the camera's noise from one phase-shifted set of pictures.

    Parameters
    ----------
    frames
        Grey values, (N, H, W), N >= 3, of the same scene under shifted fringes.
    phase_shifts_rad
        Phase shifts delta_n, rad, (N,), or a `Scheme`.
    white_level
        Saturation, grey levels; saturated neighbourhoods are left out.

    Notes
    -----
    `g_n = I_n / A`, with the background A of the same pixel, holds no texture; fourth differences along
    both axes then remove fringes longer than about 6 px, and what is left is noise. With
    `var(I) = gain I + r^2` its variance is `r^2 F + gain X`, F and X known at each pixel, so that
    `e^2 / F` against `X / F` is a line. Its median in bins of equal count ignores edges.
    Noise that the camera has smoothed (JPEG, demosaicing, denoising) is underestimated: use repeats.

    Raises
    ------
    PhaseError
        Shapes that do not fit, or pictures smaller than 16 x 16 px.
    """
    scheme = phase_shifts_rad if isinstance(phase_shifts_rad, Scheme) else least_squares(phase_shifts_rad)
    sample = _sample(np.asarray(frames), len(scheme.phase_shifts_rad))
    floor = ROUNDING_SIGMA if np.issubdtype(sample.dtype, np.integer) else 0.0
    grey = sample.astype(np.float32)
    abscissa, residual = _texture_free(grey, scheme.weights[0].astype(np.float32), white_level)
    return _line_through_bins(abscissa, residual, floor)


def noise_from_repeats(sets: ArrayLike, *, white_level: float | None = None) -> Noise:
    """Estimate the camera's noise from repeated sets: the same frames taken R times.

    Parameters
    ----------
    sets
        Grey values, (R, N, H, W), R >= 2.
    white_level
        Saturation, grey levels; saturated pixels are left out.

    Notes
    -----
    Successive repeats differ by noise only; `E (I_r - I_r+1)^2 / 2 = gain I + r^2`.

    Raises
    ------
    PhaseError
        Fewer than two repeats.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> noise = noise_from_repeats(100 + rng.normal(0, 2.0, (3, 3, 60, 60)))
    >>> bool(abs(noise.sigma(100) - 2.0) < 0.1)
    True
    """
    grey = np.asarray(sets)
    if grey.ndim != 4 or grey.shape[0] < 2:
        raise PhaseError(f"found an array of shape {grey.shape}; repeats need (R, N, H, W) with R >= 2")
    floor = ROUNDING_SIGMA if np.issubdtype(grey.dtype, np.integer) else 0.0
    values = grey.astype(np.float64)
    mean = (values[1:] + values[:-1]) / 2
    white = np.inf if white_level is None else white_level
    use = np.maximum(values[1:], values[:-1]) < white
    return _line_through_bins(mean[use], ((values[1:] - values[:-1]) / np.sqrt(2))[use], floor, _mean_square)


def _mean_square(residual: NDArray) -> float:
    """Return the plain variance: differences of integers take few values, which a median would round to."""
    return float(np.mean(np.square(residual)))


def _robust_variance(residual: NDArray) -> float:
    """Return the variance that the median absolute residual of normal noise implies."""
    return robust_sd(residual, about=0) ** 2


def _sample(frames: NDArray, n_steps: int) -> NDArray:
    """Take bands of rows, evenly spread, that hold enough pixels and no more."""
    if frames.ndim != 3 or frames.shape[0] != n_steps or min(frames.shape[1:]) < LEAST_SIDE_PX:
        raise PhaseError(
            f"found frames of shape {frames.shape}; {n_steps} phase shifts need ({n_steps}, height, width) "
            f"and their noise at least {LEAST_SIDE_PX} x {LEAST_SIDE_PX} px"
        )
    height, width = frames.shape[1:]
    step = int(np.ceil(height * width / MAX_SAMPLE_PIXELS))
    rows = np.arange(height) // BAND_ROWS % step == 0
    return frames[:, rows]


def _texture_free(
    grey: NDArray[np.float32], weights: NDArray[np.float32], white_level: float | None
) -> tuple[NDArray, NDArray]:
    """Return X / F and e / sqrt(F) of every usable pixel of every frame."""
    background = np.tensordot(weights, grey, axes=1)
    usable = _usable(grey, background, white_level)
    a = np.where(background > 0, background, 1).astype(np.float32)
    abscissae, residuals = [], []
    for n, frame in enumerate(grey):
        share = frame / a
        coefficients = [np.float32(k == n) - share * w for k, w in enumerate(weights)]
        factor = _filtered(sum(c * c for c in coefficients) / (a * a), _FOURTH_DIFFERENCE**2)
        shot = _filtered(
            sum(c * c * i for c, i in zip(coefficients, grey, strict=True)) / (a * a), _FOURTH_DIFFERENCE**2
        )
        residual = _filtered(share, _FOURTH_DIFFERENCE)
        abscissae.append(shot[usable] / factor[usable])
        residuals.append(residual[usable] / np.sqrt(factor[usable]))
    return np.concatenate(abscissae), np.concatenate(residuals)


def _filtered(image: NDArray, taps: NDArray) -> NDArray[np.float32]:
    """Filter with the same taps along both axes."""
    return cv2.sepFilter2D(np.asarray(image, np.float32), cv2.CV_32F, taps, taps)


def _usable(grey: NDArray, background: NDArray, white_level: float | None) -> NDArray[np.bool_]:
    """Mark pixels whose 5 x 5 neighbourhood is lit, unsaturated and finite; bands' seams are left in."""
    white = np.inf if white_level is None else white_level
    bright = np.isfinite(background) & (background > _LEAST_BACKGROUND * np.nanmax(background, initial=0.0))
    good = (bright & (grey.max(axis=0) < white)).astype(np.uint8)
    return (
        cv2.erode(
            good, np.ones((_FOURTH_DIFFERENCE.size,) * 2, np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
        )
        > 0
    )


def _line_through_bins(
    abscissa: NDArray,
    residual: NDArray,
    floor: float,
    variance_of: Callable[[NDArray], float] = _robust_variance,
) -> Noise:
    """Fit `variance = r^2 + gain x`, neither negative, to the variances in bins of equal count."""
    bins = int(np.clip(abscissa.size // _BIN_PIXELS, 1, _MOST_BINS))
    order = np.argsort(abscissa)
    xs: list[float] = []
    variances: list[float] = []
    for part in np.array_split(order, bins):
        if part.size:
            xs.append(float(np.median(abscissa[part])))
            variances.append(variance_of(residual[part]))
    if not xs:
        return Noise(floor)
    x, variance = np.array(xs), np.maximum(variances, floor**2)
    if np.ptp(x) < _LEAST_SPREAD * abs(x.mean()):
        # One brightness only: read noise and shot noise cannot be distinguished, and need not be.
        return Noise(float(np.sqrt(np.median(variance))))
    weight = 1 / np.maximum(variance, _LEAST_VARIANCE)
    columns = np.column_stack([np.ones_like(x), np.maximum(x, 0)])
    (read2, gain), _ = nnls(columns * weight[:, None], variance * weight)
    return Noise(float(np.sqrt(max(read2, floor**2))), float(gain))
