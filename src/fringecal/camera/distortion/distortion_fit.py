"""Least squares of a plane grid seen through a lens with distortion: the fits that the distortion test compares."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import lmfit
import numpy as np
from numpy.typing import NDArray

from fringecal.camera.distortion.crossing_scatter import CrossingNoise, shared_factor, shared_scatter
from fringecal.camera.lens.radial_lens import RadialLens
from fringecal.detect import GridDetection
from fringecal.numerics import robust_sd

Array = NDArray[np.float64]

#: Radial terms: k1 to k3, as many as Brown's model in OpenCV has beside its rational one.
MAX_TERMS = 3
#: Crossings further from the fit than this many robust standard deviations are left out of it. A stricter limit would
#: leave out the rim of a lens that has more terms than the fit.
OUTLIER_SIGMAS = 6.0
#: Step of a derivative, in standard uncertainties of the parameter: within what is linear, far above rounding.
DERIVATIVE_STEP_U = 0.1
#: Relative changes of parameters and of chi-squared at which lmfit stops, and the most evaluations: it needs some ten.
_SOLVER = {"xtol": 1e-9, "ftol": 1e-10, "max_nfev": 2000}
_HOMOGRAPHY = tuple(f"h{i}{j}" for i in range(3) for j in range(3) if (i, j) != (2, 2))
_LENS = (*(f"k{n + 1}" for n in range(MAX_TERMS)), "cu", "cv", "p1", "p2")
POSE = frozenset({"h20", "h21"})


@dataclass(frozen=True)
class Crossings:
    """Crossings in px and in units of the grid's half-size, how they err, and the picture's frame."""

    points: Array
    index: Array
    noise: CrossingNoise
    middle: tuple[float, float]
    half_diagonal: float
    half_size: float

    @property
    def site(self) -> NDArray[np.int64]:
        """Column and row (n, 2)."""
        return np.stack([self.noise.column, self.noise.row], axis=1)

    @cached_property
    def whitened(self) -> Callable[[Array], Array]:
        """Shifts (n, 2, ...), px, as independent ones of variance 1."""
        return self.noise.whitening()

    @cached_property
    def common_px(self) -> Array:
        """Shifts (n, 2, modes), px, by one standard uncertainty of what all crossings have in common."""
        return np.moveaxis(self.noise.common_px, 0, 2)

    def picked(self, keep: NDArray[np.bool_]) -> "Crossings":
        """Some of the crossings alone."""
        return replace(self, points=self.points[keep], index=self.index[keep], noise=self.noise.picked(keep))


@dataclass(frozen=True)
class GridFit:
    """One least-squares solution: lmfit's result, its lens and what it leaves of the crossings, px (n, 2)."""

    result: Any
    lens: RadialLens
    residual_px: Array
    shared: float

    @property
    def free(self) -> frozenset[str]:
        """Names of the free parameters beyond the affine part of the pose."""
        return frozenset(self.result.var_names) & ({*_LENS} | POSE)

    def lens_with(self, name: str, step: float, crossings: Crossings) -> RadialLens:
        """Return the lens with one of its parameters moved."""
        moved = self.result.params.copy()
        moved[name].value += step
        return _lens(moved, crossings, inverse=self.lens.inverse)

    def view_of(self, crossings: Crossings) -> tuple[Array, Array]:
        """Where this fit's camera without its lens shows crossings (n, 2), px, and their depths (n,), 1 mid-sheet."""
        return _ideal(self.result.params, crossings)

    @property
    def covariance(self) -> Array | None:
        """Covariance of the free parameters, with what neighbouring crossings share; None if undetermined."""
        found = self.result.covar
        return None if found is None or not np.isfinite(found).all() else self.shared * found


def crossings_of(detection: GridDetection) -> Crossings:
    """Gather the crossings of a grid as the fits need them."""
    height, width = detection.shape
    site = np.stack([detection.column, detection.row], axis=1)
    centred = site - site.mean(axis=0)
    return Crossings(
        np.stack([detection.u_px, detection.v_px], axis=1),
        centred / np.abs(centred).max(),
        CrossingNoise(detection.row, detection.column, detection.sigma_px, detection.scatter),
        ((width - 1) / 2, (height - 1) / 2),
        0.5 * math.hypot(width, height),
        float(np.abs(centred).max()),
    )


def without_outliers(crossings: Crossings, fitted: GridFit) -> Crossings:
    """Leave out crossings that lie far from a fit."""
    rest = np.abs(fitted.residual_px / crossings.noise.sigma_px[:, None]).max(axis=1)
    return crossings.picked(rest <= OUTLIER_SIGMAS * robust_sd(rest, about=0))


