"""Measure a capture by a rig that a board has calibrated: points in the camera's frame, and heights over a plate."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.projector import BoardRig
from fringecal.reconstruct import PlateFrame, PlateHeights, VolumeMap, heights_over, plate_frame
from fringecal.records import BoardCalibrationRecord
from fringecal.session import Capture, Session
from fringecal.workflows.shared import board_rig_of, demand_for_rig, points_of_capture

Array = NDArray[np.float64]
Progress = Callable[[str], None]


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
    demand_for_rig(capture, rig)
    progress(f"phase of {capture.name}")
    seen = points_of_capture(capture, rig, written.raster)
    place, u_px, volume = seen.place_px, seen.usual_u_px, seen.volume
    plates = [one for one in session.find("reference") if one.counted_axes and one.shape == capture.shape]
    found = VolumeMeasured(capture, rig, place, u_px, volume)
    if not plates:
        return found
    progress(f"the plate of {plates[0].name}")
    plate = seen if plates[0].name == capture.name else points_of_capture(plates[0], rig, written.raster)
    frame = plate_frame(rig, plate.volume, plate.place_px)
    heights = heights_over(rig, frame, volume, place, u_px)
    return VolumeMeasured(capture, rig, place, u_px, volume, frame, heights, plates[0].name)
