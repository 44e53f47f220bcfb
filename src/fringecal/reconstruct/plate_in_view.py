"""The bare plate beside an object, as measured with it: whether it lies at z = 0, level, and no rougher than noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.numerics import robust_sd
from fringecal.reconstruct.height_map import HeightMap

Array = NDArray[np.float64]

_ROUNDS = 4  # of the plane's fit, each without what lies off the one before
_KEPT_SIGMAS = 4.0  # robust standard deviations off the plane up to which a pixel is plate
_PARTS = 8  # of the picture along each axis, whose scatter says how well slopes are known
_LEAST_PIXELS = 500  # fewer are a scrap beside an object
_LEAST_SHARE = 0.02  # of the picture


@dataclass(frozen=True)
class VisiblePlate:
    """The plate beside an object: a plane through its pixels.

    Parameters
    ----------
    offset_mm, u_mm
        Height of the plane in the middle of its pixels, which is 0 on the plate of the calibration, and its standard
        uncertainty.
    rise_mm
        How much the plane rises over the extent of its pixels, beyond what two standard uncertainties of its height at
        both ends explain.
    scatter_ratio
        Root mean square of the pixels' departure from the plane over their random standard uncertainty.
    pixels
        How many there are.
    middle_mm
        Middle of its pixels, x and y.
    slopes, u_slopes
        Rise along x and along y and their standard uncertainties, mm per mm: from the scatter of parts of the plate, so
        that what neighbours share counts.
    """

    offset_mm: float
    u_mm: float
    rise_mm: float
    scatter_ratio: float
    pixels: int
    middle_mm: tuple[float, float] = (0.0, 0.0)
    slopes: tuple[float, float] = (0.0, 0.0)
    u_slopes: tuple[float, float] = (0.0, 0.0)

    def plane_at(self, x_mm: Array, y_mm: Array) -> Array:
        """Return the plane's height at some places, mm."""
        x0, y0 = self.middle_mm
        return np.asarray(self.offset_mm + self.slopes[0] * (x_mm - x0) + self.slopes[1] * (y_mm - y0))

    def u_slopes_at(self, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
        """Return what one standard uncertainty of either slope adds to the plane at some places, mm."""
        x0, y0 = self.middle_mm
        return self.u_slopes[0] * (x_mm - x0), self.u_slopes[1] * (y_mm - y0)


def visible_plate(surface: HeightMap, near_mm: float) -> VisiblePlate | None:
    """Fit a plane to what looks like plate in a surface; None where too little of it is seen.

    Parameters
    ----------
    surface
        The measured surface.
    near_mm
        Height within which plate is looked for: less than half of what a fringe is high.
    """
    near = surface.mask & (np.abs(np.nan_to_num(surface.z, nan=np.inf)) < near_mm)
    plate = _largest(near)
    least = max(_LEAST_PIXELS, _LEAST_SHARE * plate.size)
    if np.count_nonzero(plate) < least:
        return None
    v, u = np.nonzero(plate)
    x, y, z = (np.asarray(m[v, u], float) for m in (surface.x, surface.y, surface.z))
    design = np.column_stack([np.ones(x.size), x - x.mean(), y - y.mean()])
    plane, kept = _plane(design, z)
    if np.count_nonzero(kept) < least:
        return None
    left = z - design @ plane
    noise = np.asarray(surface.u_random[v, u], float)
    weights = np.zeros(surface.z.shape)
    weights[v[kept], u[kept]] = 1.0
    heights, u_z = design[kept] @ plane, float(np.median(surface.u_z[v, u]))
    return VisiblePlate(
        float(plane[0]),
        surface.mean_uncertainty(weights),
        max(float(heights.max() - heights.min()) - 4 * u_z, 0.0),
        float(np.sqrt(np.mean((left / noise)[kept] ** 2))),
        int(np.count_nonzero(kept)),
        (float(x.mean()), float(y.mean())),
        (float(plane[1]), float(plane[2])),
        _u_slopes(design[kept], left[kept], (v[kept], u[kept]), surface.z.shape),
    )


def _u_slopes(
    design: Array, left: Array, place: tuple[NDArray[np.intp], NDArray[np.intp]], shape: tuple[int, ...]
) -> tuple[float, float]:
    """Return standard uncertainties of both slopes, by noise, or by the scatter of parts of the picture if larger."""
    inverse = np.linalg.inv(design.T @ design)
    number = place[0] * _PARTS // shape[0] * _PARTS + place[1] * _PARTS // shape[1]
    pulls = np.stack([np.bincount(number, left * column, _PARTS**2) for column in design.T])
    by_parts = np.diag(inverse @ (pulls @ pulls.T) @ inverse)
    by_noise = np.diag(inverse) * float(np.mean(left**2))
    _, along_x, along_y = np.sqrt(np.maximum(by_parts, by_noise))
    return float(along_x), float(along_y)


def _largest(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the largest connected part of a mask."""
    parts, number = ndimage.label(mask)
    if number == 0:
        return mask
    return np.asarray(parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:])))


def _plane(design: Array, z: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Fit a plane, leaving out what does not lie on it: the foot of an object."""
    kept = np.ones(z.size, bool)
    plane = np.zeros(3)
    for _ in range(_ROUNDS):
        plane = np.linalg.lstsq(design[kept], z[kept], rcond=None)[0]
        left = z - design @ plane
        kept = np.abs(left) <= _KEPT_SIGMAS * robust_sd(left[kept], about=0)
    return plane, kept
