"""Pixels beside edges, whose phase may be mixed from two surfaces: found by what lies around them."""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import over_bands
from fringecal.phase import Regions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MixingRules:
    """What an edge is, and how far it is felt.

    Parameters
    ----------
    break_rad
        Change of the step over three pixels, beyond that of smooth pixels near by, that is a break and no slope.
    slopes_px
        Distance within which those are looked for.
    reach_px
        Distance within which a smooth pixel must lie for a pixel between regions to be believed.
    break_share
        Share of the outline of pixels without a smooth one near by that may be a break.
    mixed_px
        Pixels beside a break that may see both sides of it: the blur of a lens in focus, and half a pixel.
    dim_share, bright_px
        Share of the largest modulation within this distance below which a pixel sees the border of a shadow.
    """

    break_rad: float = 1.5
    slopes_px: int = 7
    reach_px: int = 7
    break_share: float = 0.05
    mixed_px: int = 2
    dim_share: float = 0.6
    bright_px: int = 3


MIXING_RULES = MixingRules()

_BROKEN, _DIM, _ALONE = 1, 2, 4
_WHOLE_SHARE = 0.9  # of the pixels around one on a folded surface that must have a phase
_STEEP_RAD = 2.4  # change of the step over three pixels that pleats reach; noise and foreign things change by more


@njit(inline="always")
def _spread(step, labels, v, u):  # type: ignore[no-untyped-def]
    """Largest minus smallest step of a pixel and its neighbours with a phase, infinite where one of them is open."""
    low = high = step[v, u]
    for y in range(max(v - 1, 0), min(v + 2, step.shape[0])):
        for x in range(max(u - 1, 0), min(u + 2, step.shape[1])):
            value = step[y, x]
            if labels[y, x] == 0:
                continue
            if value != value:
                return np.inf
            low, high = min(low, value), max(high, value)
    return high - low


@njit(inline="always")
def _smooth_spread(step, cores, labels, v, u, reach):  # type: ignore[no-untyped-def]
    """Largest spread of the smooth pixels around a pixel; 0 where there is none."""
    found = 0.0
    for y in range(max(v - reach, 0), min(v + reach + 1, step.shape[0])):
        for x in range(max(u - reach, 0), min(u + reach + 1, step.shape[1])):
            if cores[y, x] > 0:
                spread = _spread(step, labels, y, x)
                if np.isfinite(spread):
                    found = max(found, spread)
    return found


@njit(inline="always")
def _vouched(cores, v, u, reach):  # type: ignore[no-untyped-def]
    """Whether a smooth pixel lies within reach."""
    for y in range(max(v - reach, 0), min(v + reach + 1, cores.shape[0])):
        for x in range(max(u - reach, 0), min(u + reach + 1, cores.shape[1])):
            if cores[y, x] > 0 and (y - v) ** 2 + (x - u) ** 2 <= reach * reach:
                return True
    return False


@njit(nogil=True, cache=True)
def _write_spreads(first, last, step, labels, wanted, spreads):  # type: ignore[no-untyped-def]
    """Write the spread of the pixels of some rows that are wanted and belong to a region; -1 elsewhere."""
    for v in range(first, last):
        for u in range(step.shape[1]):
            spreads[v, u] = _spread(step, labels, v, u) if wanted[v, u] and labels[v, u] > 0 else -1.0


@njit(nogil=True, cache=True)
def _tell_folded(first, last, spreads, reach, break_rad, edges):  # type: ignore[no-untyped-def]
    """Mark the pixels of some rows, far from smooth ones, that are no part of a finely folded surface.

    Such a surface is as steep as all around a pixel, and not broken there.
    """
    height, width = spreads.shape
    for v in range(first, last):
        for u in range(width):
            if not edges[v, u] & _ALONE:
                continue
            total, count, visited = 0.0, 0, 0
            for y in range(max(v - reach, 0), min(v + reach + 1, height), 2):
                for x in range(max(u - reach, 0), min(u + reach + 1, width), 2):
                    visited += 1
                    if spreads[y, x] >= 0:
                        total += min(spreads[y, x], 2 * _STEEP_RAD)
                        count += 1
            mean = total / max(count, 1)
            goes_on = mean < _STEEP_RAD and spreads[v, u] < mean + break_rad
            if not (goes_on and count > _WHOLE_SHARE * visited):
                edges[v, u] ^= _ALONE | _BROKEN


@njit(nogil=True, cache=True)
def _mark(first, last, step, cores, labels, light, brightest, rules, out):  # type: ignore[no-untyped-def]
    """Mark the pixels of some rows at which an edge lies, and those far from all smooth ones."""
    break_rad, slopes, reach, dim_share = rules
    for v in range(first, last):
        for u in range(step.shape[1]):
            known = step[v, u] == step[v, u]
            if labels[v, u] == 0 or (known and cores[v, u] > 0):
                continue
            if not known:
                out[v, u] = _BROKEN
                continue
            spread = _spread(step, labels, v, u)
            if not _vouched(cores, v, u, reach):
                out[v, u] = _ALONE
            elif spread > break_rad and spread > break_rad + _smooth_spread(step, cores, labels, v, u, slopes):
                out[v, u] = _BROKEN
            if light[v, u] < dim_share * brightest[v, u]:
                out[v, u] |= _DIM


