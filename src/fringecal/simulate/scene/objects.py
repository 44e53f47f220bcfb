"""Targets as things a ray can hit: every kind of target as a `Scene` in its own frame.

The frame of a target: origin at the centre of its footprint, x across ridges, strips and steps, y along
them. A wall or a face takes part in no other calculation than the tracer's; nothing here is shared with the
code that measures targets.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from fringecal.simulate.scene.printed_patterns import DOTS, LINES, SQUARES, Pattern
from fringecal.simulate.scene.scene import Scene, Solid, plate
from fringecal.targets import Target, board_bits

RIDGE_FACETS = 24  # of a rounded ridge: it leaves the circle by 0.05 % of its radius over a right angle
LINE_WIDTH_SHARE = 0.08  # of the pitch, for grids whose line width is not stated
GRID_SHARE = 0.9  # of the picture that a grid of unstated size fills


def scene_of(target: Target, *, field_mm: tuple[float, float] = (400.0, 400.0)) -> Scene:
    """Build the scene of one target, centred on the plate.

    Parameters
    ----------
    target
        Any target of `fringecal.targets`.
    field_mm
        What the picture shows of the plate along x and y: a line grid without a stated number of
        lines fills 90 % of it.
    """
    if target.kind == "line-grid":
        return Scene(pattern=_line_grid(target, field_mm))
    return BUILDERS[target.kind](target)


def box(x_mm: tuple[float, float], y_mm: tuple[float, float], height_mm: float, *, albedo: float = 1.0) -> Solid:
    """Stand a block on the plate between two x and two y."""
    outline = [(x_mm[0], 0.0), (x_mm[1], 0.0), (x_mm[1], height_mm), (x_mm[0], height_mm)]
    return prism(np.array(outline), y_mm, albedo=albedo)


def prism(outline_mm: np.ndarray, y_mm: tuple[float, float], *, albedo: float = 1.0) -> Solid:
    """Build a prism along y with a convex cross-section.

    Parameters
    ----------
    outline_mm
        Shape (m, 2): corners (x, z) of the section, counter-clockwise as seen from -y (x right, z up).
    """
    outline = np.asarray(outline_mm, float)
    edges = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(*edges.T)[:, None]
    sides = np.column_stack([normals[:, 0], np.zeros(len(edges)), normals[:, 1], np.sum(normals * outline, axis=1)])
    ends = np.array([[0.0, -1.0, 0.0, -y_mm[0]], [0.0, 1.0, 0.0, y_mm[1]]])
    corners = [(x, y, z) for x, z in outline for y in y_mm]
    return Solid(np.vstack([sides, ends]), np.array(corners), albedo)


def rounded_ridge(leg_mm: float, apex_deg: float, radius_mm: float = 0.0) -> np.ndarray:
    """Cross-section (x, z) of one angle bar, its ridge rounded by an arc tangent to both flanks."""
    half = np.radians(apex_deg) / 2
    foot, height = leg_mm * np.sin(half), leg_mm * np.cos(half)
    if radius_mm <= 0:
        return np.array([(-foot, 0.0), (foot, 0.0), (0.0, height)])
    # The arc's centre lies r / sin(half) under the sharp ridge; flank normals stand `half` above x.
    turn = np.linspace(half, np.pi - half, RIDGE_FACETS + 1)
    arc = np.column_stack([radius_mm * np.cos(turn), height - radius_mm / np.sin(half) + radius_mm * np.sin(turn)])
    return np.vstack([[(-foot, 0.0), (foot, 0.0)], arc])


def _halves(length_mm: float) -> tuple[float, float]:
    return -length_mm / 2, length_mm / 2


def _strips(target: Any) -> Scene:
    n = target.count
    widths, heights, lengths = (getattr(target, f"{key}_mm").array(n) for key in ("width", "height", "length"))
    gaps = target.gap_mm.array(n - 1) if target.gap_mm is not None and n > 1 else np.zeros(max(n - 1, 0))
    starts = np.concatenate([[0.0], np.cumsum(widths[:-1] + gaps)])
    starts -= (starts[-1] + widths[-1]) / 2
    rows = zip(starts, widths, lengths, heights, strict=True)
    return Scene(solids=tuple(box((s, s + w), _halves(length), h) for s, w, length, h in rows))


def _zigzag(target: Any) -> Scene:
    leg, apex = target.leg_mm.value, target.apex_deg.value
    radius = target.ridge_radius_mm.value if target.ridge_radius_mm is not None else 0.0
    section = rounded_ridge(leg, apex, radius)
    base = 2 * leg * np.sin(np.radians(apex) / 2)
    centres = (np.arange(target.count) - (target.count - 1) / 2) * base
    ends = _halves(target.length_mm.value)
    return Scene(solids=tuple(prism(section + (x, 0.0), ends) for x in centres))


def _steps(target: Any) -> Scene:
    heights = np.array(target.heights_mm.values)
    edges = np.concatenate([[0.0], np.cumsum(target.width_mm.array(heights.size))])
    edges -= edges[-1] / 2
    ends = _halves(target.length_mm.value)
    return Scene(solids=tuple(box((edges[i], edges[i + 1]), ends, float(h)) for i, h in enumerate(heights)))


def _wedge(target: Any) -> Scene:
    low, high = _halves(target.width_mm.value)
    top = target.width_mm.value * np.tan(np.radians(target.angle_deg.value))
    return Scene(solids=(prism(np.array([(low, 0), (high, 0), (high, top)]), _halves(target.length_mm.value)),))


def _box(target: Any) -> Scene:
    width, length = _halves(target.width_mm.value), _halves(target.length_mm.value)
    return Scene(solids=(box(width, length, target.height_mm.value),))


def _sphere(target: Any) -> Scene:
    radius = target.diameter_mm.value / 2
    return Scene(spheres=((0.0, 0.0, radius, radius, 1.0),))


def _ball_bar(target: Any) -> Scene:
    radii = target.diameters_mm.array(2) / 2
    # Both balls touch the plate, so that balls of different size have centres at different heights.
    half = float(np.sqrt(target.spacing_mm.value**2 - (radii[1] - radii[0]) ** 2)) / 2
    first, second = (float(r) for r in radii)
    return Scene(spheres=((-half, 0.0, first, first, 1.0), (half, 0.0, second, second, 1.0)))


def _flat(target: Any) -> Scene:
    height = target.height_mm.value if target.height_mm is not None else 0.0
    if target.width_mm is None or target.length_mm is None or height == 0:
        return plate().on_flat(height)
    return Scene(solids=(box(_halves(target.width_mm.value), _halves(target.length_mm.value), height),))


def _line_grid(target: Any, field_mm: tuple[float, float]) -> Pattern:
    pitch = target.pitch_mm.value
    width = target.line_width_mm.value if target.line_width_mm is not None else LINE_WIDTH_SHARE * pitch
    heavy = target.heavy_width_mm.value if target.heavy_width_mm is not None else width
    counts = target.lines or tuple(max(2, int(GRID_SHARE * extent / pitch) + 1) for extent in field_mm)
    return Pattern(
        LINES, (counts[0], counts[1]), pitch, width,
        heavy_every=target.heavy_every or 0, heavy_width_mm=heavy, light=target.polarity == "light",
    )  # fmt: skip


def _chessboard(target: Any) -> Scene:
    return Scene(pattern=Pattern(SQUARES, (target.columns + 1, target.rows + 1), target.square_mm.value))


def _charuco(target: Any) -> Scene:
    columns, rows = target.squares
    bits = board_bits(target.dictionary, columns, rows)
    square, marker = target.square_mm.value, target.marker_mm.value
    return Scene(pattern=Pattern(SQUARES, (columns, rows), square, marker, markers=bits))


def _dots(target: Any) -> Scene:
    counts, pitch, diameter = (target.columns, target.rows), target.pitch_mm.value, target.diameter_mm.value
    return Scene(pattern=Pattern(DOTS, counts, pitch, diameter, asymmetric=target.asymmetric))


BUILDERS: dict[str, Callable[[Any], Scene]] = {
    "strips": _strips,
    "zigzag": _zigzag,
    "steps": _steps,
    "wedge": _wedge,
    "box": _box,
    "sphere": _sphere,
    "ball-bar": _ball_bar,
    "flat": _flat,
    "chessboard": _chessboard,
    "charuco": _charuco,
    "dots": _dots,
}