def fit_lens_on_grid(
    crossings: Crossings, free: frozenset[str], *, inverse: bool = False, start: GridFit | None = None
) -> GridFit:
    """Fit pose and lens to crossings by lmfit, weighted by their sigma.

    Parameters
    ----------
    crossings
        From `crossings_of`.
    free
        Which of k1, k2, k3, cu, cv, p1, p2 are free, and of h20, h21 if the camera may be tilted; the affine
        part of the pose always is.
    inverse
        Which way the polynomial leads (`RadialLens`).
    start
        A poorer fit to start from.
    """
    parameters = lmfit.Parameters()
    for name, value in zip(_HOMOGRAPHY, _first_homography(crossings), strict=True):
        parameters.add(name, value=value, vary=name in free or name not in POSE)
    for name in _LENS:
        parameters.add(name, value=0.0, vary=name in free)
    for name in _common(crossings):
        parameters.add(name, value=0.0)
    if start is not None:
        for name in start.result.params.keys() & parameters.keys():
            parameters[name].value = start.result.params[name].value
    arguments = (crossings, inverse)
    found = lmfit.minimize(_weighted, parameters, args=arguments, Dfun=_weighted_slopes, **_SOLVER)
    rest = _residual_px(found.params, crossings, inverse=inverse)
    return GridFit(found, _lens(found.params, crossings, inverse=inverse), rest, _shared(found.params, crossings, rest))


def _shared(parameters: Any, crossings: Crossings, rest: Array) -> float:
    """Factor for what crossings share that their covariance, if it is known, does not say."""
    noise = crossings.noise
    if noise.scatter is None:
        return shared_scatter(noise.row, noise.column, crossings.points, rest)
    return shared_factor(noise.row, noise.column, crossings.whitened(rest - _shift_px(parameters, crossings)))


def _common(crossings: Crossings) -> list[str]:
    """Names of what all crossings have in common, in standard uncertainties."""
    return [f"q{n + 1}" for n in range(crossings.common_px.shape[2])]


def _shift_px(parameters: Any, crossings: Crossings) -> Array:
    """Shift (n, 2), px, of the crossings by what they have in common."""
    values = np.array([parameters[name].value for name in _common(crossings)])
    return np.asarray(crossings.common_px @ values)


def left_out_u(crossings: Crossings, fitted: GridFit) -> dict[str, float]:
    """Standard uncertainty of every parameter of the lens from fits that leave out one quarter of the grid each.

    Notes
    -----
    The jackknife of four blocks, u^2 = 3/4 sum (p_i - mean)^2. Where the lens is not what the model says, its
    parameters depend on where the crossings lie, and the scatter of crossings about the fit does not know this.
    """
    right, down = (crossings.site > np.median(crossings.site, axis=0)).T
    fits = []
    for quarter in (right & down, right & ~down, ~right & down, ~right & ~down):
        rest = crossings.picked(~quarter)
        fits.append(fit_lens_on_grid(rest, fitted.free, inverse=fitted.lens.inverse, start=fitted))
    names = [name for name in _LENS if name in fitted.free]
    factor = (len(fits) - 1) / len(fits)
    values = np.array([[each.result.params[name].value for name in names] for each in fits])
    return dict(zip(names, np.sqrt(factor * ((values - values.mean(axis=0)) ** 2).sum(axis=0)).tolist(), strict=True))


def pitches_per_px(crossings: Crossings, fitted: GridFit) -> tuple[float, float]:
    """Pitches of the grid that one px at the image centre spans, mean of both directions, with its u."""
    value = _pitches_at_centre(fitted.result.params, crossings, inverse=fitted.lens.inverse)
    covariance = fitted.covariance
    if covariance is None:
        return value, math.nan
    gradient = np.zeros(len(covariance))
    for i, name in enumerate(fitted.result.var_names):
        moved, step = fitted.result.params.copy(), DERIVATIVE_STEP_U * math.sqrt(covariance[i, i])
        moved[name].value += step
        gradient[i] = (_pitches_at_centre(moved, crossings, inverse=fitted.lens.inverse) - value) / step
    return value, math.sqrt(max(0.0, float(gradient @ covariance @ gradient)))


def _pitches_at_centre(parameters: Any, crossings: Crossings, *, inverse: bool) -> float:
    h = np.append([parameters[name].value for name in _HOMOGRAPHY], 1.0).reshape(3, 3)
    around = np.array(crossings.middle) + np.array([[0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]])
    ideal = (
        _lens(parameters, crossings, inverse=inverse).undistort(around) - crossings.middle
    ) / crossings.half_diagonal
    x, y, w = np.linalg.solve(h, np.column_stack([ideal, np.ones(4)]).T)
    steps = np.array(
        [[x[0] / w[0] - x[1] / w[1], y[0] / w[0] - y[1] / w[1]], [x[2] / w[2] - x[3] / w[3], y[2] / w[2] - y[3] / w[3]]]
    )
    return float(np.hypot(*steps.T).mean()) * crossings.half_size


