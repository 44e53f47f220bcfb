"""Where a target's points, edges and flanks lie: closed forms in mm in the target's own frame.

The frame: origin at the centre of the footprint, x across strips, ridges and steps, y along them, z up from
the plate. Printed patterns lie in z = 0 with x to the right and y up; their columns are counted to the right
and their rows downward, as they are in a picture.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.targets.kinds_of_target import Zigzag
from fringecal.uncertainty import Estimate

type Floats = NDArray[np.float64]


def grid_points_mm(column: ArrayLike, row: ArrayLike, pitch_mm: float) -> tuple[Floats, Floats]:
    """Place the crossings of a line grid by their integer indices, crossing (0, 0) in the origin.

    Parameters
    ----------
    column, row
        Indices of any one shape; columns count to the right, rows downward.
    pitch_mm
        Distance of neighbouring lines, mm.

    Returns
    -------
    x, y
        mm; `x = column pitch`, `y = -row pitch` because y points up.

    Examples
    --------
    >>> x, y = grid_points_mm([0, 2], [0, 1], 10.0)
    >>> x.tolist(), y.tolist()
    ([0.0, 20.0], [0.0, -10.0])
    """
    return pitch_mm * np.asarray(column, float), 0.0 - pitch_mm * np.asarray(row, float)


def board_points_mm(columns: int, rows: int, spacing_mm: float) -> Floats:
    """Place the inner corners of a chessboard or ChArUco, or symmetric dots: row by row from the top left.

    Parameters
    ----------
    columns, rows
        Points in a row and rows of points. A ChArUco of n x m squares has (n - 1) x (m - 1) corners, and
        corner number `id` of OpenCV is element `id` here.
    spacing_mm
        Distance of neighbouring points, mm.

    Returns
    -------
    Points in mm, shape (rows * columns, 3), z = 0, origin at their centre.

    Examples
    --------
    >>> board_points_mm(2, 2, 10.0).tolist()
    [[-5.0, 5.0, 0.0], [5.0, 5.0, 0.0], [-5.0, -5.0, 0.0], [5.0, -5.0, 0.0]]
    """
    row, column = np.mgrid[:rows, :columns]
    return _centred(spacing_mm * column, -spacing_mm * row)


def asymmetric_dots_mm(columns: int, rows: int, pitch_mm: float) -> Floats:
    """Place asymmetric dots: rows one pitch apart, dots in a row two, every second row moved by one pitch.

    The order and the spacing are those of OpenCV's asymmetric circles grid.

    Examples
    --------
    >>> asymmetric_dots_mm(2, 2, 10.0).tolist()
    [[-15.0, 5.0, 0.0], [5.0, 5.0, 0.0], [-5.0, -5.0, 0.0], [15.0, -5.0, 0.0]]
    """
    row, column = np.mgrid[:rows, :columns]
    return _centred(pitch_mm * (2 * column + row % 2), -pitch_mm * row)


def _centred(x: NDArray[np.floating], y: NDArray[np.floating]) -> Floats:
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    middle: Floats = (points.min(axis=0) + points.max(axis=0)) / 2
    return points - middle


def strip_edges_mm(width_mm: ArrayLike, gap_mm: ArrayLike) -> Floats:
    """Place the edges of strips that lie side by side, the whole row centred on x = 0.

    Parameters
    ----------
    width_mm
        Width of each strip from low x to high x, mm, shape (count,).
    gap_mm
        Free plate between neighbours, mm, shape (count - 1,).

    Returns
    -------
    Low and high edge of each strip, mm, shape (count, 2); the centres are ``edges.mean(axis=1)``.

    Examples
    --------
    >>> strip_edges_mm([10, 10], [10]).tolist()
    [[-15.0, -5.0], [5.0, 15.0]]
    """
    width = np.asarray(width_mm, float)
    low = np.concatenate([[0.0], np.cumsum(width[:-1] + np.asarray(gap_mm, float))])
    total = low[-1] + width[-1]
    return np.stack([low, low + width], axis=1) - total / 2


def zigzag_base_mm(leg_mm: float, apex_deg: float) -> float:
    """Width of one bar on the plate and distance of its ridge to the next: `2 leg sin(apex / 2)`.

    Examples
    --------
    >>> round(zigzag_base_mm(40.0, 90.0), 3)
    56.569
    """
    return 2 * leg_mm * math.sin(math.radians(apex_deg) / 2)


def zigzag_height_mm(leg_mm: float, apex_deg: float, *, ridge_radius_mm: float = 0.0) -> float:
    """Full height of a bar above the plate: `leg cos(apex / 2) - r (1 / sin(apex / 2) - 1)`.

    The rounding of the ridge with radius r takes the second term from the sharp bar.

    Examples
    --------
    >>> round(zigzag_height_mm(40.0, 90.0), 3)
    28.284
    """
    half = math.radians(apex_deg) / 2
    return leg_mm * math.cos(half) - ridge_radius_mm * (1 / math.sin(half) - 1)


def zigzag_feet_mm(count: int, leg_mm: float, apex_deg: float) -> Floats:
    """Where flanks meet the plate: outer foot, `count - 1` valleys, outer foot; mm, rising."""
    return zigzag_base_mm(leg_mm, apex_deg) * np.arange(-count / 2, count / 2 + 0.5)


def zigzag_ridges_mm(count: int, leg_mm: float, apex_deg: float) -> Floats:
    """Where the ridges stand, mm, rising, shape (count,)."""
    return zigzag_base_mm(leg_mm, apex_deg) * np.arange(-(count - 1) / 2, count / 2)


def zigzag_profile_mm(
    x_mm: ArrayLike, count: int, leg_mm: float, apex_deg: float, *, ridge_radius_mm: float = 0.0
) -> Floats:
    """Height of the zig-zag over the plate along x.

    With t the distance to the nearest ridge and a the half angle, a flank is `z = leg cos(a) - t / tan(a)`;
    within `t <= r cos(a)` the ridge is the circle of radius r tangent to both. Beyond the outer feet z = 0.

    Parameters
    ----------
    x_mm
        Positions across the ridges, mm, any shape.
    count, leg_mm, apex_deg
        Number of bars, length of a leg in mm, angle between the legs in degrees.
    ridge_radius_mm
        Radius of the ridges, mm; 0 is sharp.

    Returns
    -------
    z in mm, shape of `x_mm`.

    Examples
    --------
    >>> zigzag_profile_mm([-56.6, 0.0, 28.284, 56.6], 1, 40.0, 90.0).round(2).tolist()
    [0.0, 28.28, 0.0, 0.0]
    """
    half = math.radians(apex_deg) / 2
    t = np.abs(_from_nearest_ridge_mm(x_mm, count, leg_mm, apex_deg))
    z = leg_mm * math.cos(half) - t / math.tan(half)
    if ridge_radius_mm > 0:
        centre = leg_mm * math.cos(half) - ridge_radius_mm / math.sin(half)
        round_top = centre + np.sqrt(np.maximum(ridge_radius_mm**2 - t**2, 0.0))
        z = np.where(t <= ridge_radius_mm * math.cos(half), round_top, z)
    return np.maximum(z, 0.0)


def zigzag_edge_distance_mm(x_mm: ArrayLike, count: int, leg_mm: float, apex_deg: float) -> Floats:
    """Distance in x to the nearest ridge, valley or outer foot, mm: what keeps edge zones apart from flanks.

    Examples
    --------
    >>> zigzag_edge_distance_mm([0.0, 1.0, 25.0], 1, 40.0, 90.0).round(3).tolist()
    [0.0, 1.0, 3.284]
    """
    x = np.asarray(x_mm, float)
    edges = np.concatenate([zigzag_feet_mm(count, leg_mm, apex_deg), zigzag_ridges_mm(count, leg_mm, apex_deg)])
    return np.min(np.abs(x[..., None] - edges), axis=-1)


def _from_nearest_ridge_mm(x_mm: ArrayLike, count: int, leg_mm: float, apex_deg: float) -> Floats:
    base = zigzag_base_mm(leg_mm, apex_deg)
    x = np.asarray(x_mm, float)
    bar = np.clip(np.round(x / base + (count - 1) / 2), 0, count - 1)
    return x - base * (bar - (count - 1) / 2)


def zigzag_height(target: Zigzag) -> Estimate:
    """Full height of a zig-zag target with its standard uncertainty, to first order (JCGM 100:2008, 5.1.2).

    Examples
    --------
    >>> from fringecal.targets import load_target
    >>> print(zigzag_height(load_target("angle-bars")))
    full height = 28.284 mm, u = 0.019 mm, dof inf
    """
    leg, half = target.leg_mm.value, math.radians(target.apex_deg.value) / 2
    radius, u_radius = (target.ridge_radius_mm.value, target.ridge_radius_mm.u) if target.ridge_radius_mm else (0, 0)
    parts = (
        math.cos(half) * target.leg_mm.u,
        (-leg * math.sin(half) + radius * math.cos(half) / math.sin(half) ** 2) * math.radians(target.apex_deg.u) / 2,
        (1 / math.sin(half) - 1) * u_radius,
    )
    value = zigzag_height_mm(leg, target.apex_deg.value, ridge_radius_mm=radius)
    return Estimate(value, math.hypot(*parts), unit="mm", label="full height")
