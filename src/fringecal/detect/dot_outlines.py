"""Centres of dots by their outlines: a speck on or beside a dot moves its centroid, and few points of its outline."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, map_coordinates

from fringecal.numerics import robust_sd

FloatArray = npt.NDArray[np.float64]

#: Directions in which an outline is sought; a speck of a third of a dot's width hides four of them.
RAYS = 24
#: How far a ray goes, and where dot and ground are read, in radii of the usual dot.
REACH, CORE, GROUND_FROM = 1.7, 0.4, 1.45
#: Step along a ray, px and in radii: a quarter of a pixel tells a crossing by straight lines.
STEP_PX, STEP_RADII = 0.25, 1 / 24
#: Blur that is added, px: half-way between two pixels of a sharp edge lies beside it, in step with the raster.
SMOOTH_PX = 0.7
#: Rounds by absolute deviations, which any start survives, then by Tukey's biweight with its usual constant.
ROUNDS, TUKEY = (12, 6), 4.685
#: Scatter of an outline's points that is never undercut, px: a raster tells no more.
LEAST_PX = 0.02
#: A centroid so many times the usual distance from the outline's centre, per axis, is that of a touched dot.
TOUCHED = 5.0
#: Share of an outline that must be of one shape: with less, the dot is left aside.
LEAST_OF_OUTLINE = 0.5


@dataclass(frozen=True)
class Outlined:
    """Centres of dots by their outlines (n, 2), px; those of touched dots only; and the share of rays that agree."""

    points: FloatArray
    touched: npt.NDArray[np.bool_]
    kept: FloatArray

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Dots of whose outline enough is of one shape."""
        return self.kept >= LEAST_OF_OUTLINE


def outlined(bright: npt.NDArray[np.generic], centroids: FloatArray, radius_px: float) -> Outlined:
    """Find the centres of dots by their outlines, of which a speck hides a part.

    Parameters
    ----------
    bright
        Picture in which dots are bright, (H, W).
    centroids
        (n, 2), px as (u, v).
    radius_px
        Of the usual dot.

    Notes
    -----
    The outline of dot i is where its brightness falls to half between core and ground, on 24 rays about its centroid.
    Its distances are r_ik = s_i R_k + du_i cos(t_k) + dv_i sin(t_k) with the usual shape R_k; s, du and dv are found by
    absolute deviations, then by Tukey's biweight. Where (du, dv) is far beyond its scatter, the dot is touched.
    """
    angles: FloatArray = np.linspace(0.0, 2 * np.pi, RAYS, endpoint=False, dtype=np.float64)
    distance = _outlines(np.asarray(bright, float), centroids, radius_px, angles)
    shape = _usual_shape(distance)
    fitted, kept = _robust(np.column_stack([shape, np.cos(angles), np.sin(angles)]), distance)
    move = fitted[:, 1:] - np.median(fitted[:, 1:], axis=0)  # light that falls off moves all alike
    scatter = np.maximum([robust_sd(move[:, axis], about=0) for axis in (0, 1)], LEAST_PX)
    return Outlined(centroids + move, np.any(np.abs(move) > TOUCHED * scatter, axis=1), kept)


def _usual_shape(distance: FloatArray) -> FloatArray:
    """Median of all outlines, each over its own median; a circle where none has one."""
    whole = distance[np.isfinite(distance).mean(axis=1) > LEAST_OF_OUTLINE]
    if not len(whole):
        return np.ones(distance.shape[1])
    scaled = whole / np.nanmedian(whole, axis=1, keepdims=True)
    return np.array([np.median(ray[np.isfinite(ray)]) if np.isfinite(ray).any() else 1.0 for ray in scaled.T])


def _outlines(bright: FloatArray, points: FloatArray, radius_px: float, angles: FloatArray) -> FloatArray:
    """Distances (n, rays) at which brightness falls to half, px; NaN where it does not."""
    step = max(STEP_PX, STEP_RADII * radius_px)
    along = np.arange(0.0, REACH * radius_px + 1.0, step)
    u = points[:, 0, None, None] + np.cos(angles)[:, None] * along
    v = points[:, 1, None, None] + np.sin(angles)[:, None] * along
    smooth = gaussian_filter(bright, SMOOTH_PX, mode="nearest")
    seen = map_coordinates(smooth, [v, u], order=1, mode="nearest")
    core = np.median(seen[:, :, along <= max(CORE * radius_px, STEP_PX)], axis=(1, 2))
    ground = np.median(seen[:, :, along >= GROUND_FROM * radius_px], axis=(1, 2))
    below = seen < 0.5 * (core + ground)[:, None, None]
    first = np.argmax(below, axis=2)
    before = np.maximum(first - 1, 0)
    a, b = (np.take_along_axis(seen, k[..., None], axis=2)[..., 0] for k in (before, first))
    part = (a - 0.5 * (core + ground)[:, None]) / np.where(a > b, a - b, 1.0)
    return np.where(below.any(axis=2) & (first > 0), along[before] + np.clip(part, 0, 1) * step, np.nan)


def _robust(design: FloatArray, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit each row of distances by the design (rays, 3); return what was fitted and the share of rays that agree."""
    there = np.isfinite(distance)
    values = np.where(there, distance, 0.0)
    weight = there.astype(float)
    for turn in range(sum(ROUNDS)):
        normal = np.einsum("ki,nk,kj->nij", design, weight, design) + 1e-9 * np.eye(design.shape[1])
        fitted = np.linalg.solve(normal, np.einsum("ki,nk->ni", design, weight * values)[..., None])[..., 0]
        off = np.where(there, np.abs(values - fitted @ design.T), np.inf)
        scale = max(1.4826 * float(np.median(off[there])), LEAST_PX) if there.any() else LEAST_PX
        by_tukey = np.where(off < TUKEY * scale, (1 - np.minimum(off / (TUKEY * scale), 1) ** 2) ** 2, 0.0)
        weight = 1 / np.maximum(off, LEAST_PX) if turn < ROUNDS[0] else by_tukey
    return fitted, np.mean(off < TUKEY * scale, axis=1)
