"""Measured points as a list, in a named frame: what point cloud formats hold."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError

Array = NDArray[np.float64]

PLATE_FRAME = "plate"
CAMERA_FRAME = "camera"


class _Map(Protocol):
    """Maps (H, W) in mm, NaN where masked, and where they are valid."""

    @property
    def x(self) -> np.ndarray:
        """Coordinate x."""

    @property
    def y(self) -> np.ndarray:
        """Coordinate y."""

    @property
    def z(self) -> np.ndarray:
        """Coordinate z."""

    @property
    def u_z(self) -> np.ndarray:
        """Standard uncertainty of z."""

    @property
    def mask(self) -> np.ndarray:
        """True where the pixel is valid."""


@dataclass(frozen=True)
class PointCloud:
    """Points with the standard uncertainty of each coordinate.

    Parameters
    ----------
    points_mm
        (n, 3), finite.
    u_mm
        (n, 3); a column of NaN where the uncertainty of a coordinate is not known, as of x and y of a height map.
    frame
        Whose frame the coordinates are in: "plate" (z toward the camera) or "camera" (z forward), or a name.

    Raises
    ------
    FitError
        The shapes disagree, or a point is not finite.
    """

    points_mm: Array
    u_mm: Array
    frame: str = PLATE_FRAME

    def __post_init__(self) -> None:
        if self.points_mm.ndim != 2 or self.points_mm.shape[1] != 3 or self.u_mm.shape != self.points_mm.shape:
            raise FitError(f"points {self.points_mm.shape} and u {self.u_mm.shape}; (n, 3) of both were needed")
        if not len(self.points_mm) or not np.isfinite(self.points_mm).all():
            raise FitError(f"{len(self.points_mm)} points, of which all must be finite; at least one was needed")

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points_mm)

    @property
    def known_u(self) -> dict[str, Array]:
        """Standard uncertainties that are known, by name: ``u_x``, ``u_y``, ``u_z``; (n,) each."""
        columns = zip(("u_x", "u_y", "u_z"), self.u_mm.T, strict=True)
        return {name: column for name, column in columns if np.isfinite(column).any()}


def cloud_of_map(surface: _Map, frame: str = PLATE_FRAME) -> PointCloud:
    """Return the valid pixels of maps as a list of points, row by row.

    Parameters
    ----------
    surface
        A height map (x, y, z, u_z, mask), or points of whole pictures, which also have u_x and u_y.
    frame
        Whose frame its coordinates are in.

    Raises
    ------
    FitError
        No pixel is valid.
    """
    mask = np.asarray(surface.mask, dtype=bool)
    unknown = np.full(mask.shape, np.nan)
    maps = [getattr(surface, name, unknown) for name in ("u_x", "u_y")]
    points = np.column_stack([np.asarray(part, dtype=float)[mask] for part in (surface.x, surface.y, surface.z)])
    u = np.column_stack([np.asarray(part, dtype=float)[mask] for part in (*maps, surface.u_z)])
    return PointCloud(points, u, frame)
