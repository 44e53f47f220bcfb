"""Compiled kernels of unwrapping: neighbours are joined to pieces by a union-find whose links carry whole periods.

A *node* is one int64 for each pixel: below, 32 bits with the pixel that it hangs on (its own number: a root);
above, the periods by which its phase exceeds that one's, 0 for a root. The root of a piece is its first pixel in
raster order. A *link* is one int32 for two neighbours: twice the later pixel, plus 1 if the earlier one is above
it and not beside it. Neither depends on the number of threads.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import TURN, over_bands

N_SWEEPS, N_CLASSES = 4, 9
"""Links of the first classes go by the worse of their pixels alone, all others by both; class 0 is the best."""

MASKED = np.uint8(N_CLASSES)
MAX_PIXELS = 2**30
"""Pixels of a map: a link is twice its later pixel in 32 bits with their sign."""

_STRIPS = 16  # of the picture, whose links are counted at once; the result does not depend on it
_KEYS = 2 * N_CLASSES  # of links: sums of two classes
_PARENT = np.int64(2**32 - 1)  # the lower 32 bits of a node
_PER_TURN = np.float32(1 / TURN)  # 1/rad


def _table() -> NDArray[np.uint8]:
    """Return the place in the queue of a link between two classes; 0 if it is joined before, or never."""
    table = np.zeros((16, 16), np.uint8)
    for a, b in np.ndindex(N_CLASSES, N_CLASSES):
        table[a, b] = max(a, b) if max(a, b) < N_SWEEPS else a + b
    return table


_TABLE = _table()


@njit(inline="always")
def _find(nodes, pixel):  # type: ignore[no-untyped-def]
    """Return the root of a pixel and its order against it, halving the path on the way."""
    total, node = np.int64(0), nodes[pixel]
    while True:
        above = node & _PARENT
        top = nodes[above]
        if top & _PARENT == above:
            # The root, or one that hangs on it; the order of a root is 0.
            return above, total + (node >> 32)
        order = (node >> 32) + (top >> 32)
        nodes[pixel] = (order << 32) | (top & _PARENT)
        total += order
        pixel = top & _PARENT
        node = nodes[pixel]


@njit(inline="always")
def _join(phase, p, q, at_p, at_q, nodes):  # type: ignore[no-untyped-def]
    """Join the pieces of neighbours p and q, whose roots and orders are known; return q's root and order."""
    (root_p, order_p), (root_q, order_q) = at_p, at_q
    if root_p == root_q:
        return at_q
    # Periods to add to q's piece so that p and q differ by less than half a period.
    jump = np.int64(np.rint((phase[p] - phase[q]) * _PER_TURN)) + order_p - order_q
    if root_p < root_q:
        nodes[root_q] = (jump << 32) | root_p
        return root_p, order_q + jump
    nodes[root_p] = (-jump << 32) | root_q
    return at_q


@njit(inline="always")
def _join_rows(phase, classes, width, rows, nodes):  # type: ignore[no-untyped-def]
    """Join all neighbours of class 0 in some rows: along a row, no search for roots is needed."""
    first, last = rows
    for start in range(first * width, last * width, width):
        connected, root, mine = False, np.int64(start), np.int64(0)
        for pixel in range(start, start + width):
            if classes[pixel] != 0:
                connected = False
                nodes[pixel] = pixel
                continue
            if connected:
                mine += np.int64(np.rint((phase[pixel - 1] - phase[pixel]) * _PER_TURN))
            else:
                connected, root, mine = True, np.int64(pixel), np.int64(0)
            nodes[pixel] = (mine << 32) | root
            up = pixel - width
            if start > first * width and classes[up] == 0:
                at = _find(nodes, up)
                if at[0] != root:
                    root, mine = _join(phase, up, pixel, at, (root, mine), nodes)


