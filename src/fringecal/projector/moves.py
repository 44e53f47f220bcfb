"""What a rig becomes when one physical thing in it moves: camera, projector, slide, lens, plate or strips.

Every move gives camera and rig model in the plate frame as it is afterwards, which the camera's picture and the plate
define anew. The plate's smooth residual goes with its plate points: moves are small against its waves.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import CAMERA_NAMES, PlateCamera
from fringecal.projector.move_kinds import STRIP_SETS, Move
from fringecal.projector.rig_model import RigModel, projector_line, projector_point

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigState:
    """A rig as far as an audit sees it.

    Parameters
    ----------
    camera, model
        The camera on the plate, and the phase in space.
    strip_scale, set_scales
        True over stated height of all strips, and of single sets of them by number, on top of it.
    camera_blur_px2, fringe_blur_mm2
        Change of the variance of the camera's blur in px^2, and of the fringes' on the plate in mm^2.
    """

    camera: PlateCamera
    model: RigModel
    strip_scale: float = 1.0
    camera_blur_px2: float = 0.0
    fringe_blur_mm2: float = 0.0
    set_scales: Mapping[int, float] = field(default_factory=dict)


def moved(state: RigState, amounts: Mapping[Move, float]) -> RigState:
    """Return the rig after moves, one after the other.

    Parameters
    ----------
    amounts
        By move: millimetres, radians, or relative changes.

    Examples
    --------
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 1000.0}, (480, 640))
    >>> model = RigModel(np.array([0, 0.8, -0.9, 0, 0, 5e-4, -4e-4]), np.array([0, 1000.0, 1000.0]))
    >>> lower = moved(RigState(camera, model), {Move.CAMERA_HEIGHT: -5.0})
    >>> round(lower.camera["scale_mm_per_px"], 6)
    0.4975
    """
    for move, amount in amounts.items():
        state = MOVES[move](state, amount)
    return state


def _camera(state: RigState, **values: float) -> RigState:
    parameters = state.camera.parameters.copy()
    for name, value in values.items():
        parameters[CAMERA_NAMES.index(name)] = value
    return replace(state, camera=state.camera.replaced(parameters))


def _framed(state: RigState, turn: Array, origin: Array) -> RigState:
    """Write the phase in a new frame: old point = turn @ new point + origin."""
    numerator, denominator = state.model.parameters[:3], state.model.parameters[4:]
    below = 1 + denominator @ origin
    parameters = np.array([*(numerator @ turn), numerator @ origin + state.model.parameters[3], *(denominator @ turn)])
    return _model(state, parameters / below, turn.T @ (state.model.projector_mm - origin))


def _model(state: RigState, parameters: Array, near: Array) -> RigState:
    projector = projector_point(parameters, near=near)
    return replace(state, model=replace(state.model, parameters=parameters, projector_mm=projector))


def _camera_raised(state: RigState, amount_mm: float) -> RigState:
    camera = state.camera
    height = camera["height_mm"]
    after = _camera(
        state, height_mm=height + amount_mm, scale_mm_per_px=camera["scale_mm_per_px"] * (height + amount_mm) / height
    )
    origin = -amount_mm * np.array([math.tan(camera["tilt_x_rad"]), math.tan(camera["tilt_y_rad"]), 0.0])
    return _framed(after, np.eye(3), origin)


def _camera_turned(axis: int) -> Callable[[RigState, float], RigState]:
    name = ("tilt_x_rad", "tilt_y_rad")[axis]

    def turned(state: RigState, amount_rad: float) -> RigState:
        camera = state.camera
        before, after = camera[name], camera[name] + amount_rad
        longer = math.cos(before) / math.cos(after)
        changed = _camera(state, **{name: after, "scale_mm_per_px": camera["scale_mm_per_px"] * longer})
        origin = np.zeros(3)
        # The axis tilts toward +x when its foot lies toward -x of the pupil.
        origin[axis] = -camera["height_mm"] * (math.tan(after) - math.tan(before))
        return _framed(changed, np.eye(3), origin)

    return turned


def _camera_shifted(axis: int) -> Callable[[RigState, float], RigState]:
    return lambda state, amount_mm: _framed(state, np.eye(3), amount_mm * np.eye(3)[axis])


def _camera_rolled(state: RigState, amount_rad: float) -> RigState:
    return _framed(state, _rotation(np.array([0.0, 0.0, 1.0]), amount_rad), np.zeros(3))


def _refocused(state: RigState, relative: float) -> RigState:
    return _camera(state, scale_mm_per_px=state.camera["scale_mm_per_px"] / (1 + relative))


def _lens_distorted(state: RigState, amount: float) -> RigState:
    return _camera(state, k1=state.camera["k1"] + amount)


def _projector_shifted(axis: int) -> Callable[[RigState, float], RigState]:
    def shifted(state: RigState, amount_mm: float) -> RigState:
        after = _framed(state, np.eye(3), -amount_mm * np.eye(3)[axis])
        return replace(after, camera=state.camera)

    return shifted


def _projector_aimed(axis: int) -> Callable[[RigState, float], RigState]:
    """Shift the projector, turn it back to the point it lit, and rule the slide to the same fringes at the origin."""

    def aimed(state: RigState, amount_mm: float) -> RigState:
        projector, model = state.model.projector_mm, state.model
        towards = model.parameters[4:] / np.linalg.norm(model.parameters[4:])
        aim = projector - towards * projector[2] / towards[2]
        new = projector + amount_mm * np.eye(3)[axis]
        depth = (aim - new) / np.linalg.norm(aim - new)
        d = -depth / (depth @ new)
        helper = np.eye(3)[int(np.argmin(np.abs(depth)))]
        first = np.cross(depth, helper)
        across = np.stack([first / np.linalg.norm(first), np.cross(depth, first) / np.linalg.norm(first)])
        # At the origin the ratio is n0, its slope (n - n0 d): n is chosen across the axis so that the slope stays.
        slope = (model.parameters[:2] - model.parameters[3] * model.parameters[4:6])[None, :]
        per_unit = across[:, :2] + np.outer(across @ new, d[:2])
        n = np.linalg.lstsq(per_unit.T, slope[0], rcond=None)[0] @ across
        return _model(state, np.array([*n, -n @ new, *d]), new)

    return aimed


def _projector_turned(axis: int) -> Callable[[RigState, float], RigState]:
    def turned(state: RigState, amount_rad: float) -> RigState:
        pivot = np.where(np.isfinite(state.model.projector_mm), state.model.projector_mm, 0.0)
        turn = _rotation(np.eye(3)[axis], amount_rad)
        return replace(_framed(state, turn.T, pivot - turn.T @ pivot), camera=state.camera)

    return turned


def _slide_ruled(state: RigState, relative: float) -> RigState:
    """Make the slide's pitch larger: every phase becomes smaller, the projector stays."""
    parameters = state.model.parameters.copy()
    parameters[:4] /= 1 + relative
    return _model(state, parameters, state.model.projector_mm)


