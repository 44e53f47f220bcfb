"""Decide the fringe order of the strips' phase difference: by evidence, never by assumption.

A wrapped step is known up to 2 pi k. The plate alone fixes five of the rig's seven numbers; each k then asks for
the other two, and so puts the projector elsewhere. At most one place is likely: above the plate, lighting it from
its own side, looking at the picture, in agreement with all strips and with where it is stated to stand.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.projector.joint_fit import PhasePoints
from fringecal.projector.orders.order_candidates import OrderCandidate, judge_orders

Array = NDArray[np.float64]

CLEARLY = 2.0
"""Ratio of block residuals from which on the smaller ones decide between two orders, or two ways to number the strips:
those of a wrong one are many times as large, those of two that fit alike differ by chance alone."""
_CLOSE = 0.75 * math.pi  # rad; a predicted step further off lies nearly as close to the next order (pi is half way)


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
    measured: tuple[int, int] | None = None,
) -> OrderDecision:
    """Decide by how many fringes the phase of each piece of the strips is off.

    Parameters
    ----------
    plate
        Points of the plate with unwrapped phase.
    strips
        Pieces of strip tops; within each the phase is continuous, its own multiple of 2 pi is open.
    projector_mm
        The stated position of the projector; its predicted phase difference then counts.
    orders
        Orders of the largest piece to try; by default every one that keeps the angle below 78 deg.
    measured
        That order as several fringe periods give it, and the cycle of fringes up to which it is known.

    Raises
    ------
    FitError
        No order makes sense, or several do and nothing tells them apart.
    """
    pieces = (strips,) if isinstance(strips, PhasePoints) else tuple(strips)
    candidates = judge_orders(plate, pieces, projector_mm=projector_mm, orders=orders, measured=measured)
    if not candidates:
        raise FitError("No fringe order of the strips gives a rig: check strips, reference and phase shifts.")
    if projector_mm is not None:
        return _by_theory(candidates)
    return _by_possibility(candidates)


def _by_theory(candidates: tuple[OrderCandidate, ...]) -> OrderDecision:
    best = min(candidates, key=lambda c: abs(c.predicted_difference_rad))
    if abs(best.predicted_difference_rad) > _CLOSE:
        raise FitError(
            "The stated projector position predicts a phase difference that deviates by "
            f"{best.predicted_difference_rad:+z.2f} rad from the nearest fringe order: position, strip height or pitch "
            "of the grid is wrong."
        )
    if not best.likely:
        raise FitError(
            f"The stated projector position asks for fringe order {best.order}, but then the light would come at "
            f"{_described(best)}. Check the projector's position (plate frame: x right, y up in the picture, z toward "
            "the camera) and the strips' height."
        )
    better = [c for c in candidates if c.possible and c.block_rms_rad < best.block_rms_rad / CLEARLY]
    if better:
        rival = min(better, key=lambda c: c.block_rms_rad)
        raise FitError(
            f"The stated projector position asks for fringe order {best.order} ({_described(best)}), but the strips "
            f"fit order {rival.order} far better ({_described(rival)}). Check the projector's position, the strips' "
            "height and that both captures are of one rig."
        )
    reason = (
        f"stated projector position, phase difference predicted within {abs(best.predicted_difference_rad):.2f} rad"
    )
    return OrderDecision(best.order, reason, candidates, best.orders)


def _by_possibility(candidates: tuple[OrderCandidate, ...]) -> OrderDecision:
    likely = [c for c in candidates if c.likely]
    if not likely:
        raise FitError(
            "No fringe order of the strips puts the projector above the plate and looking at it. Check that strips "
            "and reference were taken with the projector at the same position and that the target's height is right."
        )
    best = min(likely, key=lambda c: c.block_rms_rad)
    others = [c for c in likely if c is not best]
    rivals = [c for c in others if c.block_rms_rad < CLEARLY * best.block_rms_rad]
    rivals += [c for c in candidates if c.possible and not c.likely and c.block_rms_rad < best.block_rms_rad / CLEARLY]
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
