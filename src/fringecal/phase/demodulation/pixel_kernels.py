"""Compiled kernels: the camera's integers in; phase, modulation and the reasons of the mask out, in one pass.

A pixel costs N weighted sums, one division, one square root and a polynomial arctangent (u(phi) another division
and root), all in float32 and written so that the compiler vectorises them. Frames are taken in blocks that stay in the
first-level cache, so that memory is read once and written once.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import over_bands

SATURATED, DARK, LOW_MODULATION, OUTSIDE, MISFIT = 1, 2, 4, 8, 16

BLOCK = 1024
"""Pixels taken at a time: seven float32 buffers of this length fit a 32 KiB first-level cache."""

_LEAST_BLOCKS = 16  # that are worth a thread of their own
_THREE = 3  # frames whose sums stay in registers
_FLOAT_SIZE = 4  # bytes; integers have fewer, and are always finite
# The float32 next below pi: half a turn rounds to it, never to a number outside (-pi, pi].
_PI = np.nextafter(np.float32(np.pi), np.float32(0))
_ZERO, _INFINITY, _NAN = np.float32(0), np.float32(np.inf), np.float32(np.nan)
_NO_REASON = np.uint8(0)

# "nnan" and "ninf" are left out: frames may hold NaN, which must reach the mask.
_FAST = {"reassoc", "nsz", "arcp", "contract"}

# 2 atan(t) = t P(t^2) on [0, 1]: minimax by Lawson's iteration, largest error 3.4e-6 rad.
_P0, _P1, _P2, _P3, _P4, _P5 = (
    np.float32(c) for c in (1.99995444, -0.665245655, 0.387080745, -0.232852945, 0.105294682, -0.023438263)
)


class Limits(NamedTuple):
    """What makes a pixel invalid, in grey levels but for the last two.

    Parameters
    ----------
    brightest
        A frame above this is saturated; of the frames' own type, in which sixteen and more compare at once.
    dark_level
        A background below this is dark.
    min_modulation
        A modulation below this is low.
    max_sigma_rad
        A phase with a larger standard uncertainty has low modulation.
    residual_level
        A larger rms residual of the least-squares fit, in grey levels, counts as too large, if it is also ...
    residual_share
        ... larger than this share of the modulation.
    """

    brightest: np.uint8 | np.uint16 | np.float32
    dark_level: np.float32
    min_modulation: np.float32
    max_sigma_rad: np.float32
    residual_level: np.float32
    residual_share: np.float32


@njit(fastmath=_FAST, inline="always")
def _angle(y, x, length):  # type: ignore[no-untyped-def]
    """Return the four-quadrant arctangent of two float32 numbers, whose length is known, to 5e-6 rad; NaN for (0, 0).

    By half the angle, `atan2(y, |x|) = 2 atan(y / (length + |x|))`: the argument of the polynomial lies in [-1, 1]
    without any exchange of x and y, and x < 0 is what is left of half a turn.
    """
    t = y / (length + abs(x))
    q = t * t
    angle = t * (_P0 + q * (_P1 + q * (_P2 + q * (_P3 + q * (_P4 + q * _P5)))))
    return np.copysign(_PI, y) - angle if x < _ZERO else angle


@njit(fastmath=_FAST, inline="always")
def _three_sums(frames, start, count, weights, sums, peak):  # type: ignore[no-untyped-def]
    """Fill three rows of `sums` with weighted sums over one block, and `peak` with its brightest frame.

    The first three frames are summed at once: with three and four frames, most of the time is theirs.
    """
    a, c, s = sums[0], sums[1], sums[2]
    one, two, three = (
        frames[0, start : start + count],
        frames[1, start : start + count],
        frames[2, start : start + count],
    )
    for i in range(count):
        x, y, z = np.float32(one[i]), np.float32(two[i]), np.float32(three[i])
        a[i] = weights[0, 0] * x + weights[0, 1] * y + weights[0, 2] * z - weights[0, -1]
        c[i] = weights[1, 0] * x + weights[1, 1] * y + weights[1, 2] * z - weights[1, -1]
        s[i] = weights[2, 0] * x + weights[2, 1] * y + weights[2, 2] * z - weights[2, -1]
        peak[i] = max(one[i], max(two[i], three[i]))
    for n in range(3, frames.shape[0]):
        wa, wc, ws = weights[0, n], weights[1, n], weights[2, n]
        frame = frames[n, start : start + count]
        for i in range(count):
            x = np.float32(frame[i])
            a[i] += wa * x
            c[i] += wc * x
            s[i] += ws * x
            peak[i] = max(peak[i], frame[i])


@njit(fastmath=_FAST, inline="always")
def _flags(a, b, peak, limits):  # type: ignore[no-untyped-def]
    """Return the reasons that both kernels know."""
    dim, low = _flag(a < limits.dark_level, DARK), _flag(b < limits.min_modulation, LOW_MODULATION)
    return np.uint8(_flag(peak > limits.brightest, SATURATED) | dim | low)


@njit(fastmath=_FAST, inline="always")
def _flag(raised, reason):  # type: ignore[no-untyped-def]
    """Return the reason if raised, else none."""
    return np.uint8(reason) if raised else _NO_REASON


@njit(fastmath=_FAST, inline="always")
def _put_outside(modulation, maps, reasons):  # type: ignore[no-untyped-def]
    """Flag the pixels of float frames whose modulation is no finite number."""
    for i in range(modulation.shape[0]):
        if not abs(modulation[i]) < _INFINITY:
            reasons[i] |= np.uint8(OUTSIDE)
            for map_ in maps:
                map_[i] = _NAN


@njit(fastmath=_FAST, inline="always")
def _row(weights, row):  # type: ignore[no-untyped-def]
    """Return one row of the weights of three frames as four numbers, which stay in registers."""
    return weights[row, 0], weights[row, 1], weights[row, 2], weights[row, 3]


@njit(fastmath=_FAST, inline="always")
def _sum_of_three(row, x, y, z):  # type: ignore[no-untyped-def]
    """Return a weighted sum of three grey values."""
    return row[0] * x + row[1] * y + row[2] * z - row[3]


@njit(fastmath=_FAST, inline="always")
def _plain_pixel(a, c, s, peak, limits):  # type: ignore[no-untyped-def]
    """Return phase (NaN where masked), modulation and reasons of one pixel."""
    b = np.sqrt(c * c + s * s)
    why = _flags(a, b, peak, limits)
    return _angle(s, c, b) if why == _NO_REASON else _NAN, b, why


@njit(fastmath=_FAST, error_model="numpy")
def _plain_three(frames, start, weights, limits, phase, modulation, reasons):  # type: ignore[no-untyped-def]
    """Demodulate one block of three frames, their sums in registers: a sixth of the time less."""
    end = start + phase.shape[0]
    one, two, three = frames[0, start:end], frames[1, start:end], frames[2, start:end]
    row_a, row_c, row_s = _row(weights, 0), _row(weights, 1), _row(weights, 2)
    for i in range(end - start):
        x, y, z = np.float32(one[i]), np.float32(two[i]), np.float32(three[i])
        a, c, s = _sum_of_three(row_a, x, y, z), _sum_of_three(row_c, x, y, z), _sum_of_three(row_s, x, y, z)
        peak = max(one[i], max(two[i], three[i]))
        phase[i], modulation[i], reasons[i] = _plain_pixel(a, c, s, peak, limits)


@njit(fastmath=_FAST, error_model="numpy")
def _plain_many(frames, start, weights, limits, phase, modulation, reasons):  # type: ignore[no-untyped-def]
    """Demodulate one block of any number of frames."""
    count = phase.shape[0]
    sums, peak = np.empty((3, BLOCK), np.float32), np.empty(BLOCK, frames.dtype)
    _three_sums(frames, start, count, weights, sums, peak)
    a, c, s = sums[0], sums[1], sums[2]
    for i in range(count):
        phase[i], modulation[i], reasons[i] = _plain_pixel(a[i], c[i], s[i], peak[i], limits)


def demodulate_plain(
    frames: NDArray,
    weights: NDArray[np.float32],
    limits: Limits,
    phase: NDArray[np.float32],
    modulation: NDArray[np.float32],
    reasons: NDArray[np.uint8],
) -> None:
    """Demodulate without uncertainties: the least that a fast camera loop needs.

    Parameters
    ----------
    frames
        Grey values, uint8, uint16 or float32, (N, M): M pixels in any order.
    weights
        float32 (3, N + 1): `Scheme.weights` and, as the last column, `Scheme.zero`.
    limits
        `Limits`; only brightest, dark_level and min_modulation are used.
    phase, modulation, reasons
        Outputs, (M,): float32 rad (NaN where masked), float32 grey levels, uint8 flags.
    """
    size = 4 * BLOCK if len(frames) == _THREE else BLOCK
    maps = phase, modulation, reasons
    over_bands(
        _plain_blocks, -(-len(phase) // size), size, _readonly(frames), weights, limits, *maps, least=_LEAST_BLOCKS
    )


def _readonly(frames: NDArray) -> NDArray:
    """Return a view that cannot be written: decoded pictures are such arrays, and two kinds would be compiled twice."""
    view = frames.view()
    view.flags.writeable = False
    return view


@njit(nogil=True, cache=True, fastmath=_FAST)
def _plain_blocks(first, last, size, frames, weights, limits, phase, modulation, reasons):  # type: ignore[no-untyped-def]
    """Demodulate some blocks of so many pixels."""
    pixels, three = phase.shape[0], frames.shape[0] == _THREE
    for block in range(first, last):
        start, end = block * size, min((block + 1) * size, pixels)
        out_p, out_m, out_r = phase[start:end], modulation[start:end], reasons[start:end]
        if three:
            _plain_three(frames, start, weights, limits, out_p, out_m, out_r)
        else:
            _plain_many(frames, start, weights, limits, out_p, out_m, out_r)
        if frames.itemsize == _FLOAT_SIZE:
            _put_outside(out_m, (out_p,), out_r)


@njit(fastmath=_FAST, inline="always")
def _residuals(frames, start, count, model, sums, rss):  # type: ignore[no-untyped-def]
    """Fill `rss` with each pixel's sum of squared residuals; `model` is (N, 4)."""
    a, c, s = sums[0], sums[1], sums[2]
    rss[:count] = _ZERO
    for n in range(frames.shape[0]):
        ma, mc, ms, constant = model[n, 0], model[n, 1], model[n, 2], model[n, 3]
        frame = frames[n, start : start + count]
        for i in range(count):
            r = np.float32(frame[i]) - (ma * a[i] + mc * c[i] + ms * s[i] + constant)
            rss[i] += r * r


