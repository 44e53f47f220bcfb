"""From the captures of a session to a calibrated rig: phase maps are made here, all stages are `calibration`'s."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
from fringecal.numerics import wrap
from fringecal.session import Capture, Session
from fringecal.targets import Flat, Strips
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
    position = None if stated is None else stated.value_mm
    target = strips_target(strips.capture)
    try:
        return strips_on_plate(plate, strips.map, target, camera, projector_mm=position, progress=progress)
    except DetectionError as error:
        posed = _pose_of_plate(plate, strips)
        if posed:
            raise DetectionError(
                f"the pictures of {reference.capture.name!r} are {posed} against those of {strips.capture.name!r}: the "
                "bare plate has the same phase then. Take both captures from the same camera without turning the files"
            ) from error
        raise caused_by_frames(error, reference, strips) from error
    except FitError as error:
        turned = None if position is None else _turned_projector(plate, strips, target, camera, position)
        if turned is None:
            raise
        raise FitError(f"{error} {turned}") from error


_POSES = {
    "mirrored left to right": np.s_[:, ::-1],
    "mirrored top to bottom": np.s_[::-1, :],
    "turned by 180 deg": np.s_[::-1, ::-1],
}
_SAME_RAD = 0.35  # phase between two captures up to which a pixel shows the same plate
_MOSTLY, _FAR_MORE = 0.3, 2.0  # of the pixels that then do so, and times as many as in the pictures as they are


def _pose_of_plate(plate: PlateSurface, strips: CapturePhase) -> str | None:
    """Say how the plate's pictures are turned over, if they show the same plate then as those of the strips."""
    both = [_same(plate.phase.phase, plate.phase.valid, strips)]
    both += [_same(plate.phase.phase[pose], plate.phase.valid[pose], strips) for pose in _POSES.values()]
    best = int(np.argmax(both[1:]))
    found = both[1 + best] > max(_MOSTLY, _FAR_MORE * both[0])
    return list(_POSES)[best] if found else None


def _same(phase: NDArray, valid: NDArray[np.bool_], strips: CapturePhase) -> float:
    """Return the share of pixels at which a phase is that of the strips' capture."""
    known = valid & strips.map.valid
    return float(np.mean(np.abs(wrap(strips.map.phase - phase))[known] < _SAME_RAD)) if known.any() else 0.0


def _turned_projector(
    plate: PlateSurface, strips: CapturePhase, target: Strips, camera: PlateCamera, position_mm: NDArray
) -> str | None:
    """Say by how much the stated projector would have to be turned about the camera's axis to fit the pictures."""
    x, y, z = position_mm
    for degrees, turned in ((90, (-y, x, z)), (180, (-x, -y, z)), (270, (y, -x, z))):
        try:
            strips_on_plate(plate, strips.map, target, camera, projector_mm=np.array(turned))
        except (DetectionError, FitError):
            continue
        return (
            f"They fit a projector at {turned[0]:.0f}, {turned[1]:.0f}, {turned[2]:.0f} mm, the stated one turned by "
            f"{degrees} deg: are all pictures turned, or x and y of its position exchanged?"
        )
    return None
