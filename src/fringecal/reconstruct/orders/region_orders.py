"""Fringe orders of smooth regions from how they follow one another along epipolar lines.

Every passage from region a to region b bounds the fringes n that are still to be added: where they lie side by side
the projector's rays may skip (a riser that the camera does not see) but not run back, so ``n_b >= n_a + c``; across a
shadow the ray is the same at both ends, so ``n_b = n_a + c``. From the plate's region on, each region gets an interval
of orders. The bounds that most lines support are carried through first; one that contradicts them is left aside and
counts against the regions that it names.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import TURN
from fringecal.reconstruct.orders.line_evidence import (
    DARK_LEVEL,
    END_RAD,
    END_U,
    END_V,
    FIRST,
    KIND,
    MEETING,
    SECOND,
    SHADOW,
    START_RAD,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_UNBOUNDED = np.int64(10_000)
"""Fringes: an end of an interval that nothing bounds."""


@dataclass(frozen=True)
class EvidenceRules:
    """What passages must be like to count.

    Parameters
    ----------
    least_lines, least_shadow_lines
        Lines that must agree, and those that tie two regions across a shadow: fewer are a corner.
    agreeing
        Share of the lines between two regions that must agree.
    closure_rad
        Most that absolute phase may differ over a shadow, modulo a fringe: its ends are known to a pixel, which is
        up to 0.8 rad.
    closing
        Share of the dark passages between two regions that must close so: of paint, 0.35 do by chance.
    even_rad, mean_rad
        Most standard deviation and mean of what is left over along a stretch: a band that ends at a wall leaves
        anything.
    breadth
        Share of the lines through the narrower of two regions over which a shadow must close to tie them.
    against
        Share of the lines for a region's order that may speak against it.
    """

    least_lines: int = 5
    least_shadow_lines: int = 9
    agreeing: float = 0.6
    closure_rad: float = 1.1
    closing: float = 0.7
    even_rad: float = 0.6
    mean_rad: float = 0.5
    breadth: float = 0.35
    against: float = 0.5


EVIDENCE_RULES = EvidenceRules()


_NEAR_PX = 7  # square within which passages of neighbouring lines belong together


type Row = tuple[int, int, int, bool, int]
"""A bound: first, second, fringes, whether it is an equality, lines."""


class Bounds(NamedTuple):
    """``n_second >= n_first + fringes``, or equal to it, by so many lines; those of most lines first."""

    first: Ints
    second: Ints
    fringes: Ints
    equal: NDArray[np.bool_]
    lines: Ints

    def without(self, regions: NDArray[np.bool_]) -> "Bounds":
        """Return the bounds that name none of some regions, a mask by number."""
        kept = ~(regions[self.first] | regions[self.second])
        return Bounds(self.first[kept], self.second[kept], self.fringes[kept], self.equal[kept], self.lines[kept])


@dataclass(frozen=True)
class Passages:
    """What `fringecal.reconstruct.orders.line_evidence.passages` found, with the absolute phase's gain over each, rad.

    Phase and fringes count positive as they grow with height.
    """

    first: Ints
    second: Ints
    shadow: NDArray[np.bool_]
    meeting: NDArray[np.bool_]
    place: Ints
    gain_rad: Array
    light: Array

    @classmethod
    def of(cls, found: Array, plate_rad: Array, rising: int, shape: tuple[int, int]) -> "Passages":
        """Add the plate's phase at both ends, (n, 2), rad, to the steps; only over shadows does it matter."""
        shadow, meeting = found[:, KIND] == SHADOW, found[:, KIND] == MEETING
        gain = found[:, START_RAD] - found[:, END_RAD] + np.where(shadow, plate_rad[:, 1] - plate_rad[:, 0], 0.0)
        first, second = (found[:, k].astype(np.int64) for k in (FIRST, SECOND))
        u, v = (np.rint(found[:, k]).astype(np.int64) for k in (END_U, END_V))
        place = stretches(u, v, shape)
        return cls(first, second, shadow, meeting, place, rising * gain, found[:, DARK_LEVEL])

    def least_fringes(self) -> Ints:
        """Fringes that the second region needs so that no ray runs back, to half a fringe."""
        return np.ceil((-self.gain_rad - TURN / 2) / TURN).astype(np.int64)

    def closing_fringes(self) -> tuple[Ints, Array]:
        """Fringes that make both ends of a shadow show one ray, and what is left over, rad."""
        fringes = np.rint(-self.gain_rad / TURN)
        return fringes.astype(np.int64), self.gain_rad + TURN * fringes


