"""Is there lens distortion? A projective camera against one with radial terms, on one picture of a grid."""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import lmfit
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from fringecal.camera.scatter import shared_scatter
from fringecal.camera.straightness import line_points, straightness
from fringecal.detect.grid import GridDetection
from fringecal.errors import FitError
from fringecal.uncertainty.estimates import Estimate

Array = NDArray[np.float64]
Verdict = Literal["none", "barrel", "pincushion"]

SIGNIFICANCE = 0.05
#: Share of distortions of the size of the detection limit that the test finds.
POWER = 0.95
MIN_CROSSINGS = 25
MAX_TERMS = 3
#: Crossings further from the fit than this many robust standard deviations are left out of it.
OUTLIER_SIGMAS = 6.0
UNDISTORT_STEPS = 20
UNDISTORT_ENOUGH_PX = 1e-9
_HOMOGRAPHY = tuple(f"h{i}{j}" for i in range(3) for j in range(3) if (i, j) != (2, 2))


@dataclass(frozen=True)
class RadialLens:
    """Radial (and tangential) displacement of points about a centre, radius in half diagonals of the picture.

    `xd = x (1 + k1 r^2 + k2 r^4 + k3 r^6)` plus Brown's tangential terms, as in OpenCV, with
    x = (u - centre) / half_diagonal instead of the focal length.
    """

    centre_px: tuple[float, float]
    half_diagonal_px: float
    radial: tuple[float, ...]
    tangential: tuple[float, float] = (0.0, 0.0)

    def distort(self, points_px: Array) -> Array:
        """Where ideal points (n, 2), px, are seen."""
        x, y = ((points_px - self.centre_px) / self.half_diagonal_px).T
        r2 = x * x + y * y
        factor = 1 + sum(k * r2 ** (n + 1) for n, k in enumerate(self.radial))
        p1, p2 = self.tangential
        du = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        dv = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([x * factor + du, y * factor + dv], axis=1) * self.half_diagonal_px + self.centre_px

    def undistort(self, points_px: Array) -> Array:
        """Where points (n, 2), px, would be seen without the lens; the inverse of `distort` by iteration."""
        ideal = np.array(points_px, dtype=float)
        for _ in range(UNDISTORT_STEPS):
            rest = points_px - self.distort(ideal)
            ideal += rest
            if np.abs(rest).max(initial=0.0) < UNDISTORT_ENOUGH_PX:
                break
        return ideal

    def brown_k1(self, focal_px: float) -> float:
        """Brown's k1 (OpenCV) for a stated focal length: radii are then in focal lengths.

        Examples
        --------
        >>> RadialLens((320.0, 240.0), 400.0, (-0.01,)).brown_k1(800.0)
        -0.04
        """
        return self.radial[0] * (focal_px / self.half_diagonal_px) ** 2


@dataclass(frozen=True)
class DistortionTest:
    """Answer to "does this lens distort?", with what it rests on.

    Parameters
    ----------
    verdict
        ``"barrel"``, ``"pincushion"``, or ``"none"`` when the F-test at 5 % finds nothing.
    max_px
        Radial displacement at the outermost crossing, px; negative toward the centre (barrel).
    detection_limit_px
        Displacement there that would have been found in 95 % of cases.
    f_statistic, p_value
        Of the radial terms together.
    lens
        The fitted lens.
    coefficients
        Estimates of k1, k2 ... (radius in half diagonals), centre and tangential terms that were free.
    points_px, residual_before_px, residual_after_px
        Crossings and observed minus fitted, (n, 2): projective only, and with the lens.
    straightness_before, straightness_after
        One row per line, before and after undistortion (`camera.straightness`).
    """

    verdict: Verdict
    max_px: Estimate
    detection_limit_px: float
    f_statistic: float
    p_value: float
    lens: RadialLens
    coefficients: dict[str, Estimate]
    points_px: Array
    residual_before_px: Array
    residual_after_px: Array
    straightness_before: pd.DataFrame
    straightness_after: pd.DataFrame


