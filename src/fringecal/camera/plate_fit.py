"""Fit the camera on the plate to the crossings of a grid whose pitch is known."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from fringecal.camera.lens import Lens
from fringecal.camera.plate import CAMERA_NAMES, PlateCamera
from fringecal.camera.scatter import shared_scatter
from fringecal.errors import FitError
from fringecal.uncertainty.estimates import Estimate

Array = NDArray[np.float64]

_MIN_CROSSINGS = 12
_OUTLIER = 4.0  # residuals beyond this many robust sigmas are wrong crossings, not noise
_EXACT = 1e-7  # relative u of a focal length whose file states none
#: Lines are placed in the picture with a common stretch below 5e-6 (`tests/detect`, pictures without noise); among
#: 460 virtual cameras 2e-6 made the 95 % interval of the scale hold where noise is least.
_PLACING_REL_U = 2e-6
_LEAST_FACTOR = 0.02  # residuals of drawn pictures may vanish; the priors must still be felt beside them
#: Of the picture's diagonal: how far a lens's axis is off the image centre where no lens is stated. A square-on grid
#: hardly tells; left out, it would turn every line of sight by 1/4 deg unnoticed, and the projection angle with it.
_CENTRING_SHARE = 0.01
_CENTRING = ("cu_px", "cv_px")
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
    lens: Lens | None

    @property
    def centring_u_px(self) -> dict[int, float]:
        """Standard uncertainty of the principal point's parameters, by place in the vector; none with a lens."""
        if self.lens is not None:
            return {}
        u = _CENTRING_SHARE * math.hypot(self.start.width_px, self.start.height_px)
        places = (CAMERA_NAMES.index(name) for name in _CENTRING)
        return {self.free.index(i): u for i in places if i in self.free}


def fit_plate_camera(
    points_px: Array,
    points_mm: Array,
    shape: tuple[int, int],
    *,
    pitch_rel_u: float,
    sigma_px: Array | float = 0.05,
    height_mm: Estimate | None = None,
    telecentric: bool = False,
    lens: Lens | None = None,
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
    lens
        A full lens, calibrated elsewhere: focal length, principal point and distortion with their
        covariance enter as observations; `distortion` is then not asked. Without it the principal point of a
        pinhole is observed to be the image centre, within 1 % of the picture's diagonal.
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
    if not telecentric and height_mm is None and lens is None:
        raise FitError(
            "The camera's height is not stated, and one square-on grid can never yield it (any focal length "
            "fits equally well). State camera.height_mm = { value, u }, or camera.model, or telecentric = true."
        )
    problem = _prepare(points_px, points_mm, shape, sigma_px, telecentric, distortion, pitch_rel_u, height_mm, lens)
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
    lens: Lens | None,
) -> _Problem:
    if lens is not None:
        _refuse_other_camera(lens, shape, telecentric=telecentric)
    values = {} if lens is None else lens_parameters(lens)
    guess = 1.0 if telecentric else (height.value if height else 1000.0)
    start = PlateCamera.from_values(
        {"height_mm": guess, "scale_mm_per_px": 1.0} | values, shape, telecentric=telecentric
    )
    names = ["scale_mm_per_px", "tilt_x_rad", "tilt_y_rad"]
    names += ["aspect", *distortion] if lens is None else _uncertain(lens)
    if not telecentric:
        names += ["height_mm", *(_CENTRING if lens is None else ())]
    elif lens is None:
        # For parallel rays a tilt is only a second-order stretch, the same as an aspect: it is not free.
        names = [n for n in names if not n.startswith("tilt")]
    free = tuple(i for i, n in enumerate(CAMERA_NAMES) if n in names)
    sigma = np.broadcast_to(np.asarray(sigma_px, float), (len(points_px),)).copy()
    u, v = np.asarray(points_px, float).T
    x, y = (np.asarray(points_mm, float) - np.mean(points_mm, axis=0)).T
    return _Problem(u, v, x, y, sigma, start, free, math.hypot(stretch_u, _PLACING_REL_U), height, lens)


def _refuse_other_camera(lens: Lens, shape: tuple[int, int], *, telecentric: bool) -> None:
    if telecentric:
        raise FitError("a telecentric camera has no focal length, but a pinhole's model is stated; keep one of the two")
    if (lens.height_px, lens.width_px) != tuple(shape):
        raise FitError(
            f"the camera model is for pictures of {lens.width_px} x {lens.height_px} px, the grid's picture has "
            f"{shape[1]} x {shape[0]}; state the model of this camera at this picture size"
        )


