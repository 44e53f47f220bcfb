"""What a verification on an artefact found, as its record holds it."""

from collections.abc import Sequence

from fringecal.records import (
    DEFAULT_LIMITS,
    CalibrationUsed,
    Limits,
    ReadingRecord,
    VerificationRecord,
    software_versions,
)
from fringecal.session import Session
from fringecal.uncertainty import EN_DEFINITION
from fringecal.verification import Reading
from fringecal.workflows.shared import budget_rows, inputs_of, session_note
from fringecal.workflows.verify.artefacts import ArtefactVerification
from fringecal.workflows.verify.checks import artefact_checks
from fringecal.workflows.verify.volume_artefacts import VolumeVerification


def artefact_record(
    found: ArtefactVerification | VolumeVerification,
    session: Session,
    calibration: CalibrationUsed,
    *,
    command: Sequence[str] = (),
    limits: Limits = DEFAULT_LIMITS,
) -> VerificationRecord:
    """Return the record of a verification on a flat, steps, a wedge, a box, a sphere or a ball bar."""
    return VerificationRecord(
        software=software_versions(),
        command=tuple(command),
        session=session_note(session),
        inputs=inputs_of(session, only=[found.capture]),
        calibration=calibration,
        en_definition=EN_DEFINITION,
        capture=found.capture.name,
        target=found.target.model_dump(mode="json"),
        height_model=found.height_model,
        readings=tuple(_reading_record(reading) for reading in found.readings),
        sentence=found.sentence,
        checks=artefact_checks(found, limits),
        limits=limits,
        notes=(found.how, *found.probe.notes),
    )


def _reading_record(reading: Reading) -> ReadingRecord:
    return ReadingRecord(
        name=reading.name,
        unit=reading.unit,
        measured=reading.measured,
        reference=reading.reference,
        error=reading.error,
        u_measured=reading.u_measured,
        dof=reading.dof,
        u_reference=reading.u_reference,
        en=reading.en,
        points=reading.points,
        budget=() if reading.budget is None else budget_rows(reading.budget),
    )