def stretches(u: NDArray[np.integer], v: NDArray[np.integer], shape: tuple[int, int]) -> Ints:
    """Number the stretches of edge at which pixels lie: those that hang together over neighbouring lines."""
    u, v = np.clip(u, 0, shape[1] - 1), np.clip(v, 0, shape[0] - 1)
    at = np.zeros(shape, np.uint8)
    at[v, u] = 1
    _, labels = cv2.connectedComponents(cv2.dilate(at, np.ones((_NEAR_PX, _NEAR_PX), np.uint8)), connectivity=8)
    return np.asarray(labels[v, u], np.int64)


def bounds_of(
    passages: Passages, breadths: Ints, dark_level: float = np.inf, rules: EvidenceRules = EVIDENCE_RULES
) -> Bounds:
    """Let the lines between every two regions vote.

    Parameters
    ----------
    passages
        All passages.
    breadths
        Lines that cross each region.
    dark_level
        Modulation that noise alone shows, grey levels: a band with more is lit, and dark for another reason.
    rules
        What counts.
    """
    fringes, left = passages.closing_fringes()
    least = passages.least_fringes()
    closed = passages.shadow & (np.abs(left) < rules.closure_rad)
    rows: list[Row] = []
    for first, second, at in _pairs(passages):
        closing, meeting = at[closed[at]], at[passages.meeting[at]]
        if closing.size >= max(rules.least_lines, rules.closing * np.count_nonzero(passages.shadow[at])):
            even = closes_evenly(passages, left, closing, dark_level, rules)
            rows += _vote(first, second, fringes[closing], even, rules)
        rows += _vote(first, second, least[meeting], False, rules)
    rows = _supported(rows, breadths, rules)
    rows.sort(key=lambda row: -row[4])
    a, b, c, equal, lines = (np.array([row[k] for row in rows], np.int64) for k in range(5))
    return Bounds(a, b, c, equal.astype(bool), lines)


def closes_evenly(
    passages: Passages, left: Array, at: Ints, dark_level: float, rules: EvidenceRules = EVIDENCE_RULES
) -> bool:
    """Whether what is left over at some passages of one pair of regions is as even as over the shadow of one surface.

    Parameters
    ----------
    passages
        All passages.
    left
        What `Passages.closing_fringes` leaves over, rad.
    at
        Numbers of the passages, over shadows.
    dark_level
        Modulation that noise alone shows, grey levels.
    rules
        What counts.
    """
    even = float(np.std(left[at])) < rules.even_rad and abs(float(np.mean(left[at]))) < rules.mean_rad
    inner = bool(passages.first[at[0]] == passages.second[at[0]])
    return even and (inner or float(np.mean(passages.light[at])) < dark_level)


def same_pair(passages: Passages, at: Ints) -> list[Ints]:
    """Group some passages by the ordered pair of regions that they join.

    Parameters
    ----------
    passages
        All passages.
    at
        Numbers of some of them.
    """
    if at.size == 0:
        return []
    key = passages.first[at] * (int(passages.second.max()) + 1) + passages.second[at]
    order = np.argsort(key, kind="stable")
    return list(np.split(at[order], np.flatnonzero(np.diff(key[order])) + 1))


def _supported(rows: list[Row], breadths: Ints, rules: EvidenceRules) -> list[Row]:
    """Add up what several stretches of edge say alike; a shadow over few of a region's lines only bounds it from below.

    A dark band that ends at a wall instead of on what it falls on closes by chance; that is so over a part of an edge.
    """
    sums: dict[tuple[int, int, int, bool], int] = {}
    for first, second, fringes, equal, lines in rows:
        sums[first, second, fringes, equal] = sums.get((first, second, fringes, equal), 0) + lines
    out = []
    for (first, second, fringes, equal), lines in sums.items():
        least = rules.breadth * min(breadths[first], breadths[second])
        out.append((first, second, fringes, equal and (lines >= least or first == second), lines))
    return out


