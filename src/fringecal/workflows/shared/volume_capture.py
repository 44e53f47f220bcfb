"""From a capture's fringes to points in the camera's frame, by a rig that a board has calibrated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

from fringecal.errors import SessionError
from fringecal.phase import RasterCoordinate
from fringecal.projector import BoardRig
from fringecal.reconstruct import VolumeMap, volume_points
from fringecal.records import RasterRecord
from fringecal.session import Capture, FringeAxis
from fringecal.workflows.shared.raster_phase import raster_of_capture

_SAME = 1e-6  # relative, of periods that are one


@dataclass(frozen=True)
class VolumeCapture:
    """A capture's points by a rig of camera and inverse camera.

    Parameters
    ----------
    place_px
        The projector's coordinates, (2, H, W), px; NaN where not known.
    u_px
        Their standard uncertainty by the phase, px, float32, (2, H, W); 0 along an axis without fringes.
    usual_u_px
        The medians of these.
    volume
        Points of all pixels in the camera's frame.
    """

    place_px: NDArray[np.float64]
    u_px: NDArray[np.float32]
    usual_u_px: tuple[float, float]
    volume: VolumeMap


def demand_for_rig(capture: Capture, rig: BoardRig) -> None:
    """Refuse pictures of another size than the calibration's, and fringes along no axis that it knows.

    Raises
    ------
    SessionError
        With what was found, and what is needed.
    """
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


def points_of_capture(
    capture: Capture, rig: BoardRig, known: tuple[RasterRecord, ...], *, dtype: DTypeLike = np.float32
) -> VolumeCapture:
    """Count the projector's pixels as the calibration does, and triangulate.

    Parameters
    ----------
    capture, rig
        The capture, and the calibration.
    known
        How the calibration counts.
    dtype
        Of the points.

    Raises
    ------
    SessionError
        Fringes of other periods than the calibration's, whose zeros are not known.
    PhaseError, FitError
        No phase, or no point.
    """
    place, u_px = np.full((2, *capture.shape), np.nan), np.zeros((2, *capture.shape), np.float32)
    usual = [0.0, 0.0]
    for name in capture.counted_axes:
        if name in rig.axes:
            k = "uv".index(name)
            stated = next((axis for axis in capture.axes if axis.name == name), None)
            like = None if stated is None else _counted_as(stated, known)
            found = raster_of_capture(capture, name, like=like).raster
            place[k], u_px[k] = found.px, found.u_px
            usual[k] = float(np.nanmedian(np.where(np.isfinite(found.px), found.u_px, np.nan)))
    column, row = (place[k] if np.isfinite(place[k]).any() else None for k in (0, 1))
    middle = (usual[0], usual[1])
    return VolumeCapture(place, u_px, middle, volume_points(rig, column, row, u_px=middle, dtype=dtype))


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
