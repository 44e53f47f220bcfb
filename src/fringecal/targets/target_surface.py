"""The top surface of every kind of target as a height map over the plate."""

import math
from functools import singledispatch

import numpy as np
from numpy.typing import ArrayLike

from fringecal.targets.geometry import Floats, strip_edges_mm, zigzag_base_mm, zigzag_profile_mm
from fringecal.targets.kinds_of_target import (
    Artefact,
    BallBar,
    Box,
    Charuco,
    Chessboard,
    Dots,
    Flat,
    LineGrid,
    Sphere,
    Steps,
    Strips,
    Wedge,
    Zigzag,
)


def surface_mm(target: Artefact, x_mm: ArrayLike, y_mm: ArrayLike) -> Floats:
    """Height of a target's top above the plate at points of its own frame; 0 beside it.

    Upright faces belong to the higher side. Of a sphere it is the upper half.

    Parameters
    ----------
    target
        Any kind; printed patterns are flat.
    x_mm, y_mm
        Positions in the target's frame (see `fringecal.targets.geometry`), mm, shapes that broadcast;
        NaN gives NaN.

    Returns
    -------
    z in mm, the broadcast shape.

    Examples
    --------
    >>> from fringecal.targets import load_target
    >>> surface_mm(load_target("glass-strips"), [-5.0, 0.0, 5.0, 10.0], 0.0).tolist()
    [3.0, 0.0, 3.0, 3.0]
    """
    x, y = np.broadcast_arrays(np.asarray(x_mm, float), np.asarray(y_mm, float))
    return np.where(np.isnan(x) | np.isnan(y), np.nan, _surface(target, x, y))


def footprint_mm(target: Artefact) -> tuple[float, float]:
    """Extent of a target in x and y, mm, as it lies on the plate; infinite where the file gives no size.

    Examples
    --------
    >>> from fringecal.targets import load_target
    >>> footprint_mm(load_target("glass-strips"))
    (230.0, 400.0)
    """
    return _footprint(target)


def strip_edges_of(target: Strips) -> Floats:
    """Low and high edge of each strip of a target, mm, shape (count, 2)."""
    gaps = target.gap_mm.array(target.count - 1) if target.gap_mm and target.count > 1 else np.zeros(0)
    return strip_edges_mm(target.width_mm.array(target.count), gaps)


def step_edges_of(target: Steps) -> Floats:
    """Low and high edge of each step of a block, mm, shape (steps, 2)."""
    count = len(target.heights_mm.values)
    return strip_edges_mm(target.width_mm.array(count), np.zeros(count - 1))


@singledispatch
def _surface(target: Artefact, x: Floats, y: Floats) -> Floats:  # noqa: ARG001  # y is for the other kinds
    raise NotImplementedError(f"no surface is known for {type(target).__name__}")


@_surface.register(LineGrid | Chessboard | Charuco | Dots)
def _(target: Artefact, x: Floats, y: Floats) -> Floats:  # noqa: ARG001
    return np.zeros(x.shape)


@_surface.register
def _(target: Flat, x: Floats, y: Floats) -> Floats:
    height = target.height_mm.value if target.height_mm else 0.0
    return np.where(_inside(x, y, *_footprint(target)), height, 0.0)


@_surface.register
def _(target: Strips, x: Floats, y: Floats) -> Floats:
    z = np.zeros(x.shape)
    lengths, heights = target.length_mm.array(target.count), target.height_mm.array(target.count)
    for (low, high), length, height in zip(strip_edges_of(target), lengths, heights, strict=True):
        z[(low <= x) & (x <= high) & (np.abs(y) <= length / 2)] = height
    return z


@_surface.register
def _(target: Steps, x: Floats, y: Floats) -> Floats:
    z = np.zeros(x.shape)
    for (low, high), height in zip(step_edges_of(target), target.heights_mm.values, strict=True):
        here = (low <= x) & (x <= high) & (np.abs(y) <= target.length_mm.value / 2)
        z[here] = np.maximum(z[here], height)
    return z


@_surface.register
def _(target: Zigzag, x: Floats, y: Floats) -> Floats:
    radius = target.ridge_radius_mm.value if target.ridge_radius_mm else 0.0
    z = zigzag_profile_mm(x, target.count, target.leg_mm.value, target.apex_deg.value, ridge_radius_mm=radius)
    return np.where(np.abs(y) <= target.length_mm.value / 2, z, 0.0)


