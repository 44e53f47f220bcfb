"""Decide the fringe order of the strips' phase step: by evidence, never by assumption.

A wrapped step is known up to 2 pi k. Each k puts the projector elsewhere: at most one place is possible (above
the plate, lighting it from the front), and it must agree with where the projector is said to stand.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.projection.fit import PhasePoints, RigFit, fit_rig
from fringecal.projection.rig import RigModel

Array = NDArray[np.float64]

_MAX_ANGLE_DEG = 78.0
_BEHIND = 4.0  # a height that is negative by more standard uncertainties than this is impossible
_CLEARLY = 2.0  # block residuals of a wrong order are at least this many times those of the right one
_CLOSE = 0.75 * math.pi  # a predicted step further off than this decides nothing


@dataclass(frozen=True)
class OrderCandidate:
    """What one fringe order would mean: projector line and angle, and whether that can be."""

    order: int
    angle_deg: float
    line_height_mm: float
    line_side_mm: float
    block_rms_rad: float
    possible: bool
    predicted_difference_rad: float


@dataclass(frozen=True)
class OrderDecision:
    """The order found, how it was decided, and all candidates beside it."""

    order: int
    reason: str
    candidates: tuple[OrderCandidate, ...]


def decide_order(
    plate: PhasePoints,
    strips: PhasePoints,
    *,
    projector_mm: Array | None = None,
    orders: Sequence[int] | None = None,
) -> OrderDecision:
    """Decide by how many fringes the strips' phase is off.

    Parameters
    ----------
    plate, strips
        Points with unwrapped phase; the strips' phase is smooth but its common order is open.
    projector_mm
        Where the projector is said to stand; its predicted step then has a vote.
    orders
        Orders to try; by default every one that keeps the angle below 78 deg.

    Raises
    ------
    FitError
        No order makes sense, or several do and nothing tells them apart.
    """
    fits = _fit_all(plate, strips, orders)
    candidates = tuple(_judge(order, fit, plate, strips, projector_mm) for order, fit in fits.items())
    if projector_mm is not None:
        return _by_theory(candidates)
    return _by_possibility(candidates)


def _fit_all(
    plate: PhasePoints, strips: PhasePoints, orders: Sequence[int] | None
) -> dict[int, RigFit]:
    fits: dict[int, RigFit] = {}
    for order in _orders(plate, strips) if orders is None else orders:
        shifted = PhasePoints(
            strips.rays, strips.z_mm, strips.phase_rad + 2 * math.pi * order, strips.cluster
        )
        try:
            fits[order] = fit_rig([plate, shifted])
        except FitError:
            continue
    return fits


def _orders(plate: PhasePoints, strips: PhasePoints) -> range:
    """Every order for which the ray could come in at less than the steepest angle considered."""
    plate_fit = np.linalg.lstsq(
        np.column_stack([plate.rays.ax, plate.rays.ay, np.ones_like(plate.rays.ax)]), plate.phase_rad, rcond=None
    )[0]
    slope = math.hypot(plate_fit[0], plate_fit[1])
    largest = slope * strips.z_mm * math.tan(math.radians(_MAX_ANGLE_DEG))
    x, y = strips.rays.at(0.0)
    step = float(np.median(strips.phase_rad - (plate_fit[0] * x + plate_fit[1] * y + plate_fit[2])))
    low = math.floor((-largest - step) / (2 * math.pi))
    high = math.ceil((largest - step) / (2 * math.pi))
    return range(low, high + 1)


def _judge(
    order: int, fit: RigFit, plate: PhasePoints, strips: PhasePoints, projector_mm: Array | None
) -> OrderCandidate:
    angle = math.degrees(_angle_at_origin(fit.model))
    side, height, behind = _line_in_profile(fit)
    possible = abs(angle) < _MAX_ANGLE_DEG and not behind and _lights_from_front(side, angle)
    difference = math.nan
    if projector_mm is not None:
        shifted = strips.phase_rad + 2 * math.pi * order
        difference = float(np.nanmedian(shifted - _predicted(fit.model, strips, projector_mm)))
    return OrderCandidate(order, angle, height, side, _block_rms(fit, strips), possible, difference)


def _block_rms(fit: RigFit, strips: PhasePoints) -> float:
    """Scatter of the strips' residuals averaged over blocks: noise and ripple fall out, a wrong order stays."""
    residual = fit.residuals[1]
    good = np.isfinite(residual)
    _, index, number = np.unique(strips.cluster[good], return_inverse=True, return_counts=True)
    means = np.bincount(index, weights=residual[good]) / number
    return float(np.sqrt(np.average(means**2, weights=number)))


