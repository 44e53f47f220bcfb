"""Width and blur of the lines from the raw pixels of all patches at once, and what their doubt does to every point."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numba import njit

from fringecal.detect.grid.line_points import (
    NO_VARIANCE,
    RIDGE,
    SLOPE_GROUND_PX,
    Patches,
    clip01,
    slant_tables,
    span,
    table_numbers,
)
from fringecal.detect.grid.line_profile import TABLE_STEP_PX, LineProfile
from fringecal.numerics import over_bands

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Patches that the profile is fitted to: their 100,000 pixels know it far better than a crossing asks.
MOST_PATCHES = 2_000
# Rounds of the fit; the last one is that which changes width and blur by less than this part, or by less than this
# share of their standard uncertainties.
ROUNDS, CONVERGED, CONVERGED_U = 15, 1e-3, 0.1
# Shifts by one standard uncertainty of width and blur that are none, px: a hundredth of what a crossing is known to.
NO_SHIFT_PX = 2e-5
# Largest change of a logarithm in one round: beyond, first derivatives say nothing.
MOST_CHANGE = 0.5
# Step of derivatives by the logarithms of width and blur: their error is a part of 1e-5.
LOG_STEP = 5e-3
# Width and blur that are fitted, px: narrower lines and sharper edges than a pixel's own are not seen.
LEAST_PX, MOST_PX = (0.3, 0.05), (200.0, 60.0)
# What is known beforehand, as standard deviations of logarithms about a middle. Blur: a lens at f/2.8 to f/16 on
# pixels of 2 to 6 um spreads light by 0.25 to 1 px (0.42 wavelengths times the f-number, J. Goodman, Introduction to
# Fourier Optics, 4.4.2). Width: rulings are a thirtieth to an eighth of their spacing. Both within a factor of two.
BLUR_MIDDLE_PX, WIDTH_PART, LOG_U = 0.5, 1 / 15, float(np.log(2.0))
# A patch whose residual variance is above so many usual ones shows more than a line.
MOST_EXCESS = 4.0
# Columns of a patch's normal equations: ground, height, slope, turn, tilt along and across, two of the profile, grey.
# The turn is left free here, for a patch runs from crossing to crossing as the last round had them.
COLUMNS = 9
PROFILE, GREY = 6, 8
# Pixels beyond the unknowns that a patch needs.
SPARE = 3
# Places of what a patch tells: information of width and blur (3), pull on them (2), shift, its slopes (2), variance.
FACTS = 9
_FIELDS = tuple(Patches.__dataclass_fields__)


@dataclass(frozen=True)
class ProfileFit:
    """Cross-sections, one for each weight, and the covariance (weights, 2, 2) of the logarithms of width and blur.

    `matters` tells whether this doubt moves any line.
    """

    profiles: tuple[LineProfile, ...]
    covariance: FloatArray
    matters: bool = True

    @property
    def modes(self) -> FloatArray:
        """Independent changes (weights, 2, 2) of both logarithms, of one standard uncertainty each, in rows."""
        return _modes(self.covariance)


def fit_to_pixels(
    image: npt.NDArray[np.float32], patches: Patches, profiles: Sequence[LineProfile], spacing_px: float
) -> ProfileFit:
    """Fit width and blur to the pixels of many patches, each with a line's place, contrast and ground of its own.

    Parameters
    ----------
    image
        Grey picture, float32, (H, W).
    patches
        Rectangles whose middles lie on the lines, px.
    profiles
        Where to start, one for each weight.
    spacing_px
        Distance of the lines, of which their width is a part.

    Notes
    -----
    Gauss-Newton steps on all unknowns at once; a patch's own six are eliminated from its normal equations, so that
    only 2 x 2 equations are summed. What the pixels leave open, as where all lines meet the raster at one phase, is
    held by what is known beforehand (`LOG_U`), and stands in the covariance.
    """
    middle = np.log([WIDTH_PART * spacing_px, BLUR_MIDDLE_PX])
    values = np.log([[p.width_px, p.blur_px] for p in profiles])
    covariance = np.zeros((len(profiles), 2, 2))
    for _ in range(ROUNDS):
        current = _profiles(values)
        facts = patch_facts(image, patches, current)
        step, covariance = _solved(facts, patches.kind, values - middle, len(profiles))
        step = np.clip(step, -MOST_CHANGE, MOST_CHANGE)
        values = np.clip(values + step, np.log(LEAST_PX), np.log(MOST_PX))
        patches = _moved(patches, facts, step)
        u = np.sqrt(np.einsum("kii->ki", covariance))
        if (np.abs(step) < np.maximum(CONVERGED, CONVERGED_U * u)).all():
            break
    shifts = np.einsum("nab,nb->na", _modes(covariance)[patches.kind], np.nan_to_num(facts[:, 6:8]))
    return ProfileFit(_profiles(values), covariance, bool(np.abs(shifts).max(initial=0.0) > NO_SHIFT_PX))


def _modes(covariance: FloatArray) -> FloatArray:
    """Rows of changes by one standard uncertainty each, of covariances (weights, 2, 2)."""
    return np.swapaxes(np.linalg.cholesky(covariance), 1, 2)


def joined(parts: Sequence[Patches]) -> Patches:
    """Patches of several families as one."""
    return Patches(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))


def some_patches(patches: Patches) -> Patches:
    """Pick evenly from more patches than a profile needs."""
    pick = np.unique(np.linspace(0, len(patches.centre) - 1, min(MOST_PATCHES, len(patches.centre))).astype(int))
    return chosen(patches, pick)


def chosen(patches: Patches, pick: IntArray | BoolArray) -> Patches:
    """Only some of the patches."""
    return Patches(*(getattr(patches, name)[pick] for name in _FIELDS))


def _profiles(values: FloatArray) -> tuple[LineProfile, ...]:
    """Profiles of logarithms of width and blur (weights, 2)."""
    return tuple(LineProfile(*map(float, row)) for row in np.exp(values))


def _moved(patches: Patches, facts: FloatArray, step: FloatArray) -> Patches:
    """Patches at the places of the lines after a step of width and blur."""
    offset = np.nan_to_num(facts[:, 5] + (facts[:, 6:8] * step[patches.kind]).sum(axis=1))
    offset = np.clip(offset, -MOST_CHANGE, MOST_CHANGE)
    normal = np.stack([-patches.direction[:, 1], patches.direction[:, 0]], axis=1)
    return replace(patches, centre=patches.centre + offset[:, None] * normal)


def _solved(facts: FloatArray, kind: IntArray, off: FloatArray, weights: int) -> tuple[FloatArray, FloatArray]:
    """Step (weights, 2) of the logarithms, and their covariance; `off` is how far they are from the middle."""
    known = np.isfinite(facts[:, 8])
    usual = max(float(np.median(facts[known, 8])) if known.any() else 0.0, NO_VARIANCE)
    known &= facts[:, 8] < MOST_EXCESS * usual
    sums = np.stack([facts[known & (kind == k), :5].sum(axis=0) / usual for k in range(weights)])
    information = sums[:, [0, 1, 1, 2]].reshape(-1, 2, 2) + np.eye(2) / LOG_U**2
    pull = sums[:, 3:5] - off / LOG_U**2
    covariance = np.linalg.inv(information)
    return np.einsum("kab,kb->ka", covariance, pull), covariance


def patch_facts(image: npt.NDArray[np.float32], patches: Patches, profiles: Sequence[LineProfile]) -> FloatArray:
    """What every patch tells of the profile, and what the profile does to its place, (n, FACTS).

    Returns
    -------
    FloatArray
        Information (ww, wb, bb) and pull (w, b) of the logarithms of width and blur, grey levels squared; shift of
        the line, px; its slopes by both logarithms, px; residual variance; NaN where the patch leaves the picture.
    """
    far = float(patches.half_width.max(initial=1.0)) + 2.0
    number = table_numbers(patches)
    reach = np.array([profile.reach_px for profile in profiles])[patches.kind]
    size = np.where(patches.half_width > reach + SLOPE_GROUND_PX, PROFILE, PROFILE - 1)
    facts = np.full((len(patches.centre), FACTS), np.nan)
    over_bands(
        _facts_kernel,
        len(facts),
        image,
        patches.centre,
        patches.direction,
        np.stack([patches.half_length, patches.half_width], axis=1),
        number,
        size,
        _tables(profiles, far, number),
        facts,
    )
    return facts


def _tables(profiles: Sequence[LineProfile], far_px: float, number: IntArray) -> FloatArray:
    """Tables (weights x slants, n, 4) of height, slope, and the height's derivatives by the logarithms."""
    columns = [slant_tables(profiles, far_px, number)]
    for change in ((LOG_STEP, 0.0), (0.0, LOG_STEP)):
        up, down = (
            slant_tables([_scaled(profile, way * np.array(change)) for profile in profiles], far_px, number)
            for way in (1, -1)
        )
        columns.append((up - down)[..., :1] / (2 * LOG_STEP))
    return np.concatenate(columns, axis=2)


