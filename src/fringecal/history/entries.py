"""What a record says in one row of the history, and in one row per quantity."""

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC
from pathlib import Path
from typing import Any

from fringecal.records import (
    AuditRecord,
    BoardCalibrationRecord,
    CalibrationRecord,
    Check,
    EstimateRecord,
    VerificationRecord,
    board_calibration_of_bytes,
    record_bytes,
    record_file,
    record_of_bytes,
    states_board_calibration,
)
from fringecal.uncertainty import Estimate, en_score

CHANGE, CHECK = "change of ", "check: "  # how the names of changes and of checks begin
SEVERITY = ("info", "pass", "conditionalPass", "conditionalFail", "fail")


@dataclass(frozen=True)
class Reading:
    """One quantity of a record: value and standard uncertainty in `unit`, beside its reference and limit.

    `dof` is None where u is taken as exactly known; `reference` None where no certificate says the value; `limit`
    is that of a check, in the same unit.
    """

    quantity: str
    value: float
    unit: str = ""
    u: float | None = None
    dof: float | None = None
    reference: float | None = None
    u_reference: float | None = None
    en: float | None = None
    limit: float | None = None
    decision: str | None = None


@dataclass(frozen=True)
class Entry:
    """One record: which rig, what was done, when (ISO 8601, UTC), the verdict, and its quantities.

    `sha256` is the hash of the record's file and tells one record from another; `document` is its whole text, so
    that the history outlives the folders that it was filled from. `supersedes` is the hash of the entry that this one
    corrects.
    """

    rig: str
    kind: str
    captured: str
    created: str
    sha256: str
    decision: str
    readings: tuple[Reading, ...]
    operator: str | None = None
    temperature_degC: float | None = None
    minutes_since_power_on: float | None = None
    source: str = ""
    software: str = ""
    document: str | None = None
    supersedes: str | None = None


def en_of(reading: Reading) -> float | None:
    """Return the En of a reading from its own numbers, `en_score`; None where its record forms none.

    So that one table holds one definition: records of older versions took another coverage factor.
    """
    u, u_reference = reading.u or 0.0, reading.u_reference or 0.0
    if reading.en is None or not max(u, u_reference) > 0:
        return reading.en
    found = Estimate(reading.value, u, reading.unit, dof=reading.dof or math.inf)
    return en_score(found, Estimate(reading.reference or 0.0, u_reference, reading.unit))


def read_entry(path: str | Path) -> Entry:
    """Read a record file, or the folder that holds one, as an entry of the history.

    Raises
    ------
    RecordError
        The folder holds no record or several, or the file is none, damaged, or newer than this version.
    """
    content = record_bytes(file := record_file(path))
    if states_board_calibration(content):
        return _entry(board_calibration_of_bytes(content, str(file)), "calibration", content, str(path))
    record, kind = record_of_bytes(content, str(file))
    return _entry(record, kind.name, content, str(path))


def _entry(record: Any, kind: str, text: bytes, source: str) -> Entry:
    session, created = record.session, record.created.astimezone(UTC).isoformat()
    captured = session.captured.astimezone(UTC).isoformat() if session.captured else created
    return Entry(
        rig=session.rig,
        kind=kind,
        captured=captured,
        created=created,
        sha256=hashlib.sha256(text).hexdigest(),
        decision=max((check.decision for check in record.checks), key=SEVERITY.index, default="info"),
        readings=tuple(_readings(record, kind)),
        operator=session.operator,
        temperature_degC=session.temperature_degC,
        minutes_since_power_on=session.minutes_since_power_on,
        source=source,
        software=record.software.get("fringecal", ""),
        document=text.decode("utf-8"),
    )


def _readings(record: Any, kind: str) -> Iterator[Reading]:
    """Give a record's quantities, then its checks but for those of a quantity that is there already."""
    quantities = tuple(replace(reading, en=en_of(reading)) for reading in _QUANTITIES[kind](record))
    yield from quantities
    yield from _check_readings(record.checks, known={reading.quantity for reading in quantities})


