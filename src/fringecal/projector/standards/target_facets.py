"""Artefacts as rectangles of known height: what of a target a joint fit can use."""

import math
from dataclasses import dataclass, replace
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from fringecal.targets import Box, Flat, Steps, Target, Wedge, step_edges_of
from fringecal.uncertainty import Estimate, Influence

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Facet:
    """A rectangle on top of an artefact, in the target's own frame (`targets.geometry`), mm.

    Parameters
    ----------
    low_mm, high_mm
        Its edges across the artefact; infinite where the artefact fills the picture.
    half_length_mm
        Half its extent along the artefact.
    height
        Height above the plate at its middle.
    slope
        Rise per mm across; `u_slope` its standard uncertainty. A slope pivots on the low edge.
    """

    low_mm: float
    high_mm: float
    half_length_mm: float
    height: Estimate
    slope: float = 0.0
    u_slope: float = 0.0

    @property
    def middle_mm(self) -> float:
        """Place of the middle across the artefact; 0 for one without edges."""
        return (self.low_mm + self.high_mm) / 2 if math.isfinite(self.low_mm) else 0.0

    def slices(self, most_rise_mm: float) -> tuple["Facet", ...]:
        """Cut a sloping facet into level ones, none of which hides more than so much rise."""
        number = max(1, math.ceil(abs(self.slope) * (self.high_mm - self.low_mm) / most_rise_mm)) if self.slope else 1
        edges = np.linspace(self.low_mm, self.high_mm, number + 1) if self.slope else (self.low_mm, self.high_mm)
        return tuple(self._slice(float(a), float(b)) for a, b in zip(edges[:-1], edges[1:], strict=True))

    def _slice(self, low: float, high: float) -> "Facet":
        rise = self.slope * ((low + high) / 2 - self.middle_mm) if self.slope else 0.0
        height = replace(self.height, value=self.height.value + rise)
        return Facet(low, high, self.half_length_mm, height)


@singledispatch
def facets_of(target: Target) -> tuple[Facet, ...]:
    """Return the rectangles of known height on top of a target; none where it has none.

    Examples
    --------
    >>> from fringecal.targets import load_target
    >>> [(f.low_mm, f.high_mm, f.height.value) for f in facets_of(load_target("step-block"))][:2]
    [(-75.0, -45.0, 5.0), (-45.0, -15.0, 10.0)]
    """
    del target
    return ()


@facets_of.register
def _(target: Steps) -> tuple[Facet, ...]:
    half = target.length_mm.value / 2
    return tuple(
        Facet(float(low), float(high), half, target.heights_mm.estimate(Influence.STEP_HEIGHT, "mm", item=i))
        for i, (low, high) in enumerate(step_edges_of(target))
    )


@facets_of.register
def _(target: Box) -> tuple[Facet, ...]:
    half = target.width_mm.value / 2
    return (Facet(-half, half, target.length_mm.value / 2, target.height_mm.estimate(Influence.BOX_HEIGHT, "mm")),)


@facets_of.register
def _(target: Flat) -> tuple[Facet, ...]:
    """Give a raised plate; what it may be off flat adds to the uncertainty of its height."""
    if target.height_mm is None:
        return ()
    stated = target.height_mm.estimate(Influence.FLAT_HEIGHT, "mm")
    flat = target.flatness_mm
    u = math.hypot(stated.u, flat.us[0], flat.value / math.sqrt(3))
    half = target.width_mm.value / 2 if target.width_mm else math.inf
    along = target.length_mm.value / 2 if target.length_mm else math.inf
    return (Facet(-half, half, along, replace(stated, u=u)),)


@facets_of.register
def _(target: Wedge) -> tuple[Facet, ...]:
    angle, half = math.radians(target.angle_deg.value), target.width_mm.value / 2
    slope, u_slope = math.tan(angle), math.radians(target.angle_deg.us[0]) / math.cos(angle) ** 2
    height = Estimate(slope * half, 0.0, "mm", "wedge height")
    return (Facet(-half, half, target.length_mm.value / 2, height, slope, u_slope),)