def _slide_turned(state: RigState, amount_rad: float) -> RigState:
    """Turn the slide about the projector's axis."""
    parameters, pivot = state.model.parameters, state.model.projector_mm
    if not np.all(np.isfinite(pivot)):
        return state
    axis = parameters[4:] / np.linalg.norm(parameters[4:])
    across = parameters[:3] - (parameters[:3] @ axis) * axis
    n = _rotation(axis, amount_rad) @ across
    return _model(state, np.array([*n, -n @ pivot, *parameters[4:]]), pivot)


def _plate_tilted(axis: int) -> Callable[[RigState, float], RigState]:
    """Tilt the plate about the origin, so that it rises toward +x (axis 0) or +y (axis 1)."""

    def tilted(state: RigState, amount_rad: float) -> RigState:
        camera = state.camera
        about = np.array([0.0, -1.0, 0.0]) if axis == 0 else np.array([1.0, 0.0, 0.0])
        turn = _rotation(about, amount_rad)
        optical = turn.T @ np.array([math.tan(camera["tilt_x_rad"]), math.tan(camera["tilt_y_rad"]), 1.0])
        seen = _camera(
            state,
            tilt_x_rad=math.atan(optical[0] / optical[2]),
            tilt_y_rad=math.atan(optical[1] / optical[2]),
            height_mm=camera["height_mm"] * float(optical[2]),
        )
        return _framed(seen, turn, np.zeros(3))

    return tilted