def join_best(phase: NDArray[np.float32], classes: NDArray[np.uint8], width: int) -> NDArray[np.int64]:
    """Make the nodes and join neighbours of class 0: strip by strip at once, then across the strips' borders.

    Parameters
    ----------
    phase, classes
        Wrapped phase, float32 rad, and classes, uint8; flat, `width` pixels a row.
    """
    strips = min(_STRIPS, phase.size // width)
    nodes = np.empty(phase.size, np.int64)
    over_bands(_join_strips, strips, phase, classes, width, strips, nodes, least=1)
    _join_borders(phase, classes, width, strips, nodes)
    return nodes


@njit(nogil=True, cache=True)
def _join_strips(first, last, phase, classes, width, strips, nodes):  # type: ignore[no-untyped-def]
    """Join within some strips."""
    height = phase.size // width
    for s in range(first, last):
        _join_rows(phase, classes, width, (height * s // strips, height * (s + 1) // strips), nodes)


@njit(cache=True)
def _join_borders(phase, classes, width, strips, nodes):  # type: ignore[no-untyped-def]
    """Join across the strips' borders."""
    height = phase.size // width
    for s in range(1, strips):
        start = width * (height * s // strips)
        for pixel in range(start, start + width):
            up = pixel - width
            if classes[pixel] == 0 and classes[up] == 0:
                _join(phase, up, pixel, _find(nodes, up), _find(nodes, pixel), nodes)


@njit(inline="always")
def _count_links(classes, width, rows, counts):  # type: ignore[no-untyped-def]
    """Count the links of some rows by their place in the queue."""
    for i in range(rows[0], rows[1]):
        here = classes[i * width : (i + 1) * width]
        for j in range(1, width):
            counts[_TABLE[here[j - 1], here[j]]] += 1
        if i > 0:
            above = classes[(i - 1) * width : i * width]
            for j in range(width):
                counts[_TABLE[above[j], here[j]]] += 1


@njit(inline="always")
def _place_links(classes, width, rows, at, links):  # type: ignore[no-untyped-def]
    """Write the links of some rows where `at` says; a link of place 0 is overwritten by the next, not branched over."""
    step = np.ones(_KEYS, np.int64)
    step[0] = 0
    for pixel in range(rows[0] * width, rows[1] * width):
        mine = classes[pixel]
        if pixel % width:
            key = _TABLE[classes[pixel - 1], mine]
            links[at[key]] = 2 * pixel
            at[key] += step[key]
        if pixel >= width:
            key = _TABLE[classes[pixel - width], mine]
            links[at[key]] = 2 * pixel + 1
            at[key] += step[key]


def sorted_links(classes: NDArray[np.uint8], width: int) -> NDArray[np.int32]:
    """Return all links but those of class 0, the best first, in raster order where they are equally good.

    A counting sort whose loops hold no branch that depends on the picture: in noise, guessing such branches wrong
    takes longer than all the rest.
    """
    strips = min(_STRIPS, classes.size // width)
    counts = np.zeros((strips, _KEYS), np.int64)
    over_bands(_count_strips, strips, classes, width, counts, least=1)
    # Where the links of each key and strip begin: those of a key after another, its strips in their order.
    ends = np.cumsum(counts[:, 1:].T)
    total = int(ends[-1])
    counts[:, 1:] = (ends.reshape(_KEYS - 1, strips) - counts[:, 1:].T).T
    counts[:, 0] = total + np.arange(strips)
    links = np.empty(total + strips, np.int32)
    over_bands(_place_strips, strips, classes, width, counts, links, least=1)
    return links[:total]


@njit(nogil=True, cache=True)
def _count_strips(first, last, classes, width, counts):  # type: ignore[no-untyped-def]
    """Count the links of some strips by their place in the queue."""
    height, strips = classes.size // width, counts.shape[0]
    for s in range(first, last):
        mine = np.zeros(_KEYS, np.int64)  # of one's own, for strips' counts share a cache line
        _count_links(classes, width, (height * s // strips, height * (s + 1) // strips), mine)
        for key in range(_KEYS):
            counts[s, key] = mine[key]


@njit(nogil=True, cache=True)
def _place_strips(first, last, classes, width, starts, links):  # type: ignore[no-untyped-def]
    """Write the links of some strips from where they start."""
    height, strips = classes.size // width, starts.shape[0]
    for s in range(first, last):
        _place_links(classes, width, (height * s // strips, height * (s + 1) // strips), starts[s].copy(), links)


@njit(cache=True)
def join_links(phase, width, links, nodes):  # type: ignore[no-untyped-def]
    """Join neighbours link by link, in their order."""
    for link in links:
        q = np.int64(link >> 1)
        p = q - (width if link & 1 else 1)
        if (nodes[p] ^ nodes[q]) & _PARENT:
            _join(phase, p, q, _find(nodes, p), _find(nodes, q), nodes)


def hang_on_roots(nodes: NDArray[np.int64], width: int) -> None:
    """Let every node hang on its root; what another thread has done already is another path to the same root."""
    over_bands(_hang_rows, nodes.size // width, nodes, width)


@njit(nogil=True, cache=True)
def _hang_rows(first, last, nodes, width):  # type: ignore[no-untyped-def]
    """Let the nodes of some rows hang on their roots."""
    for i in range(first, last):
        for pixel in range(i * width, (i + 1) * width):
            node = nodes[pixel]
            above, order = node & _PARENT, node >> 32
            top = nodes[above]
            while top & _PARENT != above:
                order += top >> 32
                above = top & _PARENT
                top = nodes[above]
            nodes[pixel] = (order << 32) | above


@njit(cache=True)
def number_roots(nodes, classes):  # type: ignore[no-untyped-def]
    """Number the roots that are not masked in raster order; 0 elsewhere."""
    pieces = np.zeros(nodes.size, np.int32)
    count = 0
    for pixel in range(nodes.size):
        if nodes[pixel] & _PARENT == pixel and classes[pixel] != MASKED:
            count += 1
            pieces[pixel] = count
    return pieces


def add_periods(
    phase: NDArray[np.floating], classes: NDArray[np.uint8], nodes: NDArray[np.int64], pieces: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Return the phase with its periods, NaN where masked, and complete the numbers of the pieces."""
    result = np.empty(phase.shape)
    over_bands(_add_rows, len(phase), phase, classes, nodes, pieces, result)
    return result


@njit(nogil=True, cache=True)
def _add_rows(first, last, phase, classes, nodes, pieces, result):  # type: ignore[no-untyped-def]
    """Add the periods in some rows."""
    width = phase.shape[1]
    for i in range(first, last):
        for j in range(width):
            pixel = i * width + j
            root = nodes[pixel] & _PARENT
            masked = classes[pixel] == MASKED
            result[i, j] = np.nan if masked else phase[i, j] + TURN * (nodes[pixel] >> 32)
            if root != pixel:
                pieces[pixel] = pieces[root]
