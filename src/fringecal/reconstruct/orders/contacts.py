"""Groups of regions that meet along their borders, and how each hangs on what is decided.

A finely folded surface falls into many small regions that rightly hang together. One short border with the plate, where
the step is whole fringes by chance, would give all of them a wrong order. So the open regions are grouped first, and a
border must be long for the size of what hangs on it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]

CONTACT_SHARE = 0.5
"""Least length of a border, px, over the root of the pixels that hang on it, their breadth: a wedge four times
as deep as it is broad still hangs on its foot."""


@dataclass(frozen=True)
class Groups:
    """The group of every region, numbered by one of its members; the region's fringes over that one; its pixels."""

    group: Ints
    fringes: Ints
    pixels: Ints


def contact_groups(borders: Ints, sizes: Ints, share: float = CONTACT_SHARE) -> Groups:
    """Join regions along their borders, the longest first.

    Parameters
    ----------
    borders
        Rows of regions a and b, the fringes that b lacks against a, and the pixel pairs that say so, (n, 4).
    sizes
        Pixels of every region, by number.
    share
        See `CONTACT_SHARE`.
    """
    found = Groups(np.arange(sizes.size), np.zeros(sizes.size, np.int64), sizes.astype(np.int64))
    while _joined_once(borders, found, share):
        pass
    return found


def _joined_once(borders: Ints, found: Groups, share: float) -> bool:
    """Join groups in place, each with one other at most; return whether any were joined."""
    joints, fresh = joints_between(borders, found), np.ones(found.group.size, bool)
    for a, b, lacking, pairs in joints[np.argsort(-joints[:, 3], kind="stable")].tolist():
        if fresh[a] and fresh[b] and pairs >= share * np.sqrt(min(found.pixels[a], found.pixels[b])):
            members = found.group == b
            found.group[members] = a
            found.fringes[members] += lacking
            found.pixels[a] += found.pixels[b]
            fresh[[a, b]] = False
    return not fresh.all()


def joints_between(borders: Ints, found: Groups) -> Ints:
    """Add up the borders between groups that say the same: rows of groups a < b, fringes that b lacks, pixel pairs."""
    a, b = found.group[borders[:, 0]], found.group[borders[:, 1]]
    lacking = borders[:, 2] + found.fringes[borders[:, 0]] - found.fringes[borders[:, 1]]
    rows = np.column_stack([np.minimum(a, b), np.maximum(a, b), np.where(a > b, -lacking, lacking)])[a != b]
    joints, of = np.unique(rows, axis=0, return_inverse=True)
    pairs = np.bincount(of.ravel(), borders[a != b, 3], len(joints)).astype(np.int64)
    return np.column_stack([joints, pairs])


def orders_by_contact(
    borders: Ints, sizes: Ints, orders: NDArray[np.float64], impossible: Callable[[dict[int, int]], bool]
) -> dict[int, int]:
    """Return the orders of open regions that hang on decided ones by borders long enough for their whole group.

    Parameters
    ----------
    borders, sizes
        As for `contact_groups`.
    orders
        Order of every region, NaN where open.
    impossible
        Whether the orders of a whole group cannot be.
    """
    known = np.isfinite(orders)
    inner, across = ~known[borders[:, :2]].any(axis=1), known[borders[:, :2]].sum(axis=1) == 1
    found = contact_groups(borders[inner], sizes)
    hanging: dict[tuple[int, int], int] = {}
    for a, b, lacking, pairs in borders[across].tolist():
        region, order = (b, orders[a] + lacking) if known[a] else (a, orders[b] - lacking)
        key = int(found.group[region]), int(order - found.fringes[region])
        hanging[key] = hanging.get(key, 0) + pairs
    chosen: dict[int, int] = {}
    for (group, base), pairs in sorted(hanging.items(), key=lambda one: one[1]):
        if pairs >= CONTACT_SHARE * np.sqrt(found.pixels[group]):
            chosen[group] = base  # the longest comes last
    hung: dict[int, int] = {}
    for group, base in chosen.items():
        members = np.flatnonzero(found.group == group).tolist()
        those = {r: base + int(found.fringes[r]) for r in members}
        hung |= {} if impossible(those) else those
    return hung
