"""Find a ruled grid in a picture: its indexed crossings and sub-pixel points along every line."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from fringecal.detect.grid_check import choose_coarse, refuse_other_patterns
from fringecal.detect.grid_lattice import Lattice
from fringecal.detect.grid_nodes import (
    Edges,
    LocalLines,
    edges_between,
    fit_local_lines,
    intersect,
    mark_outliers,
    predict_missing,
    residuals,
    robust_sd,
    stubs,
)
from fringecal.detect.grid_seeds import coarse_grids
from fringecal.detect.line_points import LinePoints, LineStatus, cut_patches, measure_points
from fringecal.detect.line_profile import LineProfile, fit_profile, mean_profile
from fringecal.errors import DetectionError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Polarity = Literal["auto", "dark", "light"]
Family = Literal["horizontal", "vertical"]
FAMILIES: tuple[Family, Family] = ("horizontal", "vertical")

MIN_LINES = 3
MIN_SIDE_PX = 40
# Rounds of: predict missing crossings, measure lines, intersect. Each may extend the grid by one line.
EXTENSION_ROUNDS = 2
REFINEMENT_ROUNDS = 2
# A measured point much fainter than its family's middle is texture, not line.
MIN_RELATIVE_CONTRAST = 0.2


@dataclass(frozen=True)
class GridLine:
    """One line of the grid: its points in order along it.

    Parameters
    ----------
    family
        ``"horizontal"`` (a row of the grid) or ``"vertical"`` (a column).
    index
        Row or column number, as in `GridDetection`.
    u_px, v_px, sigma_px
        Position and standard uncertainty across the line of every point, px, (n,).
    status
        `LineStatus` of every point, (n,); only those that are OK may be used.
    """

    family: Family
    index: int
    u_px: FloatArray
    v_px: FloatArray
    sigma_px: FloatArray
    status: IntArray

    @property
    def good(self) -> npt.NDArray[np.bool_]:
        """Points that may be used."""
        return self.status == LineStatus.OK


@dataclass(frozen=True)
class GridDetection:
    """The grid found in a picture.

    Parameters
    ----------
    row, column
        Index of every crossing, from 0, rows downward and columns to the right, (n,).
    u_px, v_px, sigma_px
        Position of every crossing and its standard uncertainty per axis, px, (n,).
    lines
        All lines with their points.
    shape
        (height, width) of the picture, px.
    polarity
        ``"dark"`` or ``"light"`` lines.
    profile
        Width and blur of the lines, px.
    """

    row: IntArray
    column: IntArray
    u_px: FloatArray
    v_px: FloatArray
    sigma_px: FloatArray
    lines: tuple[GridLine, ...]
    shape: tuple[int, int]
    polarity: Literal["dark", "light"]
    profile: LineProfile

    def family(self, family: Family) -> tuple[GridLine, ...]:
        """Lines of one family by rising index."""
        return tuple(line for line in self.lines if line.family == family)


def find_grid(image: npt.NDArray[np.generic], *, polarity: Polarity = "auto") -> GridDetection:
    """Find the ruled grid in a picture.

    Parameters
    ----------
    image
        Grey picture, uint8, uint16 or float, (H, W).
    polarity
        Lines darker or lighter than the paper; ``"auto"`` decides.

    Returns
    -------
    GridDetection
        Crossings with (row, column) index and all lines with their points.

    Raises
    ------
    DetectionError
        If the picture shows no line grid of at least 3 x 3 lines, 6 to 120 px apart.

    Notes
    -----
    Candidates are extrema of the band-passed picture, indexed by growth from neighbour to neighbour;
    lines are then measured by least squares on the pixels between the crossings, and the crossings are
    the intersections of the lines, so that the darker blob where two lines cross plays no part.

    Examples
    --------
    >>> v, u = np.mgrid[0:120, 0:160]
    >>> picture = 200.0 - 150 * ((abs((u - 10) % 20) < 2) | (abs((v - 7) % 20) < 2))
    >>> grid = find_grid(picture)
    >>> len(grid.family("vertical")), len(grid.family("horizontal"))
    (8, 6)
    """
    grey = _as_grey(image)
    signs = {"auto": (-1, 1), "dark": (-1,), "light": (1,)}[polarity]
    coarse = choose_coarse(grey, coarse_grids(grey, signs=signs))
    nodes = _dense(coarse.lattice)
    profile = _fit_profile(grey, nodes, coarse.sign)
    refuse_other_patterns(grey, nodes, profile, coarse.sign)
    for _ in range(EXTENSION_ROUNDS):
        nodes = _refine(grey, predict_missing(_padded(nodes)), profile, coarse.sign).nodes
    for _ in range(REFINEMENT_ROUNDS):
        found = _refine(grey, nodes, profile, coarse.sign)
        nodes = found.nodes
    nodes, found = _trimmed(found)
    _refuse_fragments(found)
    return _detection(grey, found, profile, coarse.sign)


def _as_grey(image: npt.NDArray[np.generic]) -> npt.NDArray[np.float32]:
    """Check the picture and give it as float32."""
    image = np.asarray(image)
    if image.ndim != 2:
        raise DetectionError(
            f"find_grid needs a grey picture (H, W), got shape {image.shape}; convert colour to grey first"
        )
    if min(image.shape) < MIN_SIDE_PX:
        raise DetectionError(f"the picture is {image.shape[1]} x {image.shape[0]} px, too small for a grid")
    grey = image.astype(np.float32)
    if not np.isfinite(grey).all():
        raise DetectionError("the picture holds NaN or infinite values; fill or mask them first")
    if float(np.ptp(grey)) == 0.0:
        raise DetectionError("the picture has one single brightness everywhere: no grid to be seen")
    return grey


def _dense(lattice: Lattice) -> FloatArray:
    """Positions (rows, columns, 2) of an indexed lattice, NaN where there is none."""
    nodes = np.full((lattice.row.max() + 1, lattice.column.max() + 1, 2), np.nan)
    nodes[lattice.row, lattice.column] = np.stack([lattice.u_px, lattice.v_px], axis=1)
    return nodes


def _padded(nodes: FloatArray) -> FloatArray:
    """One free site all round."""
    return np.pad(nodes, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)


def _fit_profile(grey: npt.NDArray[np.float32], nodes: FloatArray, sign: int) -> LineProfile:
    """Width and blur of the lines, from the mean cross-section of the coarse edges."""
    edges = [edges_between(nodes, family) for family in (0, 1)]
    start = np.concatenate([e.start for e in edges])
    end = np.concatenate([e.end for e in edges])
    half = max(2.5, 0.45 * float(np.median(np.concatenate([e.spacing for e in edges]))))
    return fit_profile(*mean_profile(np.float32(sign) * grey, start, end, min(half, 40.0)))


@dataclass(frozen=True)
class _Refined:
    """Crossings after one round, with all that was measured; lists hold horizontal, then vertical."""

    nodes: FloatArray
    sigma_px: FloatArray
    edges: tuple[Edges, Edges]
    points: tuple[LinePoints, LinePoints]
    lines: tuple[LocalLines, LocalLines]


def _refine(grey: npt.NDArray[np.float32], nodes: FloatArray, profile: LineProfile, sign: int) -> _Refined:
    """Measure all lines between the given crossings and intersect them anew; unsupported ones become NaN."""
    measured = [_measure_family(grey, nodes, family, profile, sign) for family in (0, 1)]
    edges = (measured[0][0], measured[1][0])
    points = (measured[0][1], measured[1][1])
    lines = (measured[0][2], measured[1][2])
    crossing = intersect(nodes, *lines)
    step = np.minimum(*(np.nanmedian(e.spacing) for e in edges))
    moved = np.hypot(*np.moveaxis(crossing - nodes, -1, 0))
    lost = ~(moved < 0.3 * step)
    for family in (0, 1):
        lost |= ~_supported(nodes.shape[:2], family, edges[family], points[family])
    crossing[lost] = np.nan
    sigma = np.sqrt(0.5 * (lines[0].sigma_px ** 2 + lines[1].sigma_px ** 2))
    return _Refined(crossing, np.where(lost, np.nan, sigma), edges, points, lines)


def _measure_family(
    grey: npt.NDArray[np.float32], nodes: FloatArray, family: int, profile: LineProfile, sign: int
) -> tuple[Edges, LinePoints, LocalLines]:
    """Points of one family with outliers marked, sigma from their scatter, and the local parabolas."""
    edges = edges_between(nodes, family)
    patches = cut_patches(edges.start, edges.end, edges.spacing, profile)
    points = _drop_faint(measure_points(grey, patches, profile, sign))
    lines = fit_local_lines(nodes, family, edges, points, points.status == LineStatus.OK)
    residual = residuals(nodes, family, edges, points, lines)
    points = replace(points, status=mark_outliers(points, residual))
    good = points.status == LineStatus.OK
    scatter = robust_sd(residual[good] / points.sigma_px[good])
    if scatter > 0:
        points = replace(points, sigma_px=points.sigma_px * scatter)
    return edges, points, fit_local_lines(nodes, family, edges, points, points.status == LineStatus.OK)


def _drop_faint(points: LinePoints) -> LinePoints:
    """Call points missing that are much fainter than the middle of the family."""
    good = points.status == LineStatus.OK
    if not good.any():
        return points
    faint = good & (points.contrast < MIN_RELATIVE_CONTRAST * np.median(points.contrast[good]))
    return replace(points, status=np.where(faint, int(LineStatus.MISSING), points.status))


def _supported(grid: tuple[int, ...], family: int, edges: Edges, points: LinePoints) -> npt.NDArray[np.bool_]:
    """Nodes that touch at least one edge on which most of the line was found."""
    good = points.status == LineStatus.OK
    seen = np.bincount(points.edge, weights=good, minlength=len(edges.line))
    total = np.bincount(points.edge, minlength=len(edges.line))
    present = (seen > 0.5 * total) & (total > 0)
    support = np.zeros(grid, dtype=bool)
    for offset in (0, 1):
        line, place = edges.line[present], edges.place[present] + offset
        support[(line, place) if family == 0 else (place, line)] = True
    return support


def _trimmed(found: _Refined) -> tuple[FloatArray, _Refined]:
    """Cut empty rows and columns off the border, so that both indices start at 0."""
    known = np.isfinite(found.nodes[..., 0])
    if not known.any():
        raise DetectionError("no grid found: candidate crossings are not joined by lines")
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    cut = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    edges = tuple(
        replace(
            edge,
            line=edge.line - (rows[0], columns[0])[family],
            place=edge.place - (columns[0], rows[0])[family],
        )
        for family, edge in enumerate(found.edges)
    )
    nodes = found.nodes[cut]
    return nodes, replace(found, nodes=nodes, sigma_px=found.sigma_px[cut], edges=edges)


def _refuse_fragments(found: _Refined) -> None:
    """Refuse what has too few lines, or whose crossings are mostly not joined (bricks, texture)."""
    rows, columns = found.nodes.shape[:2]
    if rows < MIN_LINES or columns < MIN_LINES:
        raise DetectionError(
            f"no grid found: only {rows} x {columns} lines that cross; at least {MIN_LINES} x {MIN_LINES} needed"
        )
    for family, edges, points in zip(FAMILIES, found.edges, found.points, strict=True):
        known = np.isfinite(found.nodes[..., 0])
        ends = []
        for offset in (0, 1):
            line, place = edges.line, edges.place + offset
            row, column = (line, place) if family == "horizontal" else (place, line)
            inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
            ends.append(inside & known[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)])
        seen = np.bincount(points.edge, weights=points.status == LineStatus.OK, minlength=len(edges.line))
        both = ends[0] & ends[1]
        present = float(np.mean(seen[both] > 0)) if both.any() else 0.0
        if present < 0.7:
            raise DetectionError(
                f"no grid found: {family} lines join only {present:.0%} of the neighbouring crossings "
                "(a brick wall does this); photograph a sheet whose lines run through"
            )


def _detection(
    grey: npt.NDArray[np.float32], found: _Refined, profile: LineProfile, sign: int
) -> GridDetection:
    """Assemble the result: crossings, and lines with the stubs that leave the grid."""
    row, column = np.nonzero(np.isfinite(found.nodes[..., 0]))
    lines: list[GridLine] = []
    for family in (0, 1):
        lines += _family_lines(grey, found, family, profile, sign)
    position = found.nodes[row, column]
    return GridDetection(
        row.astype(np.int64),
        column.astype(np.int64),
        position[:, 0],
        position[:, 1],
        found.sigma_px[row, column],
        tuple(lines),
        (grey.shape[0], grey.shape[1]),
        "light" if sign > 0 else "dark",
        profile,
    )


def _family_lines(
    grey: npt.NDArray[np.float32], found: _Refined, family: int, profile: LineProfile, sign: int
) -> list[GridLine]:
    """All lines of a family, their points sorted along them."""
    sets = [(found.edges[family], found.points[family])]
    for way in (1, -1):
        extra = _stub_points(grey, found, family, way, profile, sign)
        if extra is not None:
            sets.append(extra)
    line = np.concatenate([edges.line[points.edge] for edges, points in sets])
    joined = {
        name: np.concatenate([getattr(points, name) for _, points in sets])
        for name in ("u_px", "v_px", "sigma_px", "status")
    }
    coordinate = joined["u_px"] if family == 0 else joined["v_px"]
    order = np.lexsort((coordinate, line))
    count = found.nodes.shape[family]
    bounds = np.searchsorted(line[order], np.arange(count + 1))
    return [
        GridLine(FAMILIES[family], k, *(_take(joined, order[bounds[k] : bounds[k + 1]])))
        for k in range(count)
        if bounds[k + 1] > bounds[k]
    ]


def _take(joined: dict[str, FloatArray], pick: IntArray) -> Sequence[npt.NDArray]:
    return [joined[name][pick] for name in ("u_px", "v_px", "sigma_px", "status")]


def _stub_points(
    grey: npt.NDArray[np.float32], found: _Refined, family: int, way: int, profile: LineProfile, sign: int
) -> tuple[Edges, LinePoints] | None:
    """Points on the pieces of line that stick out beyond the last crossing; only good ones."""
    edges = stubs(found.nodes, family, way)
    if edges.line.size == 0:
        return None
    patches = cut_patches(edges.start, edges.end, edges.spacing, profile, clear_end=True)
    points = measure_points(grey, patches, profile, sign)
    base = found.points[family]
    middle = np.median(base.contrast[base.status == LineStatus.OK])
    local = replace(edges, place=edges.place)
    residual = residuals(found.nodes, family, local, points, _cut_lines(found, family))
    limit = max(5 * robust_sd(points.sigma_px[points.status == LineStatus.OK]), 0.1)
    good = (points.status == LineStatus.OK) & (np.abs(residual) < limit) & (points.contrast > 0.5 * middle)
    kept = LinePoints(
        points.u_px[good],
        points.v_px[good],
        points.sigma_px[good],
        points.contrast[good],
        points.status[good],
        points.edge[good],
    )
    return edges, kept


def _cut_lines(found: _Refined, family: int) -> LocalLines:
    return found.lines[family]