def _plate_raised(state: RigState, amount_mm: float) -> RigState:
    after = _framed(state, np.eye(3), np.array([0.0, 0.0, amount_mm]))
    return _camera_raised(after, 0.0) if state.camera.telecentric else _camera_raised(after, -amount_mm)


def _strips_changed(state: RigState, relative: float) -> RigState:
    return replace(state, strip_scale=state.strip_scale * (1 + relative))


def _set_changed(number: int) -> Callable[[RigState, float], RigState]:
    def changed(state: RigState, relative: float) -> RigState:
        own = state.set_scales.get(number, 1.0) * (1 + relative)
        return replace(state, set_scales={**state.set_scales, number: own})

    return changed


def _lens_blurred(state: RigState, amount_px2: float) -> RigState:
    return replace(state, camera_blur_px2=state.camera_blur_px2 + amount_px2)


def _fringes_blurred(state: RigState, amount_mm2: float) -> RigState:
    return replace(state, fringe_blur_mm2=state.fringe_blur_mm2 + amount_mm2)


def _rotation(axis: Array, angle_rad: float) -> Array:
    """Rotation matrix about a unit vector (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * cross @ cross)


def has_projector_position(model: RigModel) -> bool:
    """Return whether the projector has a finite position, which can move.

    Examples
    --------
    >>> model = RigModel(np.array([0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.full(3, np.inf))  # light from 45 deg
    >>> has_projector_position(model)
    False
    """
    return bool(np.all(np.isfinite(projector_line(model.parameters)[0])) and np.all(np.isfinite(model.projector_mm)))


#: What each move does; amounts in mm, rad, or relative.
MOVES: Mapping[Move, Callable[[RigState, float], RigState]] = {
    Move.CAMERA_HEIGHT: _camera_raised,
    Move.CAMERA_ALONG_X: _camera_shifted(0),
    Move.CAMERA_ALONG_Y: _camera_shifted(1),
    Move.CAMERA_TILT_X: _camera_turned(0),
    Move.CAMERA_TILT_Y: _camera_turned(1),
    Move.CAMERA_ROLL: _camera_rolled,
    Move.FOCAL_LENGTH: _refocused,
    Move.LENS_DISTORTION: _lens_distorted,
    Move.LENS_BLUR: _lens_blurred,
    Move.PROJECTOR_ALONG_X: _projector_shifted(0),
    Move.PROJECTOR_ALONG_Y: _projector_shifted(1),
    Move.PROJECTOR_ALONG_Z: _projector_shifted(2),
    Move.AIMED_PROJECTOR_ALONG_X: _projector_aimed(0),
    Move.AIMED_PROJECTOR_ALONG_Y: _projector_aimed(1),
    Move.AIMED_PROJECTOR_ALONG_Z: _projector_aimed(2),
    Move.PROJECTOR_TURNED_X: _projector_turned(0),
    Move.PROJECTOR_TURNED_Y: _projector_turned(1),
    Move.PROJECTOR_TURNED_Z: _projector_turned(2),
    Move.SLIDE_PITCH: _slide_ruled,
    Move.SLIDE_TURN: _slide_turned,
    Move.FRINGE_BLUR: _fringes_blurred,
    Move.PLATE_TILT_X: _plate_tilted(0),
    Move.PLATE_TILT_Y: _plate_tilted(1),
    Move.PLATE_HEIGHT: _plate_raised,
    Move.STRIP_HEIGHT: _strips_changed,
    **{move: _set_changed(number) for number, move in enumerate(STRIP_SETS)},
}