def _check_readings(checks: tuple[Check, ...], *, known: set[str]) -> Iterator[Reading]:
    for check in checks:
        if check.value is not None and check.name not in known:
            yield Reading(
                f"{CHECK}{check.name}",
                check.value,
                check.unit,
                check.u,
                limit=check.limit,
                decision=check.decision,
            )


def _estimate(quantity: str, estimate: EstimateRecord) -> Reading:
    return Reading(quantity, estimate.value, estimate.unit, estimate.u, estimate.dof)


def _of_calibration(record: CalibrationRecord | BoardCalibrationRecord) -> Iterator[Reading]:
    if isinstance(record, BoardCalibrationRecord):
        yield from _of_board_calibration(record)
        return
    yield _estimate("scale, mean", record.scale.mean)
    yield _estimate("scale, horizontal", record.scale.horizontal)
    yield _estimate("scale, vertical", record.scale.vertical)
    yield _estimate("projection angle", record.projection.angle)
    largest = record.distortion.max_px
    yield Reading("lens displacement, largest", largest.value, "px", largest.u, largest.dof)
    yield Reading("rig residual, rms", record.rig.residual_rms_rad, "rad")
    yield Reading("plate residual, rms", record.rig.plate_residual_rms_rad, "rad")
    for forecast in record.advice.forecasts if record.advice else ():
        yield Reading(f"standard uncertainty of {forecast.height_mm:g} mm", forecast.u_mm, "mm")


_PARAMETERS = {
    "camera.fx_px": "focal length of the camera",
    "camera.cx_px": "centre of the camera's picture, u",
    "camera.cy_px": "centre of the camera's picture, v",
    "projector.fx_px": "focal length of the projector",
    "projector.cx_px": "centre of the projector's frame, u",
    "projector.cy_px": "centre of the projector's frame, v",
}


def _of_board_calibration(record: BoardCalibrationRecord) -> Iterator[Reading]:
    """Give what a rig of camera and inverse camera is known by; what its poses say nothing of is left out."""
    yield _estimate("baseline", record.baseline_mm)
    yield _estimate("angle of the rays amid the boards", record.angle_deg)
    for k, name in enumerate(record.names):
        if name in _PARAMETERS and name not in record.undetermined:
            u = math.sqrt(max(record.covariance[k][k], 0.0))
            yield Reading(_PARAMETERS[name], record.parameters[k], "px", u, record.dof)
    yield Reading("residual of both pictures, rms", record.stereo_rms_px, "px")
    yield Reading("largest standard uncertainty of a point", record.volume.u_largest_mm, "mm")


def _of_verification(record: VerificationRecord) -> Iterator[Reading]:
    artefact = str(record.target.get("name", record.capture))
    for profile in record.profiles:
        name = f"{artefact}: profile {profile.name}, mean error"
        yield Reading(name, profile.mean_mm, "mm", profile.u_mm, profile.dof, reference=0.0, en=profile.en)
    for reading in record.readings:
        reference = (reading.reference, reading.u_reference) if reading.reference is not None else (None, None)
        unit = "" if reading.unit == "1" else reading.unit
        values = (reading.measured, unit, reading.u_measured, reading.dof, *reference, reading.en)
        yield Reading(f"{artefact}: {reading.name}", *values)


def _of_audit(record: AuditRecord) -> Iterator[Reading]:
    """Give the changes since the calibration in force, under the names of their checks."""
    for change in record.changes:
        judged = (change.en, change.limit, change.decision)
        yield Reading(f"{CHANGE}{change.name}", change.value, change.unit, change.u, change.dof, None, None, *judged)


_QUANTITIES: Mapping[str, Callable[[Any], Iterator[Reading]]] = {
    "calibration": _of_calibration,
    "verification": _of_verification,
    "audit": _of_audit,
}
