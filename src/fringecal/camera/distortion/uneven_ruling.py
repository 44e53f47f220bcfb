"""Lens or sheet? What a grid says of the lens by the bending of its lines alone, wherever each line stands."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats

from fringecal.camera.distortion.crossing_scatter import shared_factor
from fringecal.camera.distortion.distortion_fit import Crossings, GridFit, pose_slopes
from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]

#: Singular values below this part of the largest belong to directions that other columns describe already.
_NO_NEW = 1e-6
#: Instead of a division by 0.
_NO_LENGTH = 1e-300
#: Step of a derivative, in half-sizes of the grid: errors of 1e-10 of it.
_STEP = 1e-5
#: Most lines of a family that the test takes; of more, every second, third ... one: curvature is smooth.
_MOST_LINES = 40


@dataclass(frozen=True)
class SheetTest:
    """Evidence of a lens when every line may be displaced and turned on its own.

    Parameters
    ----------
    irregular_px
        Rms displacement of the lines from an even ruling, as far as a lens does not explain it, px.
    p_irregular
        Chance that even ruling and a lens leave residuals like these.
    p_lens
        Chance that straight lines are bent like these.
    bent_px, u_bent_px
        Displacement by the lens at the outermost crossing, outward positive, by the bending alone, and its u.
    repeats
        Whether each three quarters of the grid say the same direction.
    terms
        k1, k2 ... by the bending alone, about the image centre; none where the lines are too few.
    """

    irregular_px: float
    p_irregular: float
    p_lens: float
    bent_px: float
    u_bent_px: float
    repeats: bool
    terms: tuple[Estimate, ...]


def examine_ruling(crossings: Crossings, plain: GridFit, radial_terms: int) -> SheetTest:
    """Test a lens against a sheet whose lines are straight, and otherwise anywhere.

    Parameters
    ----------
    crossings
        The grid's crossings.
    plain
        The fit of a camera without distortion to them.
    radial_terms
        Number of radial terms of the lens.

    Notes
    -----
    A line that is ruled off its place moves all its crossings alike; a lens bends it. Linear least squares about the
    plain fit, with an offset and a turn of every line as parameters, is a test that no error of the ruling can deceive
    while lines are straight. It is weaker: of the displacement k1 r^2 x the part k1 x^3 is left to the ruling.
    """
    few = _thinned(crossings)
    points, rest = few.points, plain.residual_px[_kept(crossings)]
    places, depth = plain.view_of(few)
    ideal = (places - few.middle) / few.half_diagonal
    white = few.whitened

    def flat(columns: Array) -> Array:
        return np.asarray(white(columns).reshape(2 * len(points), -1))

    pose = flat(np.concatenate([few.half_diagonal * pose_slopes(few, ideal, depth), few.common_px], axis=2))
    radius = (ideal**2).sum(axis=1)
    lens = flat(
        np.stack([few.half_diagonal * ideal * radius[:, None] ** k for k in range(1, radial_terms + 1)], axis=2)
    )
    ruling = flat(_line_shifts(few, plain))
    seen = flat(rest[:, :, None])[:, 0]
    even, uneven = _basis(pose), _basis(np.hstack([pose, ruling]))
    left_even = _without(even, lens, seen)
    left_uneven = _without(uneven, lens, seen)
    dof = len(seen) - uneven.shape[1] - radial_terms
    if dof < 1:
        return SheetTest(0.0, 1.0, 1.0, 0.0, 0.0, repeats=False, terms=())
    shared = shared_factor(few.noise.row, few.noise.column, left_uneven.full.reshape(-1, 2))
    variance = shared * left_uneven.sum_of_squares / dof
    extra = uneven.shape[1] - even.shape[1]
    irregular = (left_even.sum_of_squares - left_uneven.sum_of_squares) / max(extra, 1)
    explained = left_uneven.before - left_uneven.sum_of_squares
    gap = max(irregular - variance, 0.0) * extra / len(seen)
    outermost = np.asarray(
        few.half_diagonal * math.sqrt(radius.max()) ** (2 * np.arange(1, radial_terms + 1) + 1), float
    )
    covariance = variance * np.linalg.pinv(left_uneven.information)
    u_bent = math.sqrt(max(0.0, float(outermost @ covariance @ outermost)))
    u_terms = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return SheetTest(
        float(np.sqrt(gap) * np.median(few.noise.sigma_px)),
        float(stats.f.sf(irregular / variance, extra, dof)),
        float(stats.f.sf(explained / radial_terms / variance, radial_terms, dof)),
        float(outermost @ left_uneven.terms),
        u_bent,
        _repeats(few, left_uneven, outermost),
        tuple(
            Estimate(float(value), float(u), "", f"k{k + 1}", dof)
            for k, (value, u) in enumerate(zip(left_uneven.terms, u_terms, strict=True))
        ),
    )


def _repeats(crossings: Crossings, left: "_Left", outermost: Array) -> bool:
    """Ask whether the lens keeps its direction when any quarter of the grid is left out."""
    right, down = (crossings.site > np.median(crossings.site, axis=0)).T
    signs = set()
    for quarter in (right & down, right & ~down, ~right & down, ~right & ~down):
        keep = np.repeat(~quarter, 2)
        terms, *_ = np.linalg.lstsq(left.columns[keep], left.rest[keep], rcond=None)
        signs.add(float(np.sign(outermost @ terms)))
    return len(signs) == 1


@dataclass(frozen=True)
class _Left:
    """What a basis leaves of the observations and of the lens, the lens's terms in it, and what they leave."""

    rest: Array
    columns: Array
    terms: Array

    @property
    def full(self) -> Array:
        """Residuals with the lens."""
        return np.asarray(self.rest - self.columns @ self.terms)

    @property
    def before(self) -> float:
        """Sum of squares without the lens."""
        return float(self.rest @ self.rest)

    @property
    def sum_of_squares(self) -> float:
        """Sum of squares with the lens."""
        return float(self.full @ self.full)

    @property
    def information(self) -> Array:
        """Inverse covariance of the terms, of observations of variance 1."""
        return np.asarray(self.columns.T @ self.columns)


