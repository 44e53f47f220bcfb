"""Where an index has slipped: steps between neighbouring crossings that are not like those around them."""

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

# A line left out doubles a step, one found twice halves it; lens and view change it by less among few neighbours.
MAX_STEP_CHANGE = 0.5
# Steps to either side of one that are compared with it, and the least that must be known.
AROUND = 4
MIN_AROUND = 3


def without_torn_islands(nodes: FloatArray) -> FloatArray:
    """Leave out crossings that hang on the others by wrong steps only.

    Parameters
    ----------
    nodes
        Crossings (rows, columns, 2), px, NaN where unknown.

    Returns
    -------
    FloatArray
        Same shape. Of parts joined by wrong steps only the largest stays; parts that nothing joins stay too.
    """
    number = np.arange(nodes[..., 0].size).reshape(nodes.shape[:2])
    sound, torn = [], []
    for axis in (0, 1):
        pairs = _neighbours(number, axis)
        wrong = _torn(nodes, axis)
        here = np.isfinite(np.diff(nodes, axis=axis)[..., 0])
        sound.append(pairs[here & ~wrong])
        torn.append(pairs[here & wrong])
    cut = np.concatenate(torn)
    if not len(cut):
        return nodes
    ends = np.concatenate(sound)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(number.size, number.size))
    _, part = connected_components(graph, directed=False)
    known = np.isfinite(nodes[..., 0]).ravel()
    suspect = np.unique(part[cut])
    largest = np.argmax(np.bincount(part[known]))
    drop = np.isin(part, suspect[suspect != largest]).reshape(number.shape)
    return np.where(drop[..., None], np.nan, nodes)


def _neighbours(number: npt.NDArray[np.int64], axis: int) -> npt.NDArray[np.int64]:
    """Numbers (..., 2) of the sites at both ends of every step along an axis."""
    count = number.shape[axis]
    return np.stack([number.take(range(count - 1), axis), number.take(range(1, count), axis)], axis=-1)


def _torn(nodes: FloatArray, axis: int) -> BoolArray:
    """Steps along an axis that are not those around them, beside or before and after."""
    steps = np.diff(nodes, axis=axis)
    torn = np.zeros(steps.shape[:2], dtype=bool)
    for across in (0, 1):
        padded = np.pad(steps, [(AROUND, AROUND) if k == across else (0, 0) for k in range(3)], constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1, axis=across)
        enough = np.isfinite(windows[..., 0, :]).sum(axis=-1) >= MIN_AROUND
        typical = np.nanmedian(np.where(enough[..., None, None], windows, 0.0), axis=-1)
        off, size = (np.linalg.norm(vectors, axis=2) for vectors in (steps - typical, typical))
        torn |= enough & (off > MAX_STEP_CHANGE * size)
    return torn
