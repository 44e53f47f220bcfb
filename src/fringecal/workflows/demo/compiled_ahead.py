"""What measuring is compiled of, compiled before it is needed: half of a first demonstration is the compiler's time."""

import numpy as np

from fringecal.camera import PlateCamera
from fringecal.numerics import wrap
from fringecal.phase import Noise, PhaseMap, Reason
from fringecal.projector import RigCalibration, RigModel
from fringecal.reconstruct import absolute_phase, height_of_phase

_SHAPE = (240, 320)
_PLATE, _LOW, _HIGH = 0.0, 3.0, 12.0  # heights, mm: below and above half a fringe


def compile_ahead() -> None:
    """Measure two blocks and a shadow, drawn by formula: numba keeps on disk what it compiles for that.

    A process beside the one that simulates and calibrates has done so before the first surface is measured.
    """
    rig = _rig()
    phase = absolute_phase(_blocks(rig), rig, height_range_mm=(-1.0, 15.0))
    for dtype in (np.float64, np.float32):  # artefacts, and objects
        height_of_phase(phase, rig, dtype=dtype)


def _rig() -> RigCalibration:
    """Light from 1 m above and 1.2 m aside, fringes of 10 px."""
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, _SHAPE)
    model = RigModel(np.array([0.02, 0.78, -0.96, 0.0, 1e-4, -4e-4, -5e-4]), np.array([0.0, 1222.0, 1000.0]))
    return RigCalibration(camera, model, ())


def _blocks(rig: RigCalibration) -> PhaseMap:
    """Phase of two blocks on the plate, one of them beside its shadow."""
    height = np.full(_SHAPE, _PLATE)
    height[60:120, 60:140], height[130:200, 170:260] = _LOW, _HIGH
    reasons = np.zeros(_SHAPE, np.uint8)
    reasons[200:212, 170:260] = Reason.DARK
    rays = rig.camera.pixel_rays()
    phase = np.where(reasons == 0, wrap(rig.model.phase(*rays.at(height), height)), np.nan).astype(np.float32)
    level = np.full(_SHAPE, 80.0, np.float32)
    return PhaseMap(phase, level, level, np.full(_SHAPE, 0.02, np.float32), reasons, Noise(1.0))
