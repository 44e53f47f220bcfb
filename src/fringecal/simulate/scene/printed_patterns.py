"""Printed patterns on a flat: how much of a small spot is ink, and how far the nearest edge is."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from fringecal.simulate.tracing.compiled import compiled

PLAIN, LINES, SQUARES, DOTS = range(4)
FAR_MM = 1e9  # from any ink, where there is none
PAPER, INK = 1.0, 0.08  # reflectance against the white plate


@dataclass(frozen=True)
class Pattern:
    """A pattern centred on its own frame and placed on the flat; lengths in mm.

    Parameters
    ----------
    kind
        PLAIN, LINES, SQUARES or DOTS.
    counts
        Lines, squares or dots along x and along y.
    pitch_mm, width_mm
        Their spacing; width of a line, diameter of a dot or side of a marker.
    heavy_every, heavy_width_mm
        Every so many lines one of another width, counted from the first; 0 for none.
    asymmetric
        Every second row of dots is moved by one pitch, dots are two pitches apart within rows.
    markers
        Shape (rows, columns, n, n), row 0 at the top: the black bits of the markers in light squares.
    light
        Light lines on dark paper rather than dark on light.
    specks
        Shape (m, 3): x, y and radius of dirt, in the pattern's frame.
    place
        x and y of its middle on the flat, mm, and its turn, rad.
    stretch
        By how much its lengths along x are longer, relative; widths along x to the same order.
    """

    kind: int
    counts: tuple[int, int] = (0, 0)
    pitch_mm: float = 1.0
    width_mm: float = 0.0
    heavy_every: int = 0
    heavy_width_mm: float = 0.0
    asymmetric: bool = False
    markers: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 0, 0), bool))
    light: bool = False
    specks: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stretch: float = 0.0

    def placed(self, x_mm: float, y_mm: float, angle_rad: float) -> "Pattern":
        """Turn the pattern about the plate's normal, then move it."""
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        x, y, old = self.place
        return replace(self, place=(c * x - s * y + x_mm, s * x + c * y + y_mm, old + angle_rad))


BLANK = Pattern(PLAIN)


class PatternTable(NamedTuple):
    """A pattern ready for tracing."""

    kind: int
    nx: int
    ny: int
    pitch: float
    width: float
    heavy_every: int
    heavy_width: float
    asymmetric: bool
    markers: np.ndarray
    paper: float
    ink: float
    specks: np.ndarray
    cos: float
    sin: float
    x0: float
    y0: float
    along_x: float


def pattern_table(pattern: Pattern) -> PatternTable:
    """Tabulate a pattern for the kernels."""
    paper, ink = (INK, PAPER) if pattern.light else (PAPER, INK)
    x0, y0, angle = pattern.place
    return PatternTable(
        pattern.kind, *pattern.counts, pattern.pitch_mm, pattern.width_mm,
        pattern.heavy_every, pattern.heavy_width_mm, pattern.asymmetric,
        np.ascontiguousarray(pattern.markers, bool), paper, ink,
        np.ascontiguousarray(pattern.specks, float), float(np.cos(angle)), float(np.sin(angle)), x0, y0,
        1 + pattern.stretch,
    )  # fmt: skip


@compiled
def ink_share(table: PatternTable, x: float, y: float, soft_mm: float) -> float:
    """Reflectance of a spot of width `soft_mm`: paper and ink mixed by the share each has of the spot."""
    depth, _ = _signed_depth(table, x, y, soft_mm)
    share = min(1.0, max(0.0, 0.5 + depth / soft_mm))
    return table.paper + (table.ink - table.paper) * share


@compiled
def edge_distance(table: PatternTable, x: float, y: float) -> float:
    """Distance in mm, or a lower bound of it, from a point of the flat to the nearest edge of ink."""
    return _signed_depth(table, x, y, 0.0)[1]


@compiled
def _signed_depth(table: PatternTable, x: float, y: float, soft_mm: float) -> tuple[float, float]:
    """Depth inside the ink (negative outside), and the distance to the nearest edge of any kind.

    The depth counts for a spot of width `soft_mm`: a line that is thinner never fills it.
    """
    if table.kind == PLAIN and table.specks.shape[0] == 0:
        return -FAR_MM, FAR_MM
    dx, dy = x - table.x0, y - table.y0
    px, py = (table.cos * dx + table.sin * dy) / table.along_x, -table.sin * dx + table.cos * dy
    depth, edge = -FAR_MM, FAR_MM
    if table.kind == LINES:
        depth, edge = _lines(table, px, py, soft_mm)
    elif table.kind == SQUARES:
        depth, edge = _board(table, px, py)
    elif table.kind == DOTS:
        depth, edge = _dots(table, px, py)
    for k in range(table.specks.shape[0]):
        inside = table.specks[k, 2] - np.hypot(px - table.specks[k, 0], py - table.specks[k, 1])
        depth, edge = max(depth, inside), min(edge, abs(inside))
    return depth, edge


