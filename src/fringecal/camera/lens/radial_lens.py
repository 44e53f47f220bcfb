"""A lens as displacement in the picture: radial and tangential, about a centre, without a focal length."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UNDISTORT_STEPS = 50  # at most; Newton's method takes three or four where the lens does not fold
UNDISTORT_ENOUGH_PX = 1e-9  # far below any crossing's scatter, well above rounding
LEAST_SLOPE = 0.2
"""Floor of d(there)/d(here): no picture that is used shrinks to a fifth, and at 0 the polynomial folds. A step that is
divided by it stays finite, and ends elsewhere than it should, which the residual shows."""
_CENTRE_PX = 1e-12  # of a radius: at the centre itself there is no direction outward, nor any displacement


@dataclass(frozen=True)
class RadialLens:
    """Displacement of points about a centre, radius in half diagonals of the picture.

    `there = here (1 + k1 r^2 + k2 r^4 + k3 r^6)` plus Brown's tangential terms, as in OpenCV, with
    here = (u - centre) / half_diagonal instead of the focal length.

    Parameters
    ----------
    centre_px
        Centre of distortion (u, v).
    half_diagonal_px
        Unit of the radius.
    radial, tangential
        k1, k2 ... and p1, p2.
    inverse
        False: the polynomial leads from ideal points to seen ones (Brown, OpenCV). True: from seen ones to
        ideal ones, which needs fewer terms where the lens displaces points by tenths of the radius.
    """

    centre_px: tuple[float, float]
    half_diagonal_px: float
    radial: tuple[float, ...]
    tangential: tuple[float, float] = (0.0, 0.0)
    inverse: bool = False

    def distort(self, points_px: Array) -> Array:
        """Where ideal points (n, 2), px, are seen."""
        return self._reversed(points_px) if self.inverse else self._polynomial(points_px)

    def undistort(self, points_px: Array) -> Array:
        """Where seen points (n, 2), px, would be without the lens."""
        return self._polynomial(points_px) if self.inverse else self._reversed(points_px)

    def outward_px(self, points_px: Array) -> Array:
        """By how much the lens moves points seen at `points_px` (n, 2) away from its centre, px, (n,).

        Examples
        --------
        >>> lens = RadialLens((0.0, 0.0), 100.0, (0.02,))
        >>> lens.outward_px(lens.distort(np.array([[100.0, 0.0]]))).round(6).tolist()
        [2.0]
        """
        arm = points_px - self.centre_px
        length = np.maximum(np.hypot(arm[:, 0], arm[:, 1]), _CENTRE_PX)
        return np.einsum("ij,ij->i", points_px - self.undistort(points_px), arm) / length

    def shrunk(self, points_px: Array, offset_px: Array) -> Array:
        """Small offsets (n, 2) between ideal points as they look in the picture, at points seen at `points_px`.

        Only for inverse lenses: along the radius they shrink by the slope of the polynomial, across it by
        its factor.
        """
        arm = points_px - self.centre_px
        length = np.maximum(np.hypot(arm[:, 0], arm[:, 1]), _CENTRE_PX)
        unit = arm / length[:, None]
        along = np.einsum("ij,ij->i", offset_px, unit)[:, None] * unit
        r2 = (length / self.half_diagonal_px) ** 2
        factor = np.maximum(1 + sum(k * r2 ** (n + 1) for n, k in enumerate(self.radial)), LEAST_SLOPE)
        return along / self._slope(points_px)[:, None] + (offset_px - along) / factor[:, None]

    def brown_k1(self, focal_px: float) -> float:
        """Brown's k1 (OpenCV) for a stated focal length: radii are then in focal lengths.

        Examples
        --------
        >>> RadialLens((320.0, 240.0), 400.0, (-0.01,)).brown_k1(800.0)
        -0.04
        """
        k1 = -self.radial[0] if self.inverse else self.radial[0]
        return k1 * (focal_px / self.half_diagonal_px) ** 2

    def slopes(self, points_px: Array) -> tuple[Array, Array]:
        """Derivatives of the polynomial at points (n, 2): by the point (n, 2, 2), and by k1, k2 .. p1, p2 (n, 2, m).

        The second ones are in half diagonals.
        """
        x, y = ((points_px - self.centre_px) / self.half_diagonal_px).T
        r2 = x * x + y * y
        p1, p2 = self.tangential
        factor = 1 + sum(k * r2 ** (n + 1) for n, k in enumerate(self.radial))
        rise = 2 * sum((n + 1) * k * r2**n for n, k in enumerate(self.radial))
        cross = x * y * rise + 2 * p1 * x + 2 * p2 * y
        along_x = factor + x * x * rise + 2 * p1 * y + 6 * p2 * x
        along_y = factor + y * y * rise + 6 * p1 * y + 2 * p2 * x
        by_point = np.stack([np.stack([along_x, cross], -1), np.stack([cross, along_y], -1)], axis=1)
        powers = [r2 ** (n + 1) for n in range(len(self.radial))]
        by_term = [(x * power, y * power) for power in powers]
        by_term += [(2 * x * y, r2 + 2 * y * y), (r2 + 2 * x * x, 2 * x * y)]
        return by_point, np.stack([np.stack(pair, axis=-1) for pair in by_term], axis=-1)

    def _polynomial(self, points_px: Array) -> Array:
        x, y = ((points_px - self.centre_px) / self.half_diagonal_px).T
        r2 = x * x + y * y
        factor = 1 + sum(k * r2 ** (n + 1) for n, k in enumerate(self.radial))
        p1, p2 = self.tangential
        du = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        dv = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([x * factor + du, y * factor + dv], axis=1) * self.half_diagonal_px + self.centre_px

    def _reversed(self, points_px: Array) -> Array:
        """Solve `_polynomial` = points by Newton's step along the radius: it converges where the lens does not fold."""
        found = np.array(points_px, dtype=float)
        for _ in range(UNDISTORT_STEPS):
            rest = points_px - self._polynomial(found)
            found += rest / self._slope(found)[:, None]
            if np.abs(rest).max(initial=0.0) < UNDISTORT_ENOUGH_PX:
                break
        return found

    def _slope(self, points_px: Array) -> Array:
        """Radial stretch d(there)/d(here), kept away from 0 where the polynomial folds."""
        x, y = ((points_px - self.centre_px) / self.half_diagonal_px).T
        r2 = x * x + y * y
        return np.maximum(1 + sum((2 * n + 3) * k * r2 ** (n + 1) for n, k in enumerate(self.radial)), LEAST_SLOPE)
