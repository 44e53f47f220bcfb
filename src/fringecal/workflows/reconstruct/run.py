"""Measure an object with a calibrated rig."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fringecal.errors import FitError, SessionError
from fringecal.projector import RigCalibration
from fringecal.reconstruct import (
    CaptureHeld,
    HeightMap,
    Reason,
    VisiblePlate,
    capture_held,
    reconstruct_height,
    surface_over_plate,
    tied_to_plate,
    visible_plate,
)
from fringecal.session import Capture, Session
from fringecal.workflows.reconstruct.capture_causes import causes_of
from fringecal.workflows.shared import (
    UNTREATED,
    CaptureDiagnosis,
    CapturePhase,
    Treatment,
    demand_same_picture,
    diagnose_capture,
    effect_on_phase,
    filtered_heights,
    filtered_phase,
    frames_of,
    minus_plate,
    phase_of_capture,
    plate_beside,
)

_NEAR_RAD = 0.9  # phase within which plate is looked for: a seventh of a fringe, so that a plate 1 mm off is seen
_TEST_RAD = 1e-3


@dataclass(frozen=True)
class Measurement:
    """An object's surface, the phase it was computed from, the calibration that was applied, and how both agree.

    `tied` is the plate in view whose plane was taken off the heights; None where they are as measured.
    `height_range_mm` are the heights that were stated.
    """

    capture: Capture
    phase: CapturePhase
    diagnosed: CaptureDiagnosis
    surface: HeightMap
    calibration: RigCalibration
    model: str
    held: CaptureHeld
    treatment: Treatment = UNTREATED
    tied: VisiblePlate | None = None
    height_range_mm: tuple[float, float] | None = None

    def shares(self) -> dict[str, float]:
        """Return the share of valid pixels and of every reason for which others were masked."""
        reasons = self.surface.reasons
        masked = {r.name.lower(): float(np.mean((reasons & r) > 0)) for r in Reason if r.name}
        return {"valid": float(np.mean(self.surface.mask))} | masked


def reconstruct(
    session: Session,
    capture_name: str | None,
    calibration: RigCalibration,
    *,
    model: str = "projective",
    height_range_mm: tuple[float, float] | None = None,
    treatment: Treatment = UNTREATED,
    tie_to_plate: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Measurement:
    """Reconstruct the surface of an object capture.

    Parameters
    ----------
    session, capture_name
        The session, and the capture; None takes the only one of kind object.
    calibration
        The rig's calibration.
    model
        Name of a height model.
    height_range_mm
        Heights the object can have, where known: pixels beyond are masked.
    treatment
        Filters before and after, and whether the plate's own measured heights are subtracted.
    tie_to_plate
        Take the plane of the plate that is seen beside the object off the heights, with its uncertainty.

    Raises
    ------
    SessionError
        No such capture, pictures of another size, or no capture of the plate to be subtracted.
    PhaseError, FitError
        No phase in the frames, or nothing whose fringe order could be decided.
    """
    capture = session.one("object") if capture_name is None else session.named(capture_name)
    demand_same_picture(capture, calibration)
    progress(f"phase of {capture.name}")
    phase = phase_of_capture(capture, wave=calibration.wave)
    progress(f"heights of {capture.name}")
    seen = filtered_phase(phase, treatment.before)
    weights = phase.adapted.scheme.weights
    held = capture_held(phase.map, calibration, frames=frames_of(capture), weights=weights)
    if tie_to_plate:
        surface = surface_over_plate(seen, calibration, held.sample, model=model, height_range_mm=height_range_mm)
    else:
        surface = reconstruct_height(seen, calibration, model=model, height_range_mm=height_range_mm)
    if treatment.minus_plate:
        progress("heights of the plate")
        surface = minus_plate(surface, _plate_surface(session, capture, calibration, model, treatment.before))
    effect = effect_on_phase(phase, treatment.before)
    surface = filtered_heights(surface, treatment.after, before=effect, sigma_rad=seen.sigma)
    if not surface.mask.any():
        named = " ".join(f"It looks as if {cause}." for cause in causes_of(held, refused=True))
        raise FitError(" ".join(filter(None, (_nothing_measured(capture.name, height_range_mm), named))))
    tied = _plate_of(capture.name, surface, calibration) if tie_to_plate else None
    surface = surface if tied is None else tied_to_plate(surface, tied, calibration)
    diagnosed = diagnose_capture(phase, calibration, plate=plate_beside(session, capture))
    return Measurement(capture, phase, diagnosed, surface, calibration, model, held, treatment, tied, height_range_mm)


def _plate_surface(
    session: Session, capture: Capture, calibration: RigCalibration, model: str, before: str
) -> HeightMap:
    """Measure the bare plate as the object is measured.

    Raises
    ------
    SessionError
        The session holds no capture of the plate with the same phase shifts, or several.
    """
    plate = plate_beside(session, capture)
    if plate is None:
        raise SessionError(
            [
                f"capture {capture.name!r}: no single capture of the bare plate (kind reference) with the same phase "
                "shifts was found to subtract; add one, or measure without subtracting the plate"
            ]
        )
    phase = phase_of_capture(plate, wave=calibration.wave)
    return reconstruct_height(filtered_phase(phase, before), calibration, model=model)


def near_plate_mm(calibration: RigCalibration) -> float:
    """Return the height within which plate is looked for: a seventh of a fringe in the middle of the picture."""
    rays = calibration.camera.rays(*(np.array([c]) for c in calibration.camera.centre_px))
    phase = calibration.model.phase(rays.ax, rays.ay, 0.0)
    return _NEAR_RAD / _TEST_RAD * abs(float(calibration.model.height(phase + _TEST_RAD, rays)[0]))


def _plate_of(name: str, surface: HeightMap, calibration: RigCalibration) -> VisiblePlate:
    """Return the plate beside the object.

    Raises
    ------
    FitError
        Too little of it is seen.
    """
    plate = visible_plate(surface, near_plate_mm(calibration))
    if plate is None:
        raise FitError(
            f"capture {name!r}: too little of the plate is seen beside the object to tie heights to it; leave more of "
            "it visible, or measure without --tie-to-plate"
        )
    return plate


def _nothing_measured(name: str, height_range_mm: tuple[float, float] | None) -> str:
    if height_range_mm is not None:
        low, high = height_range_mm
        return (
            f"capture {name!r}: no part of the surface lies between the stated {low:g} and {high:g} mm; state the "
            "heights above the plate that the object can have, or none."
        )
    return (
        f"capture {name!r}: no part of the picture could be given a fringe order, as no connected part of it shows the "
        "plate where the calibration has it. Leave some plate visible beside the object, state its height range, or "
        "check that plate and camera have not moved and that the frames are in their order."
    )
