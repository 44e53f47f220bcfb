"""Fit the rig model to phase on the plate and on artefacts of known height, with an honest covariance.

Residuals of neighbouring pixels are not independent (ripple, texture, a strip that is a little high), so the
covariance comes from the scatter of whole blocks of residuals (cluster-robust, Liang and Zeger, Biometrika 73
(1986) 13), not from the number of pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import Rays
from fringecal.errors import FitError
from fringecal.numerics import robust_sd
from fringecal.projector.rig_model import RIG_NAMES, RigModel, fit_residual, projector_point
from fringecal.projector.sampling import OUTLIER_SDS

Array = NDArray[np.float64]

_ROUNDS = 6  # Gauss-Newton steps from the linear guess; each about doubles the right digits, the last two polish
_FEW_ROUNDS = 4  # from a fit that is right but for one standard uncertainty of a cause
_SETTLED = 2  # last rounds, in which the plate's residual stays as it is
_LENGTH = 100.0  # mm; unit of length inside the solver, so that its columns are of one size
_RANK_TOLERANCE = 1e-13  # of the largest singular value: what float64's sixteen digits leave of the linear guess
_WORST_CONDITION = 1e14  # of the scaled normal matrix: beyond it two digits are left of float64's sixteen
_LEAST_SPREAD_RAD = 1e-6  # drawn phase without noise scatters by rounding alone; nothing is an outlier of that
_MOST_PULL = 0.9  # of the fit toward a single block; beyond it says nothing of its own scatter
SURFACE_U_RAD = 2e-3
"""Standard uncertainty of the phase of a whole surface, rad: ripple and waves that no parameter describes and that no
number of pixels averages out. It weighs a surface against the stated heights, and no residual below it counts."""


@dataclass(frozen=True)
class PhasePoints:
    """Pixels of one surface whose height above the plate is known, with their absolute phase.

    Parameters
    ----------
    rays
        The pixels' rays.
    z_mm
        The known height: one for all, or one for each pixel.
    phase_rad
        The unwrapped phase, NaN where unknown.
    cluster
        Number of the block of neighbours a pixel belongs to.
    height_components_mm
        Uncertainty components of the height: by how much one standard uncertainty of each changes it, one number, or
        one for each pixel.
    """

    rays: Rays
    z_mm: float | Array
    phase_rad: Array
    cluster: NDArray[np.intp]
    height_components_mm: tuple[float | Array, ...] = ()

    def with_height_changed(self, by_u: Array) -> "PhasePoints":
        """Return the same pixels with their height changed by so many standard uncertainties of each component."""
        changes = (u * mm for u, mm in zip(by_u, self.height_components_mm, strict=True))
        return replace(self, z_mm=sum(changes, self.z_mm))


@dataclass(frozen=True)
class RigFit:
    """A fitted rig, its covariance from the scatter of residuals, and the residuals of every surface.

    `height_changes_u` holds, for every surface, by how many standard uncertainties each component of its height was
    changed to make all surfaces agree.
    """

    model: RigModel
    covariance: Array
    residuals: tuple[Array, ...]
    rms_rad: float
    plate_rms_rad: float
    dof: int
    height_changes_u: tuple[Array, ...] = ()


def fit_rig(
    surfaces: Sequence[PhasePoints],
    *,
    residual_degree: int = 0,
    projector_near: Array | None = None,
    start: RigFit | None = None,
) -> RigFit:
    """Fit the seven numbers and the plate's smooth residual to surfaces of known height.

    Parameters
    ----------
    surfaces
        The plate (z = 0) first, then at least one surface of another height.
    residual_degree
        Total degree of the plate residual; 0 leaves it out.
    projector_near
        The projector's stated position, mm: only used to choose the point of its line.
    start
        A fit to the same pixels with a slightly other camera or height, to begin from: fewer rounds will do.

    Raises
    ------
    FitError
        No second height, or a fit that does not determine the model.
    """
    if len({float(z) for s in surfaces for z in np.unique(s.z_mm)}) < 2:
        raise FitError(
            "All phase points lie at one height: they do not determine how phase changes with height. Add a capture of "
            "strips or height steps of known height."
        )
    model = RigModel(_first_guess(surfaces), np.full(3, np.inf)) if start is None else start.model
    keep = [np.isfinite(s.phase_rad) for s in surfaces] if start is None else [np.isfinite(r) for r in start.residuals]
    changes = [np.zeros(len(s.height_components_mm)) for s in surfaces]
    rounds = _ROUNDS if start is None else _FEW_ROUNDS
    for round_number in range(rounds):
        model, changes = _improve(model, surfaces, keep, changes)
        model = RigModel(model.parameters, projector_point(model.parameters, near=projector_near), model.residual)
        if residual_degree and round_number < rounds - _SETTLED:
            model = _with_residual(model, surfaces[0], keep[0], residual_degree)
        unfiltered = [_phase_residual(model, s.with_height_changed(c)) for s, c in zip(surfaces, changes, strict=True)]
        keep = [_inliers(m, finite=np.isfinite(s.phase_rad)) for m, s in zip(unfiltered, surfaces, strict=True)]
    return _report(model, surfaces, keep, changes)


def _phase_residual(model: RigModel, surface: PhasePoints) -> Array:
    x, y = surface.rays.at(surface.z_mm)
    return surface.phase_rad - model.phase(x, y, surface.z_mm)


def _inliers(residual: Array, *, finite: NDArray[np.bool_]) -> NDArray[np.bool_]:
    sd = max(robust_sd(residual[finite]), _LEAST_SPREAD_RAD)
    return finite & (np.abs(residual) < OUTLIER_SDS * sd + np.abs(np.median(residual[finite])))


def _first_guess(surfaces: Sequence[PhasePoints]) -> Array:
    """Solve `n . X + n0 - phi d . X = phi`, linear in all seven numbers."""
    rows, right = [], []
    for surface in surfaces:
        good = np.isfinite(surface.phase_rad)
        known = np.broadcast_to(np.asarray(surface.z_mm, float), surface.phase_rad.shape)
        x, y, z = (c[good] / _LENGTH for c in (*surface.rays.at(known), known))
        phi = surface.phase_rad[good]
        weight = 1.0 / np.sqrt(phi.size)
        rows.append(weight * np.column_stack([x, y, z, np.ones_like(x), -phi * x, -phi * y, -phi * z]))
        right.append(weight * phi)
    solution, _, rank, _ = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=_RANK_TOLERANCE)
    if rank < len(RIG_NAMES):
        raise FitError("The phase points do not span the field: they cannot determine the rig's seven numbers.")
    return solution / _UNITS


#: Solver units of the seven numbers: lengths in `_LENGTH`.
_UNITS = np.array([_LENGTH, _LENGTH, _LENGTH, 1.0, _LENGTH, _LENGTH, _LENGTH])


def _jacobian(model: RigModel, surface: PhasePoints) -> Array:
    """Derivatives of the phase by the seven numbers, in solver units, then by the height components."""
    rays = surface.rays
    x, y = rays.at(surface.z_mm)
    z = np.full_like(x, surface.z_mm)
    n, d = model.parameters[:3], model.parameters[4:]
    below = d[0] * x + d[1] * y + d[2] * z + 1
    phi = model.ratio(x, y, z)
    columns = np.column_stack([x, y, z, np.ones_like(x), -phi * x, -phi * y, -phi * z]) / _UNITS
    along = n[0] * rays.bx + n[1] * rays.by + n[2] - phi * (d[0] * rays.bx + d[1] * rays.by + d[2])
    by_height = [along * change for change in surface.height_components_mm]
    return np.column_stack([columns, *by_height]) / below[:, None]


@dataclass(frozen=True)
class _Share:
    """One surface's share of the normal equations: weighted derivatives and scores of its pixels.

    `place` says which columns of the whole its parameters are.
    """

    jacobian: Array
    score: Array
    weight: float
    place: NDArray[np.intp]


@dataclass(frozen=True)
class _Normal:
    """Normal matrix and right side of the seven numbers and all height components, and each surface's share."""

    matrix: Array
    right: Array
    shares: list[_Share]


