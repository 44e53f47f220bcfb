"""From phase maps to what a rig is fitted to: the plate, then the strips, one surface for each height."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.errors import DetectionError, FitError
from fringecal.phase import PhaseMap, PlateOrders, unwrap
from fringecal.projector import (
    MeasuredStep,
    Observations,
    OrderDecision,
    OrderedStrips,
    StripPhase,
    explained,
    height_parts,
    is_split,
    measure_strips,
    order_like_strips,
    pick_points,
    total_u,
)
from fringecal.targets import Strips
from fringecal.uncertainty import Estimate, UncertaintyComponent

Array = NDArray[np.float64]

SURFACE_POINTS = 16_000  # pixels per surface: more add time, not knowledge, since neighbours share their errors
_LEAST_POINTS = 100  # pixels of a surface; fewer say nothing beside the others
_LEAST_OF_A_HEIGHT = 2_000  # pixels drawn of each height, however many heights share `SURFACE_POINTS`
_LEAST_PLATE = 0.05  # share of the picture that the plate's largest connected piece must cover to hold a model


@dataclass(frozen=True)
class PlateSurface:
    """The bare plate.

    Parameters
    ----------
    phase
        Its phase map.
    unwrapped_rad
        The same, unwrapped over the largest connected piece, rad, NaN elsewhere, (H, W).
    """

    phase: PhaseMap
    unwrapped_rad: Array

    @property
    def noise_rad(self) -> float:
        """Median standard uncertainty of the phase of one pixel, rad."""
        return float(np.nanmedian(self.phase.sigma[self.phase.valid]))

    @property
    def orders(self) -> PlateOrders | None:
        """How several fringe periods number the plate's fringes; None with one period."""
        return None if self.phase.orders is None else PlateOrders.of(self.phase.orders, self.unwrapped_rad)


@dataclass(frozen=True)
class StripSurfaces:
    """The strips on the plate: their phase map, which pixels are which strip, and their absolute phase."""

    phase: PhaseMap
    target: Strips
    found: StripPhase
    ordered: OrderedStrips


def plate_surface(phase: PhaseMap) -> PlateSurface:
    """Unwrap the bare plate's phase over its largest connected piece.

    Parameters
    ----------
    phase
        Phase map of the bare plate.

    Raises
    ------
    FitError
        No connected piece covers enough of the picture.
    """
    pieces = unwrap(phase.phase, phase.valid)
    sizes = np.bincount(pieces.pieces.ravel())
    sizes[0] = 0
    if sizes.max(initial=0) < _LEAST_PLATE * pieces.pieces.size:
        raise FitError("The bare plate's phase is nowhere connected: shadows or dirt cut the fringes up.")
    return PlateSurface(phase, np.where(pieces.pieces == int(np.argmax(sizes)), pieces.phase, np.nan))


def strips_on_plate(
    plate: PlateSurface,
    phase: PhaseMap,
    target: Strips,
    camera: PlateCamera,
    *,
    projector_mm: Array | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> StripSurfaces:
    """Find the strips by the phase that they add to the plate's, and decide their fringe order.

    Parameters
    ----------
    plate
        The bare plate.
    phase
        Phase map of the plate with strips on it.
    target
        Count, width, gap and height of the strips.
    camera
        The camera on the plate.
    projector_mm
        Stated position of the projector's pupil, plate frame, mm, (3,).
    progress
        Called with a short sentence before each step.

    Raises
    ------
    DetectionError
        The strips do not show; where the stated projector explains that, with the reason.
    FitError
        Something moved between the two captures, or the fringe order stays open.
    """
    try:
        found = measure_strips(plate.phase, phase, target, camera)
    except DetectionError as error:
        height = float(np.mean(target.height_mm.array(target.count)))
        raise explained(error, plate.unwrapped_rad, camera, height, projector_mm) from error
    progress("fringe order of the strips")
    found, ordered = order_like_strips(
        plate.unwrapped_rad,
        found,
        camera,
        projector_mm=projector_mm,
        measured=measured_step(phase, plate.phase),
    )
    return StripSurfaces(phase, target, found, ordered)


def measured_step(above: PhaseMap, plate: PhaseMap) -> MeasuredStep | None:
    """Return the phase over the bare plate's as several fringe periods give it; None with one period."""
    if above.orders is None or plate.orders is None or above.orders.cycle != plate.orders.cycle:
        return None
    tie = PlateOrders.of(plate.orders, plate.orders.phase)
    number = None if tie is None else tie.number_for(above.orders)
    if number is None:
        return None
    return MeasuredStep(above.orders.phase.astype(float) + 2 * np.pi * number - plate.orders.phase, above.orders.cycle)


def observe_surfaces(
    plate: PlateSurface, strips: StripSurfaces, camera: PlateCamera
) -> tuple[Observations, dict[float, OrderDecision]]:
    """Draw pixels of plate and strips, one surface for each height, and return the order decided for each height."""
    picked = [_picked(np.isfinite(plate.unwrapped_rad), plate.unwrapped_rad)]
    heights = [Estimate(0.0, 0.0, "mm", "plate")]
    orders: dict[float, OrderDecision] = {}
    parts: list[tuple[UncertaintyComponent, ...] | None] = [None]
    found, ordered = strips.found, strips.ordered
    groups = ordered.groups(found)
    for height, labels in groups.items():
        inside = np.isin(found.regions.labels, labels) & np.isfinite(ordered.phase_rad)
        if np.count_nonzero(inside) >= _LEAST_POINTS:
            orders[height] = ordered.decision
            number = max(SURFACE_POINTS // len(groups), _LEAST_OF_A_HEIGHT)
            picked.append(_picked(inside, ordered.phase_rad, number=number))
            one = found.heights_mm[ordered.items[labels[0] - 1]]
            heights.append(replace(one, u=total_u(strips.target, one)))
            parts.append(_parts(strips, picked[-1], camera))
    u, v, phase, cluster = (tuple(column) for column in zip(*picked, strict=True))
    return Observations(u, v, phase, cluster, tuple(heights), parts=tuple(parts)), orders


def _parts(strips: StripSurfaces, picked: "Picked", camera: PlateCamera) -> tuple[UncertaintyComponent, ...] | None:
    """Split the uncertainty of the heights of strips into what it is made of, where more than one u is stated."""
    if not is_split(strips.target):
        return None
    u, v, _, _ = picked
    labels = strips.found.regions.labels[v.astype(int), u.astype(int)]
    rays = camera.rays(u, v)
    items = np.array(strips.ordered.items)[labels - 1]
    return height_parts(strips.target, strips.found.heights_mm, items, rays.ax, rays.ay)


type Picked = tuple[Array, Array, Array, NDArray[np.intp]]


def _picked(inside: NDArray[np.bool_], phase: Array, *, number: int = SURFACE_POINTS) -> Picked:
    u, v, cluster = pick_points(inside, number)
    return u, v, phase[v.astype(int), u.astype(int)], cluster
