"""One compiled pass from the frames of several periods to a coordinate of the projector, a strip of a row at a time."""

from typing import NamedTuple

import numpy as np
from numba import njit

from fringecal.phase.demodulation.pixel_kernels import _angle

_FAST = {"reassoc", "nsz", "arcp", "contract"}  # NaN must reach the mask
_STRIP = 512  # pixels taken at a time: seven buffers of this length stay near the processor
_TURN = np.float32(2 * np.pi)
_APART = np.float32(0.4)  # of a period, by which a longer period may disagree; at a half the next order is as near
_SURE = np.float32(
    4.5
)  # standard uncertainties of the longer period's coordinate within half a fringe: one in 10^5 fails


class PeriodArrays(NamedTuple):
    """What each set of frames needs, the longest period first.

    `weights` (K, 3, N) give A, B cos and B sin; `period` px; `zero` rad; `least` modulation and `brightest` grey value
    that counts (K,); `spread` (K,), the variance of the phase times B^2 for unit variance of a frame.
    """

    weights: np.ndarray
    period: np.ndarray
    zero: np.ndarray
    least: np.ndarray
    brightest: np.ndarray
    spread: np.ndarray


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _sums(frames, i, first, count, weights, work):  # type: ignore[no-untyped-def]
    """Fill work 0 to 2 with A, B cos(phi) and B sin(phi), and 3 with the brightest frame."""
    for j in range(count):
        work[0, j] = work[1, j] = work[2, j] = work[3, j] = np.float32(0)
    for n in range(frames.shape[0]):
        wa, wc, ws = weights[0, n], weights[1, n], weights[2, n]
        row = frames[n, i]
        for j in range(count):
            x = np.float32(row[first + j])
            work[0, j] += wa * x
            work[1, j] += wc * x
            work[2, j] += ws * x
            work[3, j] = max(work[3, j], x)


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _narrow(k, count, periods, rules, work, place):  # type: ignore[no-untyped-def]
    """Take the coordinate (`place` 0, u in 1) from the longer periods to that of the k-th; NaN where it is not sure."""
    period, zero = periods.period[k], periods.zero[k]
    least, brightest, spread = periods.least[k], periods.brightest[k], periods.spread[k]
    sign, middle, gain, floor = rules
    per_rad = period / _TURN
    for j in range(count):
        c, s = work[1, j], work[2, j]
        b = np.sqrt(c * c + s * s)
        part = sign * (_angle(s, c, b) - zero) / _TURN
        u = per_rad * np.sqrt(spread * (gain * max(work[0, j], np.float32(0)) + floor)) / b
        about = place[0, j] if k > 0 else middle
        found = period * (part + np.rint(about / period - part))
        off = abs(found - about)
        sure = (off <= _APART * period) & (_SURE * place[1, j] < np.float32(0.5) * period) if k > 0 else True
        good = sure & (b >= least) & (work[3, j] <= brightest)
        place[0, j] = found if good else np.float32(np.nan)
        place[1, j] = u if good else np.float32(np.nan)


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _back_on_raster(count, longest, middle, place):  # type: ignore[no-untyped-def]
    """Undo what noise of the longest period does at the edges of a projector that it just spans: off by all of it."""
    for j in range(count):
        turns = np.rint((place[0, j] - middle) / longest)
        place[0, j] -= longest * turns


@njit(nogil=True, cache=True)
def coordinates_in_rows(first, last, frames, periods, rules, px, u_px):  # type: ignore[no-untyped-def]
    """Write coordinates and their u of some rows; `rules` are sign, middle of the raster, and the noise's two parts."""
    work, place = np.empty((4, _STRIP), np.float32), np.empty((2, _STRIP), np.float32)
    width = px.shape[1]
    for i in range(first, last):
        for start in range(0, width, _STRIP):
            count = min(_STRIP, width - start)
            for k in range(len(frames)):
                _sums(frames[k], i, start, count, periods.weights[k], work)
                _narrow(k, count, periods, rules, work, place)
            _back_on_raster(count, periods.period[0], rules[1], place)
            px[i, start : start + count] = place[0, :count]
            u_px[i, start : start + count] = place[1, :count]
