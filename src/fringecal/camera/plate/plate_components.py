"""What one standard uncertainty of each stated input does to a fitted camera."""

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate.plate_camera import CAMERA_NAMES, PlateCamera
from fringecal.camera.plate.plate_problem import LEANING_RAD, Problem, camera_of, lens_of, lens_rows
from fringecal.camera.plate.plate_solve import Solution

Array = NDArray[np.float64]

_STEP_U = 1e-3  # of a derivative, in standard uncertainties of the parameter: within what is linear
_LEAST_STEP = 1e-12  # of parameters that are known exactly, in their own units
_DOUBTS = {"cu_px": "principal point, u", "cv_px": "principal point, v"}
_LEANING = {"tilt_x_rad": "camera tilt, x", "tilt_y_rad": "camera tilt, y"}


def causes_of(problem: Problem, solution: Solution) -> dict[str, Array]:
    """Return what one standard uncertainty of each stated input does to the camera (Kalman gain times u)."""
    free = list(problem.free)
    rows = {"grid pitch": _unit_row(solution.vector.size, problem.stretch_place) / problem.stretch_u}
    height = CAMERA_NAMES.index("height_mm")
    if problem.height is not None and height in free:
        rows["camera height"] = _unit_row(solution.vector.size, free.index(height)) / problem.height_u_mm
    for place, u in problem.doubts.items():
        rows[_DOUBTS[CAMERA_NAMES[free[place]]]] = _unit_row(solution.vector.size, place) / u
    causes = {}
    for label, row in rows.items():
        effect = np.zeros(len(CAMERA_NAMES))
        effect[free] = (solution.covariance @ row)[: len(free)]
        causes[label] = effect
    return causes | _lens_causes(problem, solution)


def leaning_of(camera: PlateCamera) -> dict[str, Array]:
    """Return what the lean of parallel rays does to a camera that counts as square on the plate."""
    if not camera.telecentric:
        return {}
    units = np.eye(len(CAMERA_NAMES)) * LEANING_RAD
    return {label: units[CAMERA_NAMES.index(name)] for name, label in _LEANING.items()}


def _lens_causes(problem: Problem, solution: Solution) -> dict[str, Array]:
    """Effects of the stated lens: one per principal axis of its covariance."""
    if problem.lens is None or not problem.lens.covariance.any():
        return {}
    observed, whitening = lens_rows(problem.lens)
    base = lens_of(camera_of(problem, solution.vector))
    steps = np.maximum(_STEP_U * np.sqrt(np.diag(solution.covariance)), _LEAST_STEP)
    columns = [
        (lens_of(camera_of(problem, solution.vector + step)) - base)[observed] / step.sum() for step in np.diag(steps)
    ]
    free = list(problem.free)
    causes = {}
    for number, row in enumerate(whitening @ np.column_stack(columns)):
        effect = np.zeros(len(CAMERA_NAMES))
        effect[free] = (solution.covariance @ row)[: len(free)]
        causes[f"lens {number + 1}"] = effect
    return causes


def _unit_row(size: int, index: int) -> Array:
    row = np.zeros(size)
    row[index] = 1.0
    return row
