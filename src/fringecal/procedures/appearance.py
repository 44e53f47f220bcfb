"""How a rig's pictures look when it is calibrated: what later audits compare with."""

import numpy as np

from fringecal.detect.grid import GridDetection
from fringecal.procedures.frames import CapturePhase
from fringecal.records.calibration import AppearanceRecord


def appearance_of(reference: CapturePhase | None, detection: GridDetection | None) -> AppearanceRecord:
    """Return sharpness of the grid's lines and light, contrast, noise and wave shape on the bare plate.

    Parameters
    ----------
    reference
        Phase of the bare plate, or None where it was not taken.
    detection
        The grid in its picture, or None.
    """
    blur = None if detection is None else float(detection.profile.blur_px)
    if reference is None:
        return AppearanceRecord(grid_blur_px=blur)
    light = reference.map
    background = light.background[light.valid]
    wave = reference.adapted.found_wave
    middle = float(np.median(background))
    return AppearanceRecord(
        grid_blur_px=blur,
        modulation_levels=float(np.median(light.modulation[light.valid])),
        contrast=float(np.median(light.modulation[light.valid] / background)),
        noise_levels=float(light.noise.sigma(np.array(middle))),
        harmonic=None if wave is None else float(abs(wave.ratios[0])),
        u_harmonic=None if wave is None else float(wave.u[0]),
    )
