"""Between what a procedure found and what a record holds: there and, for a calibration, back again."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate import CAMERA_NAMES, PlateCamera
from fringecal.camera.straightness import family_rms_px
from fringecal.detect.grid import FAMILIES
from fringecal.errors import RecordError
from fringecal.procedures.appearance import appearance_of
from fringecal.procedures.checks import commissioning_checks, verification_checks
from fringecal.procedures.commission import Commissioning, projector_of
from fringecal.procedures.examination import plate_beside
from fringecal.procedures.lens_recording import lens_record
from fringecal.procedures.recording_phase import (
    findings_of,
    orders_of,
    orders_record,
    steps_record,
    wave_of,
    wave_record,
)
from fringecal.procedures.verification import Verification
from fringecal.projection.advice import Advice
from fringecal.projection.calibration import Mode, RigCalibration
from fringecal.projection.columns import ColumnAngle
from fringecal.projection.rig import RIG_NAMES, PlateResidual, RigModel
from fringecal.projection.theory import projector_estimates
from fringecal.records import calibration as record
from fringecal.records.lens import LensRecord
from fringecal.records.limits import DEFAULT_LIMITS, Limits
from fringecal.records.parts import BudgetRow, EstimateRecord, InputFile, SessionNote, ValueU, VectorU
from fringecal.records.provenance import sha256_of, software_versions
from fringecal.records.verification import (
    CalibrationUsed,
    FilterRow,
    ModelRow,
    ProfileRecord,
    VerificationRecord,
)
from fringecal.session import Capture, Session
from fringecal.uncertainty.estimates import Estimate
from fringecal.verify.errors import ProfileErrors, ZigzagErrors

Array = NDArray[np.float64]


def calibration_record(
    found: Commissioning, *, command: Sequence[str] = (), limits: Limits = DEFAULT_LIMITS
) -> record.CalibrationRecord:
    """Return the record of a commissioning: every estimate, its budget, and all that applying it needs."""
    scales = {name: EstimateRecord.of(e) for name, e in found.camera.scales.items()}
    return record.CalibrationRecord(
        software=software_versions(),
        command=tuple(command),
        session=session_note(found.session),
        inputs=inputs_of(found.session),
        image=record.ImageRecord(
            width=found.calibration.camera.width_px,
            height=found.calibration.camera.height_px,
            white_level=found.reference.capture.white_level,
        ),
        camera=_camera_record(found.calibration.camera),
        lens=_known_lens_record(found),
        steps=tuple(steps_record(one) for one in found.examined),
        wave=wave_record(found.calibration.wave),
        orders=orders_record(found.calibration.orders),
        scale=record.ScaleRecord(**scales),
        distortion=_distortion_record(found),
        projection=_projection_record(found),
        rig=_rig_record(found),
        budgets={
            "projection.angle": budget_rows(found.angle_budget),
            "scale.mean": budget_rows(found.camera.scale_budget),
        },
        checks=commissioning_checks(found, limits),
        limits=limits,
        targets=_targets_of(found.session),
        notes=(
            found.reference.sentence(),
            found.strips_capture.sentence(),
            *(sentence for one in found.examined for sentence in one.sentences()),
            *found.notes,
        ),
        advice=_advice_record(found.advice),
        appearance=appearance_of(found.reference, found.detection),
    )


def _advice_record(advice: Advice) -> record.AdviceRecord:
    return record.AdviceRecord(
        forecasts=tuple(
            record.ForecastRecord(
                height_mm=f.z_mm,
                u_mm=f.rms_mm,
                u_least_mm=float(f.u_mm.min()),
                u_largest_mm=float(f.u_mm.max()),
                causes_mm=f.causes(),
            )
            for f in advice.forecasts
        ),
        proposals=tuple(
            record.ProposalRecord(
                name=g.proposal.name,
                heights_mm=g.proposal.heights_mm,
                u_height_mm=g.proposal.u_mm,
                u_before_mm=tuple(g.before_mm.values()),
                u_after_mm=tuple(g.after_mm.values()),
            )
            for g in advice.gains
        ),
        sentences=advice.sentences,
    )


def calibration_of(written: record.CalibrationRecord) -> RigCalibration:
    """Return the calibrated rig that a record holds.

    Raises
    ------
    RecordError
        The record holds another kind of camera or rig than this version knows.
    """
    if written.camera.names != CAMERA_NAMES or written.rig.parameter_names != RIG_NAMES:
        raise RecordError(
            "the record's camera or rig parameters are not those that this version knows; use the version "
            f"that wrote it ({written.software.get('fringecal', 'unknown')})"
        )
    camera = PlateCamera(
        np.array(written.camera.parameters),
        np.array(written.camera.covariance),
        written.camera.width,
        written.camera.height,
        written.camera.telecentric,
    )
    residual = PlateResidual()
    if written.rig.plate_residual is not None:
        kept = written.rig.plate_residual
        residual = PlateResidual(kept.degree, np.array(kept.coefficients), kept.box)
    projector = np.full(3, np.inf) if written.rig.projector_mm is None else np.array(written.rig.projector_mm)
    model = RigModel(np.array(written.rig.parameters), projector, residual)
    modes = tuple(Mode(m.label, np.array(m.effect), np.inf if m.dof is None else m.dof) for m in written.rig.modes)
    return RigCalibration(
        camera, model, modes, written.rig.excess_rad, wave_of(written.wave), orders_of(written.orders)
    )


def verification_record(
    found: Verification,
    session: Session,
    calibration_file: Path,
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
        calibration=CalibrationUsed(file=calibration_file.name, sha256=sha256_of(calibration_file)),
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
        findings=findings_of(found.examined),
        notes=(found.phase.sentence(), *found.examined.sentences()),
    )


def session_note(session: Session) -> SessionNote:
    """Return which session the record comes from."""
    return SessionNote(
        rig=session.rig,
        captured=session.captured.astimezone(UTC) if isinstance(session.captured, datetime) else None,
        operator=session.operator,
        temperature_degC=session.temperature_degC,
        minutes_since_power_on=session.minutes_since_power_on,
    )


def inputs_of(session: Session, *, only: Iterable[Capture | None] | None = None) -> tuple[InputFile, ...]:
    """Return the files of a session with their hashes; of some captures alone, those and what all captures share.

    Shared files, such as session.toml, belong to no capture.
    """
    whose = {
        path.relative_to(session.folder).as_posix(): capture.name
        for capture in session.captures.values()
        for path in (*capture.paths, *capture.gray_paths)
    }
    files = [InputFile(capture=whose.get(file, ""), file=file, sha256=sha) for file, sha in session.inputs.items()]
    names = None if only is None else {"", *(capture.name for capture in only if capture is not None)}
    return tuple(file for file in files if names is None or file.capture in names)


def budget_rows(contributions: Mapping[str, float]) -> tuple[BudgetRow, ...]:
    """Return budget rows, the largest first; contributions are in the unit of the result."""
    total = sum(c**2 for c in contributions.values()) or 1.0
    rows = sorted(contributions.items(), key=lambda item: -abs(item[1]))
    return tuple(BudgetRow(label=label, u=abs(c), contribution=abs(c), percent=100 * c**2 / total) for label, c in rows)


def _matrix(values: Array) -> tuple[tuple[float, ...], ...]:
    symmetric = (values + values.T) / 2
    return tuple(tuple(float(v) for v in row) for row in symmetric)


def _camera_record(camera: PlateCamera) -> record.CameraRecord:
    return record.CameraRecord(
        names=CAMERA_NAMES,
        parameters=tuple(map(float, camera.parameters)),
        covariance=_matrix(camera.covariance),
        telecentric=camera.telecentric,
        width=camera.width_px,
        height=camera.height_px,
    )


def _known_lens_record(found: Commissioning) -> LensRecord | None:
    camera = found.calibration.camera
    known = found.camera.lens
    return None if known is None else lens_record(known, distance_mm=float(camera["height_mm"]))


def _distortion_record(found: Commissioning) -> record.DistortionRecord:
    test = found.camera.distortion
    return record.DistortionRecord(
        verdict=test.verdict,
        max_px=ValueU(value=test.max_px.value, u=test.max_px.u),
        detection_limit_px=test.detection_limit_px,
        k1=found.calibration.camera["k1"],
        k2=found.calibration.camera["k2"],
        p_value=test.p_value,
        centre_px=None if test.centre is None else _values_record(test.centre),
        straightness_px=record.StraightnessRecord(
            **{
                f"{family}_{when}": family_rms_px(table, family)
                for family in FAMILIES
                for when, table in (("before", test.straightness_before), ("after", test.straightness_after))
            }
        ),
    )


def _values_record(estimates: Sequence[Estimate]) -> VectorU:
    return VectorU(value=tuple(e.value for e in estimates), u=tuple(e.u for e in estimates))


def _projection_record(found: Commissioning) -> record.ProjectionRecord:
    return record.ProjectionRecord(
        angle=EstimateRecord.of(found.angle),
        apparent_angle=EstimateRecord.of(found.apparent),
        columns=tuple(_column_record(c) for c in found.columns),
        theory=None if found.theory is None else _theory_record(found, found.theory),
    )


def _theory_record(found: Commissioning, theory: Estimate) -> record.TheoryRecord:
    position = projector_of(found.session)
    assert position is not None
    height = found.session.camera.height_mm
    return record.TheoryRecord(
        angle=EstimateRecord.of(theory),
        projector_position_mm=VectorU(value=tuple(map(float, position.value_mm)), u=tuple(map(float, position.u_mm))),
        camera_height_mm=None if height is None else ValueU(value=height.values[0], u=height.us[0]),
        difference_deg=found.angle.value - theory.value,
        en=found.angle_en,
        sentence=found.angle_sentence,
    )


def _column_record(column: ColumnAngle) -> record.ColumnRecord:
    return record.ColumnRecord(
        u_px=column.u_px,
        x_mm=column.x_mm,
        breaks=column.breaks,
        angle_deg=column.angle.value,
        u_deg=column.angle.u,
        apparent_deg=column.apparent_deg,
        theory_deg=None if column.theory is None else column.theory.value,
        difference_deg=column.difference_deg,
        en=column.en,
    )


def _rig_record(found: Commissioning) -> record.RigRecord:
    calibration = found.calibration
    cut, end = len(CAMERA_NAMES), len(CAMERA_NAMES) + len(RIG_NAMES)
    joint = calibration.covariance
    residual = calibration.model.residual
    projector = calibration.model.projector_mm
    return record.RigRecord(
        model="projective",
        parameter_names=RIG_NAMES,
        parameters=tuple(map(float, calibration.model.parameters)),
        covariance=_matrix(joint[cut:end, cut:end]),
        cross_covariance=tuple(tuple(map(float, row)) for row in joint[cut:end, :cut]),
        residual_rms_rad=found.fit.rms_rad,
        plate_residual_rms_rad=found.fit.plate_rms_rad,
        plate_residual=record.PlateResidual(
            degree=residual.degree, coefficients=tuple(map(float, residual.coefficients)), box=residual.box
        ),
        projector_mm=tuple(map(float, projector)) if np.all(np.isfinite(projector)) else None,
        projector_u_mm=_projector_u(found),
        excess_rad=calibration.excess_rad,
        modes=tuple(
            record.ModeRecord(label=m.label, effect=tuple(map(float, m.effect)), dof=m.dof) for m in calibration.modes
        ),
    )


def _projector_u(found: Commissioning) -> tuple[float, ...] | None:
    """Return the standard uncertainties of the projector's place; nobody knows all three unless a place is stated."""
    stated = projector_of(found.session)
    place = projector_estimates(found.calibration, stated)
    return None if stated is None or not place else tuple(e.u for e in place)


def _targets_of(session: Session) -> dict[str, dict[str, Any]]:
    targets = [c.target for c in session.captures.values() if c.target is not None]
    return {t.name: t.model_dump(mode="json") for t in targets}


def _profile_record(profile: ProfileErrors) -> ProfileRecord:
    return ProfileRecord(**{key: getattr(profile, key) for key in ProfileRecord.model_fields})


def _pooled(errors: ZigzagErrors) -> dict[str, float]:
    keys = ("mean_mm", "sd_mm", "max_abs_mm", "mean_percent", "max_percent")
    return {key: float(getattr(errors.pooled, key)) for key in keys}


def _model_row(name: str, errors: ZigzagErrors) -> ModelRow:
    return ModelRow(model=name, **_pooled(errors))