@njit(fastmath=_FAST, inline="always")
def _variance(c, s, vcc, vss, vcs, floor):  # type: ignore[no-untyped-def]
    """Return u(phi)^2 from the covariance of C = B cos(phi) and S = B sin(phi)."""
    power = c * c + s * s
    numerator = c * c * vss - np.float32(2) * c * s * vcs + s * s * vcc
    return max(numerator, floor * power) / (power * power)


@njit(fastmath=_FAST, inline="always")
def _full_pixel(sums, peak, mean_square, covariance, floor, limits):  # type: ignore[no-untyped-def]
    """Return phase, modulation, background, u(phi) and reasons of one pixel.

    `mean_square` is the mean square of the residuals; `covariance` is that of C and S (CC, SS, CS).
    """
    a, c, s = sums
    b = np.sqrt(c * c + s * s)
    variance = _variance(c, s, covariance[0], covariance[1], covariance[2], floor)
    limit = max(limits.residual_level, limits.residual_share * b)
    uncertain = _flag(variance > limits.max_sigma_rad * limits.max_sigma_rad, LOW_MODULATION)
    why = np.uint8(_flags(a, b, peak, limits) | uncertain | _flag(mean_square > limit * limit, MISFIT))
    valid = why == _NO_REASON
    angle, deviation = _angle(s, c, b), np.sqrt(variance)
    return angle if valid else _NAN, b, a, deviation if valid else _NAN, why


