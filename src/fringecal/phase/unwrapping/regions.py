"""Unwrapping over edges: smooth regions first, then regions joined where their common border agrees.

Where a surface breaks off, a path from pixel to pixel picks up any multiple of 2 pi, and some pixel of the edge
always looks harmless because the jump there happens to be a whole number of fringes. So the picture is cut into
regions in which the phase is smooth, and two regions are joined only if the pixels along their common border
agree on one order with only a small step left: a fold does, an edge does not.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.numerics import over_bands
from fringecal.phase.unwrapping import joining
from fringecal.phase.unwrapping.borders import join_regions, trusted_borders
from fringecal.phase.unwrapping.flooding import add_orders, drop_crumbs, flood, smooth_pixels, start_of_growth, torn
from fringecal.phase.unwrapping.spatial import Unwrapped, unwrap

_LEAST_PIXELS = 25  # of a region, one square of the opening that finds them; smaller ones go to their neighbours
_NARROWING_PX, _NARROWINGS = 5, 6  # side of the square by which a region is narrowed, and how often
_QUIET_RAD = 0.1  # noise of the curvature up to which neighbours in a smooth region never differ by half a fringe


@dataclass(frozen=True)
class Regions:
    """Smooth regions of a phase map, the order of one against another still open.

    Parameters
    ----------
    values
        Phase, continuous within a region, rad, (H, W); NaN where masked.
    cores
        Number of the region where the phase is smooth, from 1; 0 elsewhere, (H, W).
    labels
        The same after regions have grown over the edges between them; 0 where masked.
    """

    values: NDArray[np.float64]
    cores: NDArray[np.int32]
    labels: NDArray[np.int32]

    @cached_property
    def number(self) -> int:
        """How many regions there are."""
        return int(self.labels.max(initial=0))

    def with_cores(self, cores: NDArray[np.int32], without: NDArray[np.bool_]) -> "Regions":
        """Return the regions that grow from other smooth pixels, over all but some pixels, (H, W)."""
        values, phase, labels = np.empty_like(self.values), np.empty(cores.shape, np.float32), cores.copy()
        over_bands(start_of_growth, len(cores), self.values, cores, self.labels, without, values, phase)
        drop_crumbs(labels, int(labels.max(initial=0)), _LEAST_PIXELS)
        kept = labels.copy()
        flood(values, labels, phase)
        return Regions(values, kept, labels)

    def borders(self, light: NDArray[np.float32] | None = None) -> NDArray[np.int64]:
        """Return borders along which both sides meet: rows of regions a, b, the fringes b lacks, pixel pairs.

        Where the modulation `light`, (H, W), dips between their smooth pixels, they do not.
        """
        return trusted_borders(self.values, self.labels, None if light is None else (light, self.cores))


def smooth_regions(phase: ArrayLike, valid: ArrayLike) -> Regions | None:
    """Cut a phase map into regions in which it is smooth, and let them grow over what lies between.

    Parameters
    ----------
    phase
        Wrapped phase, rad, (H, W); best the object's minus the plate's, which is small and slow.
    valid
        True where the phase is to be used, (H, W).

    Returns
    -------
    Regions or None
        None where the phase is smooth nowhere.
    """
    single = _masked(phase, valid)
    values, labels = _consistent_cores(single)
    if drop_crumbs(labels, int(labels.max(initial=0)), _LEAST_PIXELS) == 0:
        return None
    cores = labels.copy()
    flood(values, labels, single)
    return Regions(values, cores, labels)


def _masked(phase: ArrayLike, valid: ArrayLike) -> NDArray[np.float32]:
    single = np.array(phase, np.float32)
    single[~(np.asarray(valid, dtype=bool) & np.isfinite(single))] = np.nan
    return single


def unwrap_regions(phase: ArrayLike, valid: ArrayLike) -> Unwrapped:
    """Unwrap smooth regions and join those whose common border agrees on an order.

    Parameters
    ----------
    phase
        Wrapped phase, rad, (H, W); best the object's minus the plate's, which is small and slow.
    valid
        True where the phase is to be used, (H, W).

    Returns
    -------
    Unwrapped
        `pieces` numbers what is connected: the order of one piece against another is open.

    Notes
    -----
    An edge whose jump lies within some 0.15 rad (more where the surface is curved or noisy) of whole fringes along most
    of its length looks like a surface that touches its neighbour there, and is taken for one.

    Examples
    --------
    >>> slope = 0.3 * np.tile(np.arange(60.0), (40, 1))
    >>> found = unwrap_regions(np.angle(np.exp(1j * slope)), np.ones(slope.shape, bool))
    >>> bool(np.abs(np.diff(found.phase, axis=1) - 0.3).max() < 1e-4)
    True
    """
    regions = smooth_regions(phase, valid)
    if regions is None:
        return unwrap(_masked(phase, valid))
    offsets, groups = join_regions(regions.values, regions.labels)
    add_orders(regions.values, regions.labels, offsets, _numbered(groups))
    return Unwrapped(regions.values, regions.labels)


def _consistent_cores(phase: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Unwrap the smooth pixels, and narrow the regions in which paths disagree until none does.

    Where a region holds neighbours that differ by more than half a fringe, it goes around the end of an edge and over
    it again where the jump happens to be whole fringes; the narrower it is made, the sooner that bridge breaks.
    """
    smooth, noise = smooth_pixels(phase)
    narrower = np.ones((_NARROWING_PX, _NARROWING_PX), np.uint8)
    for _ in range(_NARROWINGS):
        values, labels = _cores(phase, smooth, noise)
        bad = torn(values, labels, int(labels.max(initial=0)))
        if not bad.any():
            return values, labels
        inside = bad[labels]
        eroded = cv2.erode((smooth * inside).astype(np.uint8), narrower)
        smooth = np.where(inside, eroded, smooth).astype(np.uint8)
    labels[bad[labels]] = 0
    return values, labels


def _cores(
    phase: NDArray[np.float32], smooth: NDArray[np.uint8], noise: float
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Unwrap the smooth pixels; where they are quiet too, all paths agree and no order of joining is needed."""
    if noise > _QUIET_RAD:
        found = unwrap(phase, smooth)
        return found.phase, found.pieces
    classes = np.where(smooth, np.uint8(0), joining.MASKED).reshape(-1)
    nodes = joining.join_best(phase.reshape(-1), classes, phase.shape[1])
    joining.hang_on_roots(nodes, phase.shape[1])
    pieces = joining.number_roots(nodes, classes)
    return joining.add_periods(phase, classes, nodes, pieces), pieces.reshape(phase.shape)


def _numbered(groups: NDArray[np.int32]) -> NDArray[np.int32]:
    """Number groups of labels 1, 2, ... in the order of their first label, which is that of the raster."""
    _, first, inverse = np.unique(groups[1:], return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.concatenate([[0], rank[inverse] + 1]).astype(np.int32)
