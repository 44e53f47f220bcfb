"""Fit the camera on the plate to the crossings of a grid whose pitch is known."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.plate.plate_camera import CAMERA_NAMES, PlateCamera
from fringecal.camera.plate.plate_components import stated_components, tilt_components
from fringecal.camera.plate.plate_problem import Problem, camera_of, deformations_of, first_guess, prepare, residual_px
from fringecal.camera.plate.plate_solve import MIN_CROSSINGS, Solution, displaced_solution, solve_robustly
from fringecal.detect import LineScatter
from fringecal.errors import FitError
from fringecal.uncertainty import Estimate, UncertaintyComponent

Array = NDArray[np.float64]

#: Standard uncertainty of a crossing that states none, px: what detection reaches on a picture with some noise.
CROSSING_U_PX = 0.05


@dataclass(frozen=True)
class CameraFit:
    """A camera fitted to a grid, with the residuals that tell whether to believe it.

    `residual_u_px` and `residual_v_px` are observed minus modelled, NaN for rejected crossings; `rms_px` is
    over both coordinates; `free` names the parameters that the grid or a prior determined. `components` splits the
    camera's covariance: one for each stated input (the effect of one standard uncertainty on all parameters), and
    what is left is the scatter of the crossings. `strain` is the sum of squares of how far the sheet's
    lines had to bend, in standard uncertainties. `solved` is what was solved, how, and with which crossings; None for
    a camera that no grid was fitted to.
    """

    camera: PlateCamera
    residual_u_px: Array
    residual_v_px: Array
    rms_px: float
    dof: int
    free: tuple[str, ...]
    turn_deg: float
    components: tuple[UncertaintyComponent, ...]
    strain: float = 0.0
    solved: tuple[Problem, Solution, NDArray[np.bool_]] | None = field(default=None, repr=False, compare=False)

    def changed_by_heights(self, height_mm: Callable[[Array, Array], Array]) -> Array:
        """Return by how much the camera's parameters change if the sheet was not flat, to first order.

        Parameters
        ----------
        height_mm
            The sheet's height over z = 0 at points x, y of the plate frame: (k, n) for points (n,).

        Returns
        -------
        changes
            Shape (k, parameters), in the order of `CAMERA_NAMES`.
        """
        if self.solved is None:
            return np.zeros((len(height_mm(np.zeros(1), np.zeros(1))), len(CAMERA_NAMES)))
        problem, solution, keep = self.solved
        rays = self.camera.rays(problem.u, problem.v)
        heights = height_mm(rays.ax, rays.ay)
        # A crossing at height h is seen where a flat sheet would show the point at which its ray meets z = h.
        flat = (np.stack(self.camera.project(*rays.at(h))) for h in heights)
        moves = np.stack([one - np.stack([problem.u, problem.v]) for one in flat])
        changes = np.zeros((len(heights), len(CAMERA_NAMES)))
        changes[:, list(problem.free)] = displaced_solution(problem, solution, keep, moves)[:, : len(problem.free)]
        return changes


def fit_plate_camera(
    points_px: Array,
    points_mm: Array,
    shape: tuple[int, int],
    *,
    pitch_rel_u: float,
    sigma_px: Array | float = CROSSING_U_PX,
    height_mm: Estimate | None = None,
    telecentric: bool = False,
    lens: Lens | None = None,
    distortion: tuple[str, ...] = ("k1",),
    index: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None,
    scatter: LineScatter | None = None,
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
        pinhole is observed to be the image centre, within 1 % of the picture's diagonal; the rays of a telecentric lens
        stand square on the plate within 1 deg.
    distortion
        Which of Brown's parameters are free.
    index
        Row and column of the crossings: neighbours on a line share points, and the covariance must know
        (`crossing_scatter`). Without it they count as independent.
    scatter
        What is known of the crossings' covariance, with `index`: neighbours share points, and all share the lines'
        profile, which is fitted beside the camera.

    Raises
    ------
    FitError
        Too few crossings, no height for a pinhole, or crossings that no such camera can have seen.
    """
    if len(points_px) < MIN_CROSSINGS:
        raise FitError(
            f"{len(points_px)} crossings of the grid were indexed; at least {MIN_CROSSINGS} are needed. "
            "Photograph the grid larger or sharper."
        )
    if not telecentric and height_mm is None and lens is None:
        raise FitError(
            "The camera's height is not stated, and one square-on grid can never yield it (any focal length "
            "fits equally well). State camera.height_mm = { value, u }, or camera.model, or telecentric = true."
        )
    problem = prepare(
        points_px, points_mm, shape, sigma_px, telecentric, distortion, pitch_rel_u, height_mm, lens, index, scatter
    )
    solution, keep = solve_robustly(problem, first_guess(problem), index)
    return _report(problem, solution, keep)


def _report(problem: Problem, solution: Solution, keep: NDArray[np.bool_]) -> CameraFit:
    free = list(problem.free)
    camera = camera_of(problem, solution.vector)
    dof = 2 * int(np.count_nonzero(keep)) - solution.vector.size
    tilt = tilt_components(camera, dof)
    covariance = sum((np.outer(c.effect, c.effect) for c in tilt), np.zeros((len(CAMERA_NAMES),) * 2))
    covariance[np.ix_(free, free)] += solution.covariance[: len(free), : len(free)]
    du, dv = (np.where(keep, d, np.nan) for d in residual_px(problem, solution.vector))
    return CameraFit(
        camera=camera.replaced(camera.parameters, covariance),
        residual_u_px=du,
        residual_v_px=dv,
        rms_px=math.sqrt(float(np.nanmean(np.concatenate([du, dv]) ** 2))),
        dof=dof,
        free=tuple(CAMERA_NAMES[i] for i in free),
        turn_deg=math.degrees(solution.vector[len(free)]),
        components=(*stated_components(problem, solution, dof), *tilt),
        strain=float(np.sum(deformations_of(problem, solution.vector) ** 2)),
        solved=(problem, solution, keep),
    )
