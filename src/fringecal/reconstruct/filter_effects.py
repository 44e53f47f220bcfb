"""What a filter does to heights besides smoothing them: the noise that it leaves, and the form that it takes away.

Both are found on the capture itself, smoothed by a 3 x 3 mean: noise of the known size is added to it and what arrives
behind the filter is looked at (JCGM 101), and the filter is applied to it without, which takes away again what it took
away before (as in J. W. Tukey's twicing). So they hold for a median as for a mean, and for steep fringes as for flat
ones. What a single pixel loses beyond its noise counts as it is.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.floating]

DRAWS = 3
"""Drawn noises: with `_LOCAL_PX` squared pixels each, the noise that is left is known to 8 %."""
_TINY = 1e-30  # variance, where nothing is known around a pixel
_LOCAL_PX = 15  # side of the square over which noise that is left is averaged
_BIAS_PX = 5  # the same for what a filter takes away: as wide as a 3 x 3 filter twice
_SURE_SIGMAS = 4.0  # of nine neighbours one is beyond that by noise alone in 2,000: then a pixel's loss is believed


@dataclass(frozen=True)
class FilterEffect:
    """What a filter left of noise and took of form.

    Parameters
    ----------
    noises
        Drawn noises behind the filter, in the unit of the values, (H, W) each.
    bias
        Size of what the filter took away, at least 0, (H, W).
    """

    noises: tuple[Map, ...]
    bias: Map

    def noise_left(self, before: Map) -> Map:
        """Return the standard deviation behind the filter from the one before it, (H, W)."""
        behind = np.mean([_local_mean(noise**2, _LOCAL_PX) for noise in self.noises], axis=0)
        return np.asarray(
            before * np.sqrt(np.maximum(behind, 0.0) / np.maximum(_local_mean(before**2, _LOCAL_PX), _TINY))
        )


def effect_of_filter(
    plain: NDArray[np.floating],
    noises: Sequence[NDArray[np.floating]],
    apply: Callable[[NDArray[np.floating]], NDArray[np.floating]],
    smooth: Callable[[NDArray[np.floating]], NDArray[np.floating]],
    read: Callable[[NDArray[np.floating]], Map] = np.asarray,
    difference: Callable[[Map, Map], Map] = np.subtract,
) -> FilterEffect:
    """Find what a filter does to a picture or to a set of frames.

    Parameters
    ----------
    plain
        What is filtered.
    noises
        Drawn noise to be added to it, of its shape each.
    apply
        The filter.
    smooth
        A 3 x 3 mean of the same.
    read
        From what is filtered to the quantity of interest, (H, W): the phase of frames.
    difference
        Of two of those; modulo a fringe for phases.
    """

    def loss(values: NDArray[np.floating]) -> Map:
        return difference(read(apply(values)), read(values))

    base = smooth(plain)
    behind, lost = read(apply(base)), loss(base)
    noisy = [base + noise for noise in noises]
    sharp = _sure(loss(plain), [loss(values) - lost for values in noisy])
    smoothed = _size_of(lost, [loss(base + smooth(noise)) - lost for noise in noises])
    return FilterEffect(
        tuple(difference(read(apply(values)), behind) for values in noisy),
        np.maximum(sharp, smoothed),
    )


def _size_of(lost: Map, spread: Sequence[Map]) -> Map:
    """Return the size of what was lost without its noise; where a single pixel is sure of more, that of it."""
    around = np.sqrt(np.maximum(np.nan_to_num(_local_mean(lost**2, _BIAS_PX) - _variance(spread)), 0.0))
    return np.maximum(around, _sure(lost, spread))


def _sure(lost: Map, spread: Sequence[Map]) -> Map:
    """Return the largest loss of a pixel and its neighbours where it is beyond its noise, 0 elsewhere."""
    most = cv2.dilate(np.abs(np.nan_to_num(lost)).astype(float), np.ones((3, 3), np.uint8))
    return np.asarray(np.where(most**2 > _SURE_SIGMAS**2 * _variance(spread), most, 0.0))


def _variance(spread: Sequence[Map]) -> Map:
    """Variance of drawn noises around each pixel."""
    return np.asarray(np.mean([_local_mean(noise**2, _LOCAL_PX) for noise in spread], axis=0))


def _local_mean(values: Map, side_px: int) -> Map:
    """Mean over a square of what is finite; NaN where nothing is."""
    known = np.isfinite(values)
    total = cv2.blur(np.where(known, values, 0.0).astype(float), (side_px, side_px), borderType=cv2.BORDER_CONSTANT)
    share = cv2.blur(known.astype(float), (side_px, side_px), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(np.where(share > 0, total / np.maximum(share, 1e-9), np.nan))
