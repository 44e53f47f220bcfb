"""Compiled walk along epipolar lines: every place where one smooth region ends and the next begins.

Between the last smooth pixel of a region and the first one after it lie an edge, a fold or a shadow. What is known on
both sides is continued to it by the slope along the line; `fringecal.reconstruct.orders.region_orders` concludes.
"""

import numpy as np
from numba import njit

from fringecal.numerics import TURN, over_bands
from fringecal.reconstruct.orders.epipolar_lines import EpipolarLines

MEETING, SHADOW, END = 0, 1, 2
"""Kinds of a passage from one region to the next: side by side, across a dark band; or a run ends and says nothing."""

FREE, FROM_OTHER, FROM_SHADOW, FROM_SAME = 0, 1, 2, 3
"""How a region was entered: at the picture's border, from another region, over a shadow, over an edge within it."""

FIRST, SECOND, KIND, END_U, END_V, START_U, START_V, END_RAD, START_RAD, ENTRY, WAY_IN, DARK_LEVEL = range(12)
"""Columns of a passage: the two regions; its kind; where the one ends and the other starts, px; their steps over the
plate continued to there, rad; flat index of the pixel where the first region was entered, and over which kind of edge;
the mean modulation inside the dark band.
"""
N_FIELDS = 12

_MOST_PASSAGES = 48  # of one line: more are noise
_MOST_EDGE_PX = 16  # between smooth pixels of two regions that count as side by side
_LEAST_SHADOW_PX = 3  # dark pixels that count as a shadow
_DARK_SHARE = 0.25  # of the modulation beside it that is left in the middle of a shadow
_PENUMBRA_PX = 2  # at either end of a dark band
_SPECK_PX = 1  # in a shadow that may look lit
_SLOPE_PX = 8  # over which the slope along a line is taken
_LEAST_SLOPE_PX = 3
_EDGE_RAD = 0.3  # jump that is an edge, modulo a fringe: smaller ones may be a speck
_BESIDE_FOLD_PX = 1.2  # by which a fold may lie off the middle between smooth pixels
_FALL_RAD = np.pi  # within a region: half a fringe


@njit(inline="always")
def _pixel(a, b, columns, width):  # type: ignore[no-untyped-def]
    """Flat index of the pixel `a` along and `b` across."""
    return a * width + b if columns else b * width + a


@njit(inline="always")
def _way_in(label, here, dark):  # type: ignore[no-untyped-def]
    """Say over what a region was entered."""
    if label == 0:
        return FREE
    if dark > 1:
        return FROM_SHADOW
    return FROM_OTHER if label != here else FROM_SAME


@njit(inline="always")
def _turned(difference):  # type: ignore[no-untyped-def]
    return difference - TURN * np.rint(difference / TURN)


@njit(inline="always")
def _band(light, b_of, a, since, forward, columns, width, level_before, level_after, out):  # type: ignore[no-untyped-def]
    """Find a dark band among the pixels before position `a`; write how far before and after it smooth pixels lie.

    Its ends are where the light falls to half of what the smooth pixels beside it have, between pixels.
    """
    first, last, least = -1, -1, level_before
    previous, following = level_before, level_after
    for k in range(1, since + 1):
        there = a - forward * (since + 1 - k)
        here = light[_pixel(there, int(np.rint(b_of[there])), columns, width)]
        least = min(least, here)
        if first < 0:
            if here < 0.5 * level_before:
                first = k
                out[0] = k - (0.5 * level_before - here) / max(previous - here, 1e-6)
            previous = here
    for k in range(since, 0, -1):
        there = a - forward * (since + 1 - k)
        here = light[_pixel(there, int(np.rint(b_of[there])), columns, width)]
        if here < 0.5 * level_after:
            last = k
            out[1] = since + 1 - k - (0.5 * level_after - here) / max(following - here, 1e-6)
            break
        following = here
    if first < 0 or last < 0 or least > _DARK_SHARE * min(level_before, level_after):
        return 0
    lit, inner, total = 0, 0, 0.0
    for k in range(first, last + 1):
        there = a - forward * (since + 1 - k)
        here = light[_pixel(there, int(np.rint(b_of[there])), columns, width)]
        lit += here > 0.5 * min(level_before, level_after)
        if min(k - first, last - k) >= _PENUMBRA_PX:
            inner, total = inner + 1, total + here
    out[2] = total / inner if inner > 0 else least
    return last - first + 1 if lit <= _SPECK_PX else 1


