"""Compiled loops over pixels: the plate residual and the height where a ray meets its phase."""

import numpy as np
from numba import njit


@njit(inline="always")
def foot_of_ray(x, y, z, projector):  # type: ignore[no-untyped-def]
    """Where the ray from a projector at a finite place through a point ends on the plate: x and y, in the units given.

    With P the projector and X the point, the ray P + s (X - P) meets z = 0 at X + (X - P) z / (P_z - z). Python calls
    it as `fringecal.projector.rig_model.foot_on_plate`. Compiled loops take it in, and numba does not look into other
    files for changes: who changes it deletes the compiled files of `reconstruct` in its `__pycache__`.
    """
    stretch = z / (projector[2] - z)
    return x + (x - projector[0]) * stretch, y + (y - projector[1]) * stretch


@njit(cache=True, inline="always")
def _residual(x, y, grid, box):  # type: ignore[no-untyped-def]
    """Chebyshev sum over a box by the recurrence T(n+1) = 2 s T(n) - T(n-1), clamped to the box."""
    s = (2 * x - box[0] - box[1]) / (box[1] - box[0])
    t = (2 * y - box[2] - box[3]) / (box[3] - box[2])
    s = min(max(s, -1.0), 1.0)
    t = min(max(t, -1.0), 1.0)
    degree = grid.shape[0] - 1
    total = 0.0
    a_before, a = 0.0, 1.0
    for i in range(degree + 1):
        row = 0.0
        b_before, b = 0.0, 1.0
        for j in range(degree + 1 - i):
            row += grid[i, j] * b
            b_before, b = b, (t if j == 0 else 2 * t * b - b_before)
        total += a * row
        a_before, a = a, (s if i == 0 else 2 * s * a - a_before)
    return total


@njit(nogil=True, cache=True)
def residual_at(first, last, x, y, grid, box, out):  # type: ignore[no-untyped-def]
    """Write the plate residual at some of flat arrays of plate points."""
    for k in range(first, last):
        out[k] = _residual(x[k], y[k], grid, box)


@njit(nogil=True, cache=True)
def height_at(first, last, phase, ax, ay, bx, by, rig, projector, grid, box, rounds, out):  # type: ignore[no-untyped-def]
    """Write the height where some rays meet their phase; the residual is lifted along the projector's rays."""
    nx, ny, nz, n0, dx, dy, dz = rig
    lifted = np.isfinite(projector[2])
    for k in range(first, last):
        below = dx * ax[k] + dy * ay[k] + 1
        above = nx * ax[k] + ny * ay[k] + n0
        n_slope = nx * bx[k] + ny * by[k] + nz
        d_slope = dx * bx[k] + dy * by[k] + dz
        fx, fy, z = ax[k], ay[k], 0.0
        for _ in range(rounds + 1):
            phi = phase[k] - _residual(fx, fy, grid, box)
            slope = n_slope - phi * d_slope
            z = (phi * below - above) / slope if slope != 0 else np.nan
            x, y = ax[k] + bx[k] * z, ay[k] + by[k] * z
            fx, fy = x, y
            if lifted:
                fx, fy = foot_of_ray(x, y, z, projector)
        out[k] = z
