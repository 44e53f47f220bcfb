"""Compiled passes from the projector's coordinates to x, y, z and their u, one picture row at a time.

A ray's points lie on a straight line in the projector's ideal picture, y = b + m x; x is found on it by Newton's method
through the projector's distortion, and the depth follows from x. Buffers and threads as in `height_kernels`.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

_FAST = {"contract", "nsz"}  # NaN marks masked pixels and must survive
_STRIP = 256  # pixels of a row taken at a time, at most: buffers of this length stay near the processor
_STRIPS = 16  # of a row, at least: over a sixteenth of the picture a variance is a parabola to some per mille
_LEAST_STRIP = 16
_BUFFERS = 14
_ROUNDS = 3  # of Newton's method: a distortion of some per cent leaves 1e-2, 1e-4, 1e-8 of the coordinate
CONTINUED = 1.1
"""Half ranges from the middle of the sampled depths up to which the systematic part is continued."""


class VolumeRig(NamedTuple):
    """A rig as plain arrays.

    `rays` (H, 2, degree + 1) are coefficients of the rays' slopes along each row, at `position` (W,) from -1 to 1;
    `rotation`, `shift` and `projector` lead to the projector's frame and through its lens (`LENS_NAMES`).
    """

    rays: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    shift: np.ndarray
    projector: np.ndarray


class VolumeUncertainty(NamedTuple):
    """Uncertainty and limits as plain arrays.

    `rows` (3, H, powers of the scaled depth, powers of the position) is the systematic variance of x, y and z, mm^2;
    `middle` and `half` scale the depth, mm; `most` is the largest systematic variance of a point inside, mm^2; `u_px`
    (2,) the coordinates' own u, `epipolar_px` the largest distance across the epipolar line; `flags` (4,) the reasons
    for no phase, an order that contradicts the other axis, no ray, and outside the volume.
    """

    rows: np.ndarray
    middle: float
    half: float
    most: float
    u_px: np.ndarray
    epipolar_px: float
    flags: np.ndarray


class VolumeMaps(NamedTuple):
    """What is written: coordinates and their u in mm, all (H, W), and the reasons."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    u_x: np.ndarray
    u_y: np.ndarray
    u_z: np.ndarray
    reasons: np.ndarray


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _along_row(coefficients, first, t, out, count):  # type: ignore[no-untyped-def]
    """Horner's rule over a strip."""
    last = coefficients.size - 1
    for j in range(count):
        out[j] = coefficients[last]
    for k in range(last - 1, -1, -1):
        c = coefficients[k]
        for j in range(count):
            out[j] = out[j] * t[first + j] + c


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _epipolar_lines(rig, work, count):  # type: ignore[no-untyped-def]
    """From rays (0, 1) to their first and third direction in the projector (2, 3), line's m and b (4, 5), and q (6)."""
    r, t = rig.rotation, rig.shift
    for j in range(count):
        dx, dy = work[0, j], work[1, j]
        a1 = r[0, 0] * dx + r[0, 1] * dy + r[0, 2]
        a2 = r[1, 0] * dx + r[1, 1] * dy + r[1, 2]
        a3 = r[2, 0] * dx + r[2, 1] * dy + r[2, 2]
        q = a1 * t[2] - a3 * t[0]
        m = (a2 * t[2] - a3 * t[1]) / q
        work[2, j], work[3, j], work[4, j], work[6, j] = a1, a3, m, q
        work[5, j] = (a2 - m * a1) / a3


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _place_by_one(first, place, lens, work, count):  # type: ignore[no-untyped-def]
    """Ideal x (7) of one coordinate by Newton's method, and the coordinate's slope by x in px (8)."""
    k1, k2, p1, p2, k3 = lens[4], lens[5], lens[6], lens[7], lens[8]
    fx, cx = lens[0], lens[2]
    for j in range(count):
        m, b = work[4, j], work[5, j]
        seen = (place[first + j] - cx) / fx
        x = seen
        slope = 1.0
        for _ in range(_ROUNDS):
            y = b + m * x
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            rise = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
            bent = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
            slope = radial + x * x * rise + 2 * p1 * y + 6 * p2 * x + m * (x * y * rise + 2 * p1 * x + 2 * p2 * y)
            x += (seen - bent) / slope
        work[7, j], work[8, j] = x, slope * fx


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _place_by_two(first, places, lens, u_px, work, count):  # type: ignore[no-untyped-def]
    """The same by both coordinates, weighted; the slope (8) over their joint u, the distance across the line (9)."""
    k1, k2, p1, p2, k3 = lens[4], lens[5], lens[6], lens[7], lens[8]
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    wu, wv = 1 / (u_px[0] * u_px[0]), 1 / (u_px[1] * u_px[1])
    for j in range(count):
        m, b = work[4, j], work[5, j]
        x = (places[0][first + j] - cx) / fx
        total, along_u, along_v, rest_u, rest_v = 1.0, 1.0, 0.0, 0.0, 0.0
        for _ in range(_ROUNDS):
            y = b + m * x
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            rise = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
            cross = x * y * rise + 2 * p1 * x + 2 * p2 * y
            along_u = fx * (radial + x * x * rise + 2 * p1 * y + 6 * p2 * x + m * cross)
            along_v = fy * (cross + m * (radial + y * y * rise + 6 * p1 * y + 2 * p2 * x))
            rest_u = places[0][first + j] - cx - fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x))
            rest_v = places[1][first + j] - cy - fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)
            total = wu * along_u * along_u + wv * along_v * along_v
            x += (wu * along_u * rest_u + wv * along_v * rest_v) / total
        work[7, j], work[8, j] = x, np.sqrt(total) * u_px[0]
        work[9, j] = (along_u * rest_v - along_v * rest_u) / np.sqrt(along_u * along_u + along_v * along_v)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _depths(rig, u_px, work, count):  # type: ignore[no-untyped-def]
    """Depth (10) and its random u (11) from the ideal x."""
    t1, t3 = rig.shift[0], rig.shift[2]
    for j in range(count):
        x = work[7, j]
        below = x * work[3, j] - work[2, j]
        work[10, j] = (t1 - x * t3) / below
        work[11, j] = abs(work[6, j] / (below * below * work[8, j])) * u_px


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _at(coefficients, t):  # type: ignore[no-untyped-def]
    """Horner's rule at one place."""
    value = coefficients[-1]
    for k in range(coefficients.size - 2, -1, -1):
        value = value * t + coefficients[k]
    return value


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _variance(coefficients, first, t, work, count):  # type: ignore[no-untyped-def]
    """Systematic variance (13) along a strip by powers of the scaled depth (7).

    Of each power a parabola through both ends and the middle of the strip stands for its polynomial along the row.
    """
    half = max(0.5 * (count - 1), 0.5)
    for j in range(count):
        work[13, j] = 0.0
    for power in range(coefficients.shape[0] - 1, -1, -1):
        start, end = _at(coefficients[power], t[first]), _at(coefficients[power], t[first + count - 1])
        middle = _at(coefficients[power], 0.5 * (t[first] + t[first + count - 1]))
        slope, bend = 0.5 * (end - start), 0.5 * (end + start) - middle
        for j in range(count):
            s = (j - half) / half
            work[13, j] = work[13, j] * work[7, j] + (middle + s * (slope + s * bend))


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _write_axis(axis, i, first, rig, uncertainty, maps, work, count):  # type: ignore[no-untyped-def]
    """Write one coordinate and its u; add its systematic variance to the total (9)."""
    out, u_out = (maps.x, maps.u_x) if axis == 0 else (maps.y, maps.u_y) if axis == 1 else (maps.z, maps.u_z)
    _variance(uncertainty.rows[axis, i], first, rig.position, work, count)
    for j in range(count):
        ray = work[axis, j] if axis < 2 else 1.0
        systematic = max(work[13, j], 0.0)
        random = ray * work[11, j]
        work[9, j] += systematic
        out[i, first + j] = ray * work[10, j]
        u_out[i, first + j] = np.sqrt(systematic + random * random)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _mask(i, first, places, uncertainty, maps, work, count):  # type: ignore[no-untyped-def]
    """Give every pixel that has no point its reason, and NaN for its numbers; `work` (8) holds the contradictions."""
    no_phase, contradicts, no_ray, outside = uncertainty.flags
    for j in range(count):
        n, z = first + j, work[10, j]
        off = abs(z - uncertainty.middle) > CONTINUED * uncertainty.half
        reason = outside if off or work[9, j] > uncertainty.most else np.uint8(0)
        reason = reason if z > 0 and z < np.inf else no_ray
        reason = contradicts if work[8, j] > uncertainty.epipolar_px else reason
        for place in places:
            reason = reason if place[n] == place[n] else no_phase
        maps.reasons[i, n] = reason
        if reason != 0:
            maps.x[i, n] = maps.y[i, n] = maps.z[i, n] = np.nan
            maps.u_x[i, n] = maps.u_y[i, n] = maps.u_z[i, n] = np.nan


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _strip(i, first, count, places, rig, uncertainty, maps, work):  # type: ignore[no-untyped-def]
    _along_row(rig.rays[i, 0], first, rig.position, work[0], count)
    _along_row(rig.rays[i, 1], first, rig.position, work[1], count)
    _epipolar_lines(rig, work, count)
    if len(places) == 2:
        _place_by_two(first, places, rig.projector, uncertainty.u_px, work, count)
    else:
        _place_by_one(first, places[0], rig.projector, work, count)
        for j in range(count):
            work[9, j] = 0.0
    _depths(rig, uncertainty.u_px[0], work, count)
    for j in range(count):
        work[8, j], work[9, j] = abs(work[9, j]), 0.0
        scaled = (work[10, j] - uncertainty.middle) / uncertainty.half
        work[7, j] = min(max(scaled, -CONTINUED), CONTINUED)
    for axis in range(3):
        _write_axis(axis, i, first, rig, uncertainty, maps, work, count)
    _mask(i, first, places, uncertainty, maps, work, count)


@njit(nogil=True, cache=True)
def points_in_rows(first, last, places, rig, uncertainty, maps):  # type: ignore[no-untyped-def]
    """Write the points of some rows; `places` holds one or both coordinates of the projector, px, (H, W)."""
    work = np.zeros((_BUFFERS, _STRIP))
    width = places[0].shape[1]
    strip = max(_LEAST_STRIP, min(_STRIP, width // _STRIPS))
    for i in range(first, last):
        for start in range(0, width, strip):
            row = (places[0][i],) if len(places) == 1 else (places[0][i], places[1][i])
            _strip(i, start, min(strip, width - start), row, rig, uncertainty, maps, work)