@njit(inline="always")
def _end_of_run(a, run, b_of, forward, step, light, columns, width):  # type: ignore[no-untyped-def]
    """Return step, slope along the line, and modulation at the last pixel of a run of so many steps."""
    pixel = _pixel(a, int(np.rint(b_of[a])), columns, width)
    slope = 0.0
    if run > _LEAST_SLOPE_PX:
        far = _SLOPE_PX if run > _SLOPE_PX else _LEAST_SLOPE_PX
        back = a - forward * far
        slope = (step[pixel] - step[_pixel(back, int(np.rint(b_of[back])), columns, width)]) / far
    return step[pixel], slope, light[pixel]


@njit(inline="always")
def _write_end(passages, found, label, begin, way_in, a, b_of, columns):  # type: ignore[no-untyped-def]
    """Write that the picture ends a run that was entered over an edge within its region; return how many there are."""
    out = passages[found]
    out[FIRST], out[SECOND], out[KIND], out[ENTRY], out[WAY_IN] = label, label, END, begin, way_in
    _write_place(out, END_U, float(a), b_of, columns)
    _write_place(out, START_U, float(a), b_of, columns)
    return found + 1


@njit(nogil=True, cache=True)
def _walk(first, last, step, cores, light, shape, lines, passages, counts):  # type: ignore[no-untyped-def] # noqa: C901
    """Write the passages of some lines; a line starts at mid-picture, and is numbered by its place across there."""
    height, width = shape
    columns, forward, c0, c1, c2, rising, offset, edge = lines
    length, breadth = (height, width) if columns else (width, height)
    b_of, ends = np.empty(length), np.empty(3)
    for line in range(first, last):
        middle = length // 2
        b_of[middle] = line - offset
        for a in range(middle + 1, length):
            b_of[a] = b_of[a - 1] + c0 + c1 * (a - 1) + c2 * b_of[a - 1]
        for a in range(middle - 1, -1, -1):
            b_of[a] = b_of[a + 1] - c0 - c1 * (a + 1) - c2 * b_of[a + 1]
        label, begin, run, since, found, way_in = np.int32(0), np.int64(-1), 0, 0, 0, FREE
        value, slope, level = 0.0, 0.0, 0.0
        for k in range(length):
            a = k if forward > 0 else length - 1 - k
            b = int(np.rint(b_of[a]))
            if b < 0 or b >= breadth:
                if label > 0 and way_in == FROM_SAME and found < passages.shape[1]:
                    found = _write_end(passages[line], found, label, begin, way_in, a - forward, b_of, columns)
                label, since, way_in = np.int32(0), 0, FREE
                continue
            pixel = _pixel(a, b, columns, width)
            here = cores[pixel]
            if here == 0:
                since += 1
                continue
            if here == label and since == 0:
                run += 1
                continue
            last = a - forward * (since + 1)
            if label > 0:
                value, slope, level = _end_of_run(last, run, b_of, forward, step, light, columns, width)
            dark = 0
            ahead = _slope_ahead(a, b_of, forward, here, cores, step, columns, width, length, breadth)
            jump = abs(_turned(step[pixel] - value - (slope + ahead) * (since + 1) / 2))
            broken = jump > edge + _BESIDE_FOLD_PX * abs(ahead - slope) and run >= _SLOPE_PX and ahead == ahead
            if label > 0 and found < passages.shape[1]:
                dark = _band(light, b_of, a, since, forward, columns, width, level, light[pixel], ends)
                shadow = dark >= _LEAST_SHADOW_PX
                meeting = dark == 0 and since <= _MOST_EDGE_PX
                if label == here and meeting:  # within a region, only a fall says something
                    meeting = rising * (step[pixel] - value) < -_FALL_RAD
                ended = way_in == FROM_SAME and not (shadow or meeting)
                ended = ended and (here != label or dark > 1 or broken)
                if shadow or meeting or ended:
                    ahead = ahead if ahead == ahead else 0.0
                    before, after = (ends[0], ends[1]) if shadow else ((since + 1) / 2, (since + 1) / 2)
                    out = passages[line, found]
                    out[FIRST], out[SECOND] = label, here
                    out[KIND] = SHADOW if shadow else (MEETING if meeting else END)
                    out[ENTRY], out[WAY_IN], out[DARK_LEVEL] = begin, way_in, ends[2]
                    out[END_RAD], out[START_RAD] = value + slope * before, step[pixel] - ahead * after
                    _write_place(out, END_U, a - forward * (since + 1 - before), b_of, columns)
                    _write_place(out, START_U, a - forward * after, b_of, columns)
                    found += 1
            if here != label or dark > 1 or broken:
                begin = np.int64(pixel)
                way_in = _way_in(label, here, dark)
            label, run, since = here, 0, 0
        if label > 0 and way_in == FROM_SAME and found < passages.shape[1]:
            a = length - 1 if forward > 0 else 0
            found = _write_end(passages[line], found, label, begin, way_in, a, b_of, columns)
        counts[line] = found