def _scaled(profile: LineProfile, change: FloatArray) -> LineProfile:
    """Profile with the logarithms of width and blur changed."""
    width, blur = np.exp(change) * (profile.width_px, profile.blur_px)
    return LineProfile(float(width), float(blur))


@njit(cache=True)
def _gram(image, frame, half, table, sums):  # type: ignore[no-untyped-def] # pragma: no cover
    """Sum the products of all columns of one patch, upper triangle first; returns the sum of weights."""
    cx, cy, dx, dy = frame
    length, width = half[0] + 0.5, half[1] + 0.5
    reach_u, reach_v = abs(dx) * length + abs(dy) * width, abs(dy) * length + abs(dx) * width
    column_values = np.empty(COLUMNS)
    sums[:] = 0.0
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
            slope = table[k, 1] + part * (table[k + 1, 1] - table[k, 1])
            slope = slope if s >= 0 else -slope
            column_values[0], column_values[1] = 1.0, table[k, 0] + part * (table[k + 1, 0] - table[k, 0])
            column_values[2], column_values[3], column_values[4], column_values[5] = slope, slope * t, t, s
            for c in (0, 1):
                column_values[PROFILE + c] = table[k, 2 + c] + part * (table[k + 1, 2 + c] - table[k, 2 + c])
            column_values[GREY] = image[row, column]
            for a in range(COLUMNS):
                product = w * column_values[a]
                for b in range(a, COLUMNS):
                    sums[a, b] += product * column_values[b]
    for a in range(COLUMNS):
        for b in range(a):
            sums[a, b] = sums[b, a]
    return sums[0, 0]


