"""The plate's own form, from its heights in several poses: turned, or shifted, under a rig that stays where it is.

What the rig adds to every height stays where it is when the plate moves; what is the plate's own moves with it. So the
form is measured by a rig that was calibrated as if the plate were plane, and the rig is calibrated again with it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import FitError
from fringecal.numerics import robust_sd
from fringecal.projector import FORM_TERMS, PlateForm

Array = NDArray[np.float64]
type Box = tuple[float, float, float, float]

_SAMPLES = 4000  # points that all poses show: a smooth form of seven terms is known far better than it is stated
_LEAST = 200
_BLOCKS = 8  # along each axis: what neighbours have in common counts once
_KEPT_SIGMAS = 4.0
_ROUNDS = 3
_FREE_MM = 1e3  # standard deviation of a pose's height: anything


@dataclass(frozen=True)
class PosedPlate:
    """The bare plate's heights in one pose.

    Parameters
    ----------
    height_mm
        Heights at the same pixels in all poses, (H, W), NaN where there is none.
    turn_deg
        By how much the plate was turned about the origin of the plate frame, counterclockwise.
    dx_mm, dy_mm
        How far it was shifted after that.
    """

    height_mm: Array
    turn_deg: float = 0.0
    dx_mm: float = 0.0
    dy_mm: float = 0.0

    def on_plate(self, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
        """Return which points of the plate lie at some places."""
        c, s = math.cos(math.radians(self.turn_deg)), math.sin(math.radians(self.turn_deg))
        x, y = x_mm - self.dx_mm, y_mm - self.dy_mm
        return c * x + s * y, c * y - s * x


def form_by_poses(
    x_mm: ArrayLike,
    y_mm: ArrayLike,
    plates: Sequence[PosedPlate],
    box: Box,
    *,
    u_tilt: float,
    likely_mm: float = 0.5,
) -> PlateForm:
    """Separate the plate's form from what the rig adds to every height.

    Parameters
    ----------
    x_mm, y_mm
        Places of the pixels on the plate, (H, W).
    plates
        The plate in two poses or more; the first defines where it lies.
    box
        Part of the plate that the best plane belongs to, mm.
    u_tilt
        Standard uncertainty of the plate's tilt from pose to pose, mm per mm: that of the table it slides on. A shift
        shows a bow as a tilt, so that a bow is known no better than this.
    likely_mm
        Standard deviation of a form's coefficients before anything was measured.

    Returns
    -------
    PlateForm
        Coefficients, and how they may depart: what the poses do not show stays as uncertain as it was.

    Raises
    ------
    FitError
        Fewer than two poses, or too few points that all of them show.

    Notes
    -----
    `z_k(x) = e(x) + p(R_k'(x - t_k)) + a_k + b_k x + c_k y`, with the rig's own error e at each place, taken off as the
    mean over the poses, and the form p of `FORM_TERMS`. A half turn shows terms of third order alone, a quarter turn
    the difference of both bows and the twist; the bow itself shows in a shift. (After the turned and shifted flats of
    optical testing: D. Malacara, Optical Shop Testing, 3rd ed., Wiley 2007, ch. 14.)
    """
    if len(plates) < 2:
        raise FitError("The plate's form needs its heights in two poses or more: turn it, and shift it.")
    x, y, z, block = _points(np.asarray(x_mm, float), np.asarray(y_mm, float), plates)
    design = _design(x, y, plates, box)
    design, values = design - design.mean(axis=0), z - z.mean(axis=0)
    prior = np.array([likely_mm] * len(FORM_TERMS) + [_FREE_MM, u_tilt, u_tilt] * len(plates))
    mean, covariance = _fitted(design, values, prior, block)
    few = len(FORM_TERMS)
    variances, vectors = np.linalg.eigh(covariance[:few, :few])
    axes = tuple(np.sqrt(max(v, 0.0)) * vector for v, vector in zip(variances, vectors.T, strict=True))
    return PlateForm(box, mean[:few], axes)


def _points(x: Array, y: Array, plates: Sequence[PosedPlate]) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Return points that all poses show, their heights, (M, n), and the blocks of the picture that they lie in."""
    heights = np.stack([plate.height_mm for plate in plates])
    seen = np.isfinite(heights).all(axis=0) & np.isfinite(x) & np.isfinite(y)
    v, u = np.nonzero(seen)
    if v.size < _LEAST:
        raise FitError(f"{v.size} points are seen in all poses of the plate, {_LEAST} are needed; shift it less.")
    some = np.s_[:: max(1, v.size // _SAMPLES)]
    v, u = v[some], u[some]
    block = v * _BLOCKS // x.shape[0] * _BLOCKS + u * _BLOCKS // x.shape[1]
    return x[v, u], y[v, u], heights[:, v, u].astype(float), block


def _design(x: Array, y: Array, plates: Sequence[PosedPlate], box: Box) -> Array:
    """Return what one unit of each unknown adds to the heights, (M, n, unknowns): terms, then offset and tilts."""
    rows = []
    for k, plate in enumerate(plates):
        px, py = plate.on_plate(x, y)
        pose = np.zeros((x.size, 3 * len(plates)))
        pose[:, 3 * k : 3 * k + 3] = np.stack([np.ones_like(x), x, y], axis=1)
        rows.append(np.concatenate([_terms(px, py, box), pose], axis=1))
    return np.stack(rows)


def _terms(x: Array, y: Array, box: Box) -> Array:
    """Return the terms of a form at points of the plate, also beyond the box, (n, 7)."""
    s, t = (2 * x - box[0] - box[1]) / (box[1] - box[0]), (2 * y - box[2] - box[3]) / (box[3] - box[2])
    degree = 1 + max(max(term) for term in FORM_TERMS)
    across, along = (legendre.legvander(one, degree - 1) for one in (s, t))
    return np.stack([across[:, i] * along[:, j] for i, j in FORM_TERMS], axis=1)


def _fitted(design: Array, values: Array, prior: Array, block: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return the unknowns and their covariance; noise is that by blocks of neighbours where it is larger."""
    kept = np.ones(values.shape[1], bool)
    for _ in range(_ROUNDS):
        rows, right = (m[:, kept].reshape(-1, *m.shape[2:]) for m in (design, values))
        normal, pull = rows.T @ rows, rows.T @ right
        noise = 1.0
        for _ in range(_ROUNDS):  # the prior is weighed against the noise, which the residuals show
            covariance = np.linalg.inv(normal / noise**2 + np.diag(prior**-2.0))
            mean = covariance @ pull / noise**2
            left = values - design @ mean
            noise = max(_noise(left[:, kept], block[kept]), 1e-9)
        kept = np.abs(left).max(axis=0) <= max(_KEPT_SIGMAS * robust_sd(left[:, kept], about=0), 1e-9)
    return mean, covariance


def _noise(left: Array, block: NDArray[np.intp]) -> float:
    """Return the noise of one height as its mean over blocks shows it, or as single heights do if that is more."""
    poses = len(left)
    single = math.sqrt(float(np.mean(left**2)) * poses / (poses - 1))
    count = np.bincount(block)
    means = np.stack([np.bincount(block, row) for row in left])[:, count > 0] / count[count > 0]
    by_blocks = math.sqrt(float(np.mean(means**2 * count[count > 0])) * poses / (poses - 1))
    return max(single, by_blocks)