@njit(inline="always")
def _write_place(out, at, a, b_of, columns):  # type: ignore[no-untyped-def]
    """Write column and row of a place between pixels of a line."""
    low = max(0, min(b_of.size - 2, int(np.floor(a))))
    b = b_of[low] + (a - low) * (b_of[low + 1] - b_of[low])
    out[at], out[at + 1] = (b, a) if columns else (a, b)


@njit(inline="always")
def _slope_ahead(a, b_of, forward, label, cores, step, columns, width, length, breadth):  # type: ignore[no-untyped-def]
    """Slope along the line just after a region begins; NaN where it is too short."""
    here = step[_pixel(a, int(np.rint(b_of[a])), columns, width)]
    for far in (_SLOPE_PX, _LEAST_SLOPE_PX):
        there = a + forward * far
        if 0 <= there < length:
            b = int(np.rint(b_of[there]))
            if 0 <= b < breadth:
                pixel = _pixel(there, b, columns, width)
                if cores[pixel] == label:
                    return (step[pixel] - here) / far
    return np.nan


def passages(step, cores, light, lines: EpipolarLines, edge_rad=_EDGE_RAD):  # type: ignore[no-untyped-def]
    """Return all passages between smooth regions along epipolar lines, (n, `N_FIELDS`), by columns `FIRST` and so on.

    Parameters
    ----------
    step
        Step over the plate, continuous within each region, rad, (H, W).
    cores
        Number of the region at smooth pixels, 0 elsewhere, int32, (H, W).
    light
        Modulation of the fringes, grey levels, (H, W).
    lines
        The epipolar lines.
    edge_rad
        Jump within a region that is an edge, modulo a fringe, rad: more than noise makes.
    """
    height, width = step.shape
    breadth = width if lines.along_columns else height
    length = height if lines.along_columns else width
    reach = int(np.ceil((abs(lines.slope[0]) + abs(lines.slope[1]) * length + abs(lines.slope[2]) * breadth) * length))
    offset = min(reach, 2 * breadth)
    number = breadth + 2 * offset
    found, counts = np.zeros((number, _MOST_PASSAGES, N_FIELDS)), np.zeros(number, np.int64)
    flat = (np.ascontiguousarray(m).ravel() for m in (step, cores, light))
    value = (lines.along_columns, lines.forward, *lines.slope, lines.rising, offset, float(edge_rad))
    over_bands(_walk, number, *flat, (height, width), value, found, counts)
    return found[np.arange(_MOST_PASSAGES) < counts[:, None]]


