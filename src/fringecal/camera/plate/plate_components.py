"""What one standard uncertainty of each stated input does to a fitted camera."""

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate.plate_camera import CAMERA_NAMES, PlateCamera
from fringecal.camera.plate.plate_problem import TELECENTRIC_TILT_RAD, Problem, camera_of, lens_of, lens_rows
from fringecal.camera.plate.plate_solve import Solution
from fringecal.uncertainty import Influence, UncertaintyComponent

Array = NDArray[np.float64]

_STEP_U = 1e-3  # of a derivative, in standard uncertainties of the parameter: within what is linear
_LEAST_STEP = 1e-12  # of parameters that are known exactly, in their own units
_STATED = {"cu_px": Influence.PRINCIPAL_POINT_U, "cv_px": Influence.PRINCIPAL_POINT_V}
_TILTS = {"tilt_x_rad": Influence.CAMERA_TILT_X, "tilt_y_rad": Influence.CAMERA_TILT_Y}


def stated_components(problem: Problem, solution: Solution, dof: float) -> tuple[UncertaintyComponent, ...]:
    """Return what one standard uncertainty of each stated input does to the camera (Kalman gain times u).

    `dof` are the fit's: the inputs reach the camera through it.
    """
    free = list(problem.free)
    pitch = _unit_row(solution.vector.size, problem.stretch_place) / problem.stretch_u
    rows = {Influence.GRID_PITCH: pitch}
    height = CAMERA_NAMES.index("height_mm")
    if problem.height is not None and height in free:
        stated = _unit_row(solution.vector.size, free.index(height)) / problem.height_u_mm
        rows[Influence.CAMERA_HEIGHT] = stated
    for place, u in problem.u_of_zero.items():
        rows[_STATED[CAMERA_NAMES[free[place]]]] = _unit_row(solution.vector.size, place) / u
    found = [UncertaintyComponent(influence, _effect(row, free, solution), dof) for influence, row in rows.items()]
    axes = enumerate(_lens_rows(problem, solution), start=1)
    lens = (UncertaintyComponent(Influence.LENS, _effect(row, free, solution), dof, str(k)) for k, row in axes)
    return (*found, *lens)


def tilt_components(camera: PlateCamera, dof: float) -> tuple[UncertaintyComponent, ...]:
    """Return what the tilt of parallel rays does to a camera that counts as square on the plate."""
    if not camera.telecentric:
        return ()
    units = np.eye(len(CAMERA_NAMES)) * TELECENTRIC_TILT_RAD
    return tuple(
        UncertaintyComponent(influence, units[CAMERA_NAMES.index(name)], dof) for name, influence in _TILTS.items()
    )


def _effect(row: Array, free: list[int], solution: Solution) -> Array:
    effect = np.zeros(len(CAMERA_NAMES))
    effect[free] = (solution.covariance @ row)[: len(free)]
    return effect


def _lens_rows(problem: Problem, solution: Solution) -> Array:
    """Observations of the stated lens: one for each principal axis of its covariance."""
    if problem.lens is None or not problem.lens.covariance.any():
        return np.zeros((0, solution.vector.size))
    observed, whitening = lens_rows(problem.lens)
    base = lens_of(camera_of(problem, solution.vector))
    steps = np.maximum(_STEP_U * np.sqrt(np.diag(solution.covariance)), _LEAST_STEP)
    columns = [
        (lens_of(camera_of(problem, solution.vector + step)) - base)[observed] / step.sum() for step in np.diag(steps)
    ]
    return np.asarray(whitening @ np.column_stack(columns))


def _unit_row(size: int, index: int) -> Array:
    row = np.zeros(size)
    row[index] = 1.0
    return row
