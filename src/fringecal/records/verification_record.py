"""The verification record: a measured artefact against its certificate, profile by profile."""

from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import Field

from fringecal.records.board_calibration import BoardCalibrationRecord
from fringecal.records.calibration_record import CalibrationRecord
from fringecal.records.documents import read_document, write_document
from fringecal.records.limits import Limits
from fringecal.records.parts import BudgetRow, Check, Dof, Part, Provenance, Sha256, Uncertainty
from fringecal.records.phase_record import FindingRecord

VERIFICATION_FORMAT: Final = "fringecal-verification/1"
VERIFICATION_FILE = "verification.json"


class ProfileRecord(Part):
    """Height error along one picture row; percentages are of the artefact's full height.

    `u_mm` is the standard uncertainty of `mean_mm`, `dof` its degrees of freedom; `en` the En score of that mean.
    """

    name: str
    row_px: float
    y_mm: float
    n: int = Field(ge=0)
    mean_mm: float
    sd_mm: float = Field(ge=0)
    max_abs_mm: float = Field(ge=0)
    mean_percent: float
    max_percent: float = Field(ge=0)
    u_mm: Uncertainty
    en: float | None = None
    dof: Dof = None


class ModelRow(Part):
    """One height model's error over all profiles."""

    model: str
    mean_mm: float
    sd_mm: float = Field(ge=0)
    max_abs_mm: float = Field(ge=0)
    mean_percent: float
    max_percent: float = Field(ge=0)


class FilterRow(Part):
    """One combination of filters before and after the phase: its error and its rank (1 is best)."""

    before: str
    after: str
    mean_mm: float
    sd_mm: float = Field(ge=0)
    max_abs_mm: float = Field(ge=0)
    mean_percent: float
    max_percent: float = Field(ge=0)
    rank: int = Field(ge=1)


class ReadingRecord(Part):
    """One number of an artefact beside its certificate.

    `u_measured` is null for a form error, which contains the noise by definition; `reference` where the certificate
    says nothing. `dof` is that of `u_measured`.
    """

    name: str
    unit: str
    measured: float
    reference: float | None = None
    error: float | None = None
    u_measured: Uncertainty | None = None
    dof: Dof = None
    u_reference: Uncertainty = 0.0
    en: float | None = None
    points: int = Field(ge=1)
    budget: tuple[BudgetRow, ...] = ()


class CalibrationUsed(Part):
    """Which calibration was judged: its file and hash, and when it was made."""

    file: str
    sha256: Sha256
    created: str = ""

    @classmethod
    def of(cls, calibration: CalibrationRecord | BoardCalibrationRecord, file: Path) -> Self:
        """Name a calibration by the hash of the very bytes that it was read from, whatever `file` holds by now.

        Raises
        ------
        ValueError
            The record was not read from a file.
        """
        return cls(file=file.name, sha256=calibration.file_sha256)


class VerificationRecord(Provenance):
    """The verification of a rig on an artefact, as written to ``verification.json``."""

    format: Literal["fringecal-verification/1"] = VERIFICATION_FORMAT
    calibration: CalibrationUsed
    capture: str
    target: dict[str, Any] = Field(description="full content of the artefact's target file")
    full_height_mm: float | None = Field(default=None, gt=0, description="height that the percentages refer to")
    edge_zone_mm: float | None = Field(default=None, ge=0, description="left out beside every ridge and valley")
    height_model: str
    readings: tuple[ReadingRecord, ...] = Field(default=(), description="artefacts other than angle bars")
    profiles: tuple[ProfileRecord, ...] = Field(default=(), description="of angle bars, edge zones left out")
    profiles_with_edges: tuple[ProfileRecord, ...] = ()
    models: tuple[ModelRow, ...] = ()
    filters: tuple[FilterRow, ...] = ()
    sentence: str = Field(default="", description="what the numbers say, the dominant error first")
    checks: tuple[Check, ...] = ()
    limits: Limits | None = Field(default=None, description="what was judged by; null in records of older versions")
    findings: tuple[FindingRecord, ...] = ()
    notes: tuple[str, ...] = ()


def read_verification(path: str | Path) -> VerificationRecord:
    """Read a verification record from its file, or from the folder that holds it.

    Raises
    ------
    RecordError
        The file is missing, not JSON, of another or a newer format, or lacks a key.
    """
    return read_document(path, VerificationRecord, VERIFICATION_FORMAT, file_name=VERIFICATION_FILE)


def write_verification(record: VerificationRecord, folder: str | Path) -> Path:
    """Write ``verification.json`` into a folder, whole or not at all, and return its path."""
    return write_document(record, Path(folder) / VERIFICATION_FILE)