def _first_homography(crossings: Crossings) -> Array:
    """Affine start: column and row steps and the grid's middle, in half diagonals from the image centre."""
    seen = (crossings.points - crossings.middle) / crossings.half_diagonal
    design = np.column_stack([crossings.index, np.ones(len(seen))])
    solved, *_ = np.linalg.lstsq(design, seen, rcond=None)
    return np.concatenate([solved[:, 0], solved[:, 1], [0.0, 0.0]])


def _lens(parameters: Any, crossings: Crossings, *, inverse: bool) -> RadialLens:
    """Build the lens of a parameter set; its centre is in half diagonals from the image centre."""
    value = parameters.valuesdict()
    scale = crossings.half_diagonal
    return RadialLens(
        (crossings.middle[0] + scale * value["cu"], crossings.middle[1] + scale * value["cv"]),
        scale,
        tuple(value[f"k{n + 1}"] for n in range(MAX_TERMS)),
        (value["p1"], value["p2"]),
        inverse,
    )


def _ideal(parameters: Any, crossings: Crossings) -> tuple[Array, Array]:
    """Where a lens without distortion would show the crossings, px (n, 2), and their depths (n,)."""
    h = np.append([parameters[name].value for name in _HOMOGRAPHY], 1.0).reshape(3, 3)
    mapped = np.column_stack([crossings.index, np.ones(len(crossings.index))]) @ h.T
    return mapped[:, :2] / mapped[:, 2:] * crossings.half_diagonal + crossings.middle, mapped[:, 2]


def _residual_px(parameters: Any, crossings: Crossings, *, inverse: bool) -> Array:
    """Observed minus modelled crossings (n, 2), px in the picture."""
    ideal, _ = _ideal(parameters, crossings)
    lens = _lens(parameters, crossings, inverse=inverse)
    if not inverse:
        return crossings.points - lens.distort(ideal)
    return lens.shrunk(crossings.points, lens.undistort(crossings.points) - ideal)


def _weighted(parameters: Any, crossings: Crossings, inverse: bool) -> Array:  # noqa: FBT001 -- lmfit calls it
    rest = _residual_px(parameters, crossings, inverse=inverse) - _shift_px(parameters, crossings)
    common = [parameters[name].value for name in _common(crossings)]
    return np.concatenate([crossings.whitened(rest).ravel(), common])


def _weighted_slopes(parameters: Any, crossings: Crossings, inverse: bool) -> Array:  # noqa: FBT001 -- lmfit calls it
    """Derivatives of `_weighted` by the free parameters; the small change of an inverse lens's weights is left out."""
    lens = _lens(parameters, crossings, inverse=inverse)
    ideal, depth = _ideal(parameters, crossings)
    by_point, by_term = lens.slopes(crossings.points if inverse else ideal)
    by_pose = pose_slopes(crossings, (ideal - crossings.middle) / crossings.half_diagonal, depth)
    by_centre = np.eye(2) - by_point
    by_lens = np.concatenate([by_term[..., :MAX_TERMS], by_centre, by_term[..., MAX_TERMS:]], axis=2)
    if inverse:
        slopes = np.concatenate([-by_pose, by_lens], axis=2)
        slopes = np.stack([lens.shrunk(crossings.points, column) for column in np.moveaxis(slopes, 2, 0)], axis=2)
    else:
        slopes = -np.concatenate([by_point @ by_pose, by_lens], axis=2)
    free = [n for n, name in enumerate((*_HOMOGRAPHY, *_LENS)) if parameters[name].vary]
    columns = np.concatenate([crossings.half_diagonal * slopes[..., free], -crossings.common_px], axis=2)
    stated = np.eye(columns.shape[2])[len(free) :]
    return np.vstack([crossings.whitened(columns).reshape(-1, columns.shape[2]), stated])


def pose_slopes(crossings: Crossings, ideal: Array, depth: Array) -> Array:
    """Derivatives (n, 2, 8) of ideal places, in half diagonals, by the homography."""
    site = np.column_stack([crossings.index, np.ones(len(depth))]) / depth[:, None]
    none = np.zeros_like(site)
    rows = [np.concatenate([site, none], axis=1), np.concatenate([none, site], axis=1)]
    return np.concatenate([np.stack(rows, axis=1), -ideal[:, :, None] * site[:, None, :2]], axis=2)
