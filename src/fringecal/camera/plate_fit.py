"""Fit the camera on the plate to the crossings of a grid whose pitch is known."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from fringecal.camera.plate import CAMERA_NAMES, PlateCamera
from fringecal.camera.scatter import shared_scatter
from fringecal.errors import FitError
from fringecal.uncertainty.estimates import Estimate

Array = NDArray[np.float64]

_MIN_CROSSINGS = 12
_OUTLIER = 4.0  # residuals beyond this many robust sigmas are wrong crossings, not noise
_LEAST_FACTOR = 0.02  # residuals of drawn pictures may vanish; the priors must still be felt beside them
_POSE = ("turn_rad", "x0_mm", "y0_mm", "stretch")


@dataclass(frozen=True)
class CameraFit:
    """A camera fitted to a grid, with the residuals that tell whether to believe it.

    `residual_u_px` and `residual_v_px` are observed minus modelled, NaN for rejected crossings; `rms_px` is
    over both coordinates; `free` names the parameters that the grid or a prior determined. `causes` splits the
    camera's covariance: one vector per stated input (its effect on all parameters, one standard uncertainty
    large), and what is left is the scatter of the crossings.
    """

    camera: PlateCamera
    residual_u_px: Array
    residual_v_px: Array
    rms_px: float
    dof: int
    free: tuple[str, ...]
    turn_deg: float
    causes: dict[str, Array]


@dataclass(frozen=True)
class _Problem:
    u: Array
    v: Array
    x: Array
    y: Array
    sigma: Array
    start: PlateCamera
    free: tuple[int, ...]
    stretch_u: float
    height: Estimate | None
    focal: Estimate | None


def fit_plate_camera(
    points_px: Array,
    points_mm: Array,
    shape: tuple[int, int],
    *,
    pitch_rel_u: float,
    sigma_px: Array | float = 0.05,
    height_mm: Estimate | None = None,
    telecentric: bool = False,
    lens: PlateCamera | None = None,
    focal_px: Estimate | None = None,
    distortion: tuple[str, ...] = ("k1",),
    index: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None,
) -> CameraFit:
    """Fit scale, aspect, tilt and distortion to indexed crossings; priors enter as observations.

    Parameters
    ----------
    points_px
        Crossings (u, v) in px, shape (n, 2).
    points_mm
        The same crossings on the sheet in mm, shape (n, 2), in any frame in its plane; y up when the
        sheet's rows are numbered downward.
    shape
        Image shape (rows, columns).
    pitch_rel_u
        Relative standard uncertainty of the sheet's pitch, common to all crossings.
    sigma_px
        Standard uncertainty of a crossing; the fit rescales it when its residuals are larger.
    height_mm
        Entrance pupil above the plate. A single grid seen square-on holds no information about it.
    telecentric
        True for a lens whose rays are parallel; `height_mm` must then be absent.
    lens, focal_px
        A camera whose distortion and principal point are taken over, and its focal length.
    distortion
        Which of Brown's parameters are free.
    index
        Row and column of the crossings: neighbours on a line share points, and the covariance must know
        (`camera.scatter`). Without it they count as independent.

    Raises
    ------
    FitError
        Too few crossings, no height for a pinhole, or crossings that no such camera can have seen.
    """
    if len(points_px) < _MIN_CROSSINGS:
        raise FitError(
            f"{len(points_px)} crossings of the grid were indexed; at least {_MIN_CROSSINGS} are needed. "
            "Photograph the grid larger or sharper."
        )
    if not telecentric and height_mm is None and focal_px is None:
        raise FitError(
            "The camera's height is not stated, and one square-on grid can never yield it (any focal length "
            "fits equally well). State camera.height_mm = { value, u }, or camera.model, or telecentric = true."
        )
    problem = _prepare(
        points_px, points_mm, shape, sigma_px, telecentric, distortion, pitch_rel_u, height_mm, focal_px, lens
    )
    solution, keep = _solve_robustly(problem, _first_guess(problem), index)
    return _report(problem, solution, keep)


def _prepare(  # noqa: PLR0913, PLR0917 -- private: gathers what the public function was given
    points_px: Array,
    points_mm: Array,
    shape: tuple[int, int],
    sigma_px: Array | float,
    telecentric: bool,
    distortion: tuple[str, ...],
    stretch_u: float,
    height: Estimate | None,
    focal: Estimate | None,
    lens: PlateCamera | None,
) -> _Problem:
    values = {} if lens is None else {n: lens[n] for n in CAMERA_NAMES[4:11]} | {"aspect": lens["aspect"]}
    guess = 1.0 if telecentric else (height.value if height else 1000.0)
    start = PlateCamera.from_values(
        {"height_mm": guess, "scale_mm_per_px": 1.0} | values, shape, telecentric=telecentric
    )
    names = ["scale_mm_per_px", "tilt_x_rad", "tilt_y_rad"]
    if lens is None:
        names += ["aspect", *distortion]
    if not telecentric:
        names.append("height_mm")
    elif lens is None:
        # For parallel rays a tilt is only a second-order stretch, the same as an aspect: it is not free.
        names = [n for n in names if not n.startswith("tilt")]
    free = tuple(i for i, n in enumerate(CAMERA_NAMES) if n in names)
    sigma = np.broadcast_to(np.asarray(sigma_px, float), (len(points_px),)).copy()
    u, v = np.asarray(points_px, float).T
    x, y = (np.asarray(points_mm, float) - np.mean(points_mm, axis=0)).T
    return _Problem(u, v, x, y, sigma, start, free, stretch_u, height, focal)


def _first_guess(problem: _Problem) -> Array:
    """Similarity from plate to picture: scale, turn and shift, everything else nothing."""
    u0, v0 = problem.start.centre_px
    plate = problem.x + 1j * problem.y
    picture = (problem.u - u0) - 1j * (problem.v - v0)
    design = np.column_stack([plate, np.ones_like(plate)])
    (gain, shift), *_ = np.linalg.lstsq(design, picture, rcond=None)
    residual = picture - design @ np.array([gain, shift])
    if np.std(residual) > 0.2 * np.std(picture):
        raise FitError(
            "The crossings and the sheet do not fit together even roughly: the index of rows or columns runs "
            "the wrong way or slipped."
        )
    scale = 1 / abs(gain)
    camera = problem.start.parameters.copy()
    camera[0] = scale
    if problem.focal is not None and problem.height is None:
        camera[-1] = problem.focal.value * scale
    origin = shift * scale
    return np.concatenate([camera[list(problem.free)], [np.angle(gain), origin.real, origin.imag, 0.0]])


def _camera_of(problem: _Problem, vector: Array) -> PlateCamera:
    parameters = problem.start.parameters.copy()
    parameters[list(problem.free)] = vector[: len(problem.free)]
    return problem.start.replaced(parameters)


def _misfit_px(problem: _Problem, vector: Array) -> tuple[Array, Array]:
    turn, x0, y0, stretch = vector[len(problem.free) :]
    cosine, sine = (1 + stretch) * math.cos(turn), (1 + stretch) * math.sin(turn)
    x = cosine * problem.x - sine * problem.y + x0
    y = sine * problem.x + cosine * problem.y + y0
    u, v = _camera_of(problem, vector).project(x, y)
    return problem.u - u, problem.v - v


def _residuals(vector: Array, problem: _Problem, keep: Array, factor: float) -> Array:
    du, dv = _misfit_px(problem, vector)
    sigma = problem.sigma[keep] * factor
    rows = [du[keep] / sigma, dv[keep] / sigma, np.atleast_1d(vector[-1] / max(problem.stretch_u, 1e-9))]
    camera = _camera_of(problem, vector)
    if problem.height is not None:
        rows.append(np.atleast_1d((camera["height_mm"] - problem.height.value) / max(problem.height.u, 1e-6)))
    if problem.focal is not None:
        rows.append(np.atleast_1d((camera.focal_px - problem.focal.value) / max(problem.focal.u, 1e-6)))
    return np.concatenate(rows)


@dataclass(frozen=True)
class _Solution:
    vector: Array
    covariance: Array
    factor: float


def _solve(problem: _Problem, start: Array, keep: Array, factor: float) -> _Solution:
    scales = np.maximum(np.abs(start), 1e-3)
    result = least_squares(
        _residuals, start, args=(problem, keep, factor), x_scale=scales, method="trf", xtol=1e-12, ftol=1e-12
    )
    jacobian = np.asarray(result.jac, dtype=float) * scales
    _, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    if singular[-1] < 1e-9 * singular[0]:
        raise FitError(
            "The grid does not determine the camera: two of its parameters cannot be told apart. Photograph a "
            "larger part of the grid, or state the lens."
        )
    covariance = (right.T / singular**2) @ right * np.outer(scales, scales)
    return _Solution(result.x, covariance, factor)


def _solve_robustly(
    problem: _Problem, start: Array, index: tuple[NDArray[np.int64], NDArray[np.int64]] | None
) -> tuple[_Solution, Array]:
    """Solve, drop crossings that disagree, solve again with sigma scaled to the residuals found."""
    keep = np.ones(problem.u.size, dtype=bool)
    solution = _solve(problem, start, keep, 1.0)
    for _ in range(3):
        du, dv = _misfit_px(problem, solution.vector)
        size = np.hypot(du, dv) / problem.sigma
        robust = 1.4826 * np.median(np.abs(np.concatenate([du, dv]) / np.tile(problem.sigma, 2)))
        keep = size < _OUTLIER * math.sqrt(2) * max(robust, 1e-9)
        if np.count_nonzero(keep) < max(_MIN_CROSSINGS, 0.5 * keep.size):
            raise FitError(
                f"Only {np.count_nonzero(keep)} of {keep.size} crossings agree with one flat sheet seen by one "
                "camera: the sheet is bent, or lines were mistaken."
            )
        spread = np.concatenate([du[keep], dv[keep]]) / np.tile(problem.sigma[keep], 2)
        factor = math.sqrt(np.sum(spread**2) / max(1, spread.size - solution.vector.size))
        factor = max(factor, _LEAST_FACTOR)
        if index is not None:
            rest = np.where(keep[:, None], np.column_stack([du, dv]), np.nan)
            factor *= math.sqrt(shared_scatter(*index, np.column_stack([problem.u, problem.v]), rest))
        solution = _solve(problem, solution.vector, keep, factor)
    return solution, keep


def _report(problem: _Problem, solution: _Solution, keep: Array) -> CameraFit:
    free = list(problem.free)
    covariance = np.zeros((len(CAMERA_NAMES),) * 2)
    covariance[np.ix_(free, free)] = solution.covariance[: len(free), : len(free)]
    camera = _camera_of(problem, solution.vector).replaced(_camera_of(problem, solution.vector).parameters, covariance)
    du, dv = (np.where(keep, d, np.nan) for d in _misfit_px(problem, solution.vector))
    rms = math.sqrt(float(np.nanmean(np.concatenate([du, dv]) ** 2)))
    return CameraFit(
        camera=camera,
        residual_u_px=du,
        residual_v_px=dv,
        rms_px=rms,
        dof=2 * int(np.count_nonzero(keep)) - solution.vector.size,
        free=tuple(CAMERA_NAMES[i] for i in free),
        turn_deg=math.degrees(solution.vector[len(free)]),
        causes=_causes(problem, solution),
    )


def _causes(problem: _Problem, solution: _Solution) -> dict[str, Array]:
    """Return what one standard uncertainty of each stated input does to the camera (Kalman gain times u)."""
    free = list(problem.free)
    rows = {"grid pitch": _unit_row(solution.vector.size, -1) / max(problem.stretch_u, 1e-9)}
    height = CAMERA_NAMES.index("height_mm")
    if problem.height is not None and height in free:
        rows["camera height"] = _unit_row(solution.vector.size, free.index(height)) / max(problem.height.u, 1e-6)
    if problem.focal is not None and height in free:
        focal = _camera_of(problem, solution.vector).focal_px
        row = _unit_row(solution.vector.size, free.index(height)) * focal / solution.vector[free.index(height)]
        row -= _unit_row(solution.vector.size, free.index(0)) * focal / solution.vector[free.index(0)]
        rows["focal length"] = row / max(problem.focal.u, 1e-6)
    causes = {}
    for label, row in rows.items():
        effect = np.zeros(len(CAMERA_NAMES))
        effect[free] = (solution.covariance @ row)[: len(free)]
        causes[label] = effect
    return causes


def _unit_row(size: int, index: int) -> Array:
    row = np.zeros(size)
    row[index] = 1.0
    return row
