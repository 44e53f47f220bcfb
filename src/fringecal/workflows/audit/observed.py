"""Today's grid, plate and strips beside what the calibration in force predicts of them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.camera import CAMERA_NAMES, CameraFit, fit_grid_camera
from fringecal.detect import GridDetection
from fringecal.errors import SessionError
from fringecal.numerics import wrap
from fringecal.phase import unwrap
from fringecal.projector import RigCalibration, RigState, StripPhase, measure_strips, numberings
from fringecal.session import Capture, Session
from fringecal.targets import Strips
from fringecal.uncertainty import Estimate, Influence
from fringecal.workflows.audit.layout import PLATE_DEGREE, Blocks, StripBlocks, block_means, strip_step
from fringecal.workflows.commission import SCALED, grid_with_pitch
from fringecal.workflows.lens import known_lens
from fringecal.workflows.shared import CapturePhase, phase_of_capture, within_border

Array = NDArray[np.float64]

_LEAST_PLATE = 0.05  # of the picture: a smaller piece of plate tells nothing of the field
_LEAST_BLOCKS = 6  # of strips: two for each of the three terms that are fitted to them
_NOT_THE_PLATE_RAD = 0.5  # rms about a smooth change; strips or bars leave more


@dataclass(frozen=True)
class GridFound:
    """The grid in today's picture and the camera that it shows; `same_sheet` as at the calibration."""

    detection: GridDetection
    fit: CameraFit
    same_sheet: bool


@dataclass(frozen=True)
class PlateFound:
    """Today's bare plate: its phase, the change against the calibration (rad, (H, W)) and its mean over blocks.

    `offset_rad` is the constant part, which a mirror turned by hand leaves anywhere; `change_rad` is without it.
    """

    phase: CapturePhase
    change_rad: Array
    blocks: Blocks
    offset_rad: float


@dataclass(frozen=True)
class StripsFound:
    """Today's strips: change of their phase difference against the plate (rad, (H, W)), and blocks of it.

    `same_strips` states whether they are those of the calibration; `u_height` is the relative standard uncertainty of
    their height.
    """

    phase: CapturePhase
    change_rad: Array
    tops: StripBlocks
    same_strips: bool
    u_height: float


def base_state(calibration: RigCalibration) -> RigState:
    """Return the rig as calibrated; uncertainties are carried elsewhere."""
    camera = calibration.camera
    return RigState(camera.replaced(camera.parameters, np.zeros_like(camera.covariance)), calibration.model)


def measured_grid(
    session: Session, capture: Capture, calibration: RigCalibration, targets: dict[str, Any]
) -> GridFound:
    """Find the grid and fit the camera to it, with the height that the calibration states.

    Raises
    ------
    SessionError
        The grid's target is neither a line grid nor a board.
    DetectionError, FitError
        No grid shows, or it does not determine the camera.
    """
    target = capture.target
    if not isinstance(target, SCALED):
        raise SessionError([f"capture {capture.name!r}: its target is neither a line grid nor a board; name one"])
    detection, pitch = grid_with_pitch(capture, target)
    camera = calibration.camera
    place = CAMERA_NAMES.index("height_mm")
    height = Estimate(
        camera["height_mm"], float(np.sqrt(camera.covariance[place, place])), "mm", influence=Influence.CAMERA_HEIGHT
    )
    known = known_lens(session)
    fit = fit_grid_camera(
        detection,
        pitch,
        height_mm=None if camera.telecentric else height,
        telecentric=camera.telecentric,
        lens=None if known is None else known.lens,
    )
    return GridFound(detection, fit, same_target(target, targets))


def same_target(target: Any, targets: dict[str, Any]) -> bool:
    """Return whether an artefact is one that the calibration was made with: its file says the same."""
    return any(target.model_dump(mode="json") == stated for stated in targets.values())


def measured_plate(capture: Capture, calibration: RigCalibration) -> PlateFound:
    """Compare the bare plate's phase with the one that the calibration predicts, pixel by pixel.

    Raises
    ------
    SessionError
        What lies there is no bare plate.
    PhaseError
        The frames hold no phase.
    """
    phase = phase_of_capture(capture, wave=calibration.wave)
    rays = calibration.camera.pixel_rays()
    predicted = calibration.model.phase(rays.ax, rays.ay, 0.0)
    valid = phase.map.valid & np.isfinite(predicted) & within_border(predicted.shape)
    wrapped = np.where(valid, wrap(phase.map.phase - np.where(valid, predicted, 0.0)), 0.0)
    change = _largest_piece(wrapped, valid, capture.name)
    offset = float(np.nanmedian(change))
    change = change - offset
    blocks = block_means(np.nan_to_num(change), np.isfinite(change))
    design = blocks.design(PLATE_DEGREE)
    left = blocks.value - design @ np.linalg.lstsq(design, blocks.value, rcond=None)[0]
    rms = float(np.sqrt(np.mean(left**2)))
    if rms > _NOT_THE_PLATE_RAD:
        raise SessionError(
            [
                f"capture {capture.name!r}: its phase differs from the calibrated plate's by {rms:.2f} rad rms beyond "
                "any smooth change: something lies on the plate, captures are swapped, or frames are out of order; "
                "look at its pictures, take the bare plate again"
            ]
        )
    return PlateFound(phase, change, blocks, offset)