@njit(cache=True)
def _eliminate(sums, size):  # type: ignore[no-untyped-def] # pragma: no cover
    """Gauss-Jordan steps on the first columns: right of them their solutions, below what is left; false if singular."""
    for a in range(size):
        pivot = sums[a, a] * (1.0 + RIDGE)
        if not pivot > 0.0:
            return False
        for b in range(COLUMNS):
            sums[a, b] /= pivot
        for c in range(COLUMNS):
            factor = sums[c, a]
            if c != a and factor != 0.0:
                for b in range(COLUMNS):
                    sums[c, b] -= factor * sums[a, b]
    return True


@njit(nogil=True, cache=True)
def _facts_kernel(first, last, image, centre, direction, half, number, size, tables, facts):  # type: ignore[no-untyped-def] # pragma: no cover
    """Write the facts of some patches."""
    height, width = image.shape
    sums = np.empty((COLUMNS, COLUMNS))
    for p in range(first, last):
        dx, dy = direction[p, 0], direction[p, 1]
        cx, cy = centre[p, 0], centre[p, 1]
        reach_u = abs(dx) * (half[p, 0] + 0.5) + abs(dy) * (half[p, 1] + 0.5)
        reach_v = abs(dy) * (half[p, 0] + 0.5) + abs(dx) * (half[p, 1] + 0.5)
        if not (cx >= reach_u and cy >= reach_v and cx + reach_u <= width - 1 and cy + reach_v <= height - 1):
            continue
        pixels = _gram(image, (cx, cy, dx, dy), half[p], tables[number[p]], sums)
        if pixels < size[p] + SPARE or not _eliminate(sums, size[p]):
            continue
        contrast = sums[1, GREY]
        if contrast == 0.0:
            continue
        w, b = PROFILE, PROFILE + 1
        facts[p, 0], facts[p, 1], facts[p, 2] = sums[w, w], sums[w, b], sums[b, b]
        facts[p, 3], facts[p, 4] = sums[w, GREY], sums[b, GREY]
        for n in range(3):
            facts[p, n] *= contrast**2
        for n in (3, 4):
            facts[p, n] *= contrast
        facts[p, 5] = -sums[2, GREY] / contrast
        facts[p, 6], facts[p, 7] = sums[2, w], sums[2, b]
        facts[p, 8] = max(sums[GREY, GREY], 0.0) / (pixels - size[p])
