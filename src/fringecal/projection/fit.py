"""Fit the rig model to phase on the plate and on artefacts of known height, with an honest covariance.

Residuals of neighbouring pixels are not independent (ripple, texture, a strip that is a little high), so the
covariance comes from the scatter of whole blocks of residuals (cluster-robust, Liang and Zeger, Biometrika 73
(1986) 13), not from the number of pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate import Rays
from fringecal.errors import FitError
from fringecal.projection.rig import RigModel, fit_residual, projector_point

Array = NDArray[np.float64]

_ROUNDS = 6
_LENGTH = 100.0  # mm; unit of length inside the solver, so that its columns are of one size
_OUTLIER = 4.5  # robust sigmas


@dataclass(frozen=True)
class PhasePoints:
    """Pixels of one surface whose height above the plate is known, with their absolute phase.

    `rays` are the pixels' rays, `z_mm` the known height, `phase_rad` the unwrapped phase, `cluster` the number
    of the block of neighbours a pixel belongs to.
    """

    rays: Rays
    z_mm: float
    phase_rad: Array
    cluster: NDArray[np.intp]

    def seen_by(self, rays: Rays) -> "PhasePoints":
        """Return the same pixels looking along other rays."""
        return PhasePoints(rays, self.z_mm, self.phase_rad, self.cluster)

    def raised(self, z_mm: float) -> "PhasePoints":
        """Return the same pixels on a surface of another height."""
        return PhasePoints(self.rays, z_mm, self.phase_rad, self.cluster)


@dataclass(frozen=True)
class RigFit:
    """A fitted rig, its covariance from the scatter of residuals, and the residuals of every surface."""

    model: RigModel
    covariance: Array
    residuals: tuple[Array, ...]
    rms_rad: float
    plate_rms_rad: float
    dof: int


def fit_rig(
    surfaces: Sequence[PhasePoints],
    *,
    residual_degree: int = 0,
    projector_near: Array | None = None,
) -> RigFit:
    """Fit the seven numbers and the plate's smooth residual to surfaces of known height.

    Parameters
    ----------
    surfaces
        The plate (z = 0) first, then at least one surface of another height.
    residual_degree
        Total degree of the plate residual; 0 leaves it out.
    projector_near
        Where the projector is said to stand, in mm: only used to choose the point of its line.

    Raises
    ------
    FitError
        No second height, or a fit that does not determine the model.
    """
    heights = {float(s.z_mm) for s in surfaces}
    if len(heights) < 2:
        raise FitError(
            "All phase points lie at one height: they cannot tell how phase changes with height. Add a capture of "
            "strips or steps of known height."
        )
    model = RigModel(_first_guess(surfaces), np.full(3, np.inf))
    keep = [np.isfinite(s.phase_rad) for s in surfaces]
    for round_number in range(_ROUNDS):
        model = _improve(model, surfaces, keep)
        model = RigModel(model.parameters, projector_point(model.parameters, near=projector_near), model.residual)
        if residual_degree and round_number < _ROUNDS - 2:
            model = _with_residual(model, surfaces[0], keep[0], residual_degree)
        keep = [_inliers(_misfit(model, s), finite=np.isfinite(s.phase_rad)) for s in surfaces]
    return _report(model, surfaces, keep)


def _misfit(model: RigModel, surface: PhasePoints) -> Array:
    x, y = surface.rays.at(surface.z_mm)
    return surface.phase_rad - model.phase(x, y, surface.z_mm)


def _inliers(residual: Array, *, finite: NDArray[np.bool_]) -> NDArray[np.bool_]:
    spread = 1.4826 * np.median(np.abs(residual[finite] - np.median(residual[finite])))
    return finite & (np.abs(residual) < _OUTLIER * max(float(spread), 1e-6) + np.abs(np.median(residual[finite])))


def _first_guess(surfaces: Sequence[PhasePoints]) -> Array:
    """Solve `n . X + n0 - phi d . X = phi`, linear in all seven numbers."""
    rows, right = [], []
    for surface in surfaces:
        good = np.isfinite(surface.phase_rad)
        x, y = (c[good] / _LENGTH for c in surface.rays.at(surface.z_mm))
        z = np.full_like(x, surface.z_mm / _LENGTH)
        phi = surface.phase_rad[good]
        weight = 1.0 / np.sqrt(phi.size)
        rows.append(weight * np.column_stack([x, y, z, np.ones_like(x), -phi * x, -phi * y, -phi * z]))
        right.append(weight * phi)
    solution, _, rank, _ = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=1e-13)
    if rank < 7:
        raise FitError("The phase points do not span the field: they cannot determine the rig's seven numbers.")
    return solution / _UNITS


#: Solver units of the seven numbers: lengths in `_LENGTH`.
_UNITS = np.array([_LENGTH, _LENGTH, _LENGTH, 1.0, _LENGTH, _LENGTH, _LENGTH])


def _jacobian(model: RigModel, surface: PhasePoints) -> Array:
    """Derivatives of the phase by the seven numbers, in solver units, shape (n, 7)."""
    x, y = surface.rays.at(surface.z_mm)
    z = np.full_like(x, surface.z_mm)
    d = model.parameters[4:]
    below = d[0] * x + d[1] * y + d[2] * z + 1
    phi = model.ratio(x, y, z)
    columns = [x, y, z, np.ones_like(x), -phi * x, -phi * y, -phi * z]
    return np.column_stack(columns) / below[:, None] / _UNITS


def _weights(surfaces: Sequence[PhasePoints], keep: Sequence[NDArray[np.bool_]]) -> list[float]:
    """Give every surface the same voice, however many pixels it has."""
    return [1.0 / max(1, int(np.count_nonzero(k))) for _, k in zip(surfaces, keep, strict=True)]


def _normal(
    model: RigModel, surfaces: Sequence[PhasePoints], keep: Sequence[NDArray[np.bool_]]
) -> tuple[Array, Array, list[Array]]:
    """Return the normal matrix, the right side and every pixel's score, shape (n, 7)."""
    matrix, right = np.zeros((7, 7)), np.zeros(7)
    scores = []
    for surface, good, weight in zip(surfaces, keep, _weights(surfaces, keep), strict=True):
        jacobian = _jacobian(model, surface)[good]
        score = weight * jacobian * _misfit(model, surface)[good][:, None]
        matrix += weight * jacobian.T @ jacobian
        right += score.sum(axis=0)
        scores.append(score)
    return matrix, right, scores