def lens_parameters(lens: Lens) -> dict[str, float]:
    """Give the lens in the names of `CAMERA_NAMES`; its focal length is scale and height there."""
    values = {name: lens[name] for name in ("k1", "k2", "p1", "p2", "k3")}
    centre = {"cu_px": lens["cx_px"] - (lens.width_px - 1) / 2, "cv_px": lens["cy_px"] - (lens.height_px - 1) / 2}
    return values | centre | {"aspect": lens["fx_px"] / lens["fy_px"]}


def _uncertain(lens: Lens) -> list[str]:
    """Parameters of the camera that the lens does not state exactly."""
    known = {"aspect": "fy_px", "cu_px": "cx_px", "cv_px": "cy_px"} | {n: n for n in ("k1", "k2", "p1", "p2", "k3")}
    return [name for name, own in known.items() if lens.estimate(own).u > 0]


def _lens_of(camera: PlateCamera) -> Array:
    """Parameters of a camera in the order of `camera.lens.LENS_NAMES`."""
    (u0, v0), focal = camera.centre_px, camera.focal_px
    distortion = [camera[name] for name in ("k1", "k2", "p1", "p2", "k3")]
    return np.array([focal, focal / camera["aspect"], u0 + camera["cu_px"], v0 + camera["cv_px"], *distortion])


def _lens_rows(lens: Lens) -> tuple[NDArray[np.int64], Array]:
    """Which lens parameters are observed, and the matrix that makes their differences unit normal."""
    observed = np.flatnonzero(np.diag(lens.covariance) > 0)
    if observed.size == 0:
        return np.array([0]), np.array([[1 / (_EXACT * lens.values[0])]])
    return observed, np.linalg.inv(np.linalg.cholesky(lens.covariance[np.ix_(observed, observed)]))


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
    if problem.lens is not None and problem.height is None:
        camera[-1] = problem.lens["fx_px"] * scale
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
    rows += [np.atleast_1d(vector[i] / u) for i, u in problem.centring_u_px.items()]
    camera = _camera_of(problem, vector)
    if problem.height is not None:
        rows.append(np.atleast_1d((camera["height_mm"] - problem.height.value) / max(problem.height.u, 1e-6)))
    if problem.lens is not None:
        observed, whitening = _lens_rows(problem.lens)
        rows.append(whitening @ (_lens_of(camera) - problem.lens.values)[observed])
    return np.concatenate(rows)


@dataclass(frozen=True)
class _Solution:
    vector: Array
    covariance: Array
    factor: float


def _solve(problem: _Problem, start: Array, keep: Array, factor: float) -> _Solution:
    scales = np.maximum(np.abs(start), 1e-3)
    for place, u in problem.centring_u_px.items():
        scales[place] = u
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
    # From afar the crossings count little beside what is stated, or a first step may throw the height away.
    far = float(np.sqrt(np.mean((np.concatenate(_misfit_px(problem, start)) / np.tile(problem.sigma, 2)) ** 2)))
    solution = _solve(problem, start, keep, max(1.0, far))
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
    for place, u in problem.centring_u_px.items():
        rows[f"principal point, {CAMERA_NAMES[free[place]][1]}"] = _unit_row(solution.vector.size, place) / u
    causes = {}
    for label, row in rows.items():
        effect = np.zeros(len(CAMERA_NAMES))
        effect[free] = (solution.covariance @ row)[: len(free)]
        causes[label] = effect
    return causes | _lens_causes(problem, solution)


def _lens_causes(problem: _Problem, solution: _Solution) -> dict[str, Array]:
    """Effects of the stated lens: one per principal axis of its covariance."""
    if problem.lens is None or not problem.lens.covariance.any():
        return {}
    observed, whitening = _lens_rows(problem.lens)
    base = _lens_of(_camera_of(problem, solution.vector))
    steps = np.maximum(1e-3 * np.sqrt(np.diag(solution.covariance)), 1e-12)
    columns = [
        (_lens_of(_camera_of(problem, solution.vector + step)) - base)[observed] / step.sum() for step in np.diag(steps)
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
