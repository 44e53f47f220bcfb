"""Sections through a surface, with what moves them: noise of each point, and every influence on the calibration."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.projector import RigCalibration
from fringecal.reconstruct.height_map import HeightMap
from fringecal.reconstruct.perturbed import points_by_component
from fringecal.uncertainty import Source

Array = NDArray[np.float64]

_LEAST_POINTS = 10  # measured points of a row: from fewer no profile is drawn


@dataclass(frozen=True)
class Section:
    """A section along a picture row; only measured points, from left to right.

    Parameters
    ----------
    row_px
        The picture row.
    points_mm
        Points (n, 3) in the plate frame.
    u_random_mm
        Random standard uncertainty of every height, (n,).
    sources
        Sources of the calibration's uncertainty components, K of them.
    moved_mm
        The points with one standard uncertainty of each added, (K, n, 3).
    """

    row_px: int
    points_mm: Array
    u_random_mm: Array
    sources: tuple[Source, ...]
    moved_mm: Array

    @property
    def u_z_mm(self) -> Array:
        """Combined standard uncertainty of every height."""
        changes = self.moved_mm[:, :, 2] - self.points_mm[:, 2]
        return np.hypot(self.u_random_mm, np.sqrt((changes**2).sum(axis=0)))


def row_section(surface: HeightMap, calibration: RigCalibration, row_px: int, *, model: str = "projective") -> Section:
    """Cut a surface along a picture row.

    Parameters
    ----------
    surface
        The measured surface.
    calibration, model
        The rig and the height model that it was measured with.
    row_px
        The picture row.

    Raises
    ------
    FitError
        The row lies outside the picture, or holds fewer than ten measured points.
    """
    rows = surface.z.shape[0]
    known = np.flatnonzero(surface.mask[row_px]) if 0 <= row_px < rows else np.zeros(0, int)
    if known.size < _LEAST_POINTS:
        raise FitError(
            f"row {row_px} holds {known.size} measured points, {_LEAST_POINTS} are needed for a section; choose a row "
            f"from 0 to {rows - 1} that crosses the object"
        )
    x, y, z, u = (np.asarray(m[row_px, known], float) for m in (surface.x, surface.y, surface.z, surface.u_random))
    moved = list(
        points_by_component(calibration, known.astype(float), np.full(known.size, float(row_px)), z, model=model)
    )
    return Section(
        row_px,
        np.stack([x, y, z], axis=1),
        u,
        tuple(component.source for component, _ in moved),
        np.stack([points for _, points in moved]) if moved else np.zeros((0, known.size, 3)),
    )
