"""A height map as triangles, without bridging what was not measured."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fringecal.errors import RecordError
from fringecal.records.exports.regular_grid import demand_maps, jump_limit_mm


class Surface(Protocol):
    """What is needed of a height map: plate-frame maps (H, W) in mm, and where they are valid."""

    @property
    def x(self) -> np.ndarray:
        """Coordinate x, mm."""

    @property
    def y(self) -> np.ndarray:
        """Coordinate y, mm."""

    @property
    def z(self) -> np.ndarray:
        """Height above the plate, mm; NaN where masked."""

    @property
    def u_z(self) -> np.ndarray:
        """Standard uncertainty of the height, mm; NaN where masked."""

    @property
    def mask(self) -> np.ndarray:
        """True where the pixel is valid."""


@dataclass(frozen=True)
class Triangles:
    """Vertices (n, 3) in mm and faces (m, 3), counter-clockwise as seen from +z.

    `u_z_mm` is the standard uncertainty of each vertex's height and `max_jump_mm` the largest
    height difference that an edge was allowed.
    """

    vertices_mm: np.ndarray
    faces: np.ndarray
    u_z_mm: np.ndarray
    max_jump_mm: float


def triangulate(surface: Surface, *, max_jump_mm: float | None = None, stride: int = 1) -> Triangles:
    """Join neighbouring valid pixels to triangles, none across masked pixels or jumps.

    Each cell of four pixels is cut along the diagonal whose ends differ less in height, which
    keeps ridges sharp; with one pixel masked the other three still make a triangle.

    Parameters
    ----------
    surface
        Height map; only pixels of its mask are used.
    max_jump_mm
        Largest height difference along an edge; by default four sample spacings (76 degrees).
    stride
        Take every stride-th row and column.

    Raises
    ------
    RecordError
        No triangle is left, maps disagree in shape, or stride is below 1.
    """
    if stride < 1:
        raise RecordError(f"stride is {stride}, needed 1 or more")
    thin = (slice(None, None, stride), slice(None, None, stride))
    x, y, z, u_z, mask = (
        np.asarray(part)[thin] for part in (surface.x, surface.y, surface.z, surface.u_z, surface.mask)
    )
    demand_maps(x, y, z, u_z, mask)
    z = np.where(mask, z, np.nan).astype(float)
    limit = jump_limit_mm(x, y) if max_jump_mm is None else max_jump_mm
    faces = _cut_cells(z)
    # A corner that is NaN makes the comparison false, so masked corners drop their faces.
    faces = faces[np.ptp(z.ravel()[faces], axis=1) <= limit]
    if faces.size == 0:
        raise RecordError(f"no triangle is left with jumps up to {limit:.3g} mm; check mask and max_jump_mm")
    used, numbers = np.unique(faces, return_inverse=True)
    vertices = np.column_stack([part.ravel()[used] for part in (x, y, z)])
    return Triangles(vertices, numbers.reshape(-1, 3), u_z.ravel()[used], limit)


def _cut_cells(z: np.ndarray) -> np.ndarray:
    """Cut every cell into two triangles of flat indices, counter-clockwise with rows running down."""
    index = np.arange(z.size, dtype=np.int64).reshape(z.shape)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    fall, rise = np.abs(z[:-1, :-1] - z[1:, 1:]), np.abs(z[:-1, 1:] - z[1:, :-1])
    # NaN on one diagonal leaves the other as the cut, so that three valid corners are joined.
    along_fall = (np.where(np.isnan(fall), np.inf, fall) < np.where(np.isnan(rise), np.inf, rise)).ravel()
    by_fall = np.stack([np.stack([a, c, d], -1), np.stack([a, d, b], -1)], -2).reshape(-1, 2, 3)
    by_rise = np.stack([np.stack([a, c, b], -1), np.stack([b, c, d], -1)], -2).reshape(-1, 2, 3)
    return np.where(along_fall[:, None, None], by_fall, by_rise).reshape(-1, 3)