def _pairs(passages: Passages) -> list[tuple[int, int, Ints]]:
    """Return the passages of every ordered pair of regions, at every stretch of edge."""
    if passages.first.size == 0:
        return []
    key = (passages.first * (int(passages.second.max()) + 1) + passages.second) * (int(passages.place.max()) + 1)
    key += passages.place
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    return [(int(passages.first[at[0]]), int(passages.second[at[0]]), at) for at in np.split(order, starts[1:])]


def _vote(first: int, second: int, fringes: Ints, equal: bool, rules: EvidenceRules) -> list[Row]:
    """Return the bound that enough lines agree on, if any."""
    least = rules.least_shadow_lines if equal and first != second else rules.least_lines
    if fringes.size < least:
        return []
    values, counts = np.unique(fringes, return_counts=True)
    best = int(np.argmax(counts))
    if counts[best] < max(least, rules.agreeing * fringes.size):
        return []
    return [(first, second, int(values[best]), equal, int(counts[best]))]


class OrderBook:
    """Intervals of orders that are left for every region, narrowed by bounds and by what is chosen."""

    def __init__(self, number: int, bounds: Bounds, rules: EvidenceRules = EVIDENCE_RULES) -> None:
        """Start with regions 0 to `number` of which nothing is known."""
        self.low = np.full(number + 1, -_UNBOUNDED)
        self.high = np.full(number + 1, _UNBOUNDED)
        self.bounds = bounds
        self.rules = rules
        self._used = np.zeros(bounds.first.size, np.bool_)

    def carry(self) -> list[int]:
        """Carry all bounds through, those of most lines first; return the numbers of those that contradict them."""
        aside = []
        for k in range(self.bounds.first.size):
            if self.bounds.first[k] != self.bounds.second[k] and not self._used[k]:
                self._used[k] = True
                self._try(self._used)
                if not self._kept:
                    self._used[k] = False
                    aside.append(k)
        return aside

    def choose(self, region: int, order: int) -> bool:
        """Give a region one of the orders that are left for it; return whether that was possible."""
        if not self.low[region] <= order <= self.high[region]:
            return False
        low, high = self.low.copy(), self.high.copy()
        self.low[region] = self.high[region] = order
        self._try(self._used)
        if not self._kept:
            self.low, self.high = low, high
        return self._kept

    def _try(self, used: NDArray[np.bool_]) -> None:
        low, high = self.low.copy(), self.high.copy()
        b = self.bounds
        self._kept = bool(_narrow(low, high, b.first, b.second, b.fringes, b.equal, used))
        if self._kept:
            self.low, self.high = low, high

    def orders(self) -> Array:
        """Order of every region, NaN where several are left or too many lines speak against it."""
        b = self.bounds
        change = self.low[b.second] - self.low[b.first] - b.fringes
        holds = (change == 0) | (~b.equal & (change >= 0))
        known = (self.low == self.high)[b.first] & (self.low == self.high)[b.second] & (b.first != b.second)
        size = self.low.size
        against = np.zeros(size)
        support = np.zeros(size)
        for ends in (b.first, b.second):
            support += np.bincount(ends[known & holds], b.lines[known & holds], size)
            against += np.bincount(ends[known & ~holds], b.lines[known & ~holds], size)
        sure = (self.low == self.high) & (against <= self.rules.against * support)
        return np.where(sure, self.low, np.nan).astype(float)


@njit(cache=True)
def _narrow(low, high, first, second, fringes, equal, used):  # type: ignore[no-untyped-def]
    """Carry bounds through until nothing changes, in place; return whether every interval still holds an order."""
    changed = True
    while changed:
        changed = False
        for k in range(first.size):
            if not used[k]:
                continue
            a, b, c = first[k], second[k], fringes[k]
            if low[a] > -_UNBOUNDED and low[a] + c > low[b]:
                low[b], changed = low[a] + c, True
            if high[b] < _UNBOUNDED and high[b] - c < high[a]:
                high[a], changed = high[b] - c, True
            if equal[k]:
                if low[b] > -_UNBOUNDED and low[b] - c > low[a]:
                    low[a], changed = low[b] - c, True
                if high[a] < _UNBOUNDED and high[a] + c < high[b]:
                    high[b], changed = high[a] + c, True
            if low[a] > high[a] or low[b] > high[b]:
                return False
    return True
