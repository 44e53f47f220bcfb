"""Parts of one smooth region that a faint outline or a neck sets apart: tops whole fringes above what they cover.

From pixel to pixel such a top looks like the plate. But windows beside each other average noise away: its outline
shows as a break of the phase, of nearly whole fringes, or of the light. And where the jump over an edge passes through
whole fringes, two surfaces hang together by a neck. What an outline encloses, or a neck ties, becomes a region of its
own, and hangs on the rest only by borders along which both sides meet.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import over_bands, robust_sd
from fringecal.phase import Regions

Image = NDArray[np.float32]
Mask = NDArray[np.uint8]


@dataclass(frozen=True)
class OutlineRules:
    """How windows beside each other are compared.

    Parameters
    ----------
    ahead_px, gap_px, beside_px
        Length of the windows on either side, their distance from the edge, which blur mixes, and half their breadth.
    near_px, near_share
        Length of shorter windows, and the share of a break that they must show: an edge is as high to them, and what a
        surface curved in the third order shows grows with the windows.
    phase_sigmas, light_sigmas
        Break that counts, in its standard deviations: of the phase by its noise; of the light by how much it varies
        over the picture, texture and all.
    least_rad
        The same of the phase at least, a hundredth of a fringe: less may be curvature of the third order.
    least_light
        The same of the light at least, as a share of it.
    fold_px
        Break that a fold may show per change of slope, for it may lie so far beside the middle.
    neck_px
        Side of the square that a surface must hold where it goes on: over a narrower neck two surfaces hang together
        where their jump passes through whole fringes.
    part_px
        Least pixels of a part at which such a square fits.
    rows
        Rows of the picture to which a larger one is reduced by whole factors.
    """

    ahead_px: int = 8
    near_px: int = 4
    near_share: float = 0.5
    gap_px: int = 2
    beside_px: int = 4
    phase_sigmas: float = 6.0
    light_sigmas: float = 8.0
    least_rad: float = 0.06
    least_light: float = 0.02
    fold_px: float = 3.0
    neck_px: int = 9
    part_px: int = 250
    rows: int = 700


OUTLINE_RULES = OutlineRules()


def outlined_parts(
    regions: Regions, background: NDArray[np.floating], sigma_rad: float, rules: OutlineRules = OUTLINE_RULES
) -> Regions:
    """Return regions of which parts that an outline sets apart have numbers of their own, above those of `regions`.

    Parameters
    ----------
    regions
        Smooth regions.
    background
        Mean of the frames, grey levels, (H, W).
    sigma_rad
        Random standard uncertainty of a pixel's phase, rad.
    rules
        What counts as an outline.
    """
    factor = max(1, round(regions.cores.shape[0] / rules.rows))
    labels, step = _reduced_regions(regions, factor)
    light = np.log(np.maximum(_reduced(background, factor), 1.0))
    outline = _breaks(step, light, labels, sigma_rad / factor, rules)
    parts, changed = _parts(labels, outline, regions.number, rules)
    if not changed.any():
        return regions
    filled = _filled(labels, parts, changed, rules)
    return regions.with_cores(
        _enlarged(regions.cores, labels, filled, changed), np.zeros(regions.cores.shape, np.bool_)
    )


def _reduced(image: NDArray[np.floating], factor: int) -> Image:
    """Average squares of pixels."""
    single = np.asarray(image, np.float32)
    if factor == 1:
        return single
    size = single.shape[1] // factor, single.shape[0] // factor
    return np.asarray(
        cv2.resize(single[: size[1] * factor, : size[0] * factor], size, interpolation=cv2.INTER_AREA), np.float32
    )


def _reduced_regions(regions: Regions, factor: int) -> tuple[NDArray[np.int32], Image]:
    """Number of the region that fills a whole square of pixels, and the mean step there; 0 elsewhere."""
    shape = regions.cores.shape[0] // factor, regions.cores.shape[1] // factor
    labels, step = np.zeros(shape, np.int32), np.zeros(shape, np.float32)
    over_bands(_fill_squares, shape[0], regions.cores, regions.values, factor, labels, step)
    return labels, step


@njit(nogil=True, cache=True)
def _fill_squares(first, last, cores, values, factor, labels, step):  # type: ignore[no-untyped-def]
    """Write the squares of some rows."""
    for i in range(first, last):
        for j in range(labels.shape[1]):
            label, total = cores[i * factor, j * factor], 0.0
            for v in range(i * factor, (i + 1) * factor):
                for u in range(j * factor, (j + 1) * factor):
                    if cores[v, u] != label:
                        label = 0
                    total += values[v, u]
            if label > 0:
                labels[i, j], step[i, j] = label, total / factor**2


def _windows(ahead_px: int, rules: OutlineRules) -> tuple[Image, Image]:
    """Weights along a row that continue straight lines from both sides to the middle and subtract; and their slopes."""
    at = np.arange(1, ahead_px + 1) + rules.gap_px
    value, slope = np.linalg.pinv(np.column_stack([np.ones(at.size), at]))
    gap = np.zeros(2 * rules.gap_px + 1)
    # To the left, the slope away from the middle counts negative.
    value = np.concatenate([-value[::-1], gap, value])
    slope = np.concatenate([slope[::-1], gap, slope])
    return value.astype(np.float32), slope.astype(np.float32)


def _breaks(step: Image, light: Image, labels: NDArray[np.int32], sigma_rad: float, rules: OutlineRules) -> Mask:
    """Mark outlines, 1, along rows and columns: breaks of the step over the plate, or of the logarithm of the light."""
    found = np.zeros(labels.shape, np.uint8)
    mean = np.full(2 * rules.beside_px + 1, 1 / (2 * rules.beside_px + 1), np.float32)
    single = labels.astype(np.float32)
    for along in (True, False):
        weights = *_windows(rules.ahead_px, rules), _windows(rules.near_px, rules)[0]
        value, slope, near = ((w, mean) if along else (mean, w) for w in weights)
        whole = _within_one(single, (value[0].size, value[1].size))
        noise = rules.phase_sigmas * sigma_rad * float(np.linalg.norm(value[0]) * np.linalg.norm(value[1]))
        folded = rules.fold_px * np.abs(cv2.sepFilter2D(step, -1, *slope))
        jump = np.abs(cv2.sepFilter2D(step, -1, *value))
        broken = jump > folded + max(noise, rules.least_rad)
        broken &= np.abs(cv2.sepFilter2D(step, -1, *near)) > rules.near_share * jump
        change = np.abs(cv2.sepFilter2D(light, -1, *value))
        spread = robust_sd(change[whole], about=0) if whole.any() else 0.0
        broken |= change > max(rules.light_sigmas * spread, rules.least_light)
        found |= (broken & whole).astype(np.uint8)
    return np.asarray(cv2.dilate(found, np.ones((2 * rules.beside_px + 3,) * 2, np.uint8)), np.uint8)


def _within_one(labels: Image, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Where a window of so many columns and rows lies within one region."""
    window = np.ones(size[::-1], np.uint8)
    least = cv2.erode(labels, window, borderType=cv2.BORDER_CONSTANT, borderValue=(0.0,))
    return np.asarray((least > 0) & (least == cv2.dilate(labels, window)))


