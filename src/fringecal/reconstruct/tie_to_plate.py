"""Heights over the plate in view in place of the calibration's: its plane taken off, with its uncertainty."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fringecal.projector import RigCalibration
from fringecal.reconstruct.height_map import HeightMap
from fringecal.reconstruct.plate_in_view import VisiblePlate
from fringecal.reconstruct.sensitivity import Sensitivities
from fringecal.uncertainty import Influence, Source

Array = NDArray[np.float64]

TIED = "plate in view, to which heights were tied"


def tied_to_plate(surface: HeightMap, plate: VisiblePlate, calibration: RigCalibration) -> HeightMap:
    """Take the plane of the plate in view off the heights.

    x and y follow along each pixel's ray. The plane's uncertainty is added as common parts, offset and both slopes: a
    mean does not lose them. What plate and object share of the rig's own uncertainty stays in u(z), which is too much
    rather than too little.

    Parameters
    ----------
    surface
        The measured surface.
    plate
        The plate beside the object, from `visible_plate`.
    calibration
        The rig that it was measured with.
    """
    taken = plate.plane_at(surface.x, surface.y)
    rays = calibration.camera.pixel_rays()
    parts = _parts(surface, plate)
    more = sum(part**2 for part in (plate.u_mm, *plate.u_slopes_at(surface.x, surface.y)))
    kind = surface.z.dtype
    return replace(
        surface,
        x=(surface.x - rays.bx * taken).astype(kind),
        y=(surface.y - rays.by * taken).astype(kind),
        z=(surface.z - taken).astype(kind),
        u_z=np.sqrt(surface.u_z**2 + more).astype(kind),
        systematic=_with_parts(surface.systematic, parts),
    )


def _parts(surface: HeightMap, plate: VisiblePlate) -> list[Array]:
    """Return offset and slopes, one u each, as planes: constant, along v and along u from -1 to 1, (3, 3)."""
    v, u = np.nonzero(surface.mask)
    few = slice(None, None, max(1, v.size // 10_000))
    v, u = v[few], u[few]
    height, width = surface.mask.shape
    design = np.column_stack([np.ones(v.size), 2 * v / (height - 1) - 1, 2 * u / (width - 1) - 1])
    slopes = plate.u_slopes_at(surface.x[v, u].astype(float), surface.y[v, u].astype(float))
    return [np.array([plate.u_mm, 0.0, 0.0]), *(np.linalg.lstsq(design, part, rcond=None)[0] for part in slopes)]


def _with_parts(systematic: Sensitivities, parts: list[Array]) -> Sensitivities:
    """Add parts that are planes over the picture and the same at every height."""
    empty = np.zeros((len(parts), *systematic.coefficients.shape[1:]))
    for one, (constant, along_v, along_u) in zip(empty, parts, strict=True):
        one[0, 0, 0], one[0, 1, 0], one[0, 0, 1] = constant, along_v, along_u
    return replace(
        systematic,
        sources=(*systematic.sources, *(Source(Influence.INPUT, TIED) for _ in parts)),
        dof=(*systematic.dof, *(np.inf for _ in parts)),
        coefficients=np.concatenate([systematic.coefficients, empty]),
    )
