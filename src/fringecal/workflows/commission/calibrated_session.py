"""From the captures of a session to a calibrated rig: phase maps are made here, all stages are `calibration`'s."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from fringecal.calibration import (
    Calibrated,
    CameraFindings,
    PlateSurface,
    Standard,
    StripSurfaces,
    calibrate_surfaces,
    plate_surface,
    strips_on_plate,
)
from fringecal.camera import PlateCamera
from fringecal.errors import DetectionError, FitError, SessionError
from fringecal.session import Capture, Session
from fringecal.targets import Flat
from fringecal.workflows.commission.camera import measure_camera
from fringecal.workflows.commission.further import further_captures, strips_captures, strips_target
from fringecal.workflows.shared import CapturePhase, caused_by_frames, phase_of_capture, projector_of, too_few_pixels

Progress = Callable[[str], None]


@dataclass(frozen=True)
class CalibratedSession:
    """A session's calibration: the phase of the captures that it rests on, and what the stages found."""

    session: Session
    reference: CapturePhase
    strips: CapturePhase
    result: Calibrated


def calibrate_session(
    session: Session, *, camera: CameraFindings | None = None, progress: Progress = lambda _: None
) -> CalibratedSession:
    """Calibrate a rig from a session that holds a grid, the bare plate and strips.

    Parameters
    ----------
    session
        A checked session with captures of kind grid, reference and strips. Artefacts that state
        use = "calibration" take part in the fit.
    camera
        The camera on the plate, where it is already known; the session then needs no grid.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    SessionError
        A capture that is needed is missing.
    DetectionError, PhaseError, FitError
        What the pictures do not show or determine, with the reason.
    """
    _demand(session, *(() if camera else ("grid",)), "reference", "strips")
    if camera is None:
        progress("finding the grid and fitting the camera")
        camera = measure_camera(session)
    progress("phase of the bare plate")
    reference = phase_of_capture(session.one("reference"))
    plate = _plate(reference)
    progress("phase of the strips")
    wave = reference.adapted.found_wave
    strips_capture = phase_of_capture(strips_captures(session)[0], wave=wave)
    strips = _strips(session, plate, reference, strips_capture, camera.fit.camera, progress)
    further = tuple(phase_of_capture(capture, wave=wave) for capture in further_captures(session))
    result = calibrate_surfaces(
        camera,
        plate,
        strips,
        standards=[Standard(one.capture.name, one.capture.target, one.map) for one in further],
        projector=projector_of(session),
        wave=wave,
        reference=_flat(reference.capture),
        progress=progress,
    )
    return CalibratedSession(session, reference, strips_capture, _with_shifts(result, reference))


def _with_shifts(result: Calibrated, reference: CapturePhase) -> Calibrated:
    """Keep the phase shifts of the plate's frames with how it looked, for later captures."""
    look = result.rig.look
    if look is None:
        return result
    kept = replace(look, phase_shifts_rad=tuple(map(float, reference.phase_shifts_rad)))
    return replace(result, rig=replace(result.rig, look=kept))


def _demand(session: Session, *kinds: str) -> None:
    missing = [kind for kind in kinds if not session.find(kind)]
    if missing:
        raise SessionError(
            [f"no capture of kind {kind!r}: commissioning needs one; add it to session.toml" for kind in missing]
        )


def _flat(reference: Capture) -> Flat | None:
    """Return what the session states of its plate."""
    return reference.target if isinstance(reference.target, Flat) else None


def _plate(reference: CapturePhase) -> PlateSurface:
    """Unwrap the plate; where it hangs together nowhere, say first why so few pixels carry fringes."""
    try:
        return plate_surface(reference.map)
    except FitError as error:
        raise FitError("".join(too_few_pixels(reference)) or str(error)) from error


def _strips(  # noqa: PLR0913, PLR0917 -- private: what the stages before have found
    session: Session,
    plate: PlateSurface,
    reference: CapturePhase,
    strips: CapturePhase,
    camera: PlateCamera,
    progress: Progress,
) -> StripSurfaces:
    """Find the strips; where they do not show, say first what is wrong with the frames."""
    stated = projector_of(session)
    try:
        return strips_on_plate(
            plate,
            strips.map,
            strips_target(strips.capture),
            camera,
            projector_mm=None if stated is None else stated.value_mm,
            progress=progress,
        )
    except DetectionError as error:
        raise caused_by_frames(error, reference, strips) from error
