"""The calibrated rig that a record holds."""

import numpy as np

from fringecal.camera import CAMERA_NAMES, PlateCamera
from fringecal.errors import RecordError
from fringecal.projector import RIG_NAMES, Mode, PlateResidual, RigCalibration, RigModel
from fringecal.records import calibration_record as record
from fringecal.workflows.shared.phase_notes import orders_of, wave_of


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
