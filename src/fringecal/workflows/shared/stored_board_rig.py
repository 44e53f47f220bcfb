"""The rig of camera and inverse camera that a record holds."""

import numpy as np

from fringecal.camera import LENS_NAMES, Lens
from fringecal.errors import RecordError
from fringecal.projector import BOARD_RIG_NAMES, BoardRig
from fringecal.records import BoardCalibrationRecord

_SIZE = len(LENS_NAMES)


def board_rig_of(written: BoardCalibrationRecord) -> BoardRig:
    """Return the rig that a record holds.

    Raises
    ------
    RecordError
        Its parameters are not those that this version knows, or it was edited after it was written.
    """
    written.demand_unedited("calibration")
    if written.names != BOARD_RIG_NAMES:
        raise RecordError(
            "the record's parameters are not those that this version knows; use the version that wrote it "
            f"({written.software.get('fringecal', 'unknown')})"
        )
    values, covariance = np.array(written.parameters), np.array(written.covariance)
    camera, projector = slice(0, _SIZE), slice(_SIZE, 2 * _SIZE)
    return BoardRig(
        Lens(values[camera], covariance[camera, camera], written.image.width, written.image.height),
        Lens(values[projector], covariance[projector, projector], written.columns, written.rows),
        np.array(written.rotation),
        values[-3:],
        covariance,
        np.inf if written.dof is None else written.dof,
        written.camera_rms_px,
        written.projector_rms_px,
        written.camera_s_px,
        written.projector_s_px,
        written.axes,
        written.undetermined,
        volume_mm=np.array(written.volume.points_mm).reshape(-1, 3),
    )
