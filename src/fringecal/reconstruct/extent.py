"""Area and volume of an object on the plate, with what noise and every influence on the calibration do to them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.projector import RigCalibration
from fringecal.reconstruct.height_map import HeightMap
from fringecal.reconstruct.perturbed import points_by_component

Array = NDArray[np.float64]

_THINNED = 40_000  # pixels at which influences are evaluated: their changes are smooth
_ABOVE_PLATE = 5.0  # median u(z) above the plate: a normal deviation exceeds it once in 3.5 million


@dataclass(frozen=True)
class Extent:
    """Size of what stands above a height over the plate; every u is a standard uncertainty.

    Parameters
    ----------
    above_mm
        Height from which on the object counts.
    area_mm2, u_area_mm2
        Area of its surface.
    projected_mm2, u_projected_mm2
        Area that it covers on the plate.
    volume_mm3, u_volume_mm3
        Volume between its surface and the plate, as if it were solid.
    """

    above_mm: float
    area_mm2: float
    u_area_mm2: float
    projected_mm2: float
    u_projected_mm2: float
    volume_mm3: float
    u_volume_mm3: float


def extent_of(
    surface: HeightMap, calibration: RigCalibration, *, above_mm: float | None = None, model: str = "projective"
) -> Extent:
    """Measure area and volume of an object, cell by cell of four valid pixels.

    The area of a cell is half the length of the cross product of its diagonals; noise makes it larger by a second-order
    term, which is subtracted. Holes in the mask count in none of them.

    Parameters
    ----------
    surface
        The measured surface.
    calibration, model
        The rig and the height model that it was measured with.
    above_mm
        Mean height of a cell from which on it belongs to the object; by default five median u(z).

    Raises
    ------
    FitError
        Nothing stands so high.
    """
    least = _ABOVE_PLATE * float(np.nanmedian(surface.u_z)) if above_mm is None else above_mm
    points = _cells(np.stack([np.asarray(m, float) for m in (surface.x, surface.y, surface.z)], axis=-1))
    noise = _cells(np.asarray(surface.u_random, float)[..., None])[..., 0]
    counted = np.nan_to_num(points[..., 2].mean(axis=0), nan=-np.inf) > least
    if not counted.any():
        raise FitError(
            f"no part of the surface stands {least:.3g} mm above the plate; state a smaller height from which on the "
            "object counts"
        )
    points, noise = points[:, counted], noise[:, counted]
    values = _sums(points) - np.array([_noise_bias(points, noise), 0.0, 0.0])
    variance = _random_variance(points, noise)
    for change in _changes(surface, calibration, least, model):
        variance += (change * values) ** 2
    u = np.sqrt(variance)
    return Extent(least, *(float(n) for pair in zip(values, u, strict=True) for n in pair))


def _cells(values: Array) -> Array:
    """Return the corners of all cells, around each: (4, H - 1, W - 1, ...)."""
    return np.stack([values[1:, :-1], values[1:, 1:], values[:-1, 1:], values[:-1, :-1]])


def _diagonals(points: Array) -> tuple[Array, Array]:
    return points[2] - points[0], points[3] - points[1]


def _sums(points: Array) -> Array:
    """Area of the surface, area on the plate, volume."""
    one, two = _diagonals(points)
    normal = np.cross(one, two) / 2
    return np.array(
        [np.linalg.norm(normal, axis=-1).sum(), normal[:, 2].sum(), (normal[:, 2] * points[..., 2].mean(axis=0)).sum()]
    )


def _noise_bias(points: Array, noise: Array) -> float:
    """Second-order growth of the area by noise of the heights: `tr(C)/(2 n) - n^T C n/(2 n^3)` for the normal n."""
    one, two = _diagonals(points)
    x, y, _ = np.moveaxis(np.cross(one, two) / 2, -1, 0)
    length = np.linalg.norm(np.cross(one, two) / 2, axis=-1)
    v_one, v_two = noise[0] ** 2 + noise[2] ** 2, noise[1] ** 2 + noise[3] ** 2
    # n_x = (one_y two_z - one_z two_y) / 2 and n_y = (one_z two_x - one_x two_z) / 2 move with both diagonals' z.
    xx = (one[:, 1] ** 2 * v_two + two[:, 1] ** 2 * v_one) / 4
    yy = (two[:, 0] ** 2 * v_one + one[:, 0] ** 2 * v_two) / 4
    xy = -(one[:, 1] * one[:, 0] * v_two + two[:, 1] * two[:, 0] * v_one) / 4
    along = xx * x**2 + yy * y**2 + 2 * xy * x * y
    return float(np.sum((xx + yy) / (2 * length) - along / (2 * length**3)))


def _random_variance(points: Array, noise: Array) -> Array:
    """Variance of area, projected area and volume by noise: small, as it averages out."""
    one, two = _diagonals(points)
    normal = np.cross(one, two) / 2
    tilt = np.hypot(normal[:, 0], normal[:, 1]) / np.linalg.norm(normal, axis=-1)
    mean_square = (noise**2).mean(axis=0)
    edge = (np.linalg.norm(one[:, :2], axis=-1) ** 2 + np.linalg.norm(two[:, :2], axis=-1) ** 2) / 2
    area = float(np.sum(tilt**2 * edge * mean_square))
    # Each pixel is a corner of four cells: it carries one cell's whole area.
    return np.array([area, 0.0, float(np.sum(normal[:, 2] ** 2 * mean_square))])


def _changes(surface: HeightMap, calibration: RigCalibration, least: float, model: str) -> Iterator[Array]:
    """Relative change of the three sums under every influence, on a thinned lattice."""
    step = max(1, math.ceil(math.sqrt(surface.z.size / _THINNED)))
    v, u = np.mgrid[: surface.z.shape[0] : step, : surface.z.shape[1] : step]
    z = np.asarray(surface.z[::step, ::step], float)
    rays = calibration.camera.rays(u, v)
    counted = np.nan_to_num(_cells(z[..., None])[..., 0].mean(axis=0), nan=-np.inf) > least
    if not counted.any():
        return
    base = _sums(_cells(np.stack([*rays.at(z), z], axis=-1))[:, counted])
    flat = (u.ravel().astype(float), v.ravel().astype(float), z.ravel())
    for _, points in points_by_component(calibration, *flat, model=model):
        yield _sums(_cells(points.reshape(*z.shape, 3))[:, counted]) / base - 1
