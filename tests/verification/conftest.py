"""Zig-zag surfaces in closed form: known pose, known error, seen straight down on a pixel raster."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from fringecal.targets.kinds_of_target import Zigzag


@dataclass(frozen=True)
class Scene:
    """Stands in for a height map, and keeps what was put in."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    u_z: np.ndarray
    mask: np.ndarray
    truth: np.ndarray  # height without error
    on_bars: np.ndarray


def bars(count=4, leg=40.0, apex=90.0, length=240.0, u_leg=0.0, u_apex=0.0, radius=None) -> Zigzag:
    numbers = {"leg_mm": (leg, u_leg), "apex_deg": (apex, u_apex), "length_mm": (length, 0.0)}
    if radius is not None:
        numbers["ridge_radius_mm"] = (radius, 0.0)
    quantities = {key: {"value": value, "u": u} for key, (value, u) in numbers.items()}
    return Zigzag(name="bars", certificate="closed form", count=count, **quantities)


def scene(
    *,
    count=4,
    leg=40.0,
    apex_deg=90.0,
    length=240.0,
    rotation_deg=0.0,
    centre=(0.0, 0.0),
    size=(440, 480),
    scale_mm=0.734,
    error: Callable | None = None,
    noise=0.0,
    outliers=0.0,
    seed=1,
) -> Scene:
    """Triangles by the distance to the nearest of `count` ridges, written down apart from the package."""
    rng = np.random.default_rng(seed)
    height, width = size
    v, u = np.mgrid[:height, :width]
    x, y = (u - (width - 1) / 2) * scale_mm, ((height - 1) / 2 - v) * scale_mm
    c, s = math.cos(math.radians(rotation_deg)), math.sin(math.radians(rotation_deg))
    across = c * (x - centre[0]) + s * (y - centre[1])
    along = c * (y - centre[1]) - s * (x - centre[0])
    half = math.radians(apex_deg) / 2
    base = 2 * leg * math.sin(half)
    ridges = [(i - (count - 1) / 2) * base for i in range(count)]
    top = leg * math.cos(half)
    truth = np.max([top - np.abs(across - r) / math.tan(half) for r in ridges], axis=0)
    on_bars = (truth > 0) & (np.abs(along) < length / 2)
    truth = np.where(on_bars, truth, 0.0)
    z = truth.copy() if error is None else truth + np.where(on_bars, error(x, y, truth), 0.0)
    z = z + rng.normal(0, noise, z.shape) if noise else z
    if outliers:
        wrong = rng.random(z.shape) < outliers
        z = z + np.where(wrong, rng.choice([-6.5, 6.5], z.shape), 0.0)  # one fringe of 8 mm at 50.7 deg
    u_z = np.full(z.shape, 0.05)
    return Scene(x, y, z, u_z, np.ones(z.shape, bool), truth, on_bars)


@pytest.fixture(scope="session")
def make_scene():
    return scene


@pytest.fixture(scope="session")
def make_bars():
    return bars