def _angle_at_origin(model: RigModel) -> float:
    gx, gy, gz = model.gradient(0.0, 0.0, 0.0)
    return math.atan2(-float(gz), math.hypot(float(gx), float(gy)))


def _line_in_profile(fit: RigFit) -> tuple[float, float, bool]:
    """Side and height of the projector's line in the plane across the fringes at the origin.

    The test is on the inverse height, which stays finite for collimated light: the third value says whether
    it is negative beyond its uncertainty.
    """

    def inverse_height(parameters: Array) -> tuple[float, float]:
        model = RigModel(parameters, np.full(3, np.inf))
        gx, gy, _ = (float(g) for g in model.gradient(0.0, 0.0, 0.0))
        length = math.hypot(gx, gy)
        across = np.array([gx / length, gy / length])
        step = 20.0
        tangents = [
            -float(g[2]) / math.hypot(float(g[0]), float(g[1]))
            for g in (model.gradient(*(s * across), 0.0) for s in (-step, step))
        ]
        # For a pinhole tan(theta) = (side - s) / height along the direction across the fringes.
        return -(tangents[1] - tangents[0]) / (2 * step), (tangents[0] + tangents[1]) / 2

    base, tangent = inverse_height(fit.model.parameters)
    u = np.sqrt(np.diag(fit.covariance))
    gradient = np.zeros(7)
    for i in range(7):
        shifted = fit.model.parameters.copy()
        shifted[i] += u[i]
        gradient[i] = (inverse_height(shifted)[0] - base) / u[i] if u[i] > 0 else 0.0
    uncertainty = math.sqrt(float(gradient @ fit.covariance @ gradient))
    behind = base < -_BEHIND * max(uncertainty, 2e-5)
    height = 1 / base if base else math.inf
    return tangent * height, height, behind


def _lights_from_front(side: float, angle_deg: float) -> bool:
    """The light must come from the side on which its line stands."""
    return not math.isfinite(side) or side == 0 or math.copysign(1, side) == math.copysign(1, angle_deg) or abs(
        angle_deg
    ) < 5


def _predicted(model: RigModel, strips: PhasePoints, projector_mm: Array) -> Array:
    """Phase that the strips must have if the projector stands at `projector_mm`.

    The phase on the plate is known; along a ray from the projector it does not change.
    """
    x, y = strips.rays.at(strips.z_mm)
    stretch = strips.z_mm / (projector_mm[2] - strips.z_mm)
    return model.phase(x + (x - projector_mm[0]) * stretch, y + (y - projector_mm[1]) * stretch, 0.0)


def _by_theory(candidates: tuple[OrderCandidate, ...]) -> OrderDecision:
    if not candidates:
        raise FitError("No fringe order of the strips gives a rig at all: check strips, reference and steps.")
    best = min(candidates, key=lambda c: abs(c.predicted_difference_rad))
    if abs(best.predicted_difference_rad) > _CLOSE:
        raise FitError(
            f"The stated projector position predicts a phase step that is {best.predicted_difference_rad:+.2f} rad "
            "off the nearest fringe order: position, strip height or pitch of the grid is wrong."
        )
    if not best.possible:
        raise FitError(
            f"The stated projector position asks for fringe order {best.order}, but then the light would come at "
            f"{best.angle_deg:.1f} deg from a line {best.line_height_mm:.0f} mm above the plate. Check the sign and "
            "order of the phase steps, the projector's position and the strips' height."
        )
    reason = f"stated projector position, step predicted within {abs(best.predicted_difference_rad):.2f} rad"
    return OrderDecision(best.order, reason, candidates)


def _by_possibility(candidates: tuple[OrderCandidate, ...]) -> OrderDecision:
    possible = [c for c in candidates if c.possible]
    if not possible:
        raise FitError(
            "No fringe order of the strips puts the projector above the plate. Check the sign and order of the "
            "phase steps and that strips and reference were taken with the same lamp position."
        )
    best = min(possible, key=lambda c: c.block_rms_rad)
    others = [c for c in possible if c is not best]
    if any(c.block_rms_rad < _CLEARLY * best.block_rms_rad for c in others):
        listed = "; ".join(
            f"order {c.order}: {c.angle_deg:.1f} deg, projector {c.line_height_mm:.0f} mm up, residual {c.block_rms_rad:.4f} rad"
            for c in possible
        )
        raise FitError(
            f"The fringe order of the strips is open: {listed}. State projector.position_mm (a tape measure is "
            "enough), or use lower strips or wider fringes."
        )
    reason = "the only order that puts the projector above the plate" if not others else "smallest residual by far"
    return OrderDecision(best.order, reason, candidates)