@njit(fastmath=_FAST, error_model="numpy")
def _full_three(frames, start, weights, noise, limits, maps):  # type: ignore[no-untyped-def]
    """Demodulate one block of three frames without shot noise, their sums in registers; they leave no residuals."""
    phase, modulation, background, sigma, reasons = maps
    end = start + phase.shape[0]
    one, two, three = frames[0, start:end], frames[1, start:end], frames[2, start:end]
    row_a, row_c, row_s = _row(weights, 0), _row(weights, 1), _row(weights, 2)
    covariance, floor = (noise[0], noise[1], noise[2]), noise[3]
    for i in range(end - start):
        x, y, z = np.float32(one[i]), np.float32(two[i]), np.float32(three[i])
        sums = _sum_of_three(row_a, x, y, z), _sum_of_three(row_c, x, y, z), _sum_of_three(row_s, x, y, z)
        phase[i], modulation[i], background[i], sigma[i], reasons[i] = _full_pixel(
            sums, max(one[i], max(two[i], three[i])), _ZERO, covariance, floor, limits
        )


@njit(fastmath=_FAST, error_model="numpy")
def _full_many(frames, start, weights, model, noise, limits, maps):  # type: ignore[no-untyped-def]
    """Demodulate one block of any number of frames, with shot noise where the weights have its rows."""
    phase, modulation, background, sigma, reasons = maps
    count = phase.shape[0]
    sums, rss = np.zeros((6, BLOCK), np.float32), np.zeros(BLOCK, np.float32)
    peak = np.empty(BLOCK, frames.dtype)
    if weights.shape[0] > _THREE:
        _three_sums(frames, start, count, weights[3:], sums[3:], peak)
    _three_sums(frames, start, count, weights, sums, peak)
    if frames.shape[0] > _THREE:
        _residuals(frames, start, count, model, sums, rss)
    a, c, s, vcc, vss, vcs = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]
    spare, floor = np.float32(1) / np.float32(max(frames.shape[0] - 3, 1)), noise[3]
    for i in range(count):
        covariance = vcc[i] + noise[0], vss[i] + noise[1], vcs[i] + noise[2]
        phase[i], modulation[i], background[i], sigma[i], reasons[i] = _full_pixel(
            (a[i], c[i], s[i]), peak[i], rss[i] * spare, covariance, floor, limits
        )


