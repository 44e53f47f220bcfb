"""The distance of the strips by the grid's scale, from a calibration."""

import numpy as np

from fringecal.calibration import Calibrated
from fringecal.projector import StripSpacing, strip_spacing


def spacing_of(result: Calibrated) -> StripSpacing | None:
    """Compare the distance of the strips by the grid with the stated one; None where too few are seen whole."""
    both = result.strips.phase.valid & result.plate.phase.valid
    step = np.where(both, result.strips.phase.phase.astype(np.float64) - result.plate.phase.phase, np.nan)
    return strip_spacing(result.strips.found, step, result.camera.fit.camera)
