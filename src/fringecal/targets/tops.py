"""What the light falls on: the planes and balls that make up an artefact's top, in its own frame."""

import math
from dataclasses import dataclass
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from fringecal.targets.geometry import zigzag_base_mm
from fringecal.targets.kinds_of_target import Artefact, BallBar, Box, Flat, Sphere, Steps, Strips, Wedge, Zigzag
from fringecal.targets.target_surface import ball_centres_mm, step_edges_of, strip_edges_of

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PlaneTop:
    """A rectangle in a target's plan that is level or rises along its x; lengths in mm.

    Parameters
    ----------
    low_mm, high_mm
        Its edges across the target; infinite where the target fills the picture.
    half_length_mm
        Half its extent along the target.
    height_mm
        Above the plate, at its middle.
    slope
        Rise per mm across.
    """

    low_mm: float
    high_mm: float
    half_length_mm: float
    height_mm: float
    slope: float = 0.0

    @property
    def middle_mm(self) -> float:
        """Place of the middle across the target; 0 for one without edges."""
        return (self.low_mm + self.high_mm) / 2 if math.isfinite(self.low_mm) else 0.0

    @property
    def heights_mm(self) -> tuple[float, float]:
        """Lowest and highest point."""
        rise = abs(self.slope) * (self.high_mm - self.low_mm) / 2 if self.slope else 0.0
        return self.height_mm - rise, self.height_mm + rise

    def covers(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Tell which points of the target's plan lie under it."""
        return (x >= self.low_mm) & (x <= self.high_mm) & (np.abs(y) <= self.half_length_mm)

    def height(self, x: Floats, y: Floats) -> Floats:
        """Height over points of the plan, edges not minded, mm."""
        return self.height_mm + self.slope * (x - self.middle_mm) + 0 * y

    def met_by(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> Floats:
        """Height at which lines (x + dx z, y + dy z, z) meet it, NaN where they miss it, mm."""
        z = self.height(x, y) / (1 - self.slope * dx)
        return np.where(self.covers(x + dx * z, y + dy * z), z, np.nan)


@dataclass(frozen=True)
class BallTop:
    """The upper half of a ball that touches the plate; its centre's x and its radius in mm."""

    x_mm: float
    radius_mm: float

    @property
    def heights_mm(self) -> tuple[float, float]:
        """Lowest and highest point."""
        return self.radius_mm, 2 * self.radius_mm

    def covers(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Tell which points of the target's plan lie under it."""
        return np.hypot(x - self.x_mm, y) <= self.radius_mm

    def height(self, x: Floats, y: Floats) -> Floats:
        """Height over points of the plan, mm; NaN beside the ball."""
        under = self.radius_mm**2 - (x - self.x_mm) ** 2 - y**2
        return self.radius_mm + np.sqrt(np.where(under >= 0, under, np.nan))

    def met_by(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> Floats:
        """Height at which lines (x + dx z, y + dy z, z) meet it first from above, NaN where they miss it, mm."""
        x = x - self.x_mm
        a, b, c = 1 + dx**2 + dy**2, self.radius_mm - x * dx - y * dy, x**2 + y**2
        under = b**2 - a * c
        return np.where(under >= 0, (b + np.sqrt(np.maximum(under, 0.0))) / a, np.nan)


Top = PlaneTop | BallTop


@singledispatch
def tops_of(target: Artefact) -> tuple[Top, ...]:
    """Return the planes and balls of a target, from low x to high x; none where nothing stands out of the plate.

    A rounded ridge is left sharp.

    Examples
    --------
    >>> from fringecal.targets import load_target
    >>> [top.height_mm for top in tops_of(load_target("step-block"))]
    [5.0, 10.0, 20.0, 30.0, 50.0]
    >>> [round(top.slope, 6) for top in tops_of(load_target("angle-bars"))][:2]
    [1.0, -1.0]
    """
    del target
    return ()


@tops_of.register
def _(target: Steps) -> tuple[Top, ...]:
    half = target.length_mm.value / 2
    pairs = zip(step_edges_of(target), target.heights_mm.values, strict=True)
    return tuple(PlaneTop(float(low), float(high), half, height) for (low, high), height in pairs)


@tops_of.register
def _(target: Strips) -> tuple[Top, ...]:
    heights, lengths = target.height_mm.array(target.count), target.length_mm.array(target.count)
    rows = zip(strip_edges_of(target), lengths, heights, strict=True)
    return tuple(PlaneTop(float(a), float(b), float(length) / 2, float(h)) for (a, b), length, h in rows)


@tops_of.register
def _(target: Box) -> tuple[Top, ...]:
    half = target.width_mm.value / 2
    return (PlaneTop(-half, half, target.length_mm.value / 2, target.height_mm.value),)


@tops_of.register
def _(target: Flat) -> tuple[Top, ...]:
    half = target.width_mm.value / 2 if target.width_mm else math.inf
    along = target.length_mm.value / 2 if target.length_mm else math.inf
    return (PlaneTop(-half, half, along, target.height_mm.value if target.height_mm else 0.0),)


@tops_of.register
def _(target: Wedge) -> tuple[Top, ...]:
    slope, half = math.tan(math.radians(target.angle_deg.value)), target.width_mm.value / 2
    return (PlaneTop(-half, half, target.length_mm.value / 2, slope * half, slope),)


@tops_of.register
def _(target: Zigzag) -> tuple[Top, ...]:
    leg, apex = target.leg_mm.value, target.apex_deg.value
    base, half = zigzag_base_mm(leg, apex), target.length_mm.value / 2
    slope = 1 / math.tan(math.radians(apex) / 2)
    flanks = []
    for bar in range(target.count):
        ridge = (bar + 0.5 - target.count / 2) * base
        flanks.append(PlaneTop(ridge - base / 2, ridge, half, slope * base / 4, slope))
        flanks.append(PlaneTop(ridge, ridge + base / 2, half, slope * base / 4, -slope))
    return tuple(flanks)


@tops_of.register
def _(target: Sphere) -> tuple[Top, ...]:
    return (BallTop(0.0, target.diameter_mm.value / 2),)


@tops_of.register
def _(target: BallBar) -> tuple[Top, ...]:
    return tuple(BallTop(float(x), float(radius)) for x, _, radius in ball_centres_mm(target))
