"""The zig-zag as numbers: cross-section, flanks and edges of angle bars side by side on the plate."""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fringecal.targets import Zigzag, zigzag_base_mm, zigzag_height_mm, zigzag_profile_mm

Floats = NDArray[np.float64]

_STEP = 1e-4  # of leg and apex, over which derivatives of the height are taken: within what is linear, above rounding


class Surface(Protocol):
    """A measured surface: (H, W) maps in mm, NaN where masked; `fringecal.reconstruct.HeightMap` is one."""

    @property
    def x(self) -> NDArray[np.floating]: ...  # noqa: D102
    @property
    def y(self) -> NDArray[np.floating]: ...  # noqa: D102
    @property
    def z(self) -> NDArray[np.floating]: ...  # noqa: D102
    @property
    def u_z(self) -> NDArray[np.floating]: ...  # noqa: D102
    @property
    def mask(self) -> NDArray[np.bool_]: ...  # noqa: D102


@dataclass(frozen=True)
class ZigzagShape:
    """Nominal cross-section of the bars, with the standard uncertainties of leg and apex.

    Legs run from the plate to the sharp ridge; a ridge radius rounds the ridge below that height. `u_instrument_mm` and
    `u_thermal_mm` are what the calibration of the instrument that measured the leg and its temperature add to u of the
    leg: other artefacts may have them in common.

    Examples
    --------
    >>> bars = ZigzagShape(count=4, leg_mm=40.0, apex_deg=90.0, length_mm=300.0)
    >>> round(bars.height_mm, 4), round(bars.base_mm, 4)
    (28.2843, 56.5685)
    """

    count: int
    leg_mm: float
    apex_deg: float
    length_mm: float
    ridge_radius_mm: float = 0.0
    u_leg_mm: float = 0.0
    u_apex_deg: float = 0.0
    u_instrument_mm: float = 0.0
    u_thermal_mm: float = 0.0

    @property
    def half_apex_rad(self) -> float:
        """Half of the apex angle."""
        return math.radians(self.apex_deg) / 2

    @property
    def height_mm(self) -> float:
        """Full height of a bar, rounded ridge included; errors in percent refer to it."""
        return zigzag_height_mm(self.leg_mm, self.apex_deg, ridge_radius_mm=self.ridge_radius_mm)

    @property
    def base_mm(self) -> float:
        """Width of one bar on the plate, ``2 leg sin(apex/2)``; the period of the zig-zag."""
        return zigzag_base_mm(self.leg_mm, self.apex_deg)

    @property
    def slope(self) -> float:
        """Slope of a flank, ``cot(apex/2)``."""
        return 1 / math.tan(self.half_apex_rad)


def zigzag_shape(target: Zigzag) -> ZigzagShape:
    """Take the shape from a zig-zag target.

    Examples
    --------
    >>> from fringecal.targets import load_target
    >>> zigzag_shape(load_target("angle-bars")).leg_mm
    40.0
    """
    radius = target.ridge_radius_mm
    return ZigzagShape(
        count=target.count,
        leg_mm=target.leg_mm.value,
        apex_deg=target.apex_deg.value,
        length_mm=target.length_mm.value,
        ridge_radius_mm=0.0 if radius is None else radius.value,
        u_leg_mm=target.leg_mm.u,
        u_apex_deg=target.apex_deg.u,
        u_instrument_mm=target.instrument_u_mm,
        u_thermal_mm=target.thermal_rel_u * target.leg_mm.value,
    )


def zigzag_height(across_mm: NDArray[np.floating], shape: ZigzagShape) -> Floats:
    """Height of the endless zig-zag at a distance across the bars; 0 is the middle of the row of bars.

    Endless, because the period is found before the ends are; `targets.geometry` has the formula.

    Examples
    --------
    >>> bar = ZigzagShape(count=1, leg_mm=10 * 2**0.5, apex_deg=90.0, length_mm=50.0)
    >>> zigzag_height(np.array([-10.0, -5.0, 0.0, 5.0, 15.0]), bar).round(6).tolist()
    [0.0, 5.0, 10.0, 5.0, 5.0]
    """
    offset = ridge_offset(across_mm, shape)
    return zigzag_profile_mm(offset, 1, shape.leg_mm, shape.apex_deg, ridge_radius_mm=shape.ridge_radius_mm)


def ridge_offset(across_mm: NDArray[np.floating], shape: ZigzagShape) -> Floats:
    """Signed distance from the nearest ridge, mm, within half a base."""
    base = shape.base_mm
    return np.mod(np.asarray(across_mm, float) + shape.count * base / 2, base) - base / 2


def bar_number(across_mm: NDArray[np.floating], shape: ZigzagShape) -> NDArray[np.int64]:
    """Tell the number of the bar at a distance across; below 0 or from `count` on lies beside the bars."""
    return np.floor(np.asarray(across_mm, float) / shape.base_mm + shape.count / 2).astype(np.int64)


def edge_distance(across_mm: NDArray[np.floating], shape: ZigzagShape) -> Floats:
    """Distance to the nearest ridge or valley, mm, measured on the plate."""
    distance = np.abs(ridge_offset(across_mm, shape))
    return np.minimum(distance, shape.base_mm / 2 - distance)


def reference_sensitivities(across_mm: NDArray[np.floating], shape: ZigzagShape) -> Floats:
    """Change of the reference height per standard uncertainty of leg, apex, instrument and temperature, (4, n) mm."""
    by_leg, by_apex = (_by_one(across_mm, shape, name) for name in ("leg_mm", "apex_deg"))
    leg = np.outer((shape.u_leg_mm, shape.u_instrument_mm, shape.u_thermal_mm), by_leg)
    return np.stack([leg[0], by_apex * shape.u_apex_deg, leg[1], leg[2]])


def _by_one(across_mm: NDArray[np.floating], shape: ZigzagShape, name: str) -> Floats:
    """Return the derivative of the reference height by leg or apex, mm per unit."""
    value = getattr(shape, name)
    step = _STEP * value
    upper = zigzag_height(across_mm, replace(shape, **{name: value + step}))
    lower = zigzag_height(across_mm, replace(shape, **{name: value - step}))
    return np.asarray((upper - lower) / (2 * step))
