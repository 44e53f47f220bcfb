"""The results of a calibration report: records' estimates, tables and checks, rounded as they are printed."""

import math
from collections.abc import Iterator, Sequence

from fringecal.records import (
    BoardCalibrationRecord,
    CalibrationRecord,
    Check,
    Column,
    Conformity,
    Group,
    Measured,
    ProfileRecord,
    ReadingRecord,
    ResultTable,
    VerificationRecord,
    rounded,
)
from fringecal.uncertainty import Estimate, coverage_factor


def _estimate(value: float, u: float, dof: float | None, unit: str) -> Estimate:
    """Take an estimate from what a record states; no degrees of freedom are infinitely many."""
    return Estimate(value, u, unit, dof=math.inf if dof is None else dof)


def groups_of(record: CalibrationRecord | BoardCalibrationRecord) -> Iterator[Group]:
    """Give the results of a calibration: camera, projection angle, predicted uncertainty of heights."""
    if isinstance(record, BoardCalibrationRecord):
        yield from _groups_of_board_rig(record)
        return
    scale, angle = record.scale, record.projection
    limit, largest = record.distortion.detection_limit_px, record.distortion.max_px
    yield Group(
        "Camera",
        (
            Measured.of("Scale on the reference plate, mean", scale.mean.estimate()),
            Measured.of("Scale along the rows", scale.horizontal.estimate()),
            Measured.of("Scale along the columns", scale.vertical.estimate()),
            Measured.of(
                "Largest displacement by the lens",
                _estimate(largest.value, largest.u, largest.dof, "px"),
            ),
        ),
        note=f"Distortion: {record.distortion.verdict}; detection limit {limit:.2g} px. The scale holds on the plate.",
    )
    apparent = angle.apparent_angle
    more = () if apparent is None else (Measured.of("Apparent angle, as fringe breaks show it", apparent.estimate()),)
    yield Group(
        "Projection angle",
        (Measured.of("Projection angle at the plate's origin, from the plate's normal", angle.angle.estimate()), *more),
        _angle_tables(record),
        note="Positive angles; measured in the plane across the local fringe.",
    )
    if record.advice and record.advice.forecasts:
        yield Group("Heights", tables=(_forecasts(record),), note="Uncertainty of heights by this calibration.")


_DEVICES = {"camera": "Camera", "projector": "Projector"}
_NUMBERS = {
    "fx_px": "Focal length along the rows",
    "fy_px": "Focal length along the columns",
    "cx_px": "Centre, column",
    "cy_px": "Centre, row",
}


def _groups_of_board_rig(record: BoardCalibrationRecord) -> Iterator[Group]:
    """Give both devices, how they stand to one another, and how well points are known where boards were."""
    for device, title in _DEVICES.items():
        known = tuple(
            Measured.of(text, _parameter(record, f"{device}.{name}"))
            for name, text in _NUMBERS.items()
            if f"{device}.{name}" not in record.undetermined
        )
        note = "Pixels are counted from 0 at the centre of the first; distortion stands in the record."
        yield Group(title, known, note=note)
    yield Group(
        "Camera and projector",
        (
            Measured.of("Distance of their centres", record.baseline_mm.estimate()),
            Measured.of("Angle of the rays amid the boards", record.angle_deg.estimate()),
        ),
    )
    k, volume = coverage_factor(), record.volume
    span = {"Least": volume.u_least_mm, "Largest": volume.u_largest_mm}
    yield Group(
        "Points in the volume",
        tuple(
            Measured(f"{which} expanded uncertainty of a point where boards were", f"{k * u:.2g}", "mm")
            for which, u in span.items()
        ),
        note=f"Root sum of squares of x, y, z by the calibration, k = {k:.2f}; without the noise of a single pixel.",
    )


def _parameter(record: BoardCalibrationRecord, name: str) -> Estimate:
    i = record.names.index(name)
    return _estimate(record.parameters[i], math.sqrt(max(record.covariance[i][i], 0.0)), record.dof, "px")


