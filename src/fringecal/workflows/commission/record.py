"""Between what a procedure found and what a record holds: there and, for a calibration, back again."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.calibration import Calibrated
from fringecal.camera import CAMERA_NAMES, PlateCamera, family_rms_px
from fringecal.detect import FAMILIES
from fringecal.projector import RIG_NAMES, Advice, AxisAngle, projector_estimates
from fringecal.records import DEFAULT_LIMITS, EstimateRecord, LensRecord, Limits, ValueU, VectorU, software_versions
from fringecal.records import calibration_record as record
from fringecal.session import Session
from fringecal.uncertainty import EN_DEFINITION, Estimate
from fringecal.workflows.commission.calibrated_session import CalibratedSession
from fringecal.workflows.commission.checks import commissioning_checks
from fringecal.workflows.commission.run import Commissioning
from fringecal.workflows.commission.testability import MOST_OFF, Testability, statements_tested
from fringecal.workflows.lens import lens_record
from fringecal.workflows.shared import (
    appearance_of,
    budget_rows,
    inputs_of,
    look_record,
    orders_record,
    session_note,
    steps_record,
    wave_record,
)

Array = NDArray[np.float64]


def calibration_record(
    found: Commissioning, *, command: Sequence[str] = (), limits: Limits = DEFAULT_LIMITS
) -> record.CalibrationRecord:
    """Return the record of a commissioning: every estimate, its budget, and all that applying it needs."""
    session, result = found.calibrated.session, found.calibrated.result
    scales = {name: EstimateRecord.of(e) for name, e in result.camera.scales.items()}
    return record.CalibrationRecord(
        software=software_versions(),
        command=tuple(command),
        session=session_note(session),
        inputs=inputs_of(session),
        en_definition=EN_DEFINITION,
        image=record.ImageRecord(
            width=result.rig.camera.width_px,
            height=result.rig.camera.height_px,
            white_level=found.calibrated.reference.capture.white_level,
        ),
        camera=_camera_record(result.rig.camera),
        lens=_known_lens_record(result),
        steps=tuple(steps_record(one) for one in found.diagnosed),
        wave=wave_record(result.rig.wave),
        orders=orders_record(result.rig.orders),
        scale=record.ScaleRecord(**scales),
        distortion=_distortion_record(result),
        projection=_projection_record(found),
        rig=_rig_record(result),
        budgets={
            "projection.angle": budget_rows(result.origin.budget),
            "scale.mean": budget_rows(result.camera.scale_budget),
        },
        checks=commissioning_checks(found, limits),
        limits=limits,
        targets=_targets_of(session),
        notes=(
            found.calibrated.reference.sentence(),
            found.calibrated.strips.sentence(),
            *(sentence for one in found.diagnosed for sentence in one.sentences()),
            *found.notes,
        ),
        advice=_advice_record(found.advice),
        unseen=tuple(_unseen_record(one, limits) for one in statements_tested(found, limits)),
        appearance=appearance_of(found.calibrated.reference, result.camera.detection),
        look=look_record(result.rig.look),
    )


def _unseen_record(one: Testability, limits: Limits) -> record.UnseenErrorRecord:
    return record.UnseenErrorRecord(
        name=one.name,
        stated=EstimateRecord.of(one.stated),
        error_percent=100 * one.error_rel if one.error_rel <= MOST_OFF else None,
        height_percent=one.height_percent,
        limit_percent=limits.commission.height_percent,
        shown_by=one.shown_by,
        heights_rest_on_it=one.carries,
    )


def _advice_record(advice: Advice) -> record.AdviceRecord:
    return record.AdviceRecord(
        forecasts=tuple(
            record.ForecastRecord(
                height_mm=f.z_mm,
                u_mm=f.rms_mm,
                u_least_mm=float(f.u_mm.min()),
                u_largest_mm=float(f.u_mm.max()),
                causes_mm={source.identifier: u_mm for source, u_mm in f.contributions_mm().items()},
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


def _known_lens_record(found: Calibrated) -> LensRecord | None:
    camera = found.rig.camera
    known = found.camera.lens
    return None if known is None else lens_record(known, distance_mm=float(camera["height_mm"]))


def _distortion_record(found: Calibrated) -> record.DistortionRecord:
    test = found.camera.distortion
    return record.DistortionRecord(
        verdict=test.verdict,
        max_px=ValueU(value=test.max_px.value, u=test.max_px.u, dof=test.max_px.dof),
        detection_limit_px=test.detection_limit_px,
        k1=found.rig.camera["k1"],
        k2=found.rig.camera["k2"],
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
    origin = found.calibrated.result.origin
    return record.ProjectionRecord(
        angle=EstimateRecord.of(origin.angle),
        apparent_angle=EstimateRecord.of(origin.apparent),
        columns=tuple(_column_record(c) for c in found.angles.columns),
        theory=None if origin.theory is None else _theory_record(found.calibrated, origin.theory),
    )


def _theory_record(found: CalibratedSession, theory: Estimate) -> record.TheoryRecord:
    origin = found.result.origin
    position = found.result.stated_projector
    assert position is not None
    height = found.session.camera.height_mm
    return record.TheoryRecord(
        angle=EstimateRecord.of(theory),
        projector_position_mm=VectorU(value=tuple(map(float, position.value_mm)), u=tuple(map(float, position.u_mm))),
        camera_height_mm=None if height is None else ValueU(value=height.values[0], u=height.us[0]),
        difference_deg=origin.angle.value - theory.value,
        en=origin.en,
        sentence=origin.sentence,
    )


def _column_record(column: AxisAngle) -> record.ColumnRecord:
    return record.ColumnRecord(
        u_px=column.place_px,
        x_mm=column.place_mm,
        breaks=column.breaks,
        angle_deg=column.angle.value,
        u_deg=column.angle.u,
        dof=column.angle.dof,
        apparent_deg=column.apparent_deg,
        theory_deg=None if column.theory is None else column.theory.value,
        difference_deg=column.difference_deg,
        en=column.en,
    )


def _rig_record(found: Calibrated) -> record.RigRecord:
    calibration = found.rig
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
            record.ModeRecord(label=c.source.identifier, effect=tuple(map(float, c.effect)), dof=c.dof)
            for c in calibration.components
        ),
    )


def _projector_u(found: Calibrated) -> tuple[float, ...] | None:
    """Return the standard uncertainties of the projector's place; nobody knows all three unless a place is stated."""
    stated = found.stated_projector
    place = projector_estimates(found.rig, stated)
    return None if stated is None or not place else tuple(e.u for e in place)


def _targets_of(session: Session) -> dict[str, dict[str, Any]]:
    targets = [c.target for c in session.captures.values() if c.target is not None]
    return {t.name: t.model_dump(mode="json") for t in targets}
