"""Named checks of a measurement: whether the capture fits the calibration that it is measured with."""

import numpy as np

from fringecal.reconstruct import visible_plate
from fringecal.records import DEFAULT_LIMITS, Check, Limits
from fringecal.uncertainty import Estimate
from fringecal.workflows.reconstruct.run import Measurement
from fringecal.workflows.shared import judged

_NEAR_RAD = 0.9  # phase within which plate is looked for: a seventh of a fringe, so that a plate 1 mm off is seen
_TEST_RAD = 1e-3


def measurement_checks(found: Measurement, limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Judge the plate beside the object: its height, its level, and its scatter.

    A plate or camera that moved shifts or tilts it, and so do frames in another order; a frame that moved, vibration
    and a torn frame roughen it. What covers the whole picture, or the object alone, is not seen.
    """
    if found.treatment.minus_plate:
        return ()
    plate = visible_plate(found.surface, _near_mm(found))
    if plate is None:
        rule = "too little of the plate is seen beside the object to tell whether it lies where it was calibrated"
        return (Check(name="plate beside the object", decision="info", rule=rule),)
    own = limits.reconstruct
    height = judged(
        "plate beside the object: height",
        Estimate(plate.offset_mm, plate.u_mm, "mm"),
        own.plate_height_mm,
        level=limits.level,
    )
    return (
        height,
        _below("plate beside the object: rise over the field", plate.rise_mm, own.plate_rise_mm, "mm"),
        _below("plate beside the object: scatter", plate.scatter_ratio, own.plate_scatter_ratio, ""),
    )


def _near_mm(found: Measurement) -> float:
    """Height of the phase within which plate is looked for, in the middle of the picture."""
    rig = found.calibration
    rays = rig.camera.rays(*(np.array([c]) for c in rig.camera.centre_px))
    phase = rig.model.phase(rays.ax, rays.ay, 0.0)
    return _NEAR_RAD / _TEST_RAD * abs(float(rig.model.height(phase + _TEST_RAD, rays)[0]))


def _below(name: str, value: float, limit: float, unit: str) -> Check:
    rules = {
        "mm": "rise of a plane through its pixels over their extent, beyond what their uncertainty explains",
        "": "root mean square of the pixels' departure from their plane over their random standard uncertainty",
    }
    decision = "pass" if value <= limit else "fail"
    return Check(name=name, value=value, limit=limit, unit=unit, decision=decision, rule=rules[unit])
