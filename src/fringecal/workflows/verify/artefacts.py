"""Verify a calibrated rig on a flat, steps, a wedge, a box, a sphere or a ball bar of known size."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fringecal.errors import FringecalError
from fringecal.projector import RigCalibration
from fringecal.reconstruct import HeightMap, height_of_phase, points_by_component
from fringecal.session import Capture
from fringecal.targets import Artefact, Flat, footprint_mm, surface_mm
from fringecal.verification import Departures, Probe, Reading, departures_of, probe, take_readings
from fringecal.workflows.shared import CapturePhase, caused_by_frames_of, phase_of_capture
from fringecal.workflows.verify.form_phase import form_place, shown_form, shown_phase
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
    departures: Departures

    @property
    def sentence(self) -> str:
        """State whether the artefact's numbers agree with its certificate."""
        return sentence_of(self.readings)

    @property
    def how(self) -> str:
        """State by which phase shifts the artefact was measured."""
        return self.phase.sentence()

    @property
    def height_model(self) -> str:
        """By what heights follow from phase."""
        return "projective"


def sentence_of(readings: Sequence[Reading]) -> str:
    """State whether an artefact's numbers agree with its certificate."""
    judged = [reading for reading in readings if reading.en is not None]
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
        shown = shown_form(
            target, form_place(target, phase.map, calibration, name=capture.name), phase.map, calibration
        )
        surface = height_of_phase(shown_phase(shown, phase.map, calibration, heights), calibration)
        progress(f"finding the {target.kind} and its numbers")  # type: ignore[attr-defined]
        found = probe(target, surface, np.where(shown.core, shown.top, -1))
        readings = take_readings(
            found,
            surface,
            lambda u, v, z: points_by_component(calibration, u, v, z),
            instrument=(target.instrument, target.instrument_u_mm),
            thermal_rel_u=target.thermal_rel_u,
        )
        return ArtefactVerification(
            capture, target, phase, surface, found, readings, _departures(found, surface, target)
        )
    except FringecalError as error:
        raise caused_by_frames_of(error, phase) from error


def _departures(found: Probe, surface: HeightMap, target: Artefact) -> Departures:
    """Compare the distances from the fitted form with the heights' random uncertainty.

    What all heights have in common the fitted form has as well; what a flat may be off flat is its certificate's.
    """
    cloud = np.stack([surface.x, surface.y, surface.z], axis=-1).reshape(-1, 3)
    off = np.concatenate(found.residuals([cloud[group] for group in found.groups]))
    own = target.flatness_mm.value + target.flatness_mm.u if isinstance(target, Flat) else 0.0
    return departures_of(off, np.hypot(surface.u_random.ravel()[np.concatenate(found.groups)], own))


def height_range_mm(target: Artefact) -> tuple[float, float]:
    """Return the heights that a surface with this artefact on the plate can have, with headroom."""
    if isinstance(target, Flat):
        tallest = 0.0 if target.height_mm is None else target.height_mm.value
    else:
        tallest = float(np.max(surface_mm(target, *_raster(target))))
    return with_headroom(tallest)


def _raster(target: Artefact) -> tuple[np.ndarray, np.ndarray]:
    width, length = footprint_mm(target)
    return np.linspace(-width / 2, width / 2, _ACROSS)[:, None], np.linspace(-length / 2, length / 2, _ALONG)
