"""Verify a calibrated rig on a flat, steps, a wedge, a box, a sphere or a ball bar of known size."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fringecal.errors import FringecalError
from fringecal.projector import RigCalibration
from fringecal.reconstruct import HeightMap, Levels, absolute_phase, height_of_phase, points_by_component
from fringecal.session import Capture
from fringecal.targets import Artefact, BallBar, Box, Flat, Sphere, Steps, footprint_mm, surface_mm
from fringecal.verification import Probe, Reading, probe, take_readings
from fringecal.workflows.shared import CapturePhase, caused_by_frames_of, phase_of_capture
from fringecal.workflows.verify.height_range import with_headroom

_ACROSS, _ALONG = 401, 41  # places of an artefact's footprint at which its height is asked: across it heights change


@dataclass(frozen=True)
class ArtefactVerification:
    """An artefact measured with a calibrated rig: its numbers beside the certificate's."""

    capture: Capture
    target: Artefact
    phase: CapturePhase
    surface: HeightMap
    probe: Probe
    readings: tuple[Reading, ...]

    @property
    def sentence(self) -> str:
        """State whether the artefact's numbers agree with its certificate."""
        judged = [reading for reading in self.readings if reading.en is not None]
        if not judged:
            return "The certificate states no value with an uncertainty here: errors are reported, not judged."
        worst = max(judged, key=lambda reading: abs(reading.en or 0.0))
        verb = "agree" if abs(worst.en or 0.0) <= 1 else "do not agree"
        return (
            f"Measured and certified values {verb} within both uncertainties: largest |En| {abs(worst.en or 0.0):.2f} "
            f"({worst.name}: error {worst.error:+.4g} {worst.unit})."
        )


def verify_artefact(
    capture: Capture, calibration: RigCalibration, *, progress: Callable[[str], None] = lambda _: None
) -> ArtefactVerification:
    """Measure an artefact and compare it with its certificate.

    Parameters
    ----------
    capture
        A phase-shifted capture whose target is a flat, steps, wedge, box, sphere or ball bar.
    calibration
        The rig's calibration.

    Raises
    ------
    SessionError, PhaseError
        No steps, or no phase in the frames.
    FitError
        The surface does not show the artefact.
    """
    target = capture.target
    assert target is not None
    progress(f"phase of {capture.name}")
    phase = phase_of_capture(capture, wave=calibration.wave)
    try:
        progress(f"heights of {capture.name}")
        heights = height_range_mm(target)
        absolute = absolute_phase(phase.map, calibration, height_range_mm=heights, levels=levels_of(target))
        surface = height_of_phase(absolute, calibration, height_range_mm=heights)
        progress(f"finding the {target.kind} and its numbers")  # type: ignore[attr-defined]
        found = probe(target, surface)
        readings = take_readings(found, surface, lambda u, v, z: points_by_component(calibration, u, v, z))
        return ArtefactVerification(capture, target, phase, surface, found, readings)
    except FringecalError as error:
        raise caused_by_frames_of(error, phase) from error


def height_range_mm(target: Artefact) -> tuple[float, float]:
    """Return the heights that a surface with this artefact on the plate can have, with headroom."""
    if isinstance(target, Flat):
        tallest = 0.0 if target.height_mm is None else target.height_mm.value
    else:
        tallest = float(np.max(surface_mm(target, *_raster(target))))
    return with_headroom(tallest)


def levels_of(target: Artefact) -> Levels | None:
    """Return the heights at which an artefact has surfaces that may touch no plate."""
    match target:
        case Flat():
            return None if target.height_mm is None else Levels((target.height_mm.value,))
        case Box():
            return Levels((target.height_mm.value,))
        case Steps():
            return Levels(target.heights_mm.values)
        case Sphere():
            return Levels((target.diameter_mm.value,), top=True)
        case BallBar():
            return Levels(target.diameters_mm.values, top=True)
    return None


def _raster(target: Artefact) -> tuple[np.ndarray, np.ndarray]:
    width, length = footprint_mm(target)
    return np.linspace(-width / 2, width / 2, _ACROSS)[:, None], np.linspace(-length / 2, length / 2, _ALONG)