def breadths(cores, lines: EpipolarLines):  # type: ignore[no-untyped-def]
    """Return how many lines cross each region, about: columns of the picture, or rows, that hold some of it.

    Parameters
    ----------
    cores
        Number of the region at smooth pixels, 0 elsewhere, int32, (H, W).
    lines
        The epipolar lines.
    """
    crossed = np.zeros((int(cores.max(initial=0)) + 1, cores.shape[1 if lines.along_columns else 0]), np.bool_)
    _mark_crossed(cores, lines.along_columns, crossed)
    return np.count_nonzero(crossed, axis=1)


@njit(cache=True)
def _mark_crossed(cores, columns, crossed):  # type: ignore[no-untyped-def]
    for v in range(cores.shape[0]):
        for u in range(cores.shape[1]):
            crossed[cores[v, u], u if columns else v] = True


def mark_runs(found, shape, lines: EpipolarLines):  # type: ignore[no-untyped-def]
    """Return a mask of the first regions' runs of some passages: from where each was entered to where it ends.

    Parameters
    ----------
    found
        Passages, (n, `N_FIELDS`).
    shape
        Of the picture.
    lines
        The epipolar lines.
    """
    mask = np.zeros(shape, np.bool_)
    _mark(*_runs(found, shape, lines), mask)
    return mask


def mark_run_ends(found, cores, lines: EpipolarLines):  # type: ignore[no-untyped-def]
    """Return a mask of the ends of the first regions' runs: what lies behind the last gap in the region.

    Parameters
    ----------
    found
        Passages, (n, `N_FIELDS`).
    cores
        Number of the region at smooth pixels, 0 elsewhere, int32, (H, W).
    lines
        The epipolar lines.
    """
    mask = np.zeros(cores.shape, np.bool_)
    _mark_ends(*_runs(found, cores.shape, lines), found[:, FIRST].astype(np.int64), cores, mask)
    return mask


def _runs(found, shape, lines):  # type: ignore[no-untyped-def]
    """Where each run begins and ends along its line, where it begins across, and the line."""
    v, u = np.divmod(found[:, ENTRY].astype(np.int64), shape[1])
    begin, end = (v, found[:, END_V]) if lines.along_columns else (u, found[:, END_U])
    across = u if lines.along_columns else v
    line = (lines.along_columns, lines.forward, *lines.slope)
    return begin.astype(np.int64), np.rint(end).astype(np.int64), across.astype(np.int64), line


@njit(cache=True)
def _mark_ends(begin, end, across, lines, label, cores, mask):  # type: ignore[no-untyped-def]
    columns, forward, c0, c1, c2 = lines
    length, breadth = mask.shape if columns else (mask.shape[1], mask.shape[0])
    for k in range(begin.size):
        gap, behind = begin[k] - forward, begin[k] - forward
        for marking in range(2):
            a, b = begin[k], float(across[k])
            while (end[k] - a) * forward >= 0 and 0 <= a < length:
                at = int(np.rint(b))
                if 0 <= at < breadth:
                    row, column = (a, at) if columns else (at, a)
                    if cores[row, column] != label[k]:
                        gap = a
                    elif not marking:
                        behind = gap
                    elif (a - behind) * forward > 0:
                        mask[row, column] = True
                b += forward * (c0 + c1 * a + c2 * b)
                a += forward


@njit(cache=True)
def _mark(begin, end, across, lines, mask):  # type: ignore[no-untyped-def]
    columns, forward, c0, c1, c2 = lines
    length, breadth = mask.shape if columns else (mask.shape[1], mask.shape[0])
    for k in range(begin.size):
        a, b = begin[k], float(across[k])
        while (end[k] - a) * forward >= 0 and 0 <= a < length:
            at = int(np.rint(b))
            if 0 <= at < breadth:
                if columns:
                    mask[a, at] = True
                else:
                    mask[at, a] = True
            b += forward * (c0 + c1 * a + c2 * b)
            a += forward
