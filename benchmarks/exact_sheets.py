"""Pictures of ruled sheets by exact integration over every pixel, in closed form; nothing is shared with the simulator.

A line of width w blurred by a Gaussian of standard deviation b is a box of width w convolved with that Gaussian. A
square pixel collects, along the line's normal (c, s), a box of width |c| convolved with one of width |s|. The first
three convolve in closed form (second differences of the Gaussian's second integral), the last by Gauss-Legendre
quadrature, exact to rounding. Two families at right angles overlap by the product of both, as a Gaussian is
separable; only this product, near crossings, is integrated over the pixel by quadrature.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

# Points of the quadratures, where the Gaussian is a fifth of the pixel's side and where it is 0.4 of it or more: errors
# below 1e-6.
SHARP_POINTS, POINTS, SHARP_PX = 16, 8, 0.39
# Gaussians end here, standard deviations.
TAIL = 5.5
# Step of the table of a line's section: interpolated linearly, it errs by less than 1e-6 of its height.
STEP_PX = 1 / 1024


@dataclass(frozen=True)
class Sheet:
    """An undistorted sheet seen square-on.

    Parameters
    ----------
    width_px, blur_px
        Width of the lines, and standard deviation of the blur before the pixels collect.
    spacing_px
        Distance of neighbouring lines.
    rotation_deg
        Turn of the sheet; at 0 the lines run along the pixels.
    phase_px
        Where a vertical and a horizontal line pass the picture's middle, along their normals.
    """

    width_px: float
    blur_px: float
    spacing_px: float
    rotation_deg: float = 0.0
    phase_px: tuple[float, float] = (0.0, 0.0)

    @property
    def normals(self) -> np.ndarray:
        """Unit normals (2, 2) of the vertical and of the horizontal lines, as (u, v)."""
        c, s = math.cos(math.radians(self.rotation_deg)), math.sin(math.radians(self.rotation_deg))
        return np.array([[c, s], [-s, c]])

    def places(self, u: np.ndarray, v: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
        """Distances (2, ...) of points along both normals from line number 0 of either family, px."""
        middle = (np.array(shape[::-1]) - 1) / 2
        seen = np.stack([u - middle[0], v - middle[1]])
        return np.stack([n[0] * seen[0] + n[1] * seen[1] - p for n, p in zip(self.normals, self.phase_px, strict=True)])

    def crossings(self, column: np.ndarray, row: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
        """Places (n, 2), px, where lines of these numbers cross."""
        along = np.stack([column, row], axis=1) * self.spacing_px + self.phase_px
        return along @ self.normals + (np.array(shape[::-1]) - 1) / 2

    def nearest(self, u: np.ndarray, v: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Numbers (column, row) of the lines nearest to points."""
        column, row = np.rint(self.places(u, v, shape) / self.spacing_px)
        return column, row


def blurred_line(x: np.ndarray, width: float, blur: float) -> np.ndarray:
    """Share of ink at distances from the middle of a blurred line, before the pixels collect."""
    return special.ndtr((x + width / 2) / blur) - special.ndtr((x - width / 2) / blur)


def collected_line(x: np.ndarray, sheet: Sheet) -> np.ndarray:
    """Share of ink that a pixel collects whose centre is at distances x from the middle of a line."""
    wide, narrow = sorted(np.abs(sheet.normals[0]), reverse=True)
    nodes, weights = _quadrature(sheet)
    return sum(
        0.5 * w * _two_boxes(x + 0.5 * narrow * n, sheet.width_px, wide, sheet.blur_px)
        for n, w in zip(nodes, weights, strict=True)
    )


def _quadrature(sheet: Sheet) -> tuple[np.ndarray, np.ndarray]:
    """Places from -1 to 1 and weights of Gauss-Legendre's quadrature."""
    return np.polynomial.legendre.leggauss(SHARP_POINTS if sheet.blur_px < SHARP_PX else POINTS)


def _two_boxes(x: np.ndarray, one: float, other: float, blur: float) -> np.ndarray:
    """Boxes of height 1 and of area 1, and a Gaussian, convolved: differences of the Gaussian's second integral."""
    far, near = (one + other) / 2, (one - other) / 2
    signs = ((far, 1), (near, -1), (-near, -1), (-far, 1))
    return sum(sign * _second_integral(x + shift, blur) for shift, sign in signs) / other


def _second_integral(x: np.ndarray, blur: float) -> np.ndarray:
    """Integrate a Gaussian of area 1 twice: x Phi(x / b) + b phi(x / b)."""
    return x * special.ndtr(x / blur) + blur / math.sqrt(2 * math.pi) * np.exp(-0.5 * (x / blur) ** 2)


def ink_shares(sheet: Sheet, shape: tuple[int, int]) -> np.ndarray:
    """Share of ink (H, W) that every pixel collects."""
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    places = sheet.places(u, v, shape)
    off = places - sheet.spacing_px * np.rint(places / sheet.spacing_px)
    reach = sheet.width_px / 2 + math.sqrt(0.5) + TAIL * sheet.blur_px
    if reach > sheet.spacing_px / 2:
        raise ValueError(f"lines {sheet.spacing_px} px apart overlap: the nearest one is not all that a pixel sees")
    x = np.arange(0.0, reach + 2 * STEP_PX, STEP_PX)
    table = collected_line(x, sheet)
    table[x > reach] = 0.0
    shares = np.interp(np.abs(off), x, table).sum(axis=0)
    both = (np.abs(off) < reach).all(axis=0)
    shares[both] -= _overlap(off[:, both], sheet)
    return shares


def _overlap(off: np.ndarray, sheet: Sheet) -> np.ndarray:
    """Share of a pixel that both a vertical and a horizontal line cover; `off` (2, n) from their middles."""
    nodes, weights = _quadrature(sheet)
    du, dv = (0.5 * part.ravel() for part in np.meshgrid(nodes, nodes))
    weight = 0.25 * np.outer(weights, weights).ravel()
    x = np.arange(0.0, sheet.width_px / 2 + 2.0 + TAIL * sheet.blur_px, STEP_PX)
    table = blurred_line(x, sheet.width_px, sheet.blur_px)
    total = np.zeros(off.shape[1])
    for a, b, w in zip(du, dv, weight, strict=True):
        shift = sheet.normals @ np.array([a, b])
        covered = [np.interp(np.abs(part + s), x, table) for part, s in zip(off, shift, strict=True)]
        total += w * covered[0] * covered[1]
    return total


def picture(
    sheet: Sheet,
    shape: tuple[int, int],
    rng: np.random.Generator,
    *,
    paper: float = 200.0,
    ink: float = 60.0,
    noise: float = 1.5,
) -> np.ndarray:
    """Picture (H, W), uint8: grey levels of paper and ink, normal noise of a standard deviation, rounded."""
    grey = paper + (ink - paper) * ink_shares(sheet, shape)
    return np.clip(np.rint(grey + rng.normal(0, noise, shape)), 0, 255).astype(np.uint8)
