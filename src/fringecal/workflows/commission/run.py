"""Commission a rig: grid, plate and strips in; camera, rig model, projection angle and their budgets out."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import CameraFit
from fringecal.detect import GridDetection
from fringecal.errors import DetectionError, SessionError
from fringecal.phase import PlateOrders
from fringecal.projector import (
    Advice,
    ColumnAngle,
    Displacement,
    Observations,
    OrderDecision,
    RigCalibration,
    RigFit,
    StripPhase,
    advise,
    angles_at_origin,
    both_axes,
    calibrate_rig,
    explained,
    fringe_pitch_mm,
    measure_strips,
    order_strips,
    phase_breaks,
)
from fringecal.session import Session
from fringecal.uncertainty import Estimate
from fringecal.workflows.commission.camera import CameraFindings, measure_camera
from fringecal.workflows.commission.further import (
    FurtherArtefact,
    contradictions,
    further_captures,
    observe_further,
    phases_of,
    strips_captures,
    strips_target,
    with_further,
)
from fringecal.workflows.commission.observed_surfaces import measured_step, observe_surfaces, whole_plate
from fringecal.workflows.commission.plate_repeats import PlateRepeats, plate_repeats
from fringecal.workflows.shared import (
    CapturePhase,
    Examination,
    displaced,
    examine,
    phase_of_capture,
    projector_of,
    with_causes,
)
from fringecal.workflows.verify import Verified, verify_session

Array = NDArray[np.float64]
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Commissioning:
    """Everything that commissioning a rig has found, in the order in which it was found."""

    session: Session
    camera: CameraFindings
    reference: CapturePhase
    strips_capture: CapturePhase
    strips: StripPhase
    orders: dict[float, OrderDecision]
    observations: Observations
    calibration: RigCalibration
    fit: RigFit
    angle: Estimate
    angle_budget: dict[str, float]
    apparent: Estimate
    theory: Estimate | None
    pitch_mm: float
    plate_phase_rad: Array
    further: tuple[FurtherArtefact, ...] = ()

    @property
    def angle_en(self) -> float | None:
        """Measured against theoretical angle at the origin: difference over expanded uncertainties (k = 2)."""
        if self.theory is None:
            return None
        return (self.angle.value - self.theory.value) / (2 * math.hypot(self.angle.u, self.theory.u))

    @property
    def angle_sentence(self) -> str:
        """Say plainly whether the measured geometry agrees with the stated one."""
        if self.theory is None or self.angle_en is None:
            return "The session states no projector position: the angle has nothing to be compared with."
        difference = self.angle.value - self.theory.value
        if abs(self.angle_en) <= 1:
            return (
                f"The measured geometry agrees with the stated one ({difference:+z.2f} deg, En {self.angle_en:+z.2f})."
            )
        return (
            f"The measured angle differs from the stated geometry by {difference:+z.2f} deg "
            f"(En {self.angle_en:+z.2f}): the projector stands elsewhere, or the strips are not as high as their "
            "target says."
        )

    @cached_property
    def displacement(self) -> Displacement | None:
        """Where the projector stands against where it is said to; None without a stated position, or a source."""
        return displaced(self.calibration, projector_of(self.session))

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the record should know besides the numbers."""
        orders = [
            f"Fringe order of the {height:g} mm strips: {decision.order:+d} ({decision.reason})."
            for height, decision in self.orders.items()
        ]
        further = (note for artefact in self.further for note in artefact.notes)
        moved = () if self.displacement is None or self.displacement.agrees else (self.displacement.sentence(),)
        rest = (*self.contradictions, *moved, self.angle_sentence, *self.verified.sentences)
        return (*orders, *self.camera.notes, *further, *rest)

    @cached_property
    def columns(self) -> tuple[ColumnAngle, ...]:
        """The angle that the strips' breaks show column by column; computed when first asked for."""
        labels = self.strips.regions.labels
        breaks = phase_breaks(self.calibration, self.observations, labels, surfaces=len(self.orders))
        return both_axes(self.calibration, breaks, projector=projector_of(self.session))[0]

    @cached_property
    def examined(self) -> tuple[Examination, ...]:
        """What the doctor finds in plate and strips; looked for when first asked."""
        plate, strips = self.reference, self.strips_capture
        same = plate.capture.steps_rad == strips.capture.steps_rad
        beside = plate.capture if same else None
        return (examine(plate, self.calibration), examine(strips, self.calibration, plate=beside))

    @cached_property
    def repeats(self) -> PlateRepeats | None:
        """What repeats of the bare plate show; None where it was taken once. Computed when first asked for."""
        return plate_repeats(self.reference, self.plate_phase_rad, self.calibration)

    @cached_property
    def verified(self) -> Verified:
        """Artefacts that took no part in the fit, measured with its result; when first asked for."""
        return verify_session(self.session, self.calibration)

    @cached_property
    def advice(self) -> Advice:
        """What heights will be known to, and what one more artefact would buy; computed when first asked for."""
        noise = float(np.nanmedian(self.reference.map.sigma[self.reference.map.valid]))
        return advise(self.observations, self.camera.fit, self.fit, noise_rad=noise)

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Name every stated height that the other artefacts do not bear out."""
        return contradictions(self.observations, self.fit)

    @property
    def camera_fit(self) -> CameraFit:
        """The camera on the plate as the grid gives it."""
        return self.camera.fit

    @property
    def detection(self) -> GridDetection:
        """The grid as found in its picture."""
        return self.camera.detection


def commission(session: Session, *, progress: Progress = lambda _: None) -> Commissioning:
    """Calibrate a rig from a session that holds a grid, the bare plate and strips, and verify it on what else is there.

    Parameters
    ----------
    session
        A checked session with captures of kind grid, reference and strips. Artefacts that state
        use = "calibration" take part in the fit; all others are measured with its result when that is asked for.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    SessionError
        A capture that is needed is missing.
    DetectionError, PhaseError, FitError
        What the pictures do not show or determine, with the reason.
    """
    _demand(session, "grid", "reference", "strips")
    progress("finding the grid and fitting the camera")
    camera = measure_camera(session)
    progress("phase of the bare plate")
    reference = phase_of_capture(session.one("reference"))
    plate_phase = whole_plate(reference)
    progress("phase of the strips")
    capture = strips_captures(session)[0]
    wave = reference.adapted.found_wave
    strips_capture = phase_of_capture(capture, wave=wave)
    target = strips_target(capture)
    stated = projector_of(session)
    near = None if stated is None else stated.value_mm
    try:
        strips = measure_strips(reference.map, strips_capture.map, target, camera.fit.camera)
    except DetectionError as error:
        height = float(np.mean(target.height_mm.array(target.count)))
        explanation = explained(error, plate_phase, camera.fit.camera, height, near)
        raise with_causes(explanation, reference, strips_capture) from error
    progress("fringe order of the strips")
    ordered = order_strips(
        plate_phase,
        strips,
        camera.fit.camera,
        projector_mm=near,
        measured=measured_step(strips_capture.map, reference.map),
    )
    observations, orders = observe_surfaces(plate_phase, strips, ordered)
    progress("joint fit of the rig")
    noise = float(np.nanmedian(reference.map.sigma[reference.map.valid]))

    def solve(observed: Observations) -> tuple[RigCalibration, RigFit]:
        return calibrate_rig(observed, camera.fit, projector_near=near, phase_sigma_rad=noise, progress=progress)

    calibration, fit = solve(observations)
    further: tuple[FurtherArtefact, ...] = ()
    if phases := phases_of(further_captures(session), wave=wave):
        progress("further artefacts")
        basis = observations
        # A second round: what the first could not decide, the rig may predict once it knows more.
        for _ in range(2):
            further = observe_further(phases, reference, plate_phase, calibration)
            observations = with_further(basis, further)
            calibration, fit = solve(observations)
            if not any(artefact.seen.left_out for artefact in further):
                break
    progress("projection angle")
    captures = (reference, strips_capture)
    counted = None if reference.orders is None else PlateOrders.of(reference.orders, plate_phase)
    calibration = replace(calibration, wave=wave, orders=counted)
    found = _angles(session, camera, captures, strips, orders, observations, calibration, fit, plate_phase)
    return replace(found, further=further)


def _demand(session: Session, *kinds: str) -> None:
    missing = [kind for kind in kinds if not session.find(kind)]
    if missing:
        raise SessionError(
            [f"no capture of kind {kind!r}: commissioning needs one; add it to session.toml" for kind in missing]
        )


def _angles(  # noqa: PLR0913, PLR0917 -- private: gathers what commissioning found
    session: Session,
    camera: CameraFindings,
    captures: tuple[CapturePhase, CapturePhase],
    strips: StripPhase,
    orders: dict[float, OrderDecision],
    observations: Observations,
    calibration: RigCalibration,
    fit: RigFit,
    plate_phase: Array,
) -> Commissioning:
    origin = angles_at_origin(calibration, projector_of(session))
    return Commissioning(
        session=session,
        camera=camera,
        reference=captures[0],
        strips_capture=captures[1],
        strips=strips,
        orders=orders,
        observations=observations,
        calibration=calibration,
        fit=fit,
        angle=origin.angle,
        angle_budget=origin.budget,
        apparent=origin.apparent,
        theory=origin.theory,
        pitch_mm=float(fringe_pitch_mm(calibration.model)),
        plate_phase_rad=plate_phase,
    )