def _normal(
    model: RigModel, surfaces: Sequence[PhasePoints], keep: Sequence[NDArray[np.bool_]], changes: Sequence[Array]
) -> _Normal:
    """Gather the normal equations; all surfaces weigh the same, every height component is an observation of zero."""
    ends = 7 + np.cumsum([len(d) for d in changes])
    prior = np.concatenate([np.zeros(7), np.ones(ends[-1] - 7)])
    matrix, right = np.diag(prior), -prior * np.concatenate([np.zeros(7), *changes])
    shares = []
    for surface, good, change, end in zip(surfaces, keep, changes, ends, strict=True):
        changed = surface.with_height_changed(change)
        weight = 1.0 / (max(1, int(np.count_nonzero(good))) * SURFACE_U_RAD**2)
        place = np.concatenate([np.arange(7), np.arange(end - len(change), end)])
        jacobian = _jacobian(model, changed)[good]
        score = weight * jacobian * _phase_residual(model, changed)[good][:, None]
        matrix[np.ix_(place, place)] += weight * jacobian.T @ jacobian
        right[place] += score.sum(axis=0)
        shares.append(_Share(jacobian, score, weight, place))
    return _Normal(matrix, right, shares)


def _inverse(matrix: Array) -> Array:
    size = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(size, size)
    condition = np.linalg.cond(scaled)
    if not np.isfinite(condition) or condition > _WORST_CONDITION:
        raise FitError(
            f"The captures do not determine the rig (condition {condition:.1e}): the strips cover too little of the "
            "field, or their height is too small against the noise. Spread strips over the whole field."
        )
    return np.linalg.inv(scaled) / np.outer(size, size)


