"""The rig from its surfaces: the joint fit, further standards taken in, the projection angle."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from fringecal.calibration.grid_stage import CameraFindings
from fringecal.calibration.plate_flatness import plate_form
from fringecal.calibration.standards import (
    ObservedStandard,
    Standard,
    contradictions,
    observe_standards,
    with_standards,
)
from fringecal.calibration.surfaces import PlateSurface, StripSurfaces, observe_surfaces
from fringecal.phase import PlateLook, Waveform
from fringecal.projector import (
    Observations,
    OrderDecision,
    OriginAngles,
    PlateForm,
    ProjectorPosition,
    RigCalibration,
    RigFit,
    angles_at_origin,
    calibrate_rig,
)
from fringecal.targets import Flat

Progress = Callable[[str], None]

_ROUNDS = 2  # of taking standards in: what the first could not decide, the rig may predict once it knows more


@dataclass(frozen=True)
class Calibrated:
    """A calibration and all that it rests on, in the order in which it was found.

    Parameters
    ----------
    camera
        The camera on the plate, from the grid.
    plate, strips
        The two surfaces, with their phase maps.
    orders
        How the fringe order of the strips of each height was decided.
    observations
        What the rig was fitted to, further standards included.
    rig, fit
        The calibrated rig with its uncertainty, and the fit with its residuals.
    standards
        Further standards.
    stated_projector
        Where the projector is stated to stand, or None.
    origin
        The projection angle at the plate-frame origin: measured, apparent, and in theory.
    """

    camera: CameraFindings
    plate: PlateSurface
    strips: StripSurfaces
    orders: dict[float, OrderDecision]
    observations: Observations
    rig: RigCalibration
    fit: RigFit
    standards: tuple[ObservedStandard, ...]
    stated_projector: ProjectorPosition | None
    origin: OriginAngles

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Name every stated height that the other surfaces do not bear out."""
        return contradictions(self.observations, self.fit)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know of how the rig was found, besides the numbers."""
        orders = [
            f"Fringe order of the {height:g} mm strips: {decision.order:+d} ({decision.reason})."
            for height, decision in self.orders.items()
        ]
        standards = (note for standard in self.standards for note in standard.notes)
        return (*orders, *self.camera.notes, *standards)


def calibrate_surfaces(
    camera: CameraFindings,
    plate: PlateSurface,
    strips: StripSurfaces,
    *,
    standards: Sequence[Standard] = (),
    projector: ProjectorPosition | None = None,
    wave: Waveform | None = None,
    reference: Flat | PlateForm | None = None,
    progress: Progress = lambda _: None,
) -> Calibrated:
    """Fit the rig to plate, strips and further standards, and measure the projection angle.

    Parameters
    ----------
    camera, plate, strips
        As the earlier stages found them.
    standards
        Further artefacts of known heights that take part in the fit.
    projector
        Where the projector is stated to stand.
    wave
        Waveform of the fringes as found on the plate; kept with the rig for later pictures.
    reference
        The plate as its certificate states it, or its form as measured; without one its flatness is not stated.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    FitError
        The surfaces do not determine the rig, or a standard is not to be seen.
    """
    observations, orders = observe_surfaces(plate, strips, camera.fit.camera)
    observations = replace(observations, form=plate_form(reference, camera.fit.camera))
    progress("joint fit of the rig")
    rig, fit, observations, seen = _fitted(camera, plate, observations, standards, projector, progress)
    rig = replace(rig, wave=wave, orders=plate.orders, look=PlateLook.of(plate.phase))
    progress("projection angle")
    return Calibrated(
        camera=camera.on_plate(observations.form),
        plate=plate,
        strips=strips,
        orders=orders,
        observations=observations,
        rig=rig,
        fit=fit,
        standards=seen,
        stated_projector=projector,
        origin=angles_at_origin(rig, projector),
    )


type Fitted = tuple[RigCalibration, RigFit, Observations, tuple[ObservedStandard, ...]]


def _fitted(  # noqa: PLR0913, PLR0917 -- private: what `calibrate_surfaces` was asked for
    camera: CameraFindings,
    plate: PlateSurface,
    basis: Observations,
    standards: Sequence[Standard],
    projector: ProjectorPosition | None,
    progress: Progress,
) -> Fitted:
    """Fit the rig; where there are further standards, find them with it and fit once more."""
    near = None if projector is None else projector.value_mm

    def solve(observed: Observations) -> tuple[RigCalibration, RigFit]:
        return calibrate_rig(
            observed, camera.fit, projector_near=near, phase_sigma_rad=plate.noise_rad, progress=progress
        )

    rig, fit = solve(basis)
    if not standards:
        return rig, fit, basis, ()
    progress("further artefacts")
    observations = basis
    seen: tuple[ObservedStandard, ...] = ()
    for _ in range(_ROUNDS):
        seen = observe_standards(standards, plate, rig)
        observations = with_standards(basis, seen)
        rig, fit = solve(observations)
        if not any(standard.seen.left_out for standard in seen):
            break
    return rig, fit, observations, seen