def examine_distortion(
    detection: GridDetection,
    *,
    terms: int = 2,
    centre: Literal["image", "free"] = "image",
    tangential: bool = False,
    perspective: bool = True,
) -> DistortionTest:
    """Test whether radial terms explain the crossings better than a projective camera alone.

    Parameters
    ----------
    detection
        The grid found in the picture.
    terms
        Number of radial terms, 1 to 3.
    centre
        Centre of distortion at the image centre, or free.
    tangential
        Whether to fit Brown's p1 and p2 too.
    perspective
        Whether the camera may be tilted. Tilt and a shifted centre bend lines almost alike; without
        tilt a free centre is the point through which lines look straight, as other programs report it.

    Raises
    ------
    FitError
        Fewer than 25 crossings, or more than 3 terms.

    Notes
    -----
    F = ((S0 - S1) / q) / (g S1 / (2n - p)) with q the terms beyond the p - q of the projective camera, and
    g the `camera.scatter.shared_scatter` of neighbouring crossings: without it four times as many perfect
    lenses are called bent. The lens's own parameters are asked of the grid as a whole, so bends far below
    one pixel are found.
    """
    if not 1 <= terms <= MAX_TERMS:
        raise FitError(f"{terms} radial terms asked for; 1 to {MAX_TERMS} are possible")
    if len(detection.row) < MIN_CROSSINGS:
        raise FitError(f"{len(detection.row)} crossings do not tell distortion from noise; {MIN_CROSSINGS} needed")
    problem = _prepare(detection)
    pose = {"h20", "h21"} if perspective else set()
    free = pose | {f"k{n + 1}" for n in range(terms)}
    free |= ({"cu", "cv"} if centre == "free" else set()) | ({"p1", "p2"} if tangential else set())
    problem = _without_outliers(problem, _fit_in_steps(problem, free))
    plain, full = _fit(problem, pose), _fit_in_steps(problem, free)
    return _report(detection, problem, plain, full)


@dataclass(frozen=True)
class _Problem:
    """Crossings in px and in units of the grid's half-size, their weights, and the picture's frame."""

    points: Array
    site: NDArray[np.int64]
    index: Array
    sigma: Array
    middle: tuple[float, float]
    half_diagonal: float


def _prepare(detection: GridDetection) -> _Problem:
    height, width = detection.shape
    site = np.stack([detection.column, detection.row], axis=1)
    centred = site - site.mean(axis=0)
    return _Problem(
        np.stack([detection.u_px, detection.v_px], axis=1),
        site,
        centred / np.abs(centred).max(),
        detection.sigma_px,
        ((width - 1) / 2, (height - 1) / 2),
        0.5 * math.hypot(width, height),
    )


def _without_outliers(problem: _Problem, fitted: Any) -> _Problem:
    rest = np.abs(_residuals(fitted.params, problem).reshape(-1, 2)).max(axis=1)
    keep = rest <= OUTLIER_SIGMAS * 1.4826 * np.median(rest)
    picked = {name: getattr(problem, name)[keep] for name in ("points", "site", "index", "sigma")}
    return replace(problem, **picked)


def _fit_in_steps(problem: _Problem, free: set[str]) -> Any:
    """Fit about the image centre first: a centre has no effect, and no gradient, while k1 is 0."""
    start = _fit(problem, free - {"cu", "cv", "p1", "p2"})
    return _fit(problem, free, start) if free & {"cu", "cv", "p1", "p2"} else start


def _fit(problem: _Problem, free: set[str], start: Any = None) -> Any:
    """Least squares by lmfit over the affine part and the `free` ones of the other parameters."""
    parameters = lmfit.Parameters()
    for name, value in zip(_HOMOGRAPHY, _first_homography(problem), strict=True):
        parameters.add(name, value=value, vary=name in free or name not in ("h20", "h21"))
    for name in (*(f"k{n + 1}" for n in range(MAX_TERMS)), "cu", "cv", "p1", "p2"):
        parameters.add(name, value=0.0, vary=name in free)
    if start is not None:
        for name in parameters:
            parameters[name].value = start.params[name].value
    return lmfit.minimize(_residuals, parameters, args=(problem,), xtol=1e-9, ftol=1e-10, max_nfev=20000)


def _first_homography(problem: _Problem) -> Array:
    """Affine start: column and row steps and the grid's middle, in half diagonals from the image centre."""
    seen = (problem.points - problem.middle) / problem.half_diagonal
    design = np.column_stack([problem.index, np.ones(len(seen))])
    solved, *_ = np.linalg.lstsq(design, seen, rcond=None)
    return np.concatenate([solved[:, 0], solved[:, 1], [0.0, 0.0]])


