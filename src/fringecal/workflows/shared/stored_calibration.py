"""The calibrated rig that a record holds."""

import numpy as np

from fringecal.camera import CAMERA_NAMES, PlateCamera
from fringecal.errors import RecordError
from fringecal.projector import RIG_NAMES, PlateResidual, RigCalibration, RigModel
from fringecal.records import calibration_record as record
from fringecal.uncertainty import Source, UncertaintyComponent
from fringecal.workflows.shared.phase_notes import look_of, orders_of, wave_of


def calibration_of(written: record.CalibrationRecord) -> RigCalibration:
    """Return the calibrated rig that a record holds.

    Raises
    ------
    RecordError
        The record holds another kind of camera or rig than this version knows, or was edited after it was written.
    """
    written.demand_unedited("calibration")
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
    components = tuple(_component_of(mode) for mode in written.rig.modes)
    return RigCalibration(
        camera,
        model,
        components,
        written.rig.excess_rad,
        wave_of(written.wave),
        orders_of(written.orders),
        look_of(written.look),
    )


def _component_of(mode: record.ModeRecord) -> UncertaintyComponent:
    try:
        source = Source.parse(mode.label)
    except ValueError as error:
        raise RecordError(f"rig.modes: {error}; use the version that wrote the record") from error
    dof = np.inf if mode.dof is None else mode.dof
    return UncertaintyComponent(source.influence, np.array(mode.effect), dof, source.detail)
