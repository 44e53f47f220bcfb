"""Compiled passes from phase to x, y, z and u(z), one picture row at a time.

Each row works in buffers of its own that fit the cache, and every loop over columns is plain arithmetic without a
branch, so that it runs several pixels at once. `fringecal.numerics.over_bands` spreads the rows over threads. The
equations are those of `fringecal.projector.rig_model`.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from fringecal.numerics import TURN
from fringecal.projector import foot_of_ray

_FAST = {"contract", "nsz"}  # NaN marks masked pixels and must survive
_STRIP = 256  # pixels of a row taken at a time: fourteen buffers of this length stay in a 32 KiB first-level cache
CONTINUED = 1.2
"""Half ranges from the middle of the sampled heights up to which systematic parts are continued: the polynomials of
`sensitivity` say nothing further out, and its edge holds there."""
_ROUNDS = 2  # the residual is smooth: each round gains two to three digits, and float32 has seven


class Rig(NamedTuple):
    """Phase in space as plain arrays.

    `rays` are the coefficients of `RowRays`, `ratio` the seven numbers, `projector` its position in mm, `residual`
    the plate residual's coefficients by powers of both plate coordinates scaled to its `box` (empty: none).
    """

    rays: np.ndarray
    position: np.ndarray
    ratio: np.ndarray
    projector: np.ndarray
    residual: np.ndarray
    box: np.ndarray


class UncertaintyRows(NamedTuple):
    """Uncertainty as plain arrays.

    `rows` holds the systematic variance of z in mm^2 by row, power of the scaled height, power of the position along
    the row; `middle` and `half` (mm) scale the height; `excess` (rad) is added to every pixel's own u(phi); heights
    outside `low` to `high` (mm) get the flag `out_of_range`, those without a ray `no_ray`, without order `undecided`.
    """

    rows: np.ndarray
    middle: float
    half: float
    excess: float
    low: float
    high: float
    flags: np.ndarray


class Maps(NamedTuple):
    """What is written: coordinates and uncertainties in mm, all (H, W), and the reasons, which are added to."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    u_z: np.ndarray
    u_random: np.ndarray
    reasons: np.ndarray


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _polynomial(coefficients, t, out):  # type: ignore[no-untyped-def]
    """Horner's rule over a row."""
    out[:] = coefficients[-1]
    for k in range(coefficients.size - 2, -1, -1):
        c = coefficients[k]
        for j in range(t.size):
            out[j] = out[j] * t[j] + c


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _plate_residual(x, y, rig, work, out):  # type: ignore[no-untyped-def]
    """Horner's rule in both plate coordinates, each clamped to the box."""
    s, t, inner = work[0], work[1], work[2]
    box, powers = rig.box, rig.residual
    sx, sy = 2 / (box[1] - box[0]), 2 / (box[3] - box[2])
    for j in range(x.size):
        s[j] = min(max((x[j] - box[0]) * sx - 1, -1.0), 1.0)
        t[j] = min(max((y[j] - box[2]) * sy - 1, -1.0), 1.0)
    degree = powers.shape[0] - 1
    out[:] = 0.0
    for i in range(degree, -1, -1):
        inner[:] = powers[i, degree - i]
        for k in range(degree - i - 1, -1, -1):
            c = powers[i, k]
            for j in range(x.size):
                inner[j] = inner[j] * t[j] + c
        for j in range(x.size):
            out[j] = out[j] * s[j] + inner[j]


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _plate_phase(rig, ax, ay, work, rho, out):  # type: ignore[no-untyped-def]
    """Phase on the plate, and the residual's share of it."""
    nx, ny, _, n0, dx, dy, _ = rig.ratio
    rho[:] = 0.0
    if rig.residual.size:
        _plate_residual(ax, ay, rig, work, rho)
    for j in range(ax.size):
        out[j] = (nx * ax[j] + ny * ay[j] + n0) / (dx * ax[j] + dy * ay[j] + 1) + rho[j]


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _step_strip(i, first, phase, reasons, rig, buffers, out):  # type: ignore[no-untyped-def]
    """Write the steps of the pixels of row i from column `first` on."""
    ax, ay, rho, plate = buffers[0], buffers[1], buffers[2], buffers[3]
    position = rig.position[first : first + phase.size]
    _polynomial(rig.rays[i, 0], position, ax)
    _polynomial(rig.rays[i, 1], position, ay)
    _plate_phase(rig, ax, ay, buffers[4:], rho, plate)
    for j in range(phase.size):
        step = phase[j] - plate[j]
        step -= TURN * np.rint(step / TURN)
        out[j] = step if reasons[j] == 0 else np.nan


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _step_row(i, phase, reasons, rig, out):  # type: ignore[no-untyped-def]
    buffers = np.zeros((7, _STRIP))
    for first in range(0, phase.size, _STRIP):
        last = min(first + _STRIP, phase.size)
        _step_strip(i, first, phase[first:last], reasons[first:last], rig, buffers, out[first:last])


