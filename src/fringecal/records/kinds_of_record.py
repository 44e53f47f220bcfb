"""The records of a rig, whichever kind: which there are, and reading one without knowing beforehand."""

from dataclasses import dataclass
from pathlib import Path

from fringecal.errors import RecordError
from fringecal.guarded import Refusal, is_file, is_folder, json_of, text_of
from fringecal.records.audit_record import AUDIT_FILE, AUDIT_FORMAT, AuditRecord
from fringecal.records.board_calibration import BOARD_CALIBRATION_FORMAT
from fringecal.records.calibration_record import CALIBRATION_FILE, CALIBRATION_FORMAT, CalibrationRecord
from fringecal.records.documents import document_of_bytes, record_bytes
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
    if not is_folder(path):
        return Path(path)
    found = [Path(path) / kind.file for kind in KINDS if is_file(Path(path) / kind.file)]
    if len(found) != 1:
        names = ", ".join(file.name for file in found) or "none"
        raise RecordError(f"{path}: a folder with one record was needed, found {names}; name the file")
    return found[0]


def kind_of(stated: object, name: str) -> Kind:
    """Return which kind of record states a format.

    Raises
    ------
    RecordError
        It is no format of a rig's record; `name` is what the refusal calls the file.
    """
    form = str(stated).partition("/")[0]
    found = next((kind for kind in KINDS if kind.format.partition("/")[0] == form), None)
    if found is None:
        if stated == BOARD_CALIBRATION_FORMAT:
            raise RecordError(
                f"{name}: a calibration by a board in poses, which `fringecal reconstruct` uses and this does not yet"
            )
        known = ", ".join(kind.format for kind in KINDS)
        raise RecordError(f"{name}: no record of a rig; needed one of {known}, undamaged")
    return found


def read_record(path: str | Path) -> tuple[Record, Kind]:
    """Read a record of any kind from its file, or from the folder that holds it alone, and say which it is.

    Raises
    ------
    RecordError
        As `record_file` and `kind_of`; the record is damaged, lacks a key, or is newer than this version.
    """
    file = record_file(path)
    return record_of_bytes(record_bytes(file), str(file))


def record_of_bytes(content: bytes, name: str) -> tuple[Record, Kind]:
    """Return the record that the bytes of a file hold, and its kind.

    Raises
    ------
    RecordError
        As `read_record`; `name` is what the refusal calls the file.
    """
    try:
        stated = json_of(text_of(content)).get("format")
    except Refusal as error:
        raise RecordError(f"{name}: no record of a rig: {error}") from error
    kind = kind_of(stated, name)
    return document_of_bytes(content, kind.model, kind.format, name=name), kind
