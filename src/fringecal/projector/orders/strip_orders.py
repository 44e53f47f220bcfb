"""From strips whose phase is open to strips whose phase is absolute: which item each is, and its fringe order."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.errors import FitError
from fringecal.projector.joint_fit import PhasePoints
from fringecal.projector.orders.order_decision import CLEARLY, OrderDecision, decide_order
from fringecal.projector.sampling import pick_points
from fringecal.projector.standards.strip_phase import StripPhase, averaged_numberings, numberings

Array = NDArray[np.float64]

_POINTS_PER_PIECE = 1_500  # a piece has one order and one height; more points only take longer
_PLATE_POINTS = 16_000  # the plate has 26 numbers to tell, and is fitted once
_LEAST_PIXELS = 20  # of a piece, with known phase: fewer are a rim
_AGREED = 0.8  # of a piece's pixels that several periods must give one order; the others may lie at its edge


@dataclass(frozen=True)
class OrderedStrips:
    """Absolute phase of the strip tops, and which strip of the target each is.

    Parameters
    ----------
    phase_rad
        Map of the unwrapped phase on strip tops, counted as the plate's; NaN elsewhere.
    items
        Index of the target's strip for each label - 1; -1 where a strip is not seen.
    decision
        How the fringe order was decided.
    """

    phase_rad: Array
    items: tuple[int, ...]
    decision: OrderDecision

    def groups(self, strips: StripPhase) -> dict[float, tuple[int, ...]]:
        """Return the labels of the strips seen, by stated height."""
        found: dict[float, tuple[int, ...]] = {}
        for label in (k for k in strips.regions.seen if self.items[k - 1] >= 0):
            height = strips.heights_mm[self.items[label - 1]].value
            found[height] = (*found.get(height, ()), label)
        return found


@dataclass(frozen=True)
class MeasuredStep:
    """Phase over the bare plate's as several fringe periods give it, rad, (H, W), and its cycle in fringes."""

    difference_rad: Array
    cycle: int

    def order(self, strips: StripPhase, number: int) -> tuple[int, int] | None:
        """Return the order that a piece of strips lacks, and the cycle; None if its pixels disagree."""
        inside = strips.pieces == number
        turns = (self.difference_rad[inside] - strips.plate_drift_rad - strips.difference_rad[inside]) / (2 * np.pi)
        votes = np.bincount(np.rint(turns[np.isfinite(turns)]).astype(np.int64) % self.cycle, minlength=1)
        agreed = votes.max() > _AGREED * np.count_nonzero(inside)
        return (int(votes.argmax()), self.cycle) if agreed else None


def order_strips(
    plate_phase: Array,
    strips: StripPhase,
    camera: PlateCamera,
    *,
    projector_mm: Array | None = None,
    measured: MeasuredStep | None = None,
) -> OrderedStrips:
    """Decide the fringe order of all pieces of strip tops, and which way round unequal strips lie.

    Parameters
    ----------
    plate_phase
        Map of the unwrapped phase of the bare plate, rad, NaN where unknown.
    strips
        The strips' phase difference.
    camera
        The camera on the plate.
    projector_mm
        The stated position of the projector.
    measured
        The step as several fringe periods give it, where they were taken.

    Raises
    ------
    FitError
        The order is open, or unequal strips fit as well the other way round.
    """
    plate = _sampled(plate_phase, np.isfinite(plate_phase), camera, 0.0, _PLATE_POINTS)
    absolute = plate_phase + strips.difference_rad
    found: list[tuple[tuple[int, ...], OrderDecision]] = []
    errors: list[FitError] = []
    numbers = _usable(strips.pieces, absolute)
    known = [None if measured is None else measured.order(strips, k) for k in numbers]
    for items in numberings(strips):
        points = [_piece(strips, absolute, k, items, camera) for k in numbers]
        try:
            anchor = known[max(range(len(points)), key=lambda i: points[i].phase_rad.size)]
            found.append((items, decide_order(plate, points, projector_mm=projector_mm, measured=anchor)))
        except FitError as error:
            errors.append(error)
    if not found:
        raise errors[0]
    items, decision = _best(found)
    offsets = np.zeros(int(strips.pieces.max()) + 1)
    offsets[:] = np.nan
    offsets[numbers] = 2 * np.pi * np.array([_agreeing(*pair) for pair in zip(decision.orders, known, strict=True)])
    return OrderedStrips(absolute + offsets[strips.pieces], items, decision)


def order_like_strips(
    plate_phase: Array,
    strips: StripPhase,
    camera: PlateCamera,
    *,
    projector_mm: Array | None = None,
    measured: MeasuredStep | None = None,
) -> tuple[StripPhase, OrderedStrips]:
    """Order strips as `order_strips`; where it is open which is which and they are nearly alike, by their mean heights.

    Returns
    -------
    tuple
        The strips with the heights that were used, and their orders.
    """
    try:
        return strips, order_strips(plate_phase, strips, camera, projector_mm=projector_mm, measured=measured)
    except FitError:
        averaged = averaged_numberings(strips) if len(numberings(strips)) > 1 else None
        if averaged is None:
            raise
    return averaged, order_strips(plate_phase, averaged, camera, projector_mm=projector_mm, measured=measured)


def _agreeing(order: int, measured: tuple[int, int] | None) -> int:
    """Return the order nearest to one that was predicted which several periods bear out."""
    if measured is None:
        return order
    lack, cycle = (measured[0] - order) % measured[1], measured[1]
    return order + (lack if 2 * lack <= cycle else lack - cycle)


def _usable(pieces: NDArray[np.int32], absolute: Array) -> list[int]:
    """Return the pieces that lie on plate whose own phase is known."""
    sizes = np.bincount(pieces[np.isfinite(absolute)], minlength=2)
    sizes[0] = 0
    found = np.flatnonzero(sizes >= _LEAST_PIXELS).tolist()
    if not found:
        raise FitError("No strip lies where the phase of the bare plate is known: light the whole plate.")
    return found


def _piece(
    strips: StripPhase, absolute: Array, number: int, items: tuple[int, ...], camera: PlateCamera
) -> PhasePoints:
    inside = (strips.pieces == number) & np.isfinite(absolute)
    label = int(np.median(strips.regions.labels[inside]))
    return _sampled(absolute, inside, camera, strips.heights_mm[items[label - 1]].value, _POINTS_PER_PIECE)


def _sampled(phase: Array, inside: NDArray[np.bool_], camera: PlateCamera, z_mm: float, number: int) -> PhasePoints:
    u, v, cluster = pick_points(inside, number)
    return PhasePoints(camera.rays(u, v), z_mm, phase[v.astype(int), u.astype(int)], cluster)


def _best(found: list[tuple[tuple[int, ...], OrderDecision]]) -> tuple[tuple[int, ...], OrderDecision]:
    ranked = sorted(found, key=lambda pair: pair[1].chosen.block_rms_rad)
    if len(ranked) > 1:
        first, second = (pair[1].chosen.block_rms_rad for pair in ranked[:2])
        if second < CLEARLY * first:
            raise FitError(
                "The strips differ in height, and it is open which is which: counted from either end, or from another "
                f"strip, they fit almost as well (residuals {first:.4f} and {second:.4f} rad). Show all strips in the "
                "picture, or use strips that differ more or not at all."
            )
    return ranked[0]