@njit(nogil=True, cache=True)
def steps_over_plate(first, last, phase, reasons, rig, out):  # type: ignore[no-untyped-def]
    """Write phase minus the plate's in [-pi, pi] in some rows; NaN where the phase has a reason not to be used."""
    for i in range(first, last):
        _step_row(i, phase[i], reasons[i], rig, out[i])


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _heights(rig, rays, phi, buffers, z, slope):  # type: ignore[no-untyped-def]
    """Heights of absolute phases along a row, and dz/dphi; `buffers[0]` starts as the residual at the plate."""
    ax, ay, bx, by = rays[0], rays[1], rays[2], rays[3]
    rho, fx, fy, work = buffers[0], buffers[1], buffers[2], buffers[3:]
    nx, ny, nz, n0, dx, dy, dz = rig.ratio
    lifted = np.isfinite(rig.projector[2])
    rounds = _ROUNDS if rig.residual.size else 0
    for number in range(rounds + 1):
        for j in range(phi.size):
            below, above = dx * ax[j] + dy * ay[j] + 1, nx * ax[j] + ny * ay[j] + n0
            n_slope, d_slope = nx * bx[j] + ny * by[j] + nz, dx * bx[j] + dy * by[j] + dz
            at = phi[j] - rho[j]
            per = 1 / (n_slope - at * d_slope)
            z[j] = (at * below - above) * per
            slope[j] = (below * n_slope - above * d_slope) * per * per
        if number < rounds:
            for j in range(phi.size):
                x, y = ax[j] + bx[j] * z[j], ay[j] + by[j] * z[j]
                foot_x, foot_y = foot_of_ray(x, y, z[j], rig.projector)
                fx[j] = foot_x if lifted else x
                fy[j] = foot_y if lifted else y
            _plate_residual(fx, fy, rig, work, rho)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _variance(rows, t, height, level, out):  # type: ignore[no-untyped-def]
    """Systematic variance along a row: powers of the height, each with its polynomial along the row."""
    out[:] = 0.0
    for power in range(rows.shape[0] - 1, -1, -1):
        _polynomial(rows[power], t, level)
        for j in range(t.size):
            out[j] = out[j] * height[j] + level[j]


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _add_reasons(step, z, uncertainty, why):  # type: ignore[no-untyped-def]
    """Give every pixel without a reason the first that applies; choices without branches, several pixels at once."""
    undecided, no_ray, out_of_range = uncertainty.flags
    none = np.uint8(0)
    for j in range(step.size):
        outside = (z[j] < uncertainty.low) | (z[j] > uncertainty.high)
        reason = out_of_range if outside else none
        reason = reason if abs(z[j]) < np.inf else no_ray
        reason = reason if step[j] == step[j] else undecided
        why[j] = reason if why[j] == none else why[j]


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _random_part(slope, sigma, excess, why, out):  # type: ignore[no-untyped-def]
    """Uncertainty of the height from the pixel's own phase, and from what the fit left."""
    for j in range(slope.size):
        phase = np.sqrt(sigma[j] * sigma[j] + excess)
        random = np.float32(abs(slope[j])) * phase
        out[j] = random if why[j] == 0 else np.float32(np.nan)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _surface_strip(i, first, step, sigma, rig, uncertainty, buffers, maps):  # type: ignore[no-untyped-def]
    """Write the surface of the pixels of row i from column `first` on; `maps` are that strip's."""
    position = rig.position[first : first + step.size]
    rays, rho, work = buffers[:4], buffers[4], buffers[7:10]
    phi = buffers[10, : step.size]
    z, slope, variance = buffers[11], buffers[12, : step.size], buffers[13]
    for k in range(4):
        _polynomial(rig.rays[i, k], position, rays[k])
    _plate_phase(rig, rays[0], rays[1], work, rho, phi)
    for j in range(step.size):
        phi[j] += step[j]
    _heights(rig, rays, phi, buffers[4:10], z, slope)
    height, level = phi, rho
    for j in range(step.size):
        height[j] = min(max((z[j] - uncertainty.middle) / uncertainty.half, -CONTINUED), CONTINUED)
    _variance(uncertainty.rows[i], position, height, level, variance)
    x, y, z_out, u_z, u_random, why = maps
    _add_reasons(step, z, uncertainty, why)
    _random_part(slope, sigma, np.float32(uncertainty.excess * uncertainty.excess), why, u_random)
    for j in range(step.size):
        here = z[j] if why[j] == 0 else np.nan
        x[j] = rays[0, j] + rays[2, j] * here
        y[j] = rays[1, j] + rays[3, j] * here
        z_out[j] = here
        u_z[j] = np.sqrt(u_random[j] * u_random[j] + np.float32(max(variance[j], 0.0)))


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _surface_row(i, step, sigma, rig, uncertainty, maps):  # type: ignore[no-untyped-def]
    buffers = np.zeros((14, _STRIP))
    x, y, z, u_z, u_random, why = maps
    for first in range(0, step.size, _STRIP):
        last = min(first + _STRIP, step.size)
        part = (
            x[i, first:last],
            y[i, first:last],
            z[i, first:last],
            u_z[i, first:last],
            u_random[i, first:last],
            why[i, first:last],
        )
        _surface_strip(i, first, step[first:last], sigma[first:last], rig, uncertainty, buffers, part)


@njit(nogil=True, cache=True)
def surface_rows(first, last, step, sigma, rig, uncertainty, maps):  # type: ignore[no-untyped-def]
    """Write the surface of absolute phase differences to the plate, row by row from `first` on."""
    for i in range(first, last):
        _surface_row(i, step[i], sigma[i], rig, uncertainty, maps)
