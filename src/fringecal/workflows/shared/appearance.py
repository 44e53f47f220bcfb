"""Image quality of a rig's pictures at its calibration, which later audits compare with."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from fringecal.detect import GridDetection
from fringecal.phase import PhaseMap
from fringecal.records import AppearanceRecord
from fringecal.workflows.shared.capture_phase import CapturePhase, shortest_period

BLUR_FROM: Final = "raster"
"""What the blur of a grid's lines is fitted to today: the raw pixels."""


def appearance_of(reference: CapturePhase | None, detection: GridDetection | None) -> AppearanceRecord:
    """Return sharpness of the grid's lines and brightness, contrast, noise and waveform on the bare plate.

    Parameters
    ----------
    reference
        Phase of the bare plate, or None where it was not taken.
    detection
        The grid in its picture, or None.
    """
    blur = None if detection is None else float(detection.profile.blur_px)
    if reference is None:
        return AppearanceRecord(grid_blur_px=blur, grid_blur_from=BLUR_FROM)
    light = reference.map
    wave = reference.adapted.found_wave
    modulation, contrast, middle = _medians(light)
    scatter = _scatter_of_repeats(reference)
    return AppearanceRecord(
        grid_blur_px=blur,
        grid_blur_from=BLUR_FROM,
        modulation_levels=modulation,
        contrast=contrast,
        noise_levels=float(light.noise.sigma(np.array(middle))),
        harmonic=None if wave is None else float(abs(wave.ratios[0])),
        u_harmonic=None if wave is None else float(wave.u[0]),
        repeats=reference.capture.repeat,
        scatter_modulation=None if scatter is None else float(scatter[0]),
        scatter_contrast=None if scatter is None else float(scatter[1]),
    )


def _medians(light: PhaseMap) -> tuple[float, float, float]:
    """Modulation, contrast and background in the middle of all pixels that have a phase."""
    modulation, background = light.modulation[light.valid], light.background[light.valid]
    return float(np.median(modulation)), float(np.median(modulation / background)), float(np.median(background))


def _scatter_of_repeats(reference: CapturePhase) -> NDArray[np.float64] | None:
    """Relative standard deviations of modulation and contrast from set to set; None without repeats."""
    capture = reference.capture
    if capture.repeat < 2:
        return None
    period = shortest_period(capture)
    sets = (capture.read_set(repeat=number, period=period) for number in range(capture.repeat))
    levels = np.array([_medians(reference.again(frames))[:2] for frames in sets])
    return np.asarray(levels.std(axis=0, ddof=1) / levels.mean(axis=0))
