"""Fringe period and direction, read from a phase map or from one picture."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import wrap

LEAST_CYCLES = 3.0
"""Cycles along a picture below which a period cannot be distinguished from uneven light."""

_LEAST_PIXELS = 16  # pairs of neighbours, and px along a picture's sides: fewer are a scrap of noise
_LEAST_BLOCK_SHARE = 0.8  # of a block's pixels: the mean over a fringe with larger gaps keeps the ripple
_LEAST_SLOPE = 1e-3  # rad/px: a fringe of 6283 px, longer than pictures are
_STEADY = 0.7  # length of the mean of differences as turns, below which noise of 0.85 rad wraps one in thousands
_MOVES = 0.5  # of the mean slope that the median one has, unless the phase stands still at most pixels
_ROUNDS = 2  # the second one with blocks as long as the first one's fringe
_PEAK_TO_MEDIAN = 30.0  # of the spectrum's power: in noise, a peak 30 times the median is one in 10^9 frequencies
_NO_POWER = 1e-300  # added before a logarithm


@dataclass(frozen=True)
class FringePeriod:
    """How long the fringes are and which way the phase rises.

    Parameters
    ----------
    period_px
        Length of one fringe across the fringes, px.
    direction_deg
        Direction in which the phase rises, from +u toward +v (down in the picture), in (-180, 180] deg;
        from one picture alone only known modulo 180 deg, and then in (-45, 135], whose ends are far from the
        directions that rigs have.
    gradient_rad_px
        The same as a vector: phase per pixel along u and along v, rad/px.
    """

    period_px: float
    direction_deg: float
    gradient_rad_px: tuple[float, float]


def fringe_period(phase: ArrayLike, valid: ArrayLike | None = None) -> FringePeriod:
    """Measure the fringe period of a phase map, wrapped or not.

    Parameters
    ----------
    phase
        Phase, rad, (H, W); fringes longer than 2 px.
    valid
        True where the phase is to be used, (H, W); NaN is never used.

    Notes
    -----
    The wrapped differences to the next pixel along u and along v are averaged over blocks as large as a
    fringe, which removes the ripple of gamma and of wrong phase shifts, and the median over the blocks is taken,
    which removes edges; over a field with perspective it is the period of the median block. Where noise is of the
    size of a turn the differences are taken about the direction of their mean.

    Raises
    ------
    PhaseError
        Fewer than 16 neighbouring valid pixels, or a phase that does not change.

    Examples
    --------
    >>> falling = np.angle(np.exp(-2j * np.pi * np.arange(90) / 22.5)) * np.ones((4, 1))
    >>> found = fringe_period(falling)
    >>> round(found.period_px, 6), round(abs(found.direction_deg), 6)
    (22.5, 180.0)
    """
    gradient_u, gradient_v = phase_gradient(phase, valid)
    usable = np.isfinite(gradient_u).sum(), np.isfinite(gradient_v).sum()
    if min(usable) < _LEAST_PIXELS:
        raise PhaseError(
            f"found {usable[0]} and {usable[1]} pairs of valid neighbours along u and v; a fringe period "
            f"needs at least {_LEAST_PIXELS} of each: check exposure and the mask's reasons"
        )
    slope_u, slope_v = _usual_slopes(gradient_u, gradient_v)
    for _ in range(_ROUNDS):
        side = round(2 * np.pi / max(np.hypot(slope_u, slope_v), _LEAST_SLOPE))
        around = (slope + wrap(gradient - slope) for gradient, slope in ((gradient_u, slope_u), (gradient_v, slope_v)))
        slope_u, slope_v = (_block_median(*each) for each in zip(around, (side, side), (slope_u, slope_v), strict=True))
    return _from_gradient(slope_u, slope_v)


def _usual_slopes(gradient_u: NDArray, gradient_v: NDArray) -> tuple[float, float]:
    """Return the median differences along both axes, or the direction of their means as turns.

    The means where noise wraps many differences to the other side, and where a strong gamma lets the phase stand still
    at most pixels.
    """
    known = [gradient[np.isfinite(gradient)] for gradient in (gradient_u, gradient_v)]
    middle = [float(np.median(each)) for each in known]
    means = [complex(np.mean(np.exp(1j * each))) for each in known]
    turned = [float(np.angle(mean)) for mean in means]
    steady = min(abs(mean) for mean in means) > _STEADY
    usual = middle if steady and math.hypot(*middle) > _MOVES * math.hypot(*turned) else turned
    return usual[0], usual[1]


def _block_median(gradient: NDArray, side: int, fallback: float) -> float:
    """Return the median over blocks of the mean gradient; the fallback if no block is nearly all valid."""
    rows, columns = gradient.shape[0] // side, gradient.shape[1] // side
    if side < 2 or rows * columns == 0:
        return fallback
    tiles = gradient[: rows * side, : columns * side].reshape(rows, side, columns, side)
    finite = np.isfinite(tiles)
    count = finite.sum(axis=(1, 3))
    total = np.where(finite, tiles, 0.0).sum(axis=(1, 3))
    full = count >= _LEAST_BLOCK_SHARE * side**2
    return float(np.median(total[full] / count[full])) if full.any() else fallback


def phase_gradient(phase: ArrayLike, valid: ArrayLike | None = None) -> tuple[NDArray, NDArray]:
    """Return the wrapped phase differences to the next pixel along u, (H, W-1), and along v, (H-1, W).

    Parameters
    ----------
    phase
        Phase, rad, (H, W).
    valid
        True where the phase is to be used; differences with a masked pixel are NaN.

    Examples
    --------
    >>> along_u, along_v = phase_gradient([[0.0, 0.5], [3.0, -2.5 - 0.25]])
    >>> along_u[0].tolist(), along_v[0].tolist()
    ([0.5], [3.0, 3.0331853071795...])
    """
    p = np.asarray(phase, dtype=np.float64)
    if p.ndim != 2:
        raise PhaseError(f"found a phase map of shape {p.shape}; needed: (height, width)")
    if valid is not None:
        p = np.where(np.asarray(valid, bool), p, np.nan)
    return wrap(np.diff(p, axis=1)), wrap(np.diff(p, axis=0))


def _from_gradient(gradient_u: float, gradient_v: float) -> FringePeriod:
    """Turn a phase gradient into a period and a direction."""
    slope = float(np.hypot(gradient_u, gradient_v))
    if slope == 0:
        raise PhaseError("the phase does not change over the picture: no fringes, or identical frames")
    direction = float(np.rad2deg(np.arctan2(gradient_v, gradient_u)))
    return FringePeriod(2 * np.pi / slope, direction, (gradient_u, gradient_v))


def carrier(image: ArrayLike) -> FringePeriod:
    """Measure the fringe period in one picture, from the peak of its spectrum.

    Parameters
    ----------
    image
        Grey values, (H, W), with at least three fringes across the picture.

    Notes
    -----
    The picture minus its mean, under a Hann window; the peak's place is refined by a parabola through the
    logarithms of its neighbours.

    Raises
    ------
    PhaseError
        No periodic pattern: no peak beyond three cycles per picture that stands out.

    Examples
    --------
    >>> round(carrier(np.cos(2 * np.pi * np.arange(200) / 12.5) * np.ones((64, 1))).period_px, 2)
    12.5
    """
    grey = np.asarray(image, dtype=np.float64)
    if grey.ndim != 2 or min(grey.shape) < _LEAST_PIXELS or not np.isfinite(grey).all():
        raise PhaseError(
            f"found a picture of shape {grey.shape}; needed: (height, width), finite, {_LEAST_PIXELS} px or more"
        )
    window = np.hanning(grey.shape[0])[:, None] * np.hanning(grey.shape[1])
    power = np.abs(np.fft.rfft2((grey - np.average(grey, weights=window)) * window)) ** 2
    cycles_v = np.fft.fftfreq(grey.shape[0]) * grey.shape[0]
    cycles_u = np.arange(power.shape[1])
    power[np.hypot(cycles_v[:, None], cycles_u) < LEAST_CYCLES] = 0
    row, column = np.unravel_index(np.argmax(power), power.shape)
    if power[row, column] <= _PEAK_TO_MEDIAN * np.median(power):
        raise PhaseError("no fringes found in the picture: its spectrum has no peak beyond three cycles")
    top, side = np.log(power[:, column] + _NO_POWER), np.log(power[row] + _NO_POWER)
    cycle_v = cycles_v[row] + _parabola(top[row - 1], top[row], top[(row + 1) % top.size])
    right = side[column + 1] if column + 1 < side.size else side[column - 1]
    cycle_u = cycles_u[column] + _parabola(side[abs(column - 1)], side[column], right)
    per_u, per_v = float(cycle_u) / grey.shape[1], float(cycle_v) / grey.shape[0]
    sign = 1.0 if per_u + per_v > 0 else -1.0
    return _from_gradient(sign * 2 * np.pi * per_u, sign * 2 * np.pi * per_v)


def _parabola(left: float, centre: float, right: float) -> float:
    """Return the vertex of a parabola through three equally spaced values, from the middle one."""
    curvature = left - 2 * centre + right
    return 0.0 if curvature >= 0 else float(0.5 * (left - right) / curvature)
