"""The audit record: a smaller session against the calibration in force, what changed, and what probably moved."""

from pathlib import Path
from typing import Final, Literal

from pydantic import Field

from fringecal.records.documents import read_document, write_document
from fringecal.records.limits import Limits
from fringecal.records.parts import Check, Dof, Part, Provenance, Uncertainty
from fringecal.records.verification_record import CalibrationUsed

AUDIT_FORMAT: Final = "fringecal-audit/1"
AUDIT_FILE = "audit.json"


class ChangeRecord(Part):
    """One quantity today minus at the calibration.

    `detection_limit` is the smallest change that is seen with 95 % at the audit's chance of a false alarm.
    """

    name: str
    value: float
    u: Uncertainty
    dof: Dof = None
    unit: str
    en: float | None = None
    limit: float = Field(gt=0)
    detection_limit: float = Field(ge=0)
    decision: Literal["pass", "conditionalPass", "conditionalFail", "fail"]


class AmountRecord(Part):
    """By how much one thing would have moved under a cause."""

    name: str
    value: float
    u: Uncertainty
    unit: str


class CauseRecord(Part):
    """One cause: how well it explains the change by itself.

    `probability` is that of a chi-squared as large as `chi2` if the cause is right; `log_evidence` compares causes.
    """

    name: str
    amounts: tuple[AmountRecord, ...]
    chi2: float = Field(ge=0)
    dof: int = Field(ge=1)
    probability: float = Field(ge=0, le=1)
    log_evidence: float


class AuditRecord(Provenance):
    """The audit of a rig, as written to ``audit.json``."""

    format: Literal["fringecal-audit/1"] = AUDIT_FORMAT
    calibration: CalibrationUsed
    captures: tuple[str, ...] = Field(description="what was there decides what could be said")
    changed: bool = Field(description="whether the rig differs from its calibration by more than chance explains")
    probability: float = Field(ge=0, le=1, description="chance of such a change on an unchanged rig")
    chi2: float = Field(ge=0)
    dof: int = Field(ge=1)
    changes: tuple[ChangeRecord, ...] = ()
    causes: tuple[CauseRecord, ...] = Field(default=(), description="single causes, the likeliest first")
    verdict: Literal["pass", "conditionalPass", "conditionalFail", "fail", "info"]
    checks: tuple[Check, ...] = ()
    limits: Limits | None = Field(default=None, description="what was judged by; null in records of older versions")
    sentence: str = ""
    notes: tuple[str, ...] = ()


def read_audit(path: str | Path) -> AuditRecord:
    """Read an audit record from its file, or from the folder that holds it.

    Raises
    ------
    RecordError
        The file is missing, not JSON, of another or a newer format, or lacks a key.
    """
    return read_document(path, AuditRecord, AUDIT_FORMAT, file_name=AUDIT_FILE)


def write_audit(record: AuditRecord, folder: str | Path) -> Path:
    """Write ``audit.json`` into a folder, whole or not at all, and return its path."""
    return write_document(record, Path(folder) / AUDIT_FILE)
