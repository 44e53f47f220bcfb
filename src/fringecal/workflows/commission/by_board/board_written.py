"""Between a rig calibrated by a board in poses and its record: there and back again."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from fringecal.phase import RasterCoordinate
from fringecal.projector import BOARD_RIG_NAMES, BoardRig
from fringecal.records import (
    DEFAULT_LIMITS,
    BoardCalibrationRecord,
    EstimateRecord,
    ImageRecord,
    Limits,
    PoseRecord,
    RasterRecord,
    VolumeRecord,
    software_versions,
)
from fringecal.session import Capture, FringeAxis, StatedMap
from fringecal.uncertainty import EN_DEFINITION, Estimate
from fringecal.workflows.commission.by_board.board_judged import board_checks
from fringecal.workflows.commission.by_board.board_numbers import (
    baseline,
    points_of_boards,
    triangulation_angle,
    u_of_points_mm,
)
from fringecal.workflows.commission.by_board.board_run import BoardCommissioning
from fringecal.workflows.shared import inputs_of, session_note


def board_calibration_record(
    found: BoardCommissioning, *, command: Sequence[str] = (), limits: Limits = DEFAULT_LIMITS
) -> BoardCalibrationRecord:
    """Return the record of a calibration by a board in poses."""
    fit, rig, first = found.fit, found.fit.rig, found.captures[0]
    u = u_of_points_mm(points_of_boards(rig))
    covariance = (rig.covariance + rig.covariance.T) / 2
    return BoardCalibrationRecord(
        software=software_versions(),
        command=tuple(command),
        session=session_note(found.session),
        inputs=inputs_of(found.session, only=found.captures),
        en_definition=EN_DEFINITION,
        image=ImageRecord(width=rig.camera.width_px, height=rig.camera.height_px, white_level=first.white_level),
        columns=rig.projector.width_px,
        rows=rig.projector.height_px,
        names=BOARD_RIG_NAMES,
        parameters=_numbers(rig.values),
        rotation=_rows(rig.rotation),  # type: ignore[arg-type]
        covariance=_rows(covariance),
        dof=rig.dof,
        camera_rms_px=rig.camera_rms_px,
        projector_rms_px=rig.projector_rms_px,
        stereo_rms_px=fit.stereo_rms_px,
        camera_s_px=rig.camera_s_px,
        projector_s_px=rig.projector_s_px,
        axes=rig.axes,  # type: ignore[arg-type]
        undetermined=rig.undetermined,
        raster=tuple(_raster(found, name, raster) for name, raster in found.rasters.items()),
        poses=_poses(found),
        volume=VolumeRecord(
            points_mm=_rows(rig.volume_mm),  # type: ignore[arg-type]
            u_least_mm=float(u.min()),
            u_largest_mm=float(u.max()),
        ),
        board={name: EstimateRecord.of(estimate) for name, estimate in _board(rig).items()},
        baseline_mm=EstimateRecord.of(baseline(rig)),
        angle_deg=EstimateRecord.of(triangulation_angle(rig)),
        checks=board_checks(found, limits),
        limits=limits,
        targets={found.target.name: found.target.model_dump(mode="json", exclude_none=True)},
        notes=found.notes,
    )


def _board(rig: BoardRig) -> dict[str, Estimate]:
    """Return what was solved for the board, by name; what was held is left out."""
    u = np.sqrt(np.maximum(np.diag(rig.board_covariance), 0.0))
    rows = zip(rig.board_names, rig.board_values, u, strict=True)
    return {name: Estimate(float(value), float(own), "", name, rig.dof) for name, value, own in rows if own > 0}


def _poses(found: BoardCommissioning) -> tuple[PoseRecord, ...]:
    fits = {pose.name: pose for pose in found.fit.poses}
    rows = []
    for one in found.posed:
        row = PoseRecord(name=one.name, used=one.pose is not None, reason=one.reason, corners=one.corners, lit=one.lit)
        if one.pose is not None:
            pose = fits[one.name]
            row = row.model_copy(
                update={
                    "camera_rms_px": pose.camera_rms_px,
                    "projector_rms_px": pose.projector_rms_px,
                    "tilt_deg": pose.tilt_deg,
                    "distance_mm": pose.distance_mm,
                }
            )
        rows.append(row)
    return tuple(rows)


def _raster(found: BoardCommissioning, name: str, raster: RasterCoordinate) -> RasterRecord:
    extent, periods = next(
        (int(one.extent_px), tuple(p.period_px for p in capture.maps if p.axis == name) or axis_periods)
        for capture in found.captures
        for one, axis_periods in _counted(capture, name)
    )
    return RasterRecord(
        axis=name,  # type: ignore[arg-type]
        extent_px=extent,
        periods_px=periods,
        zeros_rad=raster.zeros_rad,
        falls=raster.falls,
    )


def _counted(capture: Capture, name: str) -> Iterator[tuple[FringeAxis | StatedMap, tuple[float, ...]]]:
    """Give what a capture states along an axis, by frames or maps, with its periods."""
    yield from ((axis, axis.periods_px) for axis in capture.axes if axis.name == name)
    yield from ((one, (one.period_px,)) for one in capture.maps if one.axis == name)


def _numbers(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(map(float, values))


def _rows(matrix: NDArray[np.float64]) -> tuple[tuple[float, ...], ...]:
    return tuple(map(_numbers, matrix))