def _parts(
    labels: NDArray[np.int32], outline: Mask, number: int, rules: OutlineRules
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Number what outlines leave of the regions; the largest part keeps its region's number. And which fell apart."""
    neck = np.ones((rules.neck_px, rules.neck_px), np.uint8)
    free = ((labels > 0) & (outline == 0)).astype(np.uint8)
    open_ = cv2.erode(free, neck, borderType=cv2.BORDER_CONSTANT, borderValue=(1.0,))
    count, parts, stats, _ = cv2.connectedComponentsWithStats(open_, connectivity=4)
    sizes = stats[:, cv2.CC_STAT_AREA]
    region = np.zeros(count, np.int64)
    region[parts.ravel()] = labels.ravel()
    large = np.flatnonzero((sizes >= rules.part_px) & (np.arange(count) > 0))
    changed = np.bincount(region[large], minlength=number + 1) > 1
    changed[0] = False
    numbers = np.zeros(count, np.int32)
    large = large[changed[region[large]]]
    first = large[np.lexsort((large, -sizes[large], region[large]))]
    keeps = np.zeros(count, np.bool_)
    keeps[first[np.unique(region[first], return_index=True)[1]]] = True
    numbers[large[keeps[large]]] = region[large[keeps[large]]]
    others = large[~keeps[large]]
    numbers[others] = number + 1 + np.arange(others.size)
    return numbers[parts], changed


def _filled(
    labels: NDArray[np.int32], parts: NDArray[np.int32], changed: NDArray[np.bool_], rules: OutlineRules
) -> NDArray[np.int32]:
    """Give what is left between parts, outlines and crumbs, to the nearest, but for a strip between two of them."""
    _, nearest = cv2.distanceTransformWithLabels(
        (parts == 0).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_CCOMP
    )
    number = np.zeros(int(nearest.max()) + 1, np.int32)
    number[nearest[parts > 0]] = parts[parts > 0]
    whole = number[nearest]
    inner = _within_one(whole.astype(np.float32), (2 * rules.beside_px + 3,) * 2)
    return np.asarray(np.where(parts > 0, parts, np.where(inner & changed[labels], whole, 0)), np.int32)


def _enlarged(
    cores: NDArray[np.int32], labels: NDArray[np.int32], parts: NDArray[np.int32], changed: NDArray[np.bool_]
) -> NDArray[np.int32]:
    """Give the smooth pixels of changed regions the number of their part, 0 on an outline and beside other regions."""
    size = cores.shape[::-1]
    filling, part = labels, parts
    if labels.shape != cores.shape:
        filling, part = (cv2.resize(m, size, interpolation=cv2.INTER_NEAREST) for m in (labels, parts))
    return np.asarray(np.where(changed[cores], np.where(filling == cores, part, 0), cores), np.int32)
