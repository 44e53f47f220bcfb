"""From phase maps to what a rig is fitted to: the plate, then the strips, one surface for each height."""

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.phase import PhaseMap, PlateOrders, unwrap
from fringecal.projector import MeasuredStep, Observations, OrderDecision, OrderedStrips, StripPhase, pick_points
from fringecal.uncertainty import Estimate
from fringecal.workflows.shared import CapturePhase, fewness

Array = NDArray[np.float64]

SURFACE_POINTS = 16_000  # pixels per surface: more add time, not knowledge, since neighbours share their errors


_LEAST_POINTS = 100  # of a surface; fewer say nothing beside the others


def measured_step(above: PhaseMap, plate: PhaseMap) -> MeasuredStep | None:
    """Return the phase over the bare plate's as several fringe periods give it; None with one period."""
    if above.orders is None or plate.orders is None or above.orders.cycle != plate.orders.cycle:
        return None
    tie = PlateOrders.of(plate.orders, plate.orders.phase)
    number = None if tie is None else tie.number_for(above.orders)
    if number is None:
        return None
    return MeasuredStep(above.orders.phase.astype(float) + 2 * np.pi * number - plate.orders.phase, above.orders.cycle)


def whole_plate(reference: CapturePhase) -> Array:
    """Unwrapped phase of the bare plate, NaN outside its largest connected piece."""
    pieces = unwrap(reference.map.phase, reference.map.valid)
    sizes = np.bincount(pieces.pieces.ravel())
    sizes[0] = 0
    if sizes.max(initial=0) < 0.05 * pieces.pieces.size:
        few = "".join(fewness(reference))
        raise FitError(few or "The bare plate's phase hangs together nowhere: shadows or dirt cut the fringes up.")
    return np.where(pieces.pieces == int(np.argmax(sizes)), pieces.phase, np.nan)


def observe_surfaces(
    plate_phase: Array, strips: StripPhase, ordered: OrderedStrips
) -> tuple[Observations, dict[float, OrderDecision]]:
    """Gather plate and strips, one surface for each height."""
    picked = [_picked(np.isfinite(plate_phase), plate_phase)]
    heights = [Estimate(0.0, 0.0, "mm", "plate")]
    orders: dict[float, OrderDecision] = {}
    groups = ordered.groups(strips)
    for height, labels in groups.items():
        inside = np.isin(strips.regions.labels, labels) & np.isfinite(ordered.phase_rad)
        if np.count_nonzero(inside) >= _LEAST_POINTS:
            orders[height] = ordered.decision
            picked.append(_picked(inside, ordered.phase_rad, number=max(SURFACE_POINTS // len(groups), 2000)))
            heights.append(strips.heights_mm[ordered.items[labels[0] - 1]])
    u, v, phase, cluster = (tuple(column) for column in zip(*picked, strict=True))
    return Observations(u, v, phase, cluster, tuple(heights)), orders


type Picked = tuple[Array, Array, Array, NDArray[np.intp]]


def _picked(inside: NDArray[np.bool_], phase: Array, *, number: int = SURFACE_POINTS) -> Picked:
    u, v, cluster = pick_points(inside, number)
    return u, v, phase[v.astype(int), u.astype(int)], cluster