def _largest_piece(wrapped: Array, valid: NDArray[np.bool_], name: str) -> Array:
    """Unwrap a smooth difference; NaN outside its largest connected piece."""
    pieces = unwrap(wrapped, valid)
    sizes = np.bincount(pieces.pieces.ravel())
    sizes[0] = 0
    if sizes.max(initial=0) < _LEAST_PLATE * wrapped.size:
        raise SessionError(
            [
                f"capture {name!r}: the phase hangs together on less than {_LEAST_PLATE:.0%} of the picture; more "
                "light, less ambient light, or a focus of the projector on the plate is needed"
            ]
        )
    return np.where(pieces.pieces == int(np.argmax(sizes)), pieces.phase, np.nan)


def measured_strips(
    capture: Capture, plate: PlateFound, calibration: RigCalibration, targets: dict[str, Any]
) -> StripsFound:
    """Compare the strips' phase difference against today's plate with the one that the calibration predicts.

    Raises
    ------
    SessionError
        The target is no set of strips.
    DetectionError, FitError
        The strips do not show.
    """
    target = capture.target
    if not isinstance(target, Strips):
        raise SessionError([f"capture {capture.name!r}: its target is no set of strips; name one"])
    phase = phase_of_capture(capture, wave=calibration.wave)
    found = measure_strips(plate.phase.map, phase.map, target, calibration.camera)
    inside = _inner(found) & plate.phase.map.valid & phase.map.valid
    step = np.where(inside, phase.map.phase.astype(float) - plate.phase.map.phase - found.plate_drift_rad, 0.0)
    heights = _heights(found, step, inside, base_state(calibration))
    rays = calibration.camera.pixel_rays()
    predicted = calibration.model.phase(*rays.at(heights), heights) - calibration.model.phase(rays.ax, rays.ay, 0.0)
    inside &= np.isfinite(predicted)
    change = np.where(inside, wrap(step - np.where(inside, predicted, 0.0)), np.nan)
    blocks = block_means(np.nan_to_num(change), inside)
    if blocks.value.size < _LEAST_BLOCKS:
        raise SessionError([f"capture {capture.name!r}: too few pixels of strips to compare; light the strips"])
    tops = StripBlocks(blocks, block_means(heights, inside).value)
    height = target.height_mm
    u_height = max(u / value for u, value in zip(height.us, height.values, strict=True))
    return StripsFound(phase, change, tops, same_target(target, targets), u_height)


def _inner(found: StripPhase) -> NDArray[np.bool_]:
    """Strip tops without their outermost pixels, which see the plate as well."""
    return np.asarray(ndimage.binary_erosion(found.pieces > 0, np.ones((3, 3), np.bool_), border_value=1))


def _heights(found: StripPhase, step: Array, inside: NDArray[np.bool_], state: RigState) -> Array:
    """Stated height at every pixel; of strips that differ, in the order that fits best."""
    best: tuple[float, Array] | None = None
    for items in numberings(found):
        by_label = np.array([0.0, *(found.heights_mm[i].value if i >= 0 else 0.0 for i in items)])
        heights = by_label[found.regions.labels]
        blocks = block_means(heights, inside)
        u, v = np.rint(blocks.u_px).astype(int), np.rint(blocks.v_px).astype(int)
        rest = wrap(step[v, u] - strip_step(state, StripBlocks(blocks, heights[v, u])))
        rest = rest[inside[v, u]]
        score = float(np.mean(np.abs(rest))) if rest.size else np.inf
        if best is None or score < best[0]:
            best = (score, heights)
    if best is None:
        raise SessionError(["the strips seen are more than the target has; name the target that lies there"])
    return best[1]


def with_todays_offset(calibration: RigCalibration, offset_rad: float) -> RigCalibration:
    """Add a constant to the phase everywhere: it depends on where the mirror was left, not on the rig."""
    model, c = calibration.model, offset_rad
    parameters = model.parameters.copy()
    parameters[:3] += c * parameters[4:]
    parameters[3] += c
    return replace(calibration, model=replace(model, parameters=parameters))