def _inverse(matrix: Array) -> Array:
    size = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(size, size)
    condition = np.linalg.cond(scaled)
    if not np.isfinite(condition) or condition > 1e14:
        raise FitError(
            f"The captures do not determine the rig (condition {condition:.1e}): the strips cover too little of the "
            "field, or their height is too small against the noise. Spread strips over the whole field."
        )
    return np.linalg.inv(scaled) / np.outer(size, size)


def _improve(model: RigModel, surfaces: Sequence[PhasePoints], keep: Sequence[NDArray[np.bool_]]) -> RigModel:
    matrix, right, _ = _normal(model, surfaces, keep)
    return RigModel(model.parameters + _inverse(matrix) @ right / _UNITS, model.projector_mm, model.residual)


def _with_residual(model: RigModel, plate: PhasePoints, good: NDArray[np.bool_], degree: int) -> RigModel:
    """Measure the plate's smooth residual afresh from what the seven numbers leave."""
    x, y = plate.rays.ax[good], plate.rays.ay[good]
    residual = fit_residual(x, y, plate.phase_rad[good] - model.ratio(x, y, 0.0), degree)
    return RigModel(model.parameters, model.projector_mm, residual)


def _report(model: RigModel, surfaces: Sequence[PhasePoints], keep: Sequence[NDArray[np.bool_]]) -> RigFit:
    matrix, _, scores = _normal(model, surfaces, keep)
    inverse = _inverse(matrix)
    meat, number = np.zeros((7, 7)), 0
    for surface, good, score in zip(surfaces, keep, scores, strict=True):
        labels, index = np.unique(surface.cluster[good], return_inverse=True)
        sums = np.zeros((labels.size, 7))
        np.add.at(sums, index, score)
        sums -= sums.mean(axis=0)
        meat += sums.T @ sums * labels.size / max(1, labels.size - 1)
        number += labels.size
    covariance = inverse @ meat @ inverse / np.outer(_UNITS, _UNITS)
    residuals = tuple(np.where(good, _misfit(model, s), np.nan) for s, good in zip(surfaces, keep, strict=True))
    everything = np.concatenate([r[np.isfinite(r)] for r in residuals])
    return RigFit(
        model=model,
        covariance=covariance,
        residuals=residuals,
        rms_rad=float(np.sqrt(np.mean(everything**2))),
        plate_rms_rad=float(np.sqrt(np.nanmean(residuals[0] ** 2))),
        dof=max(1, number - 7),
    )