def _improve(
    model: RigModel, surfaces: Sequence[PhasePoints], keep: Sequence[NDArray[np.bool_]], changes: Sequence[Array]
) -> tuple[RigModel, list[Array]]:
    normal = _normal(model, surfaces, keep, changes)
    step = _inverse(normal.matrix) @ normal.right
    better = RigModel(model.parameters + step[:7] / _UNITS, model.projector_mm, model.residual)
    return better, [c + step[share.place[7:]] for c, share in zip(changes, normal.shares, strict=True)]


def _with_residual(model: RigModel, plate: PhasePoints, good: NDArray[np.bool_], degree: int) -> RigModel:
    """Measure the plate's smooth residual afresh from what the seven numbers leave."""
    z = np.broadcast_to(np.asarray(plate.z_mm, float), plate.phase_rad.shape)
    x, y, z = (c[good] for c in (*plate.rays.at(z), z))
    left = plate.phase_rad[good] - model.ratio(x, y, z)
    residual = fit_residual(*(model.foot(x, y, z) if np.any(z) else (x, y)), left, degree)
    return RigModel(model.parameters, model.projector_mm, residual)


def _report(
    model: RigModel, surfaces: Sequence[PhasePoints], keep: Sequence[NDArray[np.bool_]], changes: Sequence[Array]
) -> RigFit:
    normal = _normal(model, surfaces, keep, changes)
    inverse = _inverse(normal.matrix)
    meat, number = np.zeros_like(inverse), 0
    for surface, good, share in zip(surfaces, keep, normal.shares, strict=True):
        sums = _block_scores(share, surface.cluster[good], inverse[np.ix_(share.place, share.place)])
        sums -= sums.mean(axis=0)
        meat[np.ix_(share.place, share.place)] += sums.T @ sums
        number += len(sums)
    covariance = (inverse @ meat @ inverse)[:7, :7] / np.outer(_UNITS, _UNITS)
    unfiltered = (_phase_residual(model, s.with_height_changed(c)) for s, c in zip(surfaces, changes, strict=True))
    residuals = tuple(np.where(good, m, np.nan) for m, good in zip(unfiltered, keep, strict=True))
    everything = np.concatenate([r[np.isfinite(r)] for r in residuals])
    return RigFit(
        model=model,
        covariance=covariance,
        residuals=residuals,
        rms_rad=float(np.sqrt(np.mean(everything**2))),
        plate_rms_rad=float(np.sqrt(np.nanmean(residuals[0] ** 2))),
        dof=max(1, number - 7),
        height_changes_u=tuple(changes),
    )


def _block_scores(share: _Share, cluster: NDArray[np.intp], inverse: Array) -> Array:
    """Sum the scores of each block, made larger by what the fit removed of the block's own residuals.

    Blocks that are few pull the fit toward themselves, and their residuals come out too small: (I - H)^-1/2 corrects
    it (Bell and McCaffrey, Survey Methodology 28 (2002) 169, "CR2").
    """
    _, index, number = np.unique(cluster, return_inverse=True, return_counts=True)
    order, starts = np.argsort(index, kind="stable"), np.concatenate([[0], np.cumsum(number)[:-1]])
    sums = np.add.reduceat(share.score[order], starts)
    # In coordinates in which the whole's normal matrix is a unit, a block's is symmetric, its size the pull.
    root = np.linalg.cholesky(inverse)
    derivatives = share.jacobian[order] @ root
    pulls = np.stack([d.T @ d for d in np.split(derivatives, starts[1:])]) * share.weight
    values, vectors = np.linalg.eigh(pulls)
    factors = 1 / np.sqrt(1 - np.clip(values, 0.0, _MOST_PULL))
    raised = np.einsum("cij,cj,ckj,ck->ci", vectors, factors, vectors, sums @ root)
    return np.asarray(raised @ np.linalg.inv(root))
