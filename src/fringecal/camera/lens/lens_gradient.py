"""Where points are seen through a lens, with the derivatives by the points and by the lens's parameters."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SeenPoints(NamedTuple):
    """Pixels of points and their derivatives.

    `pixels` (n, 2) px; `by_point` (n, 2, 3) px/mm; `by_lens` (n, 2, 9) in the order of `LENS_NAMES`.
    """

    pixels: Array
    by_point: Array
    by_lens: Array


def lens_gradient(values: Array, points_mm: Array) -> SeenPoints:
    """Project points and differentiate, in closed form.

    Parameters
    ----------
    values
        A lens in the order of `LENS_NAMES`.
    points_mm
        Points (n, 3) in the device's frame: x right, y down, z forward.

    Examples
    --------
    >>> seen = lens_gradient(np.array([800.0, 800, 320, 240, 0, 0, 0, 0, 0]), np.array([[1.0, 0.0, 10.0]]))
    >>> seen.pixels.tolist(), seen.by_point[0, 0].tolist()
    ([[400.0, 240.0]], [80.0, 0.0, -8.0])
    """
    x, y = (points_mm[:, :2] / points_mm[:, 2:]).T
    bent, by_ideal, by_terms = _bent(values, x, y)
    pixels = bent * values[:2] + values[2:4]
    slope = by_ideal * values[:2, None]
    per_mm = slope / points_mm[:, 2, None, None]
    depth = -(per_mm[..., 0] * x[:, None] + per_mm[..., 1] * y[:, None])
    by_lens = np.zeros((len(x), 2, 9))
    by_lens[:, 0, 0], by_lens[:, 1, 1] = bent.T
    by_lens[:, 0, 2] = by_lens[:, 1, 3] = 1.0
    by_lens[:, :, 4:] = by_terms * values[:2, None]
    return SeenPoints(pixels, np.concatenate([per_mm, depth[..., None]], axis=2), by_lens)


def _bent(values: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Distorted directions (n, 2), with derivatives by the ideal ones (n, 2, 2) and by Brown's five terms (n, 2, 5)."""
    k1, k2, p1, p2, k3 = values[4:]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    rise = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    bent = np.stack(
        [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], -1
    )
    cross = x * y * rise + 2 * p1 * x + 2 * p2 * y
    by_ideal = np.empty((len(x), 2, 2))
    by_ideal[:, 0, 0] = radial + x * x * rise + 2 * p1 * y + 6 * p2 * x
    by_ideal[:, 0, 1] = by_ideal[:, 1, 0] = cross
    by_ideal[:, 1, 1] = radial + y * y * rise + 6 * p1 * y + 2 * p2 * x
    by_terms = np.empty((len(x), 2, 5))
    for column, factor in ((0, r2), (1, r2 * r2), (4, r2 * r2 * r2)):
        by_terms[:, 0, column], by_terms[:, 1, column] = x * factor, y * factor
    by_terms[:, 0, 2] = by_terms[:, 1, 3] = 2 * x * y
    by_terms[:, 1, 2], by_terms[:, 0, 3] = r2 + 2 * y * y, r2 + 2 * x * x
    return bent, by_ideal, by_terms