def demodulate_full(  # noqa: PLR0913, PLR0917 -- what the kernel takes
    frames: NDArray,
    weights: NDArray[np.float32],
    model: NDArray[np.float32],
    noise: NDArray[np.float32],
    limits: Limits,
    phase: NDArray[np.float32],
    modulation: NDArray[np.float32],
    background: NDArray[np.float32],
    sigma: NDArray[np.float32],
    reasons: NDArray[np.uint8],
) -> None:
    """Demodulate with background, u(phi) and the test of the residuals.

    Parameters
    ----------
    frames
        Grey values, uint8, uint16 or float32, (N, M).
    weights
        float32 (6, N + 1): the rows of `Scheme.weights` for A, C, S, then gain times the products of rows
        C C, S S and C S, which turn the grey values into the shot-noise part of their covariance;
        (3, N + 1) where there is no shot noise. The last column is subtracted: `Scheme.zero`, then 0.
    model
        float32 (N, 4), as in `Scheme.model`; the residuals of four frames and more are tested with it.
    noise
        float32 (4,): the constant parts of the three covariances; the least variance of C and S.
    limits
        `Limits`.
    phase, modulation, background, sigma, reasons
        Outputs, (M,); phase and sigma are NaN where masked.
    """
    size = 4 * BLOCK if len(frames) == len(weights) == _THREE else BLOCK
    blocks, maps = -(-len(phase) // size), (phase, modulation, background, sigma, reasons)
    tables = weights, model, noise, limits
    over_bands(_full_blocks, blocks, size, _readonly(frames), *tables, maps, least=_LEAST_BLOCKS)


@njit(nogil=True, cache=True, fastmath=_FAST)
def _full_blocks(first, last, size, frames, weights, model, noise, limits, maps):  # type: ignore[no-untyped-def]
    """Demodulate some blocks of so many pixels, with all that there is to know."""
    phase, modulation, background, sigma, reasons = maps
    pixels, three = phase.shape[0], (frames.shape[0] == _THREE) & (weights.shape[0] == _THREE)
    for block in range(first, last):
        start, end = block * size, min((block + 1) * size, pixels)
        part = phase[start:end], modulation[start:end], background[start:end], sigma[start:end], reasons[start:end]
        if three:
            _full_three(frames, start, weights, noise, limits, part)
        else:
            _full_many(frames, start, weights, model, noise, limits, part)
        if frames.itemsize == _FLOAT_SIZE:
            _put_outside(part[1], (part[0], part[3]), part[4])
