"""Decide the fringe order of the strips' phase step: by evidence, never by assumption.

A wrapped step is known up to 2 pi k. The plate alone fixes five of the rig's seven numbers; each k then asks for
the other two, and so puts the projector elsewhere. At most one place is likely: above the plate, lighting it from
its own side, looking at the picture, in agreement with all strips and with where it is said to stand.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate import Rays
from fringecal.errors import FitError
from fringecal.projection.fit import PhasePoints
from fringecal.projection.rig import PlateResidual, RigModel, projector_point

Array = NDArray[np.float64]

_MAX_ANGLE_DEG = 78.0
_MAX_OFF_AXIS_DEG = 25.0  # between the projector's axis and its line to the plate's origin: lens shift, bad aim
_BEHIND = 4.0  # a height that is negative by more standard uncertainties than this is impossible
_CLEARLY = 2.0  # block residuals of a wrong order are at least this many times those of the right one
_CLOSE = 0.75 * math.pi  # a predicted step further off than this decides nothing
_LEAST_CHIRP = 0.02  # change of the pitch over the field below which light counts as collimated
_PLATE_POINTS = 5_000
_PLATE_DEGREE = 5
_ROUGH_RAD = 0.5
_MOST_ROUGH = 0.1  # share of the plate's points that may be off by more than that
_FLOOR_RAD = 2e-3  # residuals of blocks below this are as good as none


@dataclass(frozen=True)
class OrderCandidate:
    """What one fringe order would mean: projector line and angle, and whether that can be.

    `line_height_mm` and `line_side_mm` place the line in the plane across the fringes at the plate's origin;
    `off_axis_deg` is how far beside its own axis the projector would throw the picture's centre (NaN when
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
class OrderDecision:
    """The order found, how it was decided, and all candidates beside it.

    `order` is that of the largest piece, `orders` those of all pieces.
    """

    order: int
    reason: str
    candidates: tuple[OrderCandidate, ...]
    orders: tuple[int, ...] = ()

    @property
    def chosen(self) -> OrderCandidate:
        """The candidate that was chosen."""
        return next(c for c in self.candidates if c.order == self.order)


def decide_order(
    plate: PhasePoints,
    strips: PhasePoints | Sequence[PhasePoints],
    *,
    projector_mm: Array | None = None,
    orders: Sequence[int] | None = None,
) -> OrderDecision:
    """Decide by how many fringes the phase of each piece of the strips is off.

    Parameters
    ----------
    plate
        Points of the plate with unwrapped phase.
    strips
        Pieces of strip tops; within each the phase is continuous, its own multiple of 2 pi is open.
    projector_mm
        Where the projector is said to stand; its predicted step then has a vote.
    orders
        Orders of the largest piece to try; by default every one that keeps the angle below 78 deg.

    Raises
    ------
    FitError
        No order makes sense, or several do and nothing tells them apart.
    """
    pieces = (strips,) if isinstance(strips, PhasePoints) else tuple(strips)
    candidates = judge_orders(plate, pieces, projector_mm=projector_mm, orders=orders)
    if not candidates:
        raise FitError("No fringe order of the strips gives a rig at all: check strips, reference and steps.")
    if projector_mm is not None:
        return _by_theory(candidates)
    return _by_possibility(candidates)


def judge_orders(
    plate: PhasePoints,
    pieces: Sequence[PhasePoints],
    *,
    projector_mm: Array | None = None,
    orders: Sequence[int] | None = None,
) -> tuple[OrderCandidate, ...]:
    """Return what every order of the largest piece would mean, the other pieces following it."""
    model = plate_model(plate)
    thin = [_thinned(piece) for piece in pieces]
    anchor = max(range(len(pieces)), key=lambda i: pieces[i].phase_rad.size)
    sequence = _nearest_first(thin, anchor)
    tried = _orders(model, thin[anchor]) if orders is None else orders
    return tuple(_judge(k, model, thin, sequence, projector_mm) for k in tried)


