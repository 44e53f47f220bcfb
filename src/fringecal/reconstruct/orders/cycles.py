"""An object's step over the plate as several fringe periods give it: known at each pixel, up to whole cycles."""

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import TURN, wrap
from fringecal.phase import PhaseMap, plate_number
from fringecal.projector import RigCalibration


def step_in_cycle(phase_map: PhaseMap, calibration: RigCalibration) -> NDArray[np.float32] | None:
    """Return the phase over the plate's, known up to whole cycles, or None where nothing ties orders to the plate.

    Parameters
    ----------
    phase_map
        The object's phase with the orders that its further periods give.
    calibration
        The rig. If it was commissioned with other periods, the plate in the picture says how it counts.

    Returns
    -------
    numpy.ndarray or None
        Step in rad, at most half a cycle up or down, float32, (H, W); NaN where the order is open.
    """
    orders = phase_map.orders
    if orders is None or orders.cycle < 2:
        return None
    rays = calibration.camera.pixel_rays()
    plate = calibration.model.phase(rays.ax, rays.ay, 0.0)
    number = None if calibration.orders is None else calibration.orders.number_for(orders)
    if number is None:
        number = plate_number(orders, plate)
    if number is None:
        return None
    step = wrap(orders.phase + TURN * number - plate, TURN * orders.cycle)
    return np.where(phase_map.valid, step, np.nan).astype(np.float32)