def _mark_broken_alone(edges: NDArray[np.uint8], step: Array, labels: NDArray[np.int32], rules: MixingRules) -> None:
    """Mark as broken, in place, what lies far from smooth pixels and is no finely folded surface."""
    alone = edges & _ALONE
    if alone.any():
        spreads = np.empty(step.shape, np.float32)
        around = cv2.dilate(alone, np.ones((2 * rules.slopes_px + 1,) * 2, np.uint8))
        over_bands(_write_spreads, len(step), step, labels, around, spreads)
        over_bands(_tell_folded, len(step), spreads, rules.slopes_px, rules.break_rad, edges)


def _torn_off(edges: NDArray[np.uint8], rules: MixingRules) -> NDArray[np.bool_]:
    """Return the pixels far from all smooth ones in parts whose outline is a break along too much of it.

    A finely folded surface has no smooth pixels and goes on without a break; a thing on another has breaks all around.
    """
    alone = (edges & _ALONE) > 0
    if not alone.any():
        return alone
    square = np.ones((3, 3), np.uint8)
    rim = alone & (cv2.dilate((~alone).astype(np.uint8), square) > 0)
    beside_break = alone & (cv2.dilate(edges & _BROKEN, square) > 0)
    number, parts = cv2.connectedComponents(alone.astype(np.uint8))
    breaks, outline = (np.bincount(parts[mask], minlength=number) for mask in (beside_break, rim))
    bad = breaks > rules.break_share * outline
    bad[0] = False
    return np.asarray(bad[parts])


def beside_edges(
    step: Array, regions: Regions, light: NDArray[np.float32], rules: MixingRules = MIXING_RULES
) -> NDArray[np.bool_]:
    """Return the pixels between smooth ones whose phase may be mixed from two surfaces, (H, W).

    That is beside a break of the step, beside what is undecided, at the border of a shadow, and far from every smooth
    pixel that could vouch for it.

    Parameters
    ----------
    step
        Step over the plate, rad, NaN where open, (H, W).
    regions
        Smooth regions of it.
    light
        Modulation of the fringes, grey levels, (H, W).
    rules
        What an edge is.
    """
    edges = np.zeros(step.shape, np.uint8)
    values = (rules.break_rad, rules.slopes_px, rules.reach_px, rules.dim_share)
    brightest = cv2.dilate(light, np.ones((2 * rules.bright_px + 1,) * 2, np.uint8))
    over_bands(_mark, len(step), step, regions.cores, regions.labels, light, brightest, values, edges)
    _mark_broken_alone(edges, step, regions.labels, rules)
    if not edges.any():
        return edges > 0
    edges[_torn_off(edges, rules)] |= _BROKEN
    wide = np.ones((2 * rules.mixed_px + 1,) * 2, np.uint8)
    mixed = cv2.dilate(edges & _BROKEN, wide) | cv2.dilate(edges & _DIM, np.ones((3, 3), np.uint8))
    return np.asarray((mixed > 0) & (regions.cores == 0) & (regions.labels > 0))


_JUMP_RAD = 2.0  # between neighbours, beyond the smaller slope beside them, that is a break: a fold bends by less


@njit(inline="always")
def _jumps(before, left, right, after):  # type: ignore[no-untyped-def]
    """Whether two neighbours differ by more than the slope on either side of them explains."""
    slope = min(abs(left - before), abs(after - right))
    slope = slope if slope == slope else 0.0
    return abs(right - left) > slope + _JUMP_RAD


@njit(nogil=True, cache=True)
def _mark_breaks(first, last, step, out):  # type: ignore[no-untyped-def]
    """Mark pixels of some rows that differ from a neighbour by a break."""
    height, width = step.shape
    for v in range(first, last):
        for u in range(width):
            out[v, u] = False
            for dv, du in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                y, x = v + dv, u + du
                if 0 <= y < height and 0 <= x < width:
                    before = step[max(0, min(height - 1, v - dv)), max(0, min(width - 1, u - du))]
                    after = step[max(0, min(height - 1, y + dv)), max(0, min(width - 1, x + du))]
                    out[v, u] |= _jumps(before, step[v, u], step[y, x], after)


def beside_breaks(step: Array, light: NDArray[np.float32], rules: MixingRules = MIXING_RULES) -> NDArray[np.bool_]:
    """Return the pixels on either side of a break, and dim ones beside what is open, (H, W).

    Where every pixel's order is its own, one that sees two surfaces at once has that of neither, or of the one beside;
    so has one in a shadow into which the lens blurs a lit surface.

    Parameters
    ----------
    step
        Step over the plate, rad, NaN where open, (H, W).
    light
        Modulation of the fringes, grey levels, (H, W).
    rules
        What is dim, and how far the border of a shadow reaches.
    """
    beside = np.empty(step.shape, np.bool_)
    over_bands(_mark_breaks, len(step), step, beside)
    around = np.ones((2 * rules.bright_px + 1,) * 2, np.uint8)
    dim = light < rules.dim_share * cv2.dilate(np.nan_to_num(np.asarray(light, np.float32)), around)
    near = np.ones((2 * rules.mixed_px + 1,) * 2, np.uint8)
    missing = np.isnan(step)
    return beside | (dim & ~missing & (cv2.dilate(missing.astype(np.uint8), near) > 0))