def _angle_tables(record: CalibrationRecord) -> tuple[ResultTable, ...]:
    columns = record.projection.columns
    if not columns:
        return ()
    angles = [Measured.of("", _estimate(c.angle_deg, c.u_deg, c.dof, "deg")) for c in columns]
    parts = [
        Column("Place along x", tuple(f"{c.x_mm:.1f}" for c in columns), "mm", ref_type="basic_referenceValue"),
        Column(
            "Projection angle",
            tuple(a.value for a in angles),
            "deg",
            tuple(a.expanded for a in angles),
            tuple(a.k for a in angles),
            "basic_measuredValue",
        ),
    ]
    theory = tuple(f"{c.theory_deg:.2f}" for c in columns if c.theory_deg is not None)
    if len(theory) == len(columns):
        parts.append(Column("Angle of the stated positions", theory, "deg"))
    return (ResultTable("Projection angle along x", tuple(parts)),)


def _forecasts(record: CalibrationRecord) -> ResultTable:
    forecasts = record.advice.forecasts if record.advice else ()
    k = coverage_factor()
    return ResultTable(
        "Uncertainty of heights over the field",
        (
            Column("Height", tuple(f"{f.height_mm:g}" for f in forecasts), "mm", ref_type="basic_referenceValue"),
            Column(
                "Expanded uncertainty by the calibration",
                tuple(f"{k * f.u_mm:.2g}" for f in forecasts),
                "mm",
                ref_type="basic_uncertainty",
            ),
        ),
        note=f"95 %, k = {k:.2f}; without the noise of a single pixel, which the height maps state themselves.",
    )


def errors_of(verification: VerificationRecord | None) -> Iterator[Group]:
    """Give the errors against an artefact, if it was measured."""
    if verification is None:
        return
    artefact = str(verification.target.get("name", verification.capture))
    tables = (
        *((_profiles(verification.profiles),) if verification.profiles else ()),
        *_readings(verification.readings),
    )
    yield Group(f"Errors against {artefact}", tables=tables, note=verification.sentence)


def _profiles(profiles: Sequence[ProfileRecord]) -> ResultTable:
    means = [Measured.of("", _estimate(p.mean_mm, p.u_mm, p.dof, "mm")) for p in profiles]
    return ResultTable(
        "Height errors along profiles",
        (
            Column("Place along y", tuple(f"{p.y_mm:.1f}" for p in profiles), "mm", ref_type="basic_referenceValue"),
            Column(
                "Mean error",
                tuple(m.value for m in means),
                "mm",
                tuple(m.expanded for m in means),
                tuple(m.k for m in means),
                "basic_measurementError",
            ),
            Column("Standard deviation along the profile", tuple(f"{p.sd_mm:.3f}" for p in profiles), "mm"),
            Column("Largest error", tuple(f"{p.max_abs_mm:.3f}" for p in profiles), "mm"),
        ),
        note="Edge zones of the ridges and valleys left out; measured minus certificate.",
    )


def _readings(readings: Sequence[ReadingRecord]) -> Iterator[ResultTable]:
    """Tabulate the numbers of an artefact by unit, those that have a certificate and an uncertainty."""
    usable = [r for r in readings if r.reference is not None and r.u_measured is not None]
    for unit in dict.fromkeys(r.unit for r in usable):
        rows = [r for r in usable if r.unit == unit]
        found = [Measured.of("", _estimate(r.measured, float(r.u_measured or 0.0), r.dof, "")) for r in rows]
        unit = "" if unit == "1" else unit
        names = "; ".join(f"{n}: {r.name}" for n, r in enumerate(rows, start=1))
        certified = tuple(f"{r.reference:.6g}" for r in rows)
        measured = Column(
            "Measured",
            tuple(m.value for m in found),
            unit,
            tuple(m.expanded or "0" for m in found),
            tuple(m.k for m in found),
            "basic_measuredValue",
        )
        yield ResultTable(
            f"Numbers of the artefact in {unit or 'one'}",
            (Column("Certificate", certified, unit, ref_type="basic_referenceValue"), measured),
            note=f"Row by row: {names}.",
        )


def conformity_of(check: Check) -> Conformity:
    """Turn a check into a statement of conformity, its value rounded to its uncertainty; k is that of its U."""
    value, u = float(check.value or 0.0), check.u or 0.0
    expanded = check.expanded if check.expanded is not None else coverage_factor() * u
    text, uncertainty = rounded(value, expanded) if expanded else (f"{value:.3g}", "")
    name = f"{check.name[:1].upper()}{check.name[1:]}{' (En)' if check.score == 'En' else ''}"
    return Conformity(
        Measured(name, text, check.unit, uncertainty, expanded / u if u else math.nan),
        "" if check.limit is None else f"{check.limit:.6g}",
        check.decision,
        check.rule,
        at_least="at least the limit" in check.rule,
    )
