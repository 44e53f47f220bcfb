"""What an audit found, as its record holds it."""

from collections.abc import Sequence

from fringecal.records import (
    DEFAULT_LIMITS,
    AmountRecord,
    AuditRecord,
    CalibrationUsed,
    CauseRecord,
    ChangeRecord,
    Limits,
    software_versions,
)
from fringecal.uncertainty import EN_DEFINITION, decide
from fringecal.workflows.audit.checks import audit_checks, changes_of
from fringecal.workflows.audit.ranked_causes import CauseFit
from fringecal.workflows.audit.run import Audit
from fringecal.workflows.audit.sentences import amount_unit, audit_sentence
from fringecal.workflows.shared import inputs_of, session_note, severest


def audit_record(
    found: Audit, calibration: CalibrationUsed, *, command: Sequence[str] = (), limits: Limits = DEFAULT_LIMITS
) -> AuditRecord:
    """Return the record of an audit."""
    checks = audit_checks(found, limits)
    return AuditRecord(
        software=software_versions(),
        command=tuple(command),
        session=session_note(found.session),
        inputs=inputs_of(found.session),
        calibration=calibration,
        en_definition=EN_DEFINITION,
        captures=tuple(found.session.captures),
        changed=found.changed,
        probability=found.probability,
        chi2=found.chi2,
        dof=found.change.size,
        changes=_changes(found, limits),
        causes=tuple(_cause(fit) for fit in found.causes),
        verdict=severest(checks),
        checks=checks,
        limits=limits,
        sentence=audit_sentence(found),
        notes=found.notes,
    )


def _changes(found: Audit, limits: Limits) -> tuple[ChangeRecord, ...]:
    return tuple(
        ChangeRecord(
            name=change.name,
            value=change.found.value,
            u=change.found.u,
            dof=change.found.dof,
            unit=change.found.unit,
            en=change.en,
            limit=change.limit,
            detection_limit=change.detection_limit,
            decision=decide(
                change.found.value, change.found.u, lower=-change.limit, upper=change.limit, level=limits.level
            ).outcome,
        )
        for change in changes_of(found, limits)
    )


def _cause(fit: CauseFit) -> CauseRecord:
    amounts = []
    for move, value in fit.amounts.items():
        unit, factor = amount_unit(move)
        amounts.append(AmountRecord(name=move.value, value=factor * value, u=factor * fit.u_amounts[move], unit=unit))
    return CauseRecord(
        name=fit.cause.value,
        amounts=tuple(amounts),
        chi2=fit.chi2,
        dof=fit.dof,
        probability=fit.probability,
        log_evidence=fit.log_evidence,
    )
