"""The demonstration: the thesis's rig from nothing to a report, measured against truth, and real captures read."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from fringecal.phase import FringePeriod, fringe_period
from fringecal.session import Session
from fringecal.workflows.commission import Commissioning, commission
from fringecal.workflows.reconstruct import Measurement, reconstruct
from fringecal.workflows.shared import CapturePhase, phase_of_capture
from fringecal.workflows.verify import Verification, studied

Progress = Callable[[str], None]

#: Plain parts of the real scenes (rows, columns in px), where the stated fringe periods hold.
PLAIN_PARTS = {
    "fpp_tools": ("board", slice(255, 275), slice(100, 700)),
}

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
    """A real phase-shifted set: its phase map, and the fringe period where its scene is a plain board or wall."""

    name: str
    where: str
    phase: CapturePhase
    period: FringePeriod


def demonstrate(
    session: Session,
    truth: DemoTruth,
    *,
    progress: Progress = lambda _: None,
    done: Callable[[Commissioning | Verification | Measurement], None] = lambda _: None,
) -> Demonstration:
    """Commission the virtual rig, verify it on the bars and reconstruct the leaf.

    Parameters
    ----------
    session, truth
        The rig's session, and what is true of it.
    progress
        Called with a short sentence before each step.
    done
        Called with each result as soon as it is there.
    """
    found = commission(session, progress=progress)
    done(found)
    rig = found.calibrated.result.rig
    (bars,) = found.verified.bars
    verification = studied(bars, rig, progress=progress)
    done(verification)
    leaf = reconstruct(session, "leaf", rig, progress=progress)
    done(leaf)
    return Demonstration(found, verification, leaf, truth)


def read_real(session: Session, *, progress: Progress = lambda _: None) -> tuple[RealCapture, ...]:
    """Demodulate every phase-shifted capture of a real session."""
    captures = []
    for capture in session.captures.values():
        progress(f"real capture {session.rig}: {capture.name}")
        phase = phase_of_capture(capture)
        where, rows, columns = PLAIN_PARTS.get(session.rig, ("median", slice(None), slice(None)))
        period = fringe_period(phase.map.phase[rows, columns], phase.map.valid[rows, columns])
        captures.append(RealCapture(f"{session.rig} {capture.name}", where, phase, period))
    return tuple(captures)


def result_table(found: Demonstration) -> pd.DataFrame:
    """Tabulate what was measured against what is true and what the thesis found."""
    calibration, errors = found.commissioning.calibrated.result, found.verification.errors
    scales, truth = calibration.camera.scales, found.truth
    constant = found.verification.models["constant-angle"]
    mean, horizontal, vertical = (scales[name] for name in ("mean", "horizontal", "vertical"))
    angle, none, share = calibration.origin.angle, math.nan, "% of height"
    thesis_error = THESIS["height_error"]
    rows = [
        ("mean scale", mean.value, mean.u, (truth.scale_h + truth.scale_v) / 2, THESIS["scale"], "mm/px"),
        ("horizontal scale", horizontal.value, horizontal.u, truth.scale_h, none, "mm/px"),
        ("vertical scale", vertical.value, vertical.u, truth.scale_v, none, "mm/px"),
        ("projection angle at the origin", angle.value, angle.u, truth.angle_deg, THESIS["angle"], "deg"),
        ("zig-zag, mean error", errors.pooled.mean_percent, _percent(found, errors.pooled.u_mm), 0.0, none, share),
        ("zig-zag, mean of the maximum errors", _mean_of_max(found, "projective"), none, 0.0, thesis_error, share),
        ("the same with one constant angle", _mean_of_max(found, "constant-angle"), none, 0.0, thesis_error, share),
        ("the same, largest of all profiles", constant.pooled.max_percent, none, 0.0, none, share),
        ("leaf, mean height error", _leaf_error(found), _leaf_u(found), 0.0, none, "mm"),
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