def plate_model(plate: PhasePoints) -> RigModel:
    """Fit what the plate alone tells: five of the seven numbers, and the smooth residual.

    Raises
    ------
    FitError
        The plate's points do not span the field, or are not those of a bare plate.
    """
    good = np.flatnonzero(np.isfinite(plate.phase_rad))
    good = np.random.default_rng(2008).permutation(good)[:_PLATE_POINTS]
    x, y, phi = plate.rays.ax[good], plate.rays.ay[good], plate.phase_rad[good]
    unit = max(float(np.ptp(x)), float(np.ptp(y)), 1e-9) / 2
    parameters = np.zeros(7)
    keep = np.ones(phi.size, bool)
    residual = PlateResidual()
    below = np.ones(phi.size)
    for _ in range(4):
        s, t, p = x / unit, y / unit, phi - residual(x, y)
        design = np.column_stack([s, t, np.ones_like(s), -p * s, -p * t]) / below[:, None]
        solution, _, rank, _ = np.linalg.lstsq(design[keep], (p / below)[keep], rcond=1e-12)
        if rank < 5:
            raise FitError("The phase of the plate does not span the field: it cannot be described by a projector.")
        parameters[[0, 1, 3, 4, 5]] = solution / [unit, unit, 1.0, unit, unit]
        below = 1 + (parameters[4] * x + parameters[5] * y)
        model = RigModel(parameters.copy(), np.full(3, np.inf))
        residual = _smooth_residual(model, x[keep], y[keep], phi[keep])
        left = phi - model.ratio(x, y, 0.0) - residual(x, y)
        keep = np.abs(left) < 4.5 * 1.4826 * float(np.median(np.abs(left))) + 1e-9
    rough = float(np.mean(np.abs(left) > _ROUGH_RAD))
    if rough > _MOST_ROUGH:
        raise FitError(
            f"The reference is no bare plate: over {100 * rough:.0f} % of it the phase is more than {_ROUGH_RAD} rad "
            "off a smooth one. Something lies on the plate, or the captures of strips and reference are exchanged."
        )
    return RigModel(parameters, np.full(3, np.inf), residual)


def _smooth_residual(model: RigModel, x: Array, y: Array, phi: Array) -> PlateResidual:
    box = (float(x.min()), float(x.max()), float(y.min()), float(y.max()))
    design = PlateResidual(_PLATE_DEGREE, np.zeros(1), box).design(x, y)
    left = phi - model.ratio(x, y, 0.0)
    ridge = 1e-9 * left.size * np.eye(design.shape[1])
    coefficients = np.linalg.solve(design.T @ design + ridge, design.T @ left)
    return PlateResidual(_PLATE_DEGREE, coefficients, box)


def _thinned(points: PhasePoints) -> PhasePoints:
    """Average the points of each block: what is left is smooth, and quick to work with."""
    good = np.isfinite(points.phase_rad)
    _, index, number = np.unique(points.cluster[good], return_inverse=True, return_counts=True)

    def mean(values: Array) -> Array:
        return np.bincount(index, weights=np.broadcast_to(values, good.shape)[good]) / number

    rays = points.rays
    thin = Rays(mean(rays.ax), mean(rays.ay), mean(rays.bx), mean(rays.by))
    return PhasePoints(thin, points.z_mm, mean(points.phase_rad), number)


def _nearest_first(pieces: Sequence[PhasePoints], anchor: int) -> list[int]:
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


def _orders(model: RigModel, anchor: PhasePoints) -> range:
    """Every order for which the ray could come in at less than the steepest angle considered."""
    x, y = anchor.rays.at(anchor.z_mm)
    gx, gy, _ = model.gradient(x, y, 0.0)
    largest = float(np.median(np.hypot(gx, gy))) * anchor.z_mm * math.tan(math.radians(_MAX_ANGLE_DEG))
    step = float(np.median(anchor.phase_rad - model.phase(x, y, 0.0)))
    return range(math.floor((-largest - step) / (2 * math.pi)), math.ceil((largest - step) / (2 * math.pi)) + 1)


