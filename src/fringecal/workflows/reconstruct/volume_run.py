"""Measure a capture by a rig that a board has calibrated: points in the camera's frame, and heights over a plate."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import SessionError
from fringecal.phase import RasterCoordinate
from fringecal.projector import BoardRig
from fringecal.reconstruct import PlateFrame, PlateHeights, VolumeMap, heights_over, plate_frame, volume_points
from fringecal.records import BoardCalibrationRecord, RasterRecord
from fringecal.session import Capture, FringeAxis, Session
from fringecal.workflows.shared import board_rig_of, raster_of_capture

Array = NDArray[np.float64]
Progress = Callable[[str], None]

_SAME = 1e-6  # relative, of periods that are one


@dataclass(frozen=True)
class VolumeMeasured:
    """A capture measured by a rig that a board has calibrated.

    Parameters
    ----------
    capture
        What was measured.
    rig
        The calibration.
    place_px
        The projector's coordinates, (2, H, W), px; NaN where not known.
    u_px
        Their median standard uncertainty by the phase, px; 0 along an axis without fringes.
    volume
        Points of all pixels in the camera's frame.
    frame, heights
        The plate's frame and the surface in it; None where the session shows no bare plate.
    plate
        Name of the capture that shows the plate.
    """

    capture: Capture
    rig: BoardRig
    place_px: Array
    u_px: tuple[float, float]
    volume: VolumeMap
    frame: PlateFrame | None = None
    heights: PlateHeights | None = None
    plate: str = ""


def measure_volume(
    session: Session, name: str | None, written: BoardCalibrationRecord, *, progress: Progress = lambda _: None
) -> VolumeMeasured:
    """Measure a capture: x, y, z and u at every pixel, in the plate's frame as well where a bare plate was captured.

    Parameters
    ----------
    session
        A checked session of the calibrated rig.
    name
        The capture; the only one of kind object where None.
    written
        The calibration's record.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    SessionError
        No such capture, pictures of another size, or fringes along no stated axis.
    PhaseError, FitError
        The frames hold no phase, or no point lies in the calibrated volume.
    """
    rig = board_rig_of(written)
    capture = session.one("object") if name is None else session.named(name)
    _demand(capture, rig)
    progress(f"phase of {capture.name}")
    place, u_px, volume = _points(capture, rig, written.raster)
    plates = [one for one in session.find("reference") if one.counted_axes and one.shape == capture.shape]
    found = VolumeMeasured(capture, rig, place, u_px, volume)
    if not plates:
        return found
    progress(f"the plate of {plates[0].name}")
    if plates[0].name == capture.name:
        of_plate, plate = place, volume
    else:
        of_plate, _, plate = _points(plates[0], rig, written.raster)
    frame = plate_frame(rig, plate, of_plate)
    heights = heights_over(rig, frame, volume, place, u_px)
    return VolumeMeasured(capture, rig, place, u_px, volume, frame, heights, plates[0].name)


def _demand(capture: Capture, rig: BoardRig) -> None:
    size = (rig.camera.height_px, rig.camera.width_px)
    if capture.shape != size:
        raise SessionError(
            [
                f"capture {capture.name!r}: pictures of {capture.shape[1]} x {capture.shape[0]} px, the calibration is "
                f"for {size[1]} x {size[0]} px; use pictures of the same camera, uncropped"
            ]
        )
    if not set(capture.counted_axes) & set(rig.axes):
        wanted = " or ".join(f'"{axis}"' for axis in rig.axes)
        raise SessionError(
            [f"capture {capture.name!r}: this rig is calibrated for fringes along {wanted}; state axes of the capture"]
        )


def _points(
    capture: Capture, rig: BoardRig, known: tuple[RasterRecord, ...]
) -> tuple[Array, tuple[float, float], VolumeMap]:
    """Count the projector's pixels as the calibration does, and triangulate."""
    place, u = np.full((2, *capture.shape), np.nan), [0.0, 0.0]
    for name in capture.counted_axes:
        if name in rig.axes:
            k = "uv".index(name)
            stated = next((axis for axis in capture.axes if axis.name == name), None)
            like = None if stated is None else _counted_as(stated, known)
            found = raster_of_capture(capture, name, like=like).raster
            place[k], u[k] = found.px, float(np.nanmedian(np.where(np.isfinite(found.px), found.u_px, np.nan)))
    column, row = (place[k] if np.isfinite(place[k]).any() else None for k in (0, 1))
    return place, (u[0], u[1]), volume_points(rig, column, row, u_px=(u[0], u[1]))


def _counted_as(axis: FringeAxis, known: tuple[RasterRecord, ...]) -> RasterCoordinate | None:
    """Return how the calibration counts along an axis, if the fringes are those that it was made with.

    Raises
    ------
    SessionError
        They are others, and those of the calibration have zeros that were found on it alone.
    """
    record = next(one for one in known if one.axis == axis.name)
    same = len(record.periods_px) == len(axis.periods_px) and np.allclose(
        record.periods_px, axis.periods_px, rtol=_SAME
    )
    zeros = record.zeros_rad
    if not same:
        if any(zeros) and not axis.zeros_rad:
            raise SessionError(
                [
                    f"axis {axis.name}: fringes of other periods than the calibration's, whose phase zeros were found "
                    "on them; use the same, or state zeros_deg of both"
                ]
            )
        zeros = axis.zeros_rad or (0.0,) * len(axis.periods_px)
    return RasterCoordinate(
        np.zeros((0, 0)), np.zeros((0, 0), np.float32), record.extent_px, np.inf, zeros, record.falls
    )
