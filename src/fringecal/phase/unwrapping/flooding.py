"""Compiled passes over a phase map: where it is smooth, and how smooth regions grow over what lies between them.

All passes read float32 phase, NaN where it is masked, and work on differences of neighbours modulo 2 pi: no sine, no
arctangent, so that 12 megapixels take a few tens of milliseconds each.
"""

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import TURN, over_bands, robust_sd, wrap

_TURN, _PER_TURN = np.float32(TURN), np.float32(1 / TURN)
# Change of slope over three px above which the smoothed phase is cut: so many standard deviations of the noise, but
# not less than the curvature of a smooth surface, and not so much that an edge of 0.45 rad, a fourteenth of a fringe,
# passes.
_CURVATURE_SIGMAS, _CURVATURE_LIMITS_RAD = 6.0, (0.12, 0.45)
# The same of the jump from one side to the other: a smooth surface makes one by its third derivative alone, so that the
# limit may be tighter; at most what a fold of 0.2 rad/px shows beside itself.
_JUMP_LIMITS_RAD = (0.06, 0.5)
_NEIGHBOURS = np.float32(9)  # of a 3 x 3 square, all of which must be valid
# Variance of nine neighbours above which they disagree: their mean direction is then shorter than 0.6, rad^2.
_MOST_VARIANCE = np.float32(-2 * np.log(0.6))
_ROUGH, _FINE, _SMOOTH = np.uint8(0), np.uint8(1), np.uint8(2)  # not smooth; by curvature alone; by the jump too
_APART_PX = 11  # side of the square about a pixel smooth by curvature alone that holds none smooth by both
_SAMPLE_ROWS = 200  # of the picture, along which the noise of the curvature is measured
_SAMPLE = 100_000  # values that say it to a third of a per cent
_BRIDGE_PX = 5  # side of the square that smooth parts must hold: a bridge over an edge is narrower


@njit(inline="always")
def _wrapped(difference):  # type: ignore[no-untyped-def]
    return difference - _TURN * np.rint(difference * _PER_TURN)


@njit(nogil=True, cache=True)
def _means(first, last, phase, mean, steady):  # type: ignore[no-untyped-def]
    """Write the mean over 3 x 3 px of some rows, and 1 where all nine are valid and agree; the rim is never steady."""
    height, width = phase.shape
    for i in range(first, last):
        if i == 0 or i == height - 1:
            for j in range(width):
                mean[i, j], steady[i, j] = phase[i, j], 0
            continue
        total, squares, count = np.zeros(width, np.float32), np.zeros(width, np.float32), np.zeros(width, np.float32)
        here = phase[i]
        for row in (phase[i - 1], here, phase[i + 1]):
            for shift in (-1, 0, 1):
                for j in range(1, width - 1):
                    difference = _wrapped(row[j + shift] - here[j])
                    known = difference == difference
                    difference = difference if known else np.float32(0)
                    total[j] += difference
                    squares[j] += difference * difference
                    count[j] += np.float32(1) if known else np.float32(0)
        mean[i, 0], mean[i, width - 1] = here[0], here[width - 1]
        steady[i, 0] = steady[i, width - 1] = 0
        for j in range(1, width - 1):
            middle = total[j] / max(count[j], np.float32(1))
            mean[i, j] = here[j] + middle
            agree = squares[j] - _NEIGHBOURS * middle * middle < _NEIGHBOURS * _MOST_VARIANCE
            steady[i, j] = _SMOOTH if agree and count[j] == _NEIGHBOURS else 0


@njit(inline="always")
def _curvature(before, left, right, after):  # type: ignore[no-untyped-def]
    """Return the change of slope from the pair two px before to the pair two px after; NaN where one is missing."""
    return abs(_wrapped(after - right - left + before))


@njit(inline="always")
def _jump(before, left, right, after):  # type: ignore[no-untyped-def]
    """Return what both sides, continued by their own slopes, lack to meet half-way; NaN where one is missing."""
    return abs(_wrapped(right - left - (_wrapped(left - before) + _wrapped(after - right)) * np.float32(0.5)))