def _lens(parameters: Any, problem: _Problem) -> RadialLens:
    """Build the lens of a parameter set; its centre is in half diagonals from the image centre."""
    value = parameters.valuesdict()
    scale = problem.half_diagonal
    return RadialLens(
        (problem.middle[0] + scale * value["cu"], problem.middle[1] + scale * value["cv"]),
        scale,
        tuple(value[f"k{n + 1}"] for n in range(MAX_TERMS)),
        (value["p1"], value["p2"]),
    )


def _model(parameters: Any, problem: _Problem) -> Array:
    """Where the crossings should be seen, px."""
    h = np.append([parameters[name].value for name in _HOMOGRAPHY], 1.0).reshape(3, 3)
    mapped = np.column_stack([problem.index, np.ones(len(problem.index))]) @ h.T
    ideal = mapped[:, :2] / mapped[:, 2:] * problem.half_diagonal + problem.middle
    return _lens(parameters, problem).distort(ideal)


def _residuals(parameters: Any, problem: _Problem) -> Array:
    """Observed minus modelled over sigma, all u and v."""
    return ((problem.points - _model(parameters, problem)) / problem.sigma[:, None]).ravel()


def _report(detection: GridDetection, problem: _Problem, plain: Any, full: Any) -> DistortionTest:
    """Put both fits side by side."""
    extra = plain.nfree - full.nfree
    rest = problem.points - _model(full.params, problem)
    shared = shared_scatter(problem.site[:, 1], problem.site[:, 0], problem.points, rest)
    f_statistic = (plain.chisqr - full.chisqr) / extra / (shared * full.chisqr / full.nfree)
    p_value = float(stats.f.sf(f_statistic, extra, full.nfree))
    lens = _lens(full.params, problem)
    largest = _largest_displacement(problem, full, math.sqrt(shared))
    verdict: Verdict = "none"
    if p_value < SIGNIFICANCE:
        verdict = "barrel" if largest.value < 0 else "pincushion"
    limit = float(stats.norm.ppf(1 - SIGNIFICANCE / 2) + stats.norm.ppf(POWER)) * largest.u
    bent = line_points(detection)
    ends = np.cumsum([len(points) for points in bent])
    return DistortionTest(
        verdict,
        largest,
        limit,
        float(f_statistic),
        p_value,
        lens,
        _coefficients(problem, full, math.sqrt(shared)),
        problem.points,
        problem.points - _model(plain.params, problem),
        rest,
        straightness(detection, moved=bent),
        straightness(detection, moved=np.split(lens.undistort(np.concatenate(bent)), ends[:-1]) if bent else []),
    )


def _largest_displacement(problem: _Problem, full: Any, inflation: float) -> Estimate:
    """Radial displacement at the outermost crossing, px, with u from the covariance of the radial terms."""
    lens = _lens(full.params, problem)
    ideal = lens.undistort(problem.points) - lens.centre_px
    radius = float(np.hypot(ideal[:, 0], ideal[:, 1]).max()) / problem.half_diagonal
    names = [name for name in full.var_names if name.startswith("k")]
    gradient = np.array([problem.half_diagonal * radius ** (2 * int(name[1]) + 1) for name in names])
    value = float(gradient @ [full.params[name].value for name in names])
    if full.covar is None:
        raise FitError("the grid does not determine the distortion; photograph more of it, or use fewer terms")
    pick = [full.var_names.index(name) for name in names]
    u = inflation * math.sqrt(float(gradient @ full.covar[np.ix_(pick, pick)] @ gradient))
    return Estimate(value, u, "px", "largest displacement", full.nfree)


def _coefficients(problem: _Problem, full: Any, inflation: float) -> dict[str, Estimate]:
    """Estimates of the lens's free parameters; the centre in px of the picture."""
    found = {}
    for name in (n for n in full.var_names if not n.startswith("h")):
        parameter = full.params[name]
        value, u, unit = parameter.value, inflation * (parameter.stderr or 0.0), ""
        if name in ("cu", "cv"):
            middle = problem.middle[0 if name == "cu" else 1]
            value, u, unit = middle + value * problem.half_diagonal, u * problem.half_diagonal, "px"
        found[name] = Estimate(float(value), float(u), unit, name, full.nfree)
    return found
