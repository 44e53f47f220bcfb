"""A study: many random virtual rigs commissioned, and what was found held against what is true."""

import math
from collections.abc import Callable

import numpy as np

from fringecal.procedures.commission import Commissioning, commission
from fringecal.procedures.study_rigs import DrawnRig
from fringecal.projection.calibration import RigCalibration
from fringecal.session import temporary_session
from fringecal.simulate import RigSpec, truth_of
from fringecal.simulate.camera import build_camera, ray
from fringecal.simulate.projector import build_projector, phase_at
from fringecal.uncertainty.estimates import Estimate

HEIGHTS_MM = (5.0, 15.0, 30.0)
CORNER_INSET = 0.05  # of the picture's sides: a corner point lies this far inside

#: Where heights are checked, as shares of the picture's width and height.
PLACES = {
    "centre": (0.5, 0.5),
    "top left": (CORNER_INSET, CORNER_INSET),
    "top right": (1 - CORNER_INSET, CORNER_INSET),
    "bottom left": (CORNER_INSET, 1 - CORNER_INSET),
    "bottom right": (1 - CORNER_INSET, 1 - CORNER_INSET),
}


def check_rig(drawn: DrawnRig, *, heights_mm: tuple[float, ...] = HEIGHTS_MM) -> dict[str, tuple[Estimate, float]]:
    taken = drawn.session()
    with temporary_session(taken.document, taken.frames, extra_files=taken.files) as session:
        found = commission(session)
    truth = truth_of(drawn.spec)
    pairs = {
        "scale": (found.camera.scales["mean"], (truth.scale_h + truth.scale_v) / 2),
        "angle at origin": (found.angle, truth.angle_origin_deg),
    }
    offset = phase_offset(found, taken.captures["reference"].phase)
    for z in heights_mm:
        for place, share in PLACES.items():
            pairs[f"height {z:g} mm, {place}"] = (_height(found.calibration, drawn.spec, share, z, offset), z)
    return pairs


def phase_offset(found: Commissioning, true_phase: np.ndarray) -> float:
    """Mean of measured minus true phase of the bare plate, rad."""
    return float(np.nanmean(found.plate_phase_rad - true_phase))


def _height(
    calibration: RigCalibration, spec: RigSpec, share: tuple[float, float], z_mm: float, offset_rad: float
) -> Estimate:
    u, v = share[0] * (spec.camera.width_px - 1), share[1] * (spec.camera.height_px - 1)
    ax, ay, bx, by = ray(build_camera(spec.camera), u, v)
    phase = phase_at(build_projector(spec.projector), ax + bx * z_mm, ay + by * z_mm, z_mm) + offset_rad

    def height(moved: RigCalibration) -> float:
        return float(moved.model.height(np.array(phase), moved.camera.rays(u, v)))

    estimate, _ = calibration.estimate(height, unit="mm", label="height")
    return estimate
