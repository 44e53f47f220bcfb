"""What the heights of strips hang on: each strip's own errors, and what all strips of a set have in common."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fringecal.targets import Strips
from fringecal.uncertainty import Estimate, Influence, UncertaintyComponent

Array = NDArray[np.float64]

_RECTANGULAR = 1 / math.sqrt(3)  # standard deviation of what lies anywhere within a half width of 1 (GUM 4.3.7)


def seen_heights(target: Strips) -> tuple[Estimate, ...]:
    """Return the height at which each strip is seen: as certified, with paint and gap, less the depth of its light."""
    stated = (target.height_mm.estimate(Influence.STRIP_HEIGHT, "mm", item=i) for i in range(target.count))
    return tuple(replace(one, value=one.value + target.added_mm) for one in stated)


def is_split(target: Strips) -> bool:
    """Whether more is stated of a set than one common standard uncertainty of its heights."""
    more = (target.paint_mm, target.seating_mm, target.depth_mm, target.parallelism_mm)
    return bool(target.instrument_u_mm or target.thermal_rel_u) or any(one is not None for one in more)


def height_parts(
    target: Strips, heights: Sequence[Estimate], item: NDArray[np.intp], x_mm: Array, y_mm: Array
) -> tuple[UncertaintyComponent, ...]:
    """Return the components of the heights of strips, each with its effect on every pixel, mm.

    Parameters
    ----------
    target
        What is stated of the set.
    heights
        The height that each strip counts as, with the u that is its own, or the set's where no instrument is stated.
    item, x_mm, y_mm
        Which strip each pixel lies on, and where, (n,).
    """
    return (*_common(target, heights, item), *_own(target, heights, item, x_mm, y_mm))


def total_u(target: Strips, height: Estimate) -> float:
    """Return the standard uncertainty of one strip's height, all that is stated of it together, mm."""
    parts = (u for _, u, _ in _constants(target, height.value))
    seating = 0.0 if target.seating_mm is None else target.seating_mm.us[0]
    return math.hypot(height.u, seating, *parts)


type Constant = tuple[Influence, float, float]


def _constants(target: Strips, height_mm: float) -> Iterator[Constant]:
    """Influence, standard uncertainty in mm and degrees of freedom of what all strips of a set have in common."""
    yield Influence.INSTRUMENT, target.instrument_u_mm, math.inf
    yield Influence.TEMPERATURE, target.thermal_rel_u * height_mm, math.inf
    added = ((Influence.STRIP_PAINT, target.paint_mm), (Influence.TRANSLUCENCY, target.depth_mm))
    for influence, stated in added:
        if stated is not None:
            yield influence, stated.us[0], stated.dof


def _common(target: Strips, heights: Sequence[Estimate], item: NDArray[np.intp]) -> Iterator[UncertaintyComponent]:
    height = float(np.mean([heights[k].value for k in np.unique(item)]))
    for influence, u_mm, dof in _constants(target, height):
        if u_mm > 0:
            detail = (target.instrument or target.name) if influence is Influence.INSTRUMENT else ""
            yield UncertaintyComponent(influence, np.full(item.size, u_mm), dof, detail)
    if not target.instrument_u_mm:
        u = np.array([one.u for one in heights])[item]
        yield UncertaintyComponent(Influence.STRIP_HEIGHT, u, heights[0].dof)


def _own(
    target: Strips, heights: Sequence[Estimate], item: NDArray[np.intp], x_mm: Array, y_mm: Array
) -> Iterator[UncertaintyComponent]:
    seating, parallel = target.seating_mm, target.parallelism_mm
    for k in np.unique(item):
        on = item == k
        if target.instrument_u_mm:
            yield UncertaintyComponent(Influence.STRIP_HEIGHT, np.where(on, heights[k].u, 0.0), heights[k].dof)
        if seating is not None:
            yield UncertaintyComponent(Influence.STRIP_SEATING, np.where(on, seating.us[0], 0.0), seating.dof)
        if parallel is not None:
            half = math.hypot(parallel.value, parallel.us[0]) / 2 * _RECTANGULAR
            ends = target.length_mm.array(target.count)[k] / 2
            effect = np.zeros(item.size)
            effect[on] = half * np.clip(_along(x_mm[on], y_mm[on]) / ends, -1, 1)
            yield UncertaintyComponent(Influence.STRIP_PARALLELISM, effect, parallel.dof)


def _along(x_mm: Array, y_mm: Array) -> Array:
    """Distance of each pixel of a strip from its middle along it, mm."""
    points = np.column_stack([x_mm - x_mm.mean(), y_mm - y_mm.mean()])
    return np.asarray(points @ np.linalg.eigh(points.T @ points)[1][:, 1])