def _without(basis: Array, lens: Array, seen: Array) -> _Left:
    """Take a basis out of observations and lens, and fit the lens to the rest."""
    rest, columns = (values - basis @ (basis.T @ values) for values in (seen, lens))
    terms, *_ = np.linalg.lstsq(columns, rest, rcond=None)
    return _Left(rest, columns, terms)


def _basis(columns: Array) -> Array:
    """Return an orthonormal basis of what columns span."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), _NO_LENGTH)
    vectors, values, _ = linalg.svd(scaled, full_matrices=False)
    return np.asarray(vectors[:, values > _NO_NEW * values[0]])


def _line_shifts(crossings: Crossings, plain: GridFit) -> Array:
    """Shifts (n, 2, 2 lines), px: every line displaced on the sheet by one unit of the index, and turned.

    On the sheet, not in the picture: what a change of the camera's pose does is then wholly among them.
    """
    column, row = crossings.noise.column, crossings.noise.row
    shifts = []
    for axis, (line, place) in enumerate(((column, row), (row, column))):
        step = _steps(crossings, plain, axis)
        along = (place - place.mean()) / max(float(np.ptp(place)), 1.0)
        for one in np.unique(line):
            on = (line == one)[:, None] * step
            shifts += [on, on * along[:, None]]
    return np.stack(shifts, axis=2)


def _steps(crossings: Crossings, plain: GridFit, axis: int) -> Array:
    """Shift (n, 2), px per unit of the index, along the sheet's rows (0) or columns (1)."""
    by = _STEP * np.eye(2)[axis]
    after, before = (plain.view_of(replace(crossings, index=crossings.index + way))[0] for way in (by, -by))
    return np.asarray((after - before) / (2 * _STEP))


def _kept(crossings: Crossings) -> NDArray[np.bool_]:
    """Crossings of every k-th line of either family."""
    keep = np.ones(len(crossings.points), dtype=bool)
    for line in (crossings.noise.row, crossings.noise.column):
        keep &= line % (1 + int(np.ptp(line)) // _MOST_LINES) == 0
    return keep


def _thinned(crossings: Crossings) -> Crossings:
    keep = _kept(crossings)
    return crossings if keep.all() else crossings.picked(keep)