def _judge(
    order: int,
    plate: RigModel,
    pieces: Sequence[PhasePoints],
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
    angle = math.degrees(_angle_at_origin(model))
    side, height, behind = _line_in_profile(model, _covariance(model, done, rms))
    possible = abs(angle) < _MAX_ANGLE_DEG and not behind
    off_axis = _off_axis_deg(model, side, height, pieces)
    likely = possible and not abs(off_axis) > _MAX_OFF_AXIS_DEG
    difference = math.nan
    if projector_mm is not None:
        lacks = [p.phase_rad - _predicted(plate, p, projector_mm) for p in done]
        difference = float(np.median(np.concatenate(lacks)))
    numbers = tuple(orders[i] for i in range(len(pieces)))
    return OrderCandidate(order, angle, height, side, off_axis, rms, possible, likely, difference, numbers)


def _shifted(piece: PhasePoints, order: int) -> PhasePoints:
    return replace(piece, phase_rad=piece.phase_rad + 2 * math.pi * order)


def _solved(plate: RigModel, pieces: Sequence[PhasePoints], *, near: Array | None = None) -> RigModel:
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
            weights.append(np.sqrt(piece.cluster.astype(float)))
        nz, dz = _two_numbers(plate, np.vstack(rows), np.concatenate(right), np.concatenate(weights))
        parameters = plate.parameters.copy()
        parameters[2], parameters[6] = nz, dz
        model = RigModel(parameters, projector_point(parameters, near=near), plate.residual)
    return model


def _two_numbers(plate: RigModel, design: Array, right: Array, weight: Array) -> tuple[float, float]:
    """Weighted least squares, robust against blocks that are off, with the weak pull of `_solved`."""
    nx, ny, _, n0, dx, dy, _ = plate.parameters
    # Phase counted from the origin's makes the two columns nearly orthogonal: n_z -> n_z - phi0 d_z.
    design = np.column_stack([design[:, 0], design[:, 1] + n0 * design[:, 0]])
    gradient = np.array([nx - n0 * dx, ny - n0 * dy])
    slope = float(np.hypot(*gradient))
    across = float(gradient @ [dx, dy]) / slope
    solution = np.zeros(2)
    for round_number in range(4):
        left = right - design @ solution
        spread = 1.4826 * float(np.median(np.abs(left - np.median(left))))
        keep = np.ones(left.size, bool) if round_number == 0 else np.abs(left) < 5 * max(spread, 1e-6)
        if np.count_nonzero(keep) < 2:
            break
        tangent = -solution[0] / slope
        pull = across / tangent if abs(tangent) > 0.1 else 0.0
        w = weight[keep] / math.sqrt(float(np.sum(weight[keep] ** 2)))
        # Worth 0.3 rad of misfit for an axis that is off by as much as its own tilt.
        strength = 0.3 / max(abs(pull), 1e-4)
        matrix = np.vstack([design[keep] * w[:, None], [0.0, 1e-2 * strength]])
        solution, *_ = np.linalg.lstsq(matrix, np.append(right[keep] * w, 1e-2 * strength * pull), rcond=None)
    return float(solution[0] + n0 * solution[1]), float(solution[1])


def _misfits(model: RigModel, pieces: Sequence[PhasePoints]) -> tuple[Array, Array]:
    left, weight = [], []
    for piece in pieces:
        x, y = piece.rays.at(piece.z_mm)
        left.append(piece.phase_rad - model.phase(x, y, piece.z_mm))
        weight.append(piece.cluster.astype(float))
    return np.concatenate(left), np.concatenate(weight)


def _rms(model: RigModel, pieces: Sequence[PhasePoints]) -> float:
    """Scatter of block means: noise and ripple fall out, a wrong order stays. Blocks at a flaw are left out."""
    left, weight = _misfits(model, pieces)
    size = np.abs(left)
    keep = size <= np.quantile(size, 0.95)
    return math.hypot(float(np.sqrt(np.average(left[keep] ** 2, weights=weight[keep]))), _FLOOR_RAD)


def _covariance(model: RigModel, pieces: Sequence[PhasePoints], rms: float) -> Array:
    """Covariance of (n_z, d_z) as the scatter of the blocks gives it."""
    rows = []
    for piece in pieces:
        x, y = piece.rays.at(piece.z_mm)
        phi, d = model.phase(x, y, piece.z_mm), model.parameters[4:]
        below = 1 + d[0] * x + d[1] * y + d[2] * piece.z_mm
        rows.append(np.column_stack([piece.z_mm / below, -phi * piece.z_mm / below]))
    jacobian = np.vstack(rows)
    return rms**2 * np.linalg.pinv(jacobian.T @ jacobian)


def _angle_at_origin(model: RigModel) -> float:
    gx, gy, gz = model.gradient(0.0, 0.0, 0.0)
    return math.atan2(-float(gz), math.hypot(float(gx), float(gy)))


def _inverse_height(parameters: Array) -> tuple[float, float]:
    """Return 1/height of the projector's line and the tangent at the origin, across the fringes there.

    For a pinhole tan(theta) = (side - s) / height at s across the fringes; the inverse stays finite for
    collimated light.
    """
    n, n0, d = parameters[:3], parameters[3], parameters[4:]
    gradient = n[:2] - n0 * d[:2]
    length = math.hypot(*gradient)
    across = gradient / length
    tangent = -float(n[2] - n0 * d[2]) / length
    # The line: points s across and z up with n.X + n0 = 0 and d.X + 1 = 0.
    matrix = np.array([[float(n[:2] @ across), n[2]], [float(d[:2] @ across), d[2]]])
    determinant = float(np.linalg.det(matrix))
    # Cramer's rule for z = (d_s n0 - n_s) / determinant.
    return determinant / (float(matrix[1, 0]) * n0 - float(matrix[0, 0])), tangent


def _line_in_profile(model: RigModel, covariance: Array) -> tuple[float, float, bool]:
    """Side and height of the projector's line; whether the height is negative beyond its uncertainty."""
    base, tangent = _inverse_height(model.parameters)
    gradient = np.zeros(2)
    for i, index in enumerate((2, 6)):
        step = math.sqrt(max(float(covariance[i, i]), 0.0))
        if step > 0:
            shifted = model.parameters.copy()
            shifted[index] += step
            gradient[i] = (_inverse_height(shifted)[0] - base) / step
    uncertainty = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
    behind = base < -_BEHIND * max(uncertainty, 2e-5)
    height = 1 / base if base else math.inf
    return tangent * height, height, behind


def _off_axis_deg(model: RigModel, side: float, height: float, pieces: Sequence[PhasePoints]) -> float:
    """Angle at the projector between its axis and the plate's origin, in the plane across the fringes.

    The denominator of the phase vanishes on the plane through the pupil that stands square to the axis: its
    gradient is the axis, and the plate alone gives two thirds of it.
    """
    n, n0, d = model.parameters[:3], model.parameters[3], model.parameters[4:]
    gradient = n[:2] - n0 * d[:2]
    across = float(d[:2] @ gradient) / math.hypot(*gradient)
    extent = max(
        float(np.ptp(np.concatenate([p.rays.ax for p in pieces]))),
        float(np.ptp(np.concatenate([p.rays.ay for p in pieces]))),
    )
    if math.hypot(across, float(d[2])) * extent < _LEAST_CHIRP or not math.isfinite(height):
        return math.nan
    axis = math.atan2(across, float(d[2]))
    return math.degrees((math.atan2(-side, -height) - axis + math.pi) % (2 * math.pi) - math.pi)


def _predicted(plate: RigModel, strips: PhasePoints, projector_mm: Array) -> Array:
    """Phase that the strips must have if the projector stands at `projector_mm`.

    The phase on the plate is known; along a ray from the projector it does not change.
    """
    x, y = strips.rays.at(strips.z_mm)
    stretch = strips.z_mm / (projector_mm[2] - strips.z_mm)
    return plate.phase(x + (x - projector_mm[0]) * stretch, y + (y - projector_mm[1]) * stretch, 0.0)


def _by_theory(candidates: tuple[OrderCandidate, ...]) -> OrderDecision:
    best = min(candidates, key=lambda c: abs(c.predicted_difference_rad))
    if abs(best.predicted_difference_rad) > _CLOSE:
        raise FitError(
            f"The stated projector position predicts a phase step that is {best.predicted_difference_rad:+.2f} rad "
            "off the nearest fringe order: position, strip height or pitch of the grid is wrong."
        )
    if not best.likely:
        raise FitError(
            f"The stated projector position asks for fringe order {best.order}, but then the light would come at "
            f"{_described(best)}. Check the projector's position (plate frame: x right, y up in the picture, z toward "
            "the camera) and the strips' height."
        )
    better = [c for c in candidates if c.possible and c.block_rms_rad < best.block_rms_rad / _CLEARLY]
    if better:
        rival = min(better, key=lambda c: c.block_rms_rad)
        raise FitError(
            f"The stated projector position asks for fringe order {best.order} ({_described(best)}), but the strips "
            f"fit order {rival.order} far better ({_described(rival)}). Check the projector's position, the strips' "
            "height and that both captures are of one rig."
        )
    reason = f"stated projector position, step predicted within {abs(best.predicted_difference_rad):.2f} rad"
    return OrderDecision(best.order, reason, candidates, best.orders)


def _by_possibility(candidates: tuple[OrderCandidate, ...]) -> OrderDecision:
    likely = [c for c in candidates if c.likely]
    if not likely:
        raise FitError(
            "No fringe order of the strips puts the projector above the plate and looking at it. Check that strips "
            "and reference were taken with the same lamp position and that the target's height is right."
        )
    best = min(likely, key=lambda c: c.block_rms_rad)
    others = [c for c in likely if c is not best]
    rivals = [c for c in others if c.block_rms_rad < _CLEARLY * best.block_rms_rad]
    rivals += [c for c in candidates if c.possible and not c.likely and c.block_rms_rad < best.block_rms_rad / _CLEARLY]
    if rivals:
        listed = "; ".join(f"order {c.order}: {_described(c)}" for c in [best, *rivals])
        raise FitError(
            f"The fringe order of the strips is open: {listed}. State projector.position_mm (a tape measure is "
            "enough), or use lower strips or wider fringes."
        )
    reason = "smallest residual by far" if others else "the only order whose projector looks down at the plate"
    if math.isfinite(best.off_axis_deg):
        # A height stated wrongly shows here first: it makes the projector look past the plate.
        reason += f", its axis {abs(best.off_axis_deg):.0f} deg beside the picture's centre"
    return OrderDecision(best.order, reason, candidates, best.orders)


def _described(candidate: OrderCandidate) -> str:
    return (
        f"{candidate.angle_deg:.1f} deg from {candidate.line_height_mm:.0f} mm above the plate, "
        f"{abs(candidate.off_axis_deg):.0f} deg beside the projector's axis, residual {candidate.block_rms_rad:.4f} rad"
    )
