"""Commission a rig: calibrate it from grid, plate and strips, then judge it by all else that the session holds."""

from collections.abc import Callable
from dataclasses import dataclass

from fringecal.calibration import CameraKnowledge, WrongStatement, wrong_statements
from fringecal.projector import Advice, advise
from fringecal.session import Session
from fringecal.uncertainty import Estimate
from fringecal.workflows.commission.angle_findings import AngleFindings, angles_of
from fringecal.workflows.commission.calibrated_session import CalibratedSession, calibrate_session
from fringecal.workflows.commission.camera import stated_height
from fringecal.workflows.commission.plate_repeats import PlateRepeats, plate_repeats
from fringecal.workflows.shared import CaptureDiagnosis, assumption_sentences, diagnose_capture
from fringecal.workflows.verify import Verified, verify_session

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Commissioning:
    """A calibrated session and what judges it.

    Parameters
    ----------
    calibrated
        The session's calibration.
    angles
        The projection angle by columns and rows, and the projector against its stated position.
    diagnosed
        What the diagnostics find in the frames of plate and strips.
    repeats
        What repeats of the bare plate show; None where it was taken once.
    verified
        Artefacts that took no part in the fit, measured with its result.
    advice
        The predicted uncertainty of heights, and the gain by one more artefact.
    wrong
        What would follow from each statement on which heights rest, if it were wrong.
    """

    calibrated: CalibratedSession
    angles: AngleFindings
    diagnosed: tuple[CaptureDiagnosis, ...]
    repeats: PlateRepeats | None
    verified: Verified
    advice: Advice
    wrong: tuple[WrongStatement, ...] = ()

    @property
    def height_stated(self) -> Estimate | None:
        """The camera's height as the session states it, mm."""
        return stated_height(self.calibrated.session)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the record should know besides the numbers."""
        result, moved = self.calibrated.result, self.angles.displacement
        projector = () if moved is None or moved.agrees else (moved.sentence(),)
        return (
            *result.notes,
            *result.contradictions,
            *projector,
            result.origin.sentence,
            *assumption_sentences(result.rig),
            *self.verified.sentences,
        )


def commission(session: Session, *, progress: Progress = lambda _: None) -> Commissioning:
    """Calibrate a rig from a session that holds a grid, the bare plate and strips, and verify it on what else is there.

    Parameters
    ----------
    session
        A checked session with captures of kind grid, reference and strips. Artefacts that state
        use = "calibration" take part in the fit; all others are measured with its result.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    SessionError
        A capture that is needed is missing.
    DetectionError, PhaseError, FitError
        What the pictures do not show or determine, with the reason.
    """
    return judged_session(calibrate_session(session, progress=progress), progress=progress)


def judged_session(found: CalibratedSession, *, progress: Progress = lambda _: None) -> Commissioning:
    """Judge a calibrated session by its frames, its repeats and its independent artefacts.

    Parameters
    ----------
    found
        The session's calibration.
    progress
        Called with a short sentence before each step.
    """
    result = found.result
    progress("projection angle column by column")
    angles = angles_of(found)
    progress("diagnostics of the frames")
    diagnosed = _examined(found)
    repeats = plate_repeats(found.reference, result.plate.unwrapped_rad, result.rig)
    verified = verify_session(found.session, result.rig, progress=progress)
    progress("gain by one more artefact")
    advice = advise(result.observations, result.camera.fit, result.fit, noise_rad=result.plate.noise_rad)
    progress("what wrong statements would have shown")
    wrong = wrong_statements(result, _known(found))
    return Commissioning(found, angles, diagnosed, repeats, verified, advice, wrong)


def _known(found: CalibratedSession) -> CameraKnowledge:
    """Return what was stated of the camera, with the lens as it was found."""
    stated = found.session.camera
    return CameraKnowledge(stated_height(found.session), stated.telecentric, found.result.camera.lens)


def _examined(found: CalibratedSession) -> tuple[CaptureDiagnosis, ...]:
    plate, strips, rig = found.reference, found.strips, found.result.rig
    same = plate.capture.phase_shifts_rad == strips.capture.phase_shifts_rad
    return (diagnose_capture(plate, rig), diagnose_capture(strips, rig, plate=plate.capture if same else None))
