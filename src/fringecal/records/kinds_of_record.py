"""The records of a rig, whichever kind: which there are, and reading one without knowing beforehand."""

import json
from dataclasses import dataclass
from pathlib import Path

from fringecal.errors import RecordError
from fringecal.records.audit_record import AUDIT_FILE, AUDIT_FORMAT, AuditRecord
from fringecal.records.calibration_record import CALIBRATION_FILE, CALIBRATION_FORMAT, CalibrationRecord
from fringecal.records.documents import read_document
from fringecal.records.verification_record import VERIFICATION_FILE, VERIFICATION_FORMAT, VerificationRecord

type Record = CalibrationRecord | VerificationRecord | AuditRecord


@dataclass(frozen=True)
class Kind:
    """One kind of record: the format that it states, the file that it is written to, and its model."""

    name: str
    format: str
    file: str
    model: type[Record]


KINDS = (
    Kind("calibration", CALIBRATION_FORMAT, CALIBRATION_FILE, CalibrationRecord),
    Kind("verification", VERIFICATION_FORMAT, VERIFICATION_FILE, VerificationRecord),
    Kind("audit", AUDIT_FORMAT, AUDIT_FILE, AuditRecord),
)


def record_file(path: str | Path) -> Path:
    """Return the record's file: the path itself, or the only record in a folder.

    Raises
    ------
    RecordError
        The folder holds none, or several.
    """
    if not Path(path).is_dir():
        return Path(path)
    found = [Path(path) / kind.file for kind in KINDS if (Path(path) / kind.file).is_file()]
    if len(found) != 1:
        names = ", ".join(file.name for file in found) or "none"
        raise RecordError(f"{path}: a folder with one record was needed, found {names}; name the file")
    return found[0]


def kind_of(file: Path) -> Kind:
    """Return which kind of record a file holds, by the format that it states.

    Raises
    ------
    RecordError
        The file cannot be read, or states no format of a rig's record.
    """
    try:
        document = json.loads(file.read_bytes())
    except OSError as error:
        raise RecordError(f"{file}: cannot be read ({error.strerror or error}); give a record file") from error
    except (ValueError, RecursionError):
        document = None
    stated = document.get("format") if isinstance(document, dict) else None
    name = str(stated).partition("/")[0]
    found = next((kind for kind in KINDS if kind.format.partition("/")[0] == name), None)
    if found is None:
        known = ", ".join(kind.format for kind in KINDS)
        raise RecordError(f"{file}: no record of a rig; needed one of {known}, undamaged")
    return found


def read_record(path: str | Path) -> tuple[Record, Kind]:
    """Read a record of any kind from its file, or from the folder that holds it alone, and say which it is.

    Raises
    ------
    RecordError
        As `record_file` and `kind_of`; the record is damaged, lacks a key, or is newer than this version.
    """
    file = record_file(path)
    kind = kind_of(file)
    return read_document(file, kind.model, kind.format, file_name=kind.file), kind
