"""What each fringe order of the strips would mean: the rig that it asks for, and how well all strips agree."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import Rays
from fringecal.numerics import robust_sd
from fringecal.projector.joint_fit import SURFACE_U_RAD, PhasePoints
from fringecal.projector.plate_model import plate_model
from fringecal.projector.projector_line import angle_at_origin, line_in_profile, off_axis_deg
from fringecal.projector.rig_model import RigModel, foot_on_plate, projector_point

Array = NDArray[np.float64]

_MAX_ANGLE_DEG = 78.0  # from the normal: beyond it a fringe is five times as wide on the plate as across its light
_MAX_OFF_AXIS_DEG = 25.0  # between the projector's axis and its line to the plate's origin: lens shift, bad aim
_USUAL_SHARE = 0.95  # of the blocks, the best; the others may lie at a flaw and say nothing of the order


@dataclass(frozen=True)
class _SlopeSettings:
    """How phase with height, n_z and d_z, is solved from blocks of strip tops (`_two_numbers`).

    Parameters
    ----------
    rounds
        Of which each leaves out what lies far off the one before.
    outlier_sds
        Robust standard deviations beyond which a block is left out; its phase is a mean, and flaws are many.
    least_spread_rad
        Drawn phase without noise scatters by rounding alone; nothing is an outlier of that.
    least_tangent
        Of the projection angle; under light that falls more steeply the axis tells nothing of d_z.
    pull_rad
        Misfit that an axis is worth which is off by as much as its own tilt.
    pull_weight
        Of the pull beside all blocks together: a hundredth, so that it settles only what they leave open.
    least_pull_per_mm
        Floor of the tilt that the pull is measured by, 1/mm: light from 10 m away.
    """

    rounds: int = 4
    outlier_sds: float = 5.0
    least_spread_rad: float = 1e-6
    least_tangent: float = 0.1
    pull_rad: float = 0.3
    pull_weight: float = 1e-2
    least_pull_per_mm: float = 1e-4


_SLOPE = _SlopeSettings()


@dataclass(frozen=True)
class OrderCandidate:
    """What one fringe order would mean: projector line and angle, and whether that can be.

    `line_height_mm` and `line_side_mm` place the line in the plane across the fringes at the plate's origin;
    `off_axis_deg` is how far beside its own axis the projector would show the picture's centre (NaN when
    collimated).
    """

    order: int
    angle_deg: float
    line_height_mm: float
    line_side_mm: float
    off_axis_deg: float
    block_rms_rad: float
    possible: bool
    likely: bool
    predicted_difference_rad: float
    orders: tuple[int, ...] = ()


@dataclass(frozen=True)
class BlockMeans:
    """One piece of strips, averaged over its blocks of neighbours.

    Parameters
    ----------
    rays
        Mean ray of each block.
    z_mm
        Height of the piece.
    phase_rad
        Mean phase of each block, (n,).
    pixels
        Number of pixels of each block, its weight, (n,).
    """

    rays: Rays
    z_mm: float | Array
    phase_rad: Array
    pixels: NDArray[np.intp]


def judge_orders(
    plate: PhasePoints,
    pieces: Sequence[PhasePoints],
    *,
    projector_mm: Array | None = None,
    orders: Sequence[int] | None = None,
    measured: tuple[int, int] | None = None,
) -> tuple[OrderCandidate, ...]:
    """Return what every order of the largest piece would mean, the other pieces following it.

    `measured` is that order as several fringe periods give it, and the cycle up to which it is known.
    """
    model = plate_model(plate)
    thin = [_thinned(piece) for piece in pieces]
    anchor = max(range(len(pieces)), key=lambda i: pieces[i].phase_rad.size)
    sequence = _nearest_first(thin, anchor)
    tried = _orders(model, thin[anchor]) if orders is None else orders
    if measured is not None:
        tried = [k for k in tried if (k - measured[0]) % measured[1] == 0]
    return tuple(_judge(k, model, thin, sequence, projector_mm) for k in tried)


def _thinned(points: PhasePoints) -> BlockMeans:
    """Average the points of each block: what is left is smooth, and quick to work with."""
    good = np.isfinite(points.phase_rad)
    _, index, number = np.unique(points.cluster[good], return_inverse=True, return_counts=True)

    def mean(values: Array) -> Array:
        return np.bincount(index, weights=np.broadcast_to(values, good.shape)[good]) / number

    rays = points.rays
    thin = Rays(mean(rays.ax), mean(rays.ay), mean(rays.bx), mean(rays.by))
    return BlockMeans(thin, points.z_mm, mean(points.phase_rad), number)


def _nearest_first(pieces: Sequence[BlockMeans], anchor: int) -> list[int]:
    """Order the pieces so that each next one is the nearest to those before it."""
    centres = np.array([(np.median(p.rays.ax), np.median(p.rays.ay)) for p in pieces])
    left = set(range(len(pieces))) - {anchor}
    sequence = [anchor]
    distance = np.hypot(*(centres - centres[anchor]).T)
    while left:
        nearest = min(left, key=lambda i: distance[i])
        sequence.append(nearest)
        left.remove(nearest)
        distance = np.minimum(distance, np.hypot(*(centres - centres[nearest]).T))
    return sequence


def _orders(model: RigModel, anchor: BlockMeans) -> range:
    """Every order for which the ray could come in at less than the steepest angle considered."""
    x, y = anchor.rays.at(anchor.z_mm)
    gx, gy, _ = model.gradient(x, y, 0.0)
    largest = float(np.median(np.hypot(gx, gy))) * anchor.z_mm * math.tan(math.radians(_MAX_ANGLE_DEG))
    step = float(np.median(anchor.phase_rad - model.phase(x, y, 0.0)))
    return range(math.floor((-largest - step) / (2 * math.pi)), math.ceil((largest - step) / (2 * math.pi)) + 1)


def _judge(
    order: int,
    plate: RigModel,
    pieces: Sequence[BlockMeans],
    sequence: Sequence[int],
    projector_mm: Array | None,
) -> OrderCandidate:
    """Grow from the anchor with this order over all pieces, and say what rig that makes."""
    first = pieces[sequence[0]]
    done = [_shifted(first, order)]
    orders = dict.fromkeys(range(len(pieces)), order)
    model = _solved(plate, done)
    for i in sequence[1:]:
        x, y = pieces[i].rays.at(pieces[i].z_mm)
        lack = model.phase(x, y, pieces[i].z_mm) - pieces[i].phase_rad
        orders[i] = round(float(np.median(lack)) / (2 * math.pi))
        done.append(_shifted(pieces[i], orders[i]))
        model = _solved(plate, done)
    model = _solved(plate, done, near=projector_mm)
    rms = _rms(model, done)
    angle = math.degrees(angle_at_origin(model))
    side, height, behind = line_in_profile(model, _covariance(model, done, rms))
    possible = abs(angle) < _MAX_ANGLE_DEG and not behind
    off_axis = off_axis_deg(model, side, height, _extent_mm(pieces))
    likely = possible and not abs(off_axis) > _MAX_OFF_AXIS_DEG
    difference = math.nan
    if projector_mm is not None:
        lacks = [p.phase_rad - _predicted(plate, p, projector_mm) for p in done]
        difference = float(np.median(np.concatenate(lacks)))
    numbers = tuple(orders[i] for i in range(len(pieces)))
    return OrderCandidate(order, angle, height, side, off_axis, rms, possible, likely, difference, numbers)


def _shifted(piece: BlockMeans, order: int) -> BlockMeans:
    return replace(piece, phase_rad=piece.phase_rad + 2 * math.pi * order)


def _solved(plate: RigModel, pieces: Sequence[BlockMeans], *, near: Array | None = None) -> RigModel:
    """Solve for n_z and d_z, linear where the residual is known: `n_z z - phi d_z z = phi D - N`.

    One strip along the fringes fixes only one combination of the two; a weak pull toward a projector that looks
    at the plate's origin settles the other until more strips are in.
    """
    model = plate
    for _ in range(2):
        rows, right, weights = [], [], []
        for piece in pieces:
            x, y = piece.rays.at(piece.z_mm)
            phi = piece.phase_rad - model.residual(*model.foot(x, y, piece.z_mm))
            below = 1 + (plate.parameters[4] * x + plate.parameters[5] * y)
            above = plate.parameters[0] * x + plate.parameters[1] * y + plate.parameters[3]
            z = np.full_like(x, piece.z_mm)
            rows.append(np.column_stack([z, -phi * z]))
            right.append(phi * below - above)
            weights.append(np.sqrt(piece.pixels.astype(float)))
        nz, dz = _two_numbers(plate, np.vstack(rows), np.concatenate(right), np.concatenate(weights))
        parameters = plate.parameters.copy()
        parameters[2], parameters[6] = nz, dz
        model = RigModel(parameters, projector_point(parameters, near=near), plate.residual)
    return model


def _two_numbers(
    plate: RigModel, design: Array, right: Array, weight: Array, *, settings: _SlopeSettings = _SLOPE
) -> tuple[float, float]:
    """Weighted least squares, robust against blocks that are off, with the weak pull of `_solved`."""
    nx, ny, _, n0, dx, dy, _ = plate.parameters
    # Phase counted from the origin's makes the two columns nearly orthogonal: n_z -> n_z - phi0 d_z.
    design = np.column_stack([design[:, 0], design[:, 1] + n0 * design[:, 0]])
    gradient = np.array([nx - n0 * dx, ny - n0 * dy])
    slope = float(np.hypot(*gradient))
    across = float(gradient @ [dx, dy]) / slope
    solution = np.zeros(2)
    for round_number in range(settings.rounds):
        left = right - design @ solution
        far = settings.outlier_sds * max(robust_sd(left), settings.least_spread_rad)
        keep = np.ones(left.size, bool) if round_number == 0 else np.abs(left) < far
        if np.count_nonzero(keep) < 2:
            break
        tangent = -solution[0] / slope
        pull = across / tangent if abs(tangent) > settings.least_tangent else 0.0
        w = weight[keep] / math.sqrt(float(np.sum(weight[keep] ** 2)))
        strength = settings.pull_weight * (settings.pull_rad / max(abs(pull), settings.least_pull_per_mm))
        matrix = np.vstack([design[keep] * w[:, None], [0.0, strength]])
        solution, *_ = np.linalg.lstsq(matrix, np.append(right[keep] * w, strength * pull), rcond=None)
    return float(solution[0] + n0 * solution[1]), float(solution[1])


def _residuals(model: RigModel, pieces: Sequence[BlockMeans]) -> tuple[Array, Array]:
    left, weight = [], []
    for piece in pieces:
        x, y = piece.rays.at(piece.z_mm)
        left.append(piece.phase_rad - model.phase(x, y, piece.z_mm))
        weight.append(piece.pixels.astype(float))
    return np.concatenate(left), np.concatenate(weight)


def _rms(model: RigModel, pieces: Sequence[BlockMeans]) -> float:
    """Scatter of block means: noise and ripple fall out, a wrong order stays. Blocks at a flaw are left out."""
    left, weight = _residuals(model, pieces)
    size = np.abs(left)
    keep = size <= np.quantile(size, _USUAL_SHARE)
    return math.hypot(float(np.sqrt(np.average(left[keep] ** 2, weights=weight[keep]))), SURFACE_U_RAD)


def _covariance(model: RigModel, pieces: Sequence[BlockMeans], rms: float) -> Array:
    """Covariance of (n_z, d_z) as the scatter of the blocks gives it."""
    rows = []
    for piece in pieces:
        x, y = piece.rays.at(piece.z_mm)
        phi, d = model.phase(x, y, piece.z_mm), model.parameters[4:]
        below = 1 + d[0] * x + d[1] * y + d[2] * piece.z_mm
        rows.append(np.column_stack([piece.z_mm / below, -phi * piece.z_mm / below]))
    jacobian = np.vstack(rows)
    return rms**2 * np.linalg.pinv(jacobian.T @ jacobian)


def _extent_mm(pieces: Sequence[BlockMeans]) -> float:
    x, y = (np.concatenate([getattr(p.rays, axis) for p in pieces]) for axis in ("ax", "ay"))
    return float(max(np.ptp(x), np.ptp(y)))


def _predicted(plate: RigModel, strips: BlockMeans, projector_mm: Array) -> Array:
    """Phase that the strips must have if the projector stands at `projector_mm`.

    The phase on the plate is known; along a ray from the projector it does not change.
    """
    return plate.phase(*foot_on_plate(*strips.rays.at(strips.z_mm), strips.z_mm, projector_mm), 0.0)
