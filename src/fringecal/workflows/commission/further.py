"""What of a session takes part in the joint fit beside plate and strips: steps, wedges, flats, further strips."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError, SessionError
from fringecal.phase import Waveform
from fringecal.projector import (
    ArtefactPhase,
    Observations,
    RigCalibration,
    RigFit,
    measure_strips,
    observe_artefact,
    observe_strips,
)
from fringecal.session import Capture, Session
from fringecal.targets import Strips
from fringecal.workflows.shared import CapturePhase, phase_of_capture

Array = NDArray[np.float64]

CONTRADICTS = 2.6  # standard uncertainties: 1 % of honest statements go beyond


@dataclass(frozen=True)
class FurtherArtefact:
    """A further capture of known heights: its phase and, if it could be used, what it observes."""

    phase: CapturePhase
    seen: ArtefactPhase

    @property
    def notes(self) -> tuple[str, ...]:
        """Say what took part in the fit and what was left out."""
        name, used = self.phase.capture.name, self.seen.observations
        heights = [] if used is None else [f"{h.value:g}" for h in used.height_mm]
        taken = f"{name}: {', '.join(heights)} mm took part in the joint fit." if heights else f"{name}: not used."
        return (taken, *(f"{name}: {reason}." for reason in self.seen.left_out))


def strips_captures(session: Session) -> tuple[Capture, ...]:
    """Return the captures of strips that the rig is fitted to, the lowest strips first.

    The lowest strips have the smallest phase step, so that their fringe order is the easiest to decide.

    Raises
    ------
    SessionError
        There is none, or one has a target that is no set of strips.
    """
    chosen = [capture for capture in session.find("strips") if capture.use == "calibration"]
    if not chosen:
        raise SessionError(['every capture of kind "strips" states use = "verification"; the rig needs one to fit to'])
    return tuple(sorted(chosen, key=lambda capture: max(strips_target(capture).height_mm.values)))


def strips_target(capture: Capture) -> Strips:
    """Return the strips that a capture shows.

    Raises
    ------
    SessionError
        Its target is something else.
    """
    if not isinstance(capture.target, Strips):
        raise SessionError([f"capture {capture.name!r}: its target is no set of strips; name one"])
    return capture.target


def further_captures(session: Session) -> tuple[Capture, ...]:
    """Return all captures but the lowest strips that the rig is to be fitted to."""
    artefacts = (c for c in session.find("artefact") if c.use == "calibration")
    return (*strips_captures(session)[1:], *artefacts)


def phases_of(captures: Sequence[Capture], *, wave: Waveform | None = None) -> tuple[CapturePhase, ...]:
    """Demodulate every capture, with the fringes' shape as found on the plate."""
    return tuple(phase_of_capture(capture, wave=wave) for capture in captures)


def observe_further(
    phases: Sequence[CapturePhase], reference: CapturePhase, plate_phase: Array, calibration: RigCalibration
) -> tuple[FurtherArtefact, ...]:
    """Register every further artefact on the plate, with the rig as it is known so far.

    Parameters
    ----------
    phases
        The further captures.
    reference, plate_phase
        The bare plate and its unwrapped phase, rad.
    calibration
        The rig as known so far.

    Raises
    ------
    FitError
        An artefact that the session wants used is not to be seen; the message names its capture.
    """
    found = []
    for phase in phases:
        try:
            found.append(FurtherArtefact(phase, _observed(phase, reference, plate_phase, calibration)))
        except FitError as error:
            raise FitError(f"capture {phase.capture.name!r}: {error}") from error
    return tuple(found)


def _observed(
    phase: CapturePhase, reference: CapturePhase, plate_phase: Array, calibration: RigCalibration
) -> ArtefactPhase:
    target = phase.capture.target
    if isinstance(target, Strips):
        strips = measure_strips(reference.map, phase.map, target, calibration.camera)
        return observe_strips(strips, plate_phase, calibration)
    if target is None:
        raise FitError("it names no target; name the artefact's")
    return observe_artefact(target, phase.map.phase.astype(float), phase.map.valid, calibration)


def with_further(observations: Observations, further: Sequence[FurtherArtefact]) -> Observations:
    """Return the observations of plate and strips with those of all further artefacts."""
    for artefact in further:
        if artefact.seen.observations is not None:
            observations = observations.joined(artefact.seen.observations)
    return observations


def contradictions(observations: Observations, fit: RigFit) -> tuple[str, ...]:
    """Name every stated height that the other surfaces would have to move beyond its uncertainty."""
    found = []
    for surface, moved in enumerate(fit.doubts):
        for doubt, value in zip(observations.doubts_of(surface), moved, strict=True):
            if abs(value) > CONTRADICTS:
                height = observations.height_mm[surface].value
                found.append(
                    f"The artefacts contradict one another: to agree with the others, the {doubt.label} "
                    f"({height:g} mm) would have to be off by {float(value):+z.1f} of its standard uncertainties. "
                    "Measure it again."
                )
    return tuple(found)