@_surface.register
def _(target: Wedge, x: Floats, y: Floats) -> Floats:
    rise = (x + target.width_mm.value / 2) * math.tan(math.radians(target.angle_deg.value))
    return np.where(_inside(x, y, *_footprint(target)), rise, 0.0)


@_surface.register
def _(target: Box, x: Floats, y: Floats) -> Floats:
    return np.where(_inside(x, y, *_footprint(target)), target.height_mm.value, 0.0)


@_surface.register
def _(target: Sphere, x: Floats, y: Floats) -> Floats:
    return _ball(x, y, target.diameter_mm.value / 2)


@_surface.register
def _(target: BallBar, x: Floats, y: Floats) -> Floats:
    left, right = target.diameters_mm.array(2) / 2
    low, high = ball_centres_mm(target)[:, 0]
    return np.maximum(_ball(x - low, y, left), _ball(x - high, y, right))


def ball_centres_mm(target: BallBar) -> Floats:
    """Centres of the two balls that touch the plate, mm, shape (2, 3); the footprint is centred on x = 0."""
    radii = target.diameters_mm.array(2) / 2
    apart_x = math.sqrt(target.spacing_mm.value**2 - (radii[1] - radii[0]) ** 2)
    low = -(apart_x + radii[1] - radii[0]) / 2
    return np.array([[low, 0.0, radii[0]], [low + apart_x, 0.0, radii[1]]])


def _inside(x: Floats, y: Floats, width: float, length: float) -> np.ndarray:
    return (np.abs(x) <= width / 2) & (np.abs(y) <= length / 2)


def _ball(x: Floats, y: Floats, radius: float) -> Floats:
    under = radius**2 - x**2 - y**2
    return np.where(under >= 0, radius + np.sqrt(np.maximum(under, 0.0)), 0.0)


@singledispatch
def _footprint(target: Artefact) -> tuple[float, float]:
    raise NotImplementedError(f"no footprint is known for {type(target).__name__}")


@_footprint.register
def _(target: LineGrid) -> tuple[float, float]:
    if target.lines is None:
        return math.inf, math.inf
    return (target.lines[0] - 1) * target.pitch_mm.value, (target.lines[1] - 1) * target.pitch_mm.value


@_footprint.register
def _(target: Chessboard) -> tuple[float, float]:
    return (target.columns + 1) * target.square_mm.value, (target.rows + 1) * target.square_mm.value


@_footprint.register
def _(target: Charuco) -> tuple[float, float]:
    return target.squares[0] * target.square_mm.value, target.squares[1] * target.square_mm.value


@_footprint.register
def _(target: Dots) -> tuple[float, float]:
    across = 2 * target.columns - 1 if target.asymmetric else target.columns - 1
    pitch, diameter = target.pitch_mm.value, target.diameter_mm.value
    return across * pitch + diameter, (target.rows - 1) * pitch + diameter


@_footprint.register
def _(target: Flat) -> tuple[float, float]:
    width = target.width_mm.value if target.width_mm else math.inf
    return width, target.length_mm.value if target.length_mm else math.inf


@_footprint.register
def _(target: Strips) -> tuple[float, float]:
    edges = strip_edges_of(target)
    return float(edges[-1, 1] - edges[0, 0]), max(target.length_mm.values)


@_footprint.register
def _(target: Steps) -> tuple[float, float]:
    edges = step_edges_of(target)
    return float(edges[-1, 1] - edges[0, 0]), target.length_mm.value


@_footprint.register
def _(target: Zigzag) -> tuple[float, float]:
    return target.count * zigzag_base_mm(target.leg_mm.value, target.apex_deg.value), target.length_mm.value


@_footprint.register(Wedge | Box)
def _(target: Wedge | Box) -> tuple[float, float]:
    return target.width_mm.value, target.length_mm.value


@_footprint.register
def _(target: Sphere) -> tuple[float, float]:
    return target.diameter_mm.value, target.diameter_mm.value


@_footprint.register
def _(target: BallBar) -> tuple[float, float]:
    radii = target.diameters_mm.array(2) / 2
    centres = ball_centres_mm(target)
    return float(centres[1, 0] - centres[0, 0] + radii.sum()), float(2 * radii.max())