@njit(nogil=True, cache=True)
def _cut_at_edges(first, last, mean, limits, steady):  # type: ignore[no-untyped-def]
    """Clear pixels of some rows around which curvature exceeds its limit; if just the jump does, make them `_FINE`.

    What is missing exceeds no limit. Rows are taken as a whole and without branches, for the compiler's vectors.
    """
    height, width = mean.shape
    for i in range(max(first, 2), min(last, height - 2)):
        up, above, here, below, down = mean[i - 2], mean[i - 1], mean[i], mean[i + 1], mean[i + 2]
        state = steady[i]
        if 3 <= i < height - 3:
            upper, lower = mean[i - 3], mean[i + 3]
            for j in range(2, width - 2):
                bent = _jump(upper[j], above[j], below[j], lower[j]) >= limits[2]
                state[j] = min(state[j], _FINE if bent else _SMOOTH)
        for j in range(3, width - 3):
            bent = _jump(here[j - 3], here[j - 1], here[j + 1], here[j + 3]) >= limits[3]
            state[j] = min(state[j], _FINE if bent else _SMOOTH)
        for j in range(2, width - 2):
            across = _curvature(up[j], above[j], below[j], down[j]) >= limits[0]
            along = _curvature(here[j - 2], here[j - 1], here[j + 1], here[j + 2]) >= limits[1]
            state[j] = _ROUGH if across | along else state[j]


def smooth_pixels(phase: NDArray[np.float32]) -> tuple[NDArray[np.uint8], float]:
    """Return 1 at pixels around which the phase is nowhere strongly curved, and the noise of the curvature, rad.

    Parameters
    ----------
    phase
        Wrapped phase, rad, (H, W), NaN where masked.
    """
    mean, steady = np.empty_like(phase), np.empty(phase.shape, np.uint8)
    over_bands(_means, len(phase), phase, mean, steady)
    noise = [_noise_of_curvature(mean), _noise_of_curvature(mean.T)]
    curved = np.clip(_CURVATURE_SIGMAS * np.array(noise), *_CURVATURE_LIMITS_RAD)
    jumps = np.clip(_CURVATURE_SIGMAS * np.array([_noise_of_jump(mean), _noise_of_jump(mean.T)]), *_JUMP_LIMITS_RAD)
    over_bands(_cut_at_edges, len(mean), mean, np.concatenate([curved, jumps]).astype(np.float32), steady)
    smooth = _without_bridges(steady == _SMOOTH)
    # What is too finely folded for that, and far from all that is not, may be smooth by its curvature alone.
    near = cv2.dilate(smooth, np.ones((_APART_PX, _APART_PX), np.uint8))
    return smooth | (_without_bridges(steady >= _FINE) & (1 - near)), max(noise)


