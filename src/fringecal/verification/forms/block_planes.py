"""Small planes fitted to blocks of a surface: slopes that survive holes and wrong fringe orders."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.verification.zigzag.zigzag_shape import Floats

_MIN_SHARE = 0.3  # of a block's pixels that must be valid: a plane through fewer is a guess


@dataclass(frozen=True)
class _Reweighting:
    """How planes are fitted in the L1 sense, by least squares with weights 1 / residual.

    Parameters
    ----------
    rounds
        From a plain least-squares plane; after twelve the plane stands still to a thousandth of its residuals.
    least_mm, least_share
        Floor of a residual, so that a pixel on the plane gets no endless weight: a micrometre, and a tenth of the
        block's mean.
    ridge
        Of the normal matrix's trace: a block whose pixels lie on a line has no plane, and must not stop the others.
    """

    rounds: int = 12
    least_mm: float = 1e-3
    least_share: float = 0.1
    ridge: float = 1e-9


_REWEIGHTING = _Reweighting()


@dataclass(frozen=True)
class Facets:
    """Planes ``z = z0 + p (x - x0) + q (y - y0)`` of blocks; arrays of length n, mm and mm/mm."""

    x: Floats
    y: Floats
    z: Floats
    p: Floats
    q: Floats
    residual: Floats

    @property
    def angle_rad(self) -> Floats:
        """Angle of each facet against the plate."""
        return np.arctan(np.hypot(self.p, self.q))

    def where(self, chosen: NDArray[np.bool_]) -> "Facets":
        """Take some of the facets."""
        return Facets(*(getattr(self, name)[chosen] for name in ("x", "y", "z", "p", "q", "residual")))


def fit_facets(
    x: NDArray[np.floating],
    y: NDArray[np.floating],
    z: NDArray[np.floating],
    valid: NDArray[np.bool_],
    *,
    block_px: int,
) -> Facets:
    """Fit a plane to every block of `block_px` x `block_px` pixels, in the L1 sense.

    L1 by reweighting, because a pixel whose fringe order is wrong lies a whole fringe off and
    would tilt a least-squares plane; a handful of them in a block does not move this one.

    Parameters
    ----------
    x, y, z
        (H, W) surface in mm.
    valid
        (H, W) True where the surface may be used.
    block_px
        Side of a block; blocks with less than 30 % valid pixels are left out.
    """
    bx, by, bz, bv = (_blocks(np.where(valid, m, 0.0), block_px) for m in (x, y, z, valid))
    keep = bv.mean(axis=1) >= _MIN_SHARE
    bx, by, bz, bv = bx[keep], by[keep], bz[keep], bv[keep]
    count = bv.sum(axis=1)
    x0, y0 = (bx * bv).sum(axis=1) / count, (by * bv).sum(axis=1) / count
    design = np.stack([np.ones_like(bx), bx - x0[:, None], by - y0[:, None]], axis=2) * bv[:, :, None]
    plane, residual = _l1_planes(design, bz, bv)
    return Facets(x0, y0, plane[:, 0], plane[:, 1], plane[:, 2], residual)


def _blocks(image: NDArray[np.floating], side: int) -> Floats:
    rows, columns = image.shape[0] // side, image.shape[1] // side
    cut = np.asarray(image[: rows * side, : columns * side], float)
    return cut.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(rows * columns, side * side)


def _l1_planes(
    design: Floats, z: Floats, weight: Floats, *, settings: _Reweighting = _REWEIGHTING
) -> tuple[Floats, Floats]:
    w = weight
    plane = np.zeros((design.shape[0], 3))
    residual = np.zeros_like(z)
    for _ in range(settings.rounds):
        weighted = (design * w[:, :, None]).swapaxes(1, 2)
        normal = weighted @ design
        normal += settings.ridge * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        plane = np.linalg.solve(normal, weighted @ z[:, :, None])[:, :, 0]
        residual = np.abs(z - (design @ plane[:, :, None])[:, :, 0]) * weight
        mean = residual.sum(axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True)
        w = weight / np.maximum(residual, settings.least_mm + settings.least_share * mean)
    middle = np.nanmedian(np.where(weight > 0, residual, np.nan), axis=1) if len(z) else np.zeros(0)
    return plane, middle
