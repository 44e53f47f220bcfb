"""Sub-pixel points along a ruled line: least squares on the pixels of short patches beside the crossings."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt
from numba import njit

from fringecal.detect.grid.line_profile import TABLE_STEP_PX, LineProfile
from fringecal.detect.grid.nodes import Edges
from fringecal.numerics import over_bands

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# Gauss-Newton steps smaller than this, px, are the last ones: while the grid is still being extended, and at the end.
ROUGH_PX, FINE_PX = 0.1, 3e-3
# A patch this long keeps the curvature of a strongly bent line (radius 2000 px) below 0.003 px on average.
PATCH_LENGTH_PX = 9.0
# Patches of the longest edges (108 px): more of them know a crossing no better.
MAX_PATCHES = 12
# Gauss-Newton steps, each of which leaves an error of about its own square.
ITERATIONS = 5
# A patch keeps off the crossing lines by their reach and this, px, but by no more than this part of the edge.
CLEAR_OF_CROSSING_PX, MAX_MARGIN_PART = 0.7, 0.4
# Tables of a line at slants to the pixels, evenly from 0 to 45 deg: half a step changes its height by 1e-3 at most.
SLANTS = 46
# A patch is wider than its line to either side by this, px, and by this part of the line's width: the ground there
# tells the background's slope. It may not reach the next line, but always takes this part of the spacing.
GROUND_PX, GROUND_PART, MIN_ROOM_PART = 2.0, 0.25, 0.5
# The background's slope is distinguished from a shift of the line if the patch holds ground to either side of its
# reach, px.
SLOPE_GROUND_PX = 1.0
# A step is limited to this part of the line's reach and this, px: further off the line's slope points nowhere.
STEP_PART, STEP_PX = 0.5, 1.0
# A line further off the patch's middle than this part of its half width is another one.
MAX_OFFSET_PART = 0.6
# Pixels beyond the number of unknowns that a patch needs.
SPARE_PIXELS = 2
# Lines weaker than this multiple of their own uncertainty are not told from noise.
MIN_SIGNIFICANCE = 5.0
# Residuals of a line: up to this part of its contrast (sharp edges, uneven ink), and this multiple of their typical
# variance.
MAX_RESIDUAL = 0.15
MAX_EXCESS = 9.0
# Against rounding: variance, and slope across rows, instead of a division by 0; part of the diagonal added to normal
# equations; least variance of a patch, grey levels squared.
NO_VARIANCE, NO_SLOPE, RIDGE, MIN_VARIANCE = 1e-12, 1e-12, 1e-9, 1e-6


class LineStatus(IntEnum):
    """Why a point of a line may not be used; OK where it may."""

    OK = 0
    OUTSIDE = 1
    MISSING = 2
    OUTLIER = 3


@dataclass(frozen=True)
class Patches:
    """Where to look for a line: centres, unit directions and half sizes of rectangles, px, edge and line weight."""

    centre: FloatArray
    direction: FloatArray
    half_length: FloatArray
    half_width: FloatArray
    edge: IntArray
    kind: IntArray


@dataclass(frozen=True)
class LinePoints:
    """Points of lines: position and u across, px, contrast (grey levels), status and edge; all (n,)."""

    u_px: FloatArray
    v_px: FloatArray
    sigma_px: FloatArray
    contrast: FloatArray
    status: npt.NDArray[np.int64]
    edge: IntArray


def cut_patches(
    edges: Edges,
    profiles: Sequence[LineProfile],
    kinds: IntArray,
    *,
    most: int = MAX_PATCHES,
    longest_px: float = np.inf,
) -> Patches:
    """Divide edges into patches that keep clear of the crossing lines at their ends.

    Parameters
    ----------
    edges
        Pieces of line between crossings.
    profiles
        Cross-sections of the lines, one for each weight.
    kinds
        Weight of the edge's own line, and of those that cross it at its start and its end, (n, 3).
    most
        Number of patches on the longest edges.
    longest_px
        Length of the longest patches; where they are shorter than the edge's share, pixels are left out.
    """
    reach = np.array([profile.reach_px for profile in profiles])[kinds]
    along = edges.end - edges.start
    length = np.hypot(along[:, 0], along[:, 1])
    margin = np.minimum(reach[:, 1:] + CLEAR_OF_CROSSING_PX, MAX_MARGIN_PART * length[:, None])
    free = length - margin.sum(axis=1)
    count = np.clip(np.round(free / PATCH_LENGTH_PX), 1, most).astype(int)
    edge = np.repeat(np.arange(len(length)), count)
    k = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    t = (margin[edge, 0] + free[edge] * (k + 0.5) / count[edge]) / length[edge]
    room = np.maximum(edges.spacing - reach.max(axis=1), MIN_ROOM_PART * edges.spacing)
    width = np.array([profile.width_px for profile in profiles])[kinds[:, 0]]
    return Patches(
        edges.start[edge] + t[:, None] * along[edge],
        (along / length[:, None])[edge],
        0.5 * np.minimum(free[edge] / count[edge], longest_px),
        np.minimum(reach[:, 0] + GROUND_PX + GROUND_PART * width, room)[edge],
        edge,
        kinds[edge, 0],
    )


def measure_points(
    image: npt.NDArray[np.float32],
    patches: Patches,
    profiles: Sequence[LineProfile],
    sign: int,
    *,
    tolerance_px: float = FINE_PX,
) -> LinePoints:
    """Position of the line in every patch, by least squares on its pixels.

    Parameters
    ----------
    image
        Grey picture, float32, (H, W).
    patches
        Rectangles along the expected lines.
    profiles
        Cross-sections of the lines, one for each weight.
    sign
        -1 for dark lines, +1 for light ones.
    tolerance_px
        A step smaller than this is the last one.

    Notes
    -----
    The model is ``b0 + b1 s + b2 t + A L(s - c)`` with s across and t along the line; it is solved
    for b0, b1, b2, A and c by Gauss-Newton steps, the window moving with c. L is symmetric, so a wrong
    width or blur cannot shift c, and the free background slope keeps shading from doing so.
    """
    far = float(patches.half_width.max(initial=1.0)) + 2.0
    number = table_numbers(patches)
    tables = slant_tables(profiles, far, number)
    reaches = np.repeat([profile.reach_px for profile in profiles], SLANTS)
    measured = np.zeros((len(patches.centre), 6))
    over_bands(
        _measure,
        len(measured),
        image,
        patches.centre,
        patches.direction,
        patches.half_length,
        patches.half_width,
        number,
        (tables, reaches, tolerance_px),
        measured,
    )
    offset, sigma, contrast, sigma_contrast, inside, variance = measured.T
    # The residual variance of one patch rests on few pixels; half of it is taken from all patches.
    pooled = np.sqrt(0.5 * (1 + _typical(variance) / np.maximum(variance, NO_VARIANCE)))
    sigma, sigma_contrast = sigma * pooled, sigma_contrast * pooled
    normal = np.stack([-patches.direction[:, 1], patches.direction[:, 0]], axis=1)
    point = patches.centre + offset[:, None] * normal
    missing = ~np.isfinite(sigma) | (sign * contrast < MIN_SIGNIFICANCE * sigma_contrast)
    missing |= np.abs(offset) > MAX_OFFSET_PART * patches.half_width
    # The edge of a cover or of a shadow resembles a line, but leaves residuals as large as itself.
    missing |= variance > MAX_RESIDUAL**2 * contrast**2 + MAX_EXCESS * _typical(variance)
    status = np.where(inside == 0, LineStatus.OUTSIDE, np.where(missing, LineStatus.MISSING, LineStatus.OK))
    return LinePoints(point[:, 0], point[:, 1], sigma, sign * contrast, status.astype(np.int64), patches.edge)


def slant_tables(profiles: Sequence[LineProfile], far_px: float, number: IntArray) -> FloatArray:
    """Tables (weights x SLANTS, n, 2) of a line's height and slope; those whose number is not asked for are empty."""
    slants = np.sin(np.linspace(0, np.pi / 4, SLANTS))
    asked = {int(n): profiles[n // SLANTS].table(far_px, float(slants[n % SLANTS])).T for n in np.unique(number)}
    length = max((len(table) for table in asked.values()), default=2)
    tables = np.zeros((len(profiles) * SLANTS, length, 2))
    for n, table in asked.items():
        tables[n] = table
    return tables


def table_numbers(patches: Patches) -> IntArray:
    """Number (n,) of every patch's table among those of all weights and slants."""
    angle = np.arctan2(*np.sort(np.abs(patches.direction), axis=1).T)
    return patches.kind * SLANTS + np.rint(angle / (np.pi / 4) * (SLANTS - 1)).astype(np.int64)


def _typical(variance: FloatArray) -> float:
    """Median of the positive residual variances."""
    positive = variance[variance > 0]
    return float(np.median(positive)) if positive.size else 0.0


@njit(cache=True, inline="always")
def clip01(x):  # type: ignore[no-untyped-def] # pragma: no cover
    """Return x between 0 and 1."""
    return min(max(x, 0.0), 1.0)


@njit(cache=True, inline="always")
def span(low, high, offset, step, limit):  # type: ignore[no-untyped-def] # pragma: no cover
    """Narrow (low, high) to the x with abs(offset + x step) < limit."""
    if abs(step) < NO_SLOPE:
        return (low, high) if abs(offset) < limit else (1.0, 0.0)
    one, other = (-limit - offset) / step, (limit - offset) / step
    return max(low, min(one, other)), min(high, max(one, other))


@njit(cache=True)
def _accumulate(image, frame, half, table, normal, right):  # type: ignore[no-untyped-def] # pragma: no cover
    """Sum the normal equations of one patch; returns (sum of weights, weighted sum of squares).

    Each sum is a variable of its own: in registers, they cost a quarter of sums in an array.
    """
    cx, cy, dx, dy = frame
    length, width = half[0] + 0.5, half[1] + 0.5
    reach_u, reach_v = abs(dx) * length + abs(dy) * width, abs(dy) * length + abs(dx) * width
    n11 = nh1 = nhh = nd1 = ndh = ndd = nt1 = nth = ntd = ntt = ns1 = nsh = nsd = nst = nss = 0.0
    r1 = rh = rd = rt = rs = squares = 0.0
    for row in range(int(np.ceil(cy - reach_v)), int(np.floor(cy + reach_v)) + 1):
        y = row - cy
        low, high = span(-reach_u, reach_u, y * dy, dx, length)
        low, high = span(low, high, y * dx, -dy, width)
        for column in range(int(np.ceil(cx + low)), int(np.floor(cx + high)) + 1):
            x = column - cx
            t, s = x * dx + y * dy, y * dx - x * dy
            w = clip01(length - abs(t)) * clip01(width - abs(s))
            place = abs(s) / TABLE_STEP_PX
            k = int(place)
            part = place - k
            h = table[k, 0] + part * (table[k + 1, 0] - table[k, 0])
            d = table[k, 1] + part * (table[k + 1, 1] - table[k, 1])
            d = d if s >= 0 else -d
            value = image[row, column]
            wh, wd, wt, ws, wv = w * h, w * d, w * t, w * s, w * value
            n11, nh1, nd1, nt1, ns1, r1 = n11 + w, nh1 + wh, nd1 + wd, nt1 + wt, ns1 + ws, r1 + wv
            nhh, ndh, nth, nsh, rh = nhh + wh * h, ndh + wh * d, nth + wh * t, nsh + wh * s, rh + wh * value
            ndd, ntd, nsd, rd = ndd + wd * d, ntd + wd * t, nsd + wd * s, rd + wd * value
            ntt, nst, rt = ntt + wt * t, nst + wt * s, rt + wt * value
            nss, rs, squares = nss + ws * s, rs + ws * value, squares + wv * value
    normal[0, 0], normal[1, 0], normal[2, 0], normal[3, 0], normal[4, 0] = n11, nh1, nd1, nt1, ns1
    normal[1, 1], normal[2, 1], normal[3, 1], normal[4, 1] = nhh, ndh, nth, nsh
    normal[2, 2], normal[3, 2], normal[4, 2] = ndd, ntd, nsd
    normal[3, 3], normal[4, 3], normal[4, 4] = ntt, nst, nss
    right[0], right[1], right[2], right[3], right[4] = r1, rh, rd, rt, rs
    for a in range(5):
        for b in range(a):
            normal[b, a] = normal[a, b]
    return n11, squares


@njit(cache=True)
def _invert(matrix, inverse, size):  # type: ignore[no-untyped-def] # pragma: no cover
    """Invert a small positive definite matrix by Gauss-Jordan steps; false if it is singular."""
    inverse[:] = 0.0
    for a in range(size):
        inverse[a, a] = 1.0
    for a in range(size):
        pivot = matrix[a, a]
        if not pivot > 0.0:
            return False
        for b in range(size):
            matrix[a, b] /= pivot
            inverse[a, b] /= pivot
        for c in range(size):
            factor = matrix[c, a]
            if c != a and factor != 0.0:
                for b in range(size):
                    matrix[c, b] -= factor * matrix[a, b]
                    inverse[c, b] -= factor * inverse[a, b]
    return True


@njit(cache=True)
def _solve(normal, right, inverse, solution, size):  # type: ignore[no-untyped-def] # pragma: no cover
    """Solve normal equations; returns the sum of squares they explain, -1 if they are singular."""
    for a in range(size):
        normal[a, a] *= 1.0 + RIDGE
    if not _invert(normal, inverse, size):
        return -1.0
    explained = 0.0
    for a in range(size):
        solution[a] = 0.0
        for b in range(size):
            solution[a] += inverse[a, b] * right[b]
        explained += solution[a] * right[a]
    return explained


@njit(nogil=True, cache=True)
def _measure(first, last, image, centre, direction, half_length, half_width, kind, template, out):  # type: ignore[no-untyped-def] # pragma: no cover
    """Write rows (offset, its u, contrast, its u, 1 if inside the picture, residual variance) of some patches."""
    tables, reaches, tolerance = template
    height, width = image.shape
    for p in range(first, last):
        dx, dy = direction[p, 0], direction[p, 1]
        table, reach = tables[kind[p]], reaches[kind[p]]
        step_limit = STEP_PART * reach + STEP_PX
        half = (half_length[p], half_width[p])
        reach_u = abs(dx) * (half[0] + 0.5) + abs(dy) * (half[1] + 0.5)
        reach_v = abs(dy) * (half[0] + 0.5) + abs(dx) * (half[1] + 0.5)
        normal = np.empty((5, 5))
        inverse = np.empty((5, 5))
        right = np.empty(5)
        solution = np.empty(5)
        size = 5 if half[1] > reach + SLOPE_GROUND_PX else 4
        offset = 0.0
        out[p, 1] = np.inf
        for _ in range(ITERATIONS + 1):
            cx, cy = centre[p, 0] - offset * dy, centre[p, 1] + offset * dx
            if cx - reach_u < 0 or cy - reach_v < 0 or cx + reach_u > width - 1 or cy + reach_v > height - 1:
                break
            out[p, 4] = 1.0
            frame = (cx, cy, dx, dy)
            weights, squares = _accumulate(image, frame, half, table, normal, right)
            if weights < size + SPARE_PIXELS:
                break
            explained = _solve(normal, right, inverse, solution, size)
            contrast = solution[1]
            if explained < 0.0 or contrast == 0.0:
                break
            shift = -solution[2] / contrast
            rest = max(squares - explained, MIN_VARIANCE * weights) / (weights - size)
            out[p, 0] = offset
            out[p, 1] = np.sqrt(rest * inverse[2, 2]) / abs(contrast)
            out[p, 2] = contrast
            out[p, 3] = np.sqrt(rest * inverse[1, 1])
            out[p, 5] = rest
            if abs(shift) < tolerance:
                out[p, 0] = offset + shift
                break
            offset += min(max(shift, -step_limit), step_limit)
            if abs(offset) > half[1]:
                break
