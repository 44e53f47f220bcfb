"""Further height standards of the joint fit beside plate and strips: steps, wedges, flats, further strips."""

from collections.abc import Sequence
from dataclasses import dataclass

from fringecal.calibration.surfaces import PlateSurface
from fringecal.errors import FitError
from fringecal.phase import PhaseMap
from fringecal.projector import (
    ArtefactPhase,
    Observations,
    RigCalibration,
    RigFit,
    measure_strips,
    observe_artefact,
    observe_strips,
)
from fringecal.targets import Strips, Target

CONTRADICTS = 2.6  # standard uncertainties: 1 % of honest statements go beyond


@dataclass(frozen=True)
class Standard:
    """An artefact of known heights on the plate: its name in messages, what it is, and its phase map."""

    name: str
    target: Target | None
    phase: PhaseMap


@dataclass(frozen=True)
class ObservedStandard:
    """What a standard gives to the joint fit, if it could be used."""

    name: str
    seen: ArtefactPhase

    @property
    def notes(self) -> tuple[str, ...]:
        """Say what took part in the fit and what was left out."""
        used = self.seen.observations
        heights = [] if used is None else [f"{h.value:g}" for h in used.height_mm]
        taken = f"{', '.join(heights)} mm took part in the joint fit." if heights else "not used."
        return (f"{self.name}: {taken}", *(f"{self.name}: {reason}." for reason in self.seen.left_out))


def observe_standards(
    standards: Sequence[Standard], plate: PlateSurface, rig: RigCalibration
) -> tuple[ObservedStandard, ...]:
    """Register every standard on the plate, with the rig as it is known so far.

    Raises
    ------
    FitError
        A standard is not to be seen, or names no target; the message names its capture.
    """
    found = []
    for standard in standards:
        try:
            found.append(ObservedStandard(standard.name, _observed(standard, plate, rig)))
        except FitError as error:
            raise FitError(f"capture {standard.name!r}: {error}") from error
    return tuple(found)


def _observed(standard: Standard, plate: PlateSurface, rig: RigCalibration) -> ArtefactPhase:
    target, phase = standard.target, standard.phase
    if isinstance(target, Strips):
        strips = measure_strips(plate.phase, phase, target, rig.camera)
        return observe_strips(strips, plate.unwrapped_rad, rig)
    if target is None:
        raise FitError("it names no target; name the artefact's")
    return observe_artefact(target, phase.phase.astype(float), phase.valid, rig)


def with_standards(observations: Observations, standards: Sequence[ObservedStandard]) -> Observations:
    """Return the observations of plate and strips with those of all standards."""
    for standard in standards:
        if standard.seen.observations is not None:
            observations = observations.joined(standard.seen.observations)
    return observations


def contradictions(observations: Observations, fit: RigFit) -> tuple[str, ...]:
    """Name every stated height that agrees with the other surfaces only when changed beyond its uncertainty."""
    found = []
    for surface, changes in enumerate(fit.height_changes_u):
        for component, value in zip(observations.components_of(surface), changes, strict=True):
            if abs(value) > CONTRADICTS:
                height = observations.height_mm[surface].value
                found.append(
                    f"The artefacts contradict one another: to agree with the others, the {component.source.text} "
                    f"({height:g} mm) would have to be wrong by {float(value):+z.1f} standard uncertainties. "
                    "Measure it again."
                )
    return tuple(found)