@compiled
def _line_depth(
    table: PatternTable, across: float, along: float, n: int, reach: float, soft_mm: float
) -> tuple[float, float]:
    """Depth inside the nearest of `n` parallel lines of half length `reach`, for a spot and for a point.

    A line of width w covers at most w / soft of the spot, which is the share that a depth of w - soft / 2 stands for.
    """
    first = -0.5 * (n - 1) * table.pitch
    i = min(n - 1, max(0, int(np.floor((across - first) / table.pitch + 0.5))))
    width = table.heavy_width if table.heavy_every > 0 and i % table.heavy_every == 0 else table.width
    depth = min(0.5 * width - abs(across - first - i * table.pitch), reach - abs(along))
    return min(depth, width - 0.5 * soft_mm), depth


@compiled
def _lines(table: PatternTable, x: float, y: float, soft_mm: float) -> tuple[float, float]:
    # Lines end flush with the outer edge of the outermost crossing lines.
    reach_x = 0.5 * ((table.nx - 1) * table.pitch + table.width)
    reach_y = 0.5 * ((table.ny - 1) * table.pitch + table.width)
    vertical, to_vertical = _line_depth(table, x, y, table.nx, reach_y, soft_mm)
    horizontal, to_horizontal = _line_depth(table, y, x, table.ny, reach_x, soft_mm)
    return max(vertical, horizontal), min(abs(to_vertical), abs(to_horizontal))


@compiled
def _board(table: PatternTable, x: float, y: float) -> tuple[float, float]:
    """Dark and light squares, and markers in the light ones."""
    # Counted from the top left, where boards begin with a dark square.
    cx, cy = 0.5 * table.nx + x / table.pitch, 0.5 * table.ny - y / table.pitch
    depth, edge = _squares(table, cx, cy)
    i, j = int(np.floor(cx)), int(np.floor(cy))
    if table.markers.size > 0 and 0 <= i < table.nx and 0 <= j < table.ny and (i + j) % 2 == 1:
        n = table.markers.shape[3]
        bit = table.width / n
        to_bits = table.pitch / bit
        inside = bit * _marker_depth(
            table.markers[j, i], 0.5 * n + (cx - i - 0.5) * to_bits, 0.5 * n + (cy - j - 0.5) * to_bits
        )
        depth, edge = max(depth, inside), min(edge, abs(inside))
    return depth, edge


@compiled
def _marker_depth(bits: np.ndarray, x: float, y: float) -> float:
    """Depth in black bits (negative in white ones), in bits and at most 1, from the marker's top left corner."""
    column, row = int(np.floor(x)), int(np.floor(y))
    black = _is_black(bits, column, row)
    nearest = 1.0
    for i in range(column - 1, column + 2):
        for j in range(row - 1, row + 2):
            if _is_black(bits, i, j) != black:
                away_x, away_y = max(0.0, i - x, x - i - 1), max(0.0, j - y, y - j - 1)
                nearest = min(nearest, np.hypot(away_x, away_y))
    return nearest if black else -nearest


@compiled
def _is_black(bits: np.ndarray, column: int, row: int) -> bool:
    return 0 <= column < bits.shape[1] and 0 <= row < bits.shape[0] and bits[row, column]


@compiled
def _squares(table: PatternTable, cx: float, cy: float) -> tuple[float, float]:
    to_x = abs(cx - np.floor(cx + 0.5)) * table.pitch
    to_y = abs(cy - np.floor(cy + 0.5)) * table.pitch
    outside = max(-cx, cx - table.nx, -cy, cy - table.ny) * table.pitch
    edge = min(to_x, to_y)
    if outside > 0:
        # Beside the board the nearest ink is the nearest dark square of its rim.
        i = min(table.nx - 1, max(0, int(np.floor(cx))))
        j = min(table.ny - 1, max(0, int(np.floor(cy))))
        return (-outside if (i + j) % 2 == 0 else -FAR_MM), min(outside, edge)
    dark = (int(np.floor(cx)) + int(np.floor(cy))) % 2 == 0
    return (edge if dark else -edge), edge


@compiled
def _dots(table: PatternTable, x: float, y: float) -> tuple[float, float]:
    p = table.pitch
    j = min(table.ny - 1, max(0, int(np.floor(y / p + 0.5 * (table.ny - 1) + 0.5))))
    spacing = 2 * p if table.asymmetric else p
    first = -0.5 * (table.nx - 1) * spacing
    depth = -FAR_MM
    # The nearest dot of an asymmetric grid may lie in the next row.
    for row in range(max(0, j - 1), min(table.ny, j + 2)):
        odd_from_top = (table.ny - 1 - row) % 2 == 1
        shift = 0.5 * p * (1 if odd_from_top else -1) if table.asymmetric else 0.0
        i = min(table.nx - 1, max(0, int(np.floor((x - first - shift) / spacing + 0.5))))
        centre_x, centre_y = first + shift + i * spacing, (row - 0.5 * (table.ny - 1)) * p
        depth = max(depth, 0.5 * table.width - np.hypot(x - centre_x, y - centre_y))
    return depth, abs(depth)
