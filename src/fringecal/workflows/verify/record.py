"""What a verification on angle bars found, as its record holds it."""

from collections.abc import Sequence

from fringecal.records import (
    DEFAULT_LIMITS,
    CalibrationUsed,
    FilterRow,
    Limits,
    ModelRow,
    ProfileRecord,
    VerificationRecord,
    software_versions,
)
from fringecal.session import Session
from fringecal.uncertainty import EN_DEFINITION
from fringecal.verification import ProfileErrors, ZigzagErrors
from fringecal.workflows.shared import findings_of, inputs_of, plate_beside, session_note
from fringecal.workflows.verify.checks import verification_checks
from fringecal.workflows.verify.run import Verification


def verification_record(
    found: Verification,
    session: Session,
    calibration: CalibrationUsed,
    *,
    command: Sequence[str] = (),
    limits: Limits = DEFAULT_LIMITS,
) -> VerificationRecord:
    """Return the record of a verification on a zig-zag."""
    errors = found.errors
    return VerificationRecord(
        software=software_versions(),
        command=tuple(command),
        session=session_note(session),
        inputs=inputs_of(session, only=(found.capture, plate_beside(session, found.capture))),
        calibration=calibration,
        en_definition=EN_DEFINITION,
        capture=found.capture.name,
        target=found.target.model_dump(mode="json"),
        full_height_mm=errors.full_height_mm,
        edge_zone_mm=errors.edge_zone_mm,
        height_model="projective",
        profiles=tuple(_profile_record(p) for p in errors.profiles),
        profiles_with_edges=tuple(_profile_record(p) for p in errors.profiles_with_edges),
        models=tuple(_model_row(name, e) for name, e in found.models.items()),
        filters=tuple(
            FilterRow(before=f.before, after=f.after, rank=f.rank, **_pooled(f.errors)) for f in found.filters
        ),
        sentence=errors.sentence,
        checks=verification_checks(found, limits),
        limits=limits,
        findings=findings_of(found.diagnosed),
        notes=(found.phase.sentence(), *found.diagnosed.sentences()),
    )


def _profile_record(profile: ProfileErrors) -> ProfileRecord:
    return ProfileRecord(**{key: getattr(profile, key) for key in ProfileRecord.model_fields})


def _pooled(errors: ZigzagErrors) -> dict[str, float]:
    keys = ("mean_mm", "sd_mm", "max_abs_mm", "mean_percent", "max_percent")
    return {key: float(getattr(errors.pooled, key)) for key in keys}


def _model_row(name: str, errors: ZigzagErrors) -> ModelRow:
    return ModelRow(model=name, **_pooled(errors))
