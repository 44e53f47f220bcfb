"""The demonstration: the thesis's rig from nothing to a report, measured against truth, and real captures read."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from fringecal.phase import FringePeriod, fringe_period
from fringecal.procedures.commission import Commissioning, commission
from fringecal.procedures.frames import CapturePhase, phase_of_capture
from fringecal.procedures.measurement import Measurement, reconstruct
from fringecal.procedures.verification import Verification, verify
from fringecal.session import Session

Progress = Callable[[str], None]

#: What the thesis of 2008 states: scale in mm/px, angle in deg, largest height error in percent.
THESIS = {"scale": 0.734, "angle": 50.7, "height_error": 7.2}


@dataclass(frozen=True)
class DemoTruth:
    """What the virtual rig really is; from the simulator, never used by what is measured."""

    scale_h: float
    scale_v: float
    angle_deg: float
    leaf_z_mm: np.ndarray


@dataclass(frozen=True)
class Demonstration:
    """Everything that the demonstration measured on the virtual rig."""

    commissioning: Commissioning
    verification: Verification
    leaf: Measurement
    truth: DemoTruth


@dataclass(frozen=True)
class RealCapture:
    """A real phase-shifted set: its phase map and what it shows."""

    name: str
    phase: CapturePhase
    period: FringePeriod


def demonstrate(session: Session, truth: DemoTruth, *, progress: Progress = lambda _: None) -> Demonstration:
    """Commission the virtual rig, verify it on the bars and reconstruct the leaf."""
    found = commission(session, progress=progress)
    verification = verify(session, "bars", found.calibration, progress=progress)
    leaf = reconstruct(session, "leaf", found.calibration, progress=progress)
    return Demonstration(found, verification, leaf, truth)


def read_real(session: Session, *, progress: Progress = lambda _: None) -> tuple[RealCapture, ...]:
    """Demodulate every phase-shifted capture of a real session."""
    captures = []
    for capture in session.captures.values():
        progress(f"real capture {session.rig}: {capture.name}")
        phase = phase_of_capture(capture)
        captures.append(
            RealCapture(f"{session.rig} {capture.name}", phase, fringe_period(phase.map.phase, phase.map.valid))
        )
    return tuple(captures)


def result_table(found: Demonstration) -> pd.DataFrame:
    """Tabulate what was measured against what is true and what the thesis found."""
    calibration, errors = found.commissioning, found.verification.errors
    scales, truth = calibration.camera.scales, found.truth
    constant = found.verification.models["constant-angle"]
    rows = [
        ("mean scale", scales["mean"].value, scales["mean"].u, (truth.scale_h + truth.scale_v) / 2, THESIS["scale"], "mm/px"),
        ("horizontal scale", scales["horizontal"].value, scales["horizontal"].u, truth.scale_h, math.nan, "mm/px"),
        ("vertical scale", scales["vertical"].value, scales["vertical"].u, truth.scale_v, math.nan, "mm/px"),
        ("projection angle at the origin", calibration.angle.value, calibration.angle.u, truth.angle_deg, THESIS["angle"], "deg"),
        ("zig-zag, mean error", errors.pooled.mean_percent, _percent(found, errors.pooled.u_mm), 0.0, math.nan, "% of height"),
        ("zig-zag, mean of the largest errors", _mean_of_max(found, "projective"), math.nan, 0.0, THESIS["height_error"], "% of height"),
        ("the same with one constant angle", _mean_of_max(found, "constant-angle"), math.nan, 0.0, THESIS["height_error"], "% of height"),
        ("the same, largest of all profiles", constant.pooled.max_percent, math.nan, 0.0, math.nan, "% of height"),
        ("leaf, mean height error", _leaf_error(found), _leaf_u(found), 0.0, math.nan, "mm"),
    ]
    return pd.DataFrame(rows, columns=["quantity", "measured", "u", "true", "thesis 2008", "unit"])


def _percent(found: Demonstration, value_mm: float) -> float:
    return 100 * value_mm / found.verification.errors.full_height_mm


def _mean_of_max(found: Demonstration, model: str) -> float:
    return float(np.mean([p.max_percent for p in found.verification.models[model].profiles]))


def _leaf_error(found: Demonstration) -> float:
    return float(np.nanmean(found.leaf.surface.z - found.truth.leaf_z_mm))


def _leaf_u(found: Demonstration) -> float:
    surface = found.leaf.surface
    return surface.mean_uncertainty(np.isfinite(found.truth.leaf_z_mm).astype(float))