def _without_bridges(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Erode: a bridge over an edge, where the jump is whole fringes by chance, is a few pixels wide and must go."""
    square = np.ones((_BRIDGE_PX, _BRIDGE_PX), np.uint8)
    eroded = cv2.erode(mask.astype(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=(0.0,))
    return np.asarray(eroded, np.uint8)


def _noise_of_curvature(mean: NDArray[np.float32]) -> float:
    """Robust standard deviation of the curvature along columns, from a sample."""
    lines = np.unique(np.linspace(0, max(mean.shape[1] - 1, 0), _SAMPLE_ROWS).astype(int))
    sample = mean[:, lines]
    difference = sample[4:] - sample[3:-1] - sample[1:-3] + sample[:-4]
    return robust_sd(wrap(_thinned(difference)), about=0)


def _noise_of_jump(mean: NDArray[np.float32]) -> float:
    """Robust standard deviation of the jump along columns, from a sample."""
    lines = np.unique(np.linspace(0, max(mean.shape[1] - 1, 0), _SAMPLE_ROWS).astype(int))
    sample = mean[:, lines]
    differences = (sample[2:-4] - sample[:-6], sample[6:] - sample[4:-2], sample[4:-2] - sample[2:-4])
    before, after, across = (wrap(_thinned(difference)) for difference in differences)
    return robust_sd(wrap(across - (before + after) / 2), about=0)


def _thinned(sample: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return rows of a sample that are enough to tell its spread."""
    return sample[:: max(1, sample.size // _SAMPLE)]


@njit(cache=True)
def torn(values, labels, number):  # type: ignore[no-untyped-def]
    """Return for every region whether neighbours in it differ by more than half a fringe."""
    found = np.zeros(number + 1, np.bool_)
    height, width = labels.shape
    half = TURN / 2
    for v in range(height):
        for u in range(width):
            label = labels[v, u]
            if label > 0:
                if u + 1 < width and labels[v, u + 1] == label and abs(values[v, u + 1] - values[v, u]) > half:
                    found[label] = True
                if v + 1 < height and labels[v + 1, u] == label and abs(values[v + 1, u] - values[v, u]) > half:
                    found[label] = True
    return found


@njit(cache=True)
def drop_crumbs(pieces, number, least):  # type: ignore[no-untyped-def]
    """Number pieces of at least so many pixels anew, 1 and up, in place; smaller ones become 0. Return how many."""
    flat = pieces.reshape(-1)
    sizes = np.zeros(number + 1, np.int64)
    for pixel in range(flat.size):
        sizes[flat[pixel]] += 1
    numbers = np.zeros(number + 1, np.int32)
    count = 0
    for piece in range(1, number + 1):
        if sizes[piece] >= least:
            count += 1
            numbers[piece] = count
    for pixel in range(flat.size):
        flat[pixel] = numbers[flat[pixel]]
    return count


@njit(nogil=True, cache=True)
def start_of_growth(first, last, grown, cores, labels, without, values, phase):  # type: ignore[no-untyped-def]
    """Write for some rows the values of the smooth pixels alone, and the wrapped phase where regions may grow."""
    for v in range(first, last):
        for u in range(cores.shape[1]):
            value = grown[v, u]
            values[v, u] = value if cores[v, u] > 0 else np.nan
            free = labels[v, u] > 0 and not without[v, u]
            phase[v, u] = value - TURN * np.rint(value / TURN) if free else np.nan


@njit(inline="always")
def _at_open_side(labels, phase, v, u):  # type: ignore[no-untyped-def]
    """Return whether a neighbour has phase and no label."""
    height, width = labels.shape
    for dv, du in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        y, x = v + dv, u + du
        if 0 <= y < height and 0 <= x < width and labels[y, x] == 0 and phase[y, x] == phase[y, x]:
            return True
    return False


@njit(nogil=True, cache=True)
def _count_open(first, last, labels, phase, counts):  # type: ignore[no-untyped-def]
    """Count in some rows the labelled pixels beside open ones, and the open ones."""
    for v in range(first, last):
        rim, free = 0, 0
        for u in range(labels.shape[1]):
            if labels[v, u] > 0:
                rim += _at_open_side(labels, phase, v, u)
            else:
                free += phase[v, u] == phase[v, u]
        counts[v, 0], counts[v, 1] = rim, free


@njit(cache=True)
def _flood(values, labels, phase, counts):  # type: ignore[no-untyped-def]
    height, width = labels.shape
    queue = np.empty((counts.sum(), 2), np.int32)
    tail = 0
    for v in range(height):
        if counts[v, 0] > 0:
            for u in range(width):
                if labels[v, u] > 0 and _at_open_side(labels, phase, v, u):
                    queue[tail, 0], queue[tail, 1] = v, u
                    tail += 1
    head = 0
    while head < tail:
        v, u = queue[head]
        head += 1
        for dv, du in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            y, x = v + dv, u + du
            inside = 0 <= y < height and 0 <= x < width
            if inside and labels[y, x] == 0 and phase[y, x] == phase[y, x]:
                periods = np.floor((values[v, u] - phase[y, x]) / TURN + 0.5)
                values[y, x] = phase[y, x] + TURN * periods
                labels[y, x] = labels[v, u]
                queue[tail, 0], queue[tail, 1] = y, x
                tail += 1


def flood(values: NDArray[np.float64], labels: NDArray[np.int32], phase: NDArray[np.float32]) -> None:
    """Grow all regions ring by ring over the pixels left, each continuing from the pixel it is reached from.

    Parameters
    ----------
    values, labels
        Phase within regions, rad, and their numbers from 1, (H, W); completed in place.
    phase
        Wrapped phase, rad, (H, W), NaN where masked.
    """
    counts = np.zeros((labels.shape[0], 2), np.int64)
    over_bands(_count_open, len(labels), labels, phase, counts)
    _flood(values, labels, phase, counts)


def add_orders(
    values: NDArray[np.float64], labels: NDArray[np.int32], orders: NDArray[np.int64], numbers: NDArray[np.int32]
) -> None:
    """Add its fringes to every region and number it anew, in place; NaN where there is no region."""
    over_bands(_add_orders, len(labels), values, labels, orders, numbers)


@njit(nogil=True, cache=True)
def _add_orders(first, last, values, labels, orders, numbers):  # type: ignore[no-untyped-def]
    """Add the fringes in some rows."""
    for v in range(first, last):
        for u in range(labels.shape[1]):
            label = labels[v, u]
            values[v, u] = values[v, u] + TURN * orders[label] if label > 0 else np.nan
            labels[v, u] = numbers[label]
