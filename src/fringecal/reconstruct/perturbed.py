"""Measured points moved by each component of the calibration's uncertainty, all three coordinates at once."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fringecal.projector import RigCalibration, height_model
from fringecal.uncertainty import UncertaintyComponent

Array = NDArray[np.float64]


def points_by_component(
    calibration: RigCalibration, u_px: Array, v_px: Array, z_mm: Array, *, model: str = "projective"
) -> Iterator[tuple[UncertaintyComponent, Array]]:
    """Yield every uncertainty component of the calibration and the points as they would come out with it added.

    The phase behind each height is kept, the calibration moves: heights, and x and y with the camera, follow.
    Any length, form or volume is evaluated on the moved points; its change is the contribution of that component.

    Parameters
    ----------
    calibration
        The rig with its uncertainty components.
    u_px, v_px, z_mm
        Pixels and their measured heights, (n,).
    model
        Height model that the heights were computed with.

    Yields
    ------
    tuple
        Component and points, (n, 3) in mm.
    """
    rays = calibration.camera.rays(u_px, v_px)
    x, y = rays.at(z_mm)
    phase = calibration.model.phase(x, y, z_mm)
    base = height_model(calibration, model).height(phase, rays)
    for component in calibration.components:
        moved = calibration.shifted(component)
        moved_rays = moved.camera.rays(u_px, v_px)
        # Other models do not invert the phase exactly: only the change counts.
        z = z_mm + height_model(moved, model).height(phase, moved_rays) - base
        yield component, np.stack([*moved_rays.at(z), z], axis=1)
