"""Measure all lines between known crossings and intersect them anew: one round, repeated until it stands."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from fringecal.detect.grid.crossings import (
    MIN_SIGMA_PX,
    LocalLines,
    crossing_normals,
    fit_local_lines,
    intersect,
    mark_outliers,
    residuals,
    shift_of,
)
from fringecal.detect.grid.line_points import (
    FINE_PX,
    MAX_PATCHES,
    PATCH_LENGTH_PX,
    ROUGH_PX,
    LinePoints,
    LineStatus,
    cut_patches,
    measure_points,
)
from fringecal.detect.grid.line_profile import LineProfile
from fringecal.detect.grid.line_scatter import LineScatter, line_bands
from fringecal.detect.grid.line_weights import Weights, line_kinds
from fringecal.detect.grid.nodes import Edges, edges_between, predict_missing, stubs
from fringecal.detect.grid.raster_profile import ProfileFit, chosen, fit_to_pixels, joined, patch_facts, some_patches
from fringecal.detect.grid.seeds import MIN_CROSSINGS
from fringecal.detect.grid.shape_map import SmoothMap, deviations, fit_to_nodes, fit_to_points
from fringecal.detect.grid.tears import without_torn_islands
from fringecal.errors import DetectionError
from fringecal.numerics import robust_sd

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Rounds of: predict missing crossings, measure lines, intersect, until there are no more; a last round with all
# points then makes it sub-pixel.
EXTENSION_ROUNDS = 12
# Across a gap of so many lines, and of no more than this part of the known ones, the map of the whole grid predicts
# crossings; those found further off than this part of the spacing are others.
MAX_BRIDGE, BRIDGE_PARTS = 4, 4
MAX_BRIDGE_MOVE = 0.15
# Steps of a grid seen obliquely change by more than this part from line to line: gaps are not bridged there.
MAX_CHANGE = 0.04
# A round that loses more than the rest of the crossings, and finds no others, is not the last one.
MIN_KEPT = 0.98
# Coarse crossings are off by up to this part of the spacing; the lines are first sought that much broader.
CAPTURE_PART = 0.03
# Patches per edge while the grid is still being extended.
ROUGH_PATCHES = 2
# A crossing that moves further than this part of the spacing from its prediction is another feature.
MAX_MOVE = 0.3
# A measured point much fainter than its family's middle is texture, not line.
MIN_RELATIVE_CONTRAST = 0.2
# Beyond the last crossings a line must be so much fainter at most, and this near to where it is expected, px: there
# nothing else confirms it.
MIN_STUB_CONTRAST = 0.5
MAX_STUB_OFFSET_PX = 0.5
# Part of the points of an edge that must be good for its line to be there.
MIN_GOOD_PART = 0.5
# A slipped index displaces a crossing by a whole spacing; the map of degree 3 follows lenses far better.
MAX_STRAY = 0.5
# Rounds, the second with a map without the first one's strays; and the part of the crossings that must suit the map, or
# the sheet is too bent for it and it cannot tell.
STRAY_ROUNDS = 2
MIN_MAPPED = 0.7


@dataclass(frozen=True)
class LinePicture:
    """A grey picture with the expected cross-sections of its lines and their sign (-1 dark, +1 light).

    `weights` tell where lines lie and how far they reach, tails and all; `fitted`, once there is one, measures them.
    """

    grey: npt.NDArray[np.float32]
    weights: Weights
    sign: int
    fitted: ProfileFit | None = None

    @property
    def profiles(self) -> tuple[LineProfile, ...]:
        """Cross-sections by which lines are measured, one for each weight."""
        return self.weights.profiles if self.fitted is None else self.fitted.profiles

    def blurred(self, blur_px: float) -> "LinePicture":
        """Return one that expects broader lines, and so catches them from further off."""
        profiles = tuple(replace(p, blur_px=float(np.hypot(p.blur_px, blur_px))) for p in self.weights.profiles)
        return replace(self, weights=replace(self.weights, profiles=profiles))

    def kinds(self, edges: tuple[Edges, Edges], shape: tuple[int, int]) -> tuple[IntArray, IntArray]:
        """Weight of every row and column."""
        return line_kinds(self.grey, self.sign, edges, shape, self.weights)


@dataclass(frozen=True)
class Refined:
    """Crossings after one round, with all that was measured; pairs hold horizontal, then vertical."""

    nodes: FloatArray
    sigma_px: FloatArray
    smooth: SmoothMap
    edges: tuple[Edges, Edges]
    points: tuple[LinePoints, LinePoints]
    lines: tuple[LocalLines, LocalLines]
    kinds: tuple[IntArray, IntArray]
    scatter: LineScatter | None = None


def refine_grid(line_picture: LinePicture, nodes: FloatArray) -> tuple[LinePicture, Refined]:
    """Extend coarse crossings to the whole grid and make them sub-pixel; the picture's profiles are made exact, too.

    Parameters
    ----------
    line_picture
        Picture, cross-section and sign of the lines.
    nodes
        Coarse crossings (rows, columns, 2), px, NaN where unknown.

    Raises
    ------
    DetectionError
        If fewer than nine crossings are joined by lines.
    """
    nodes = _without_slips(nodes)
    capture = line_picture.blurred(CAPTURE_PART * _spacing(nodes))
    smooth = fit_to_nodes(nodes)
    for _ in range(EXTENSION_ROUNDS):
        known, nodes, bridged = _extended(nodes, smooth, line_picture.grey.shape)
        found = _round(capture, nodes, known, tolerance_px=ROUGH_PX)
        off = np.linalg.norm(found.nodes - nodes, axis=2) > MAX_BRIDGE_MOVE * _spacing(found.nodes)
        nodes = _without_slips(np.where((bridged & off)[..., None], np.nan, found.nodes))
        seen = np.isfinite(nodes[..., 0])
        if not (seen & ~known).any() and seen.sum() >= MIN_KEPT * known.sum():
            break
        capture, (nodes, smooth) = line_picture, _cropped(nodes, found.smooth)
    line_picture = _with_pixels_profile(line_picture, nodes)
    found = _round(line_picture, nodes, np.isfinite(nodes[..., 0]), tolerance_px=FINE_PX)
    return line_picture, _trimmed(replace(found, scatter=_scatter(line_picture, found)))


def _with_pixels_profile(line_picture: LinePicture, nodes: FloatArray) -> LinePicture:
    """Line picture whose profiles were fitted to the pixels of patches all over the sheet."""
    edges = (edges_between(nodes, 0), edges_between(nodes, 1))
    kinds = line_picture.kinds(edges, nodes.shape[:2])
    weights = line_picture.weights
    cut = [cut_patches(edges[k], weights.profiles, _edge_kinds(edges[k], kinds, k, 1)) for k in (0, 1)]
    some = some_patches(joined(cut))
    points = measure_points(line_picture.grey, some, weights.profiles, line_picture.sign)
    good = points.status == LineStatus.OK
    placed = replace(some, centre=np.stack([points.u_px, points.v_px], axis=1))
    spacing_px = float(np.median(np.concatenate([each.spacing for each in edges])))
    fitted = fit_to_pixels(line_picture.grey, chosen(placed, good), weights.profiles, spacing_px)
    return replace(line_picture, fitted=fitted)


def _scatter(line_picture: LinePicture, found: Refined) -> LineScatter:
    """What the errors of the crossings share, for all sites of the grid."""
    shape = (found.nodes.shape[0], found.nodes.shape[1])
    fitted = line_picture.fitted
    bands, common = [], []
    for family in (0, 1):
        edges, points = found.edges[family], found.points[family]
        usable = points.status == LineStatus.OK
        seen = deviations(found.smooth, family, edges, points)
        bands.append(line_bands(shape, family, seen, points.sigma_px, usable, found.lines[family]))
        none = np.zeros((0, len(points.edge)))
        shifts = _profile_shifts(line_picture, fitted, found, family) if fitted and fitted.matters else none
        common.append([
            fit_local_lines(shape, family, replace(seen, offset_px=shift), points.sigma_px, usable).coefficients[..., 0]
            for shift in shifts
        ])  # fmt: skip
    normals = crossing_normals(found.smooth, *found.lines)
    modes = [shift_of(normals, np.stack(both, axis=-1)) for both in zip(*common, strict=True)]
    return LineScatter(normals, np.stack(bands, axis=2), np.array(modes).reshape(-1, *shape, 2))


def _profile_shifts(line_picture: LinePicture, fitted: ProfileFit, found: Refined, family: int) -> FloatArray:
    """Shift (modes, n), px, of every point of a family by one standard uncertainty of the profiles."""
    edges, points = found.edges[family], found.points[family]
    patches = cut_patches(edges, line_picture.weights.profiles, _edge_kinds(edges, found.kinds, family, 1))
    placed = replace(patches, centre=np.stack([points.u_px, points.v_px], axis=1))
    slopes = np.nan_to_num(patch_facts(line_picture.grey, placed, fitted.profiles)[:, 6:8])
    shifts = [np.where(patches.kind == kind, modes @ slopes.T, 0.0) for kind, modes in enumerate(fitted.modes)]
    return np.concatenate(shifts)


def _extended(nodes: FloatArray, smooth: SmoothMap, shape: tuple[int, ...]) -> tuple[BoolArray, FloatArray, BoolArray]:
    """Sites known, all sites to look at with their predictions, px, and which of these lie beyond a gap.

    Next to known crossings these predict; across a cover or the edge of a shadow the map of the whole grid does,
    no further than it may be trusted.
    """
    known = np.isfinite(nodes[..., 0])
    reach = np.minimum(MAX_BRIDGE, np.array(known.shape) // BRIDGE_PARTS)
    pads = [(max(1, int(r)),) * 2 for r in reach]
    known, nodes = np.pad(known, pads), predict_missing(np.pad(nodes, [*pads, (0, 0)], constant_values=np.nan))
    near = cv2.dilate(known.astype(np.uint8), np.ones(2 * reach + 1, np.uint8)) > 0
    row, column = np.nonzero(near & ~np.isfinite(nodes[..., 0]))
    index = row - pads[0][0], column - pads[1][0]
    at = smooth(*index)
    inside = ((at > 0) & (at < np.array(shape[::-1]) - 1)).all(axis=1) & _gentle(smooth, *index)
    nodes[row[inside], column[inside]] = at[inside]
    bridged = np.zeros_like(known)
    bridged[row[inside], column[inside]] = True
    return known, nodes, bridged


def _gentle(smooth: SmoothMap, row: IntArray, column: IntArray) -> BoolArray:
    """Sites where the map's steps change little from line to line, so that it may be trusted beyond a gap."""
    gentle = np.ones(len(row), dtype=bool)
    for family in (0, 1):
        for down, right in ((1, 0), (0, 1)):
            after, before = (
                np.linalg.norm(smooth.step(row + way * down, column + way * right, family), axis=1) for way in (1, -1)
            )
            gentle &= np.abs(after - before) < MAX_CHANGE * (after + before)
    return gentle


def _cropped(nodes: FloatArray, smooth: SmoothMap) -> tuple[FloatArray, SmoothMap]:
    """Crossings, and the map over them, without empty rows and columns at the border."""
    rows, columns = (np.flatnonzero(np.isfinite(nodes[..., 0]).any(axis=axis)) for axis in (1, 0))
    moved = replace(smooth, middle=smooth.middle - np.array([rows[0], columns[0]]))
    return nodes[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], moved


def _without_slips(nodes: FloatArray) -> FloatArray:
    """Crossings without those that lie elsewhere than the whole grid says.

    Behind a cover an index may have slipped by one; such an island is left out rather than guessed at.
    """
    nodes = without_torn_islands(nodes)
    row, column = np.mgrid[: nodes.shape[0], : nodes.shape[1]]
    limit = MAX_STRAY * _spacing(nodes)
    kept = nodes
    for _ in range(STRAY_ROUNDS):
        rest = nodes - fit_to_nodes(kept)(row, column)
        kept = np.where((np.hypot(rest[..., 0], rest[..., 1]) < limit)[..., None], nodes, np.nan)
        if np.isfinite(kept[..., 0]).sum() < MIN_MAPPED * np.isfinite(nodes[..., 0]).sum():
            return nodes
    return kept


def _spacing(nodes: FloatArray) -> float:
    """Smaller one of the two families' median spacings, px."""
    spacings = [edges_between(nodes, family).spacing for family in (0, 1)]
    if min(s.size for s in spacings) == 0:
        raise DetectionError("no grid found: no two crossings are neighbours on a line")
    return min(float(np.median(s)) for s in spacings)


def _round(line_picture: LinePicture, nodes: FloatArray, trusted: BoolArray, *, tolerance_px: float) -> Refined:
    """Measure all lines between the crossings and intersect them; unsupported crossings become NaN."""
    shape = nodes.shape[0], nodes.shape[1]
    edges = (edges_between(nodes, 0), edges_between(nodes, 1))
    kinds = line_picture.kinds(edges, shape)
    points = (
        _measured(line_picture, edges, kinds, 0, tolerance_px),
        _measured(line_picture, edges, kinds, 1, tolerance_px),
    )
    smooth = fit_to_nodes(np.where(trusted[..., None], nodes, np.nan))
    rough = [deviations(smooth, family, edges[family], points[family]) for family in (0, 1)]
    smooth = fit_to_points(smooth, rough, [p.status == LineStatus.OK for p in points], shape)
    (first, lines0), (second, lines1) = (
        _local_lines(smooth, shape, family, edges[family], points[family]) for family in (0, 1)
    )
    points, lines = (first, second), (lines0, lines1)
    crossing = intersect(smooth, *lines)
    reach = MAX_MOVE * min(float(np.median(e.spacing)) for e in edges)
    shift = crossing - nodes
    kept = np.hypot(shift[..., 0], shift[..., 1]) < reach
    for family in (0, 1):
        kept &= _supported(nodes.shape[:2], family, edges[family], points[family])
    crossing[~kept] = np.nan
    if kept.sum() < MIN_CROSSINGS:
        raise DetectionError(f"no grid found: only {kept.sum()} crossings are joined by lines, {MIN_CROSSINGS} needed")
    sigma = np.sqrt(0.5 * (lines[0].sigma_px ** 2 + lines[1].sigma_px ** 2))
    return Refined(crossing, np.where(kept, sigma, np.nan), smooth, edges, points, lines, kinds)


def _measured(
    line_picture: LinePicture,
    edges: tuple[Edges, Edges],
    kinds: tuple[IntArray, IntArray],
    family: int,
    tolerance_px: float,
) -> LinePoints:
    """Points on all edges of a family."""
    most, longest_px = (ROUGH_PATCHES, PATCH_LENGTH_PX) if tolerance_px >= ROUGH_PX else (MAX_PATCHES, np.inf)
    profiles = line_picture.weights.profiles
    own = _edge_kinds(edges[family], kinds, family, 1)
    patches = cut_patches(edges[family], profiles, own, most=most, longest_px=longest_px)
    return _drop_faint(
        measure_points(line_picture.grey, patches, line_picture.profiles, line_picture.sign, tolerance_px=tolerance_px)
    )


def _edge_kinds(edges: Edges, kinds: tuple[IntArray, IntArray], family: int, way: int) -> IntArray:
    """Weights (n, 3) of an edge's own line and of the lines that cross its start and its end."""
    crossing = kinds[1 - family]
    end = np.clip(edges.place + way, 0, len(crossing) - 1)
    return np.stack([kinds[family][edges.line], crossing[edges.place], crossing[end]], axis=1)


def _local_lines(
    smooth: SmoothMap, shape: tuple[int, ...], family: int, edges: Edges, points: LinePoints
) -> tuple[LinePoints, LocalLines]:
    """Points of one family with outliers marked and sigma from their scatter, and the local parabolas."""
    grid = (shape[0], shape[1])
    seen = deviations(smooth, family, edges, points)
    lines = fit_local_lines(grid, family, seen, points.sigma_px, points.status == LineStatus.OK)
    residual = residuals(family, seen, points.sigma_px, lines)
    status = mark_outliers(points.status, residual)
    good = status == LineStatus.OK
    scatter = robust_sd(residual[good] / points.sigma_px[good], about=0)
    sigma = np.full_like(points.sigma_px, np.inf)
    sigma[good] = np.maximum(points.sigma_px[good] * scatter, MIN_SIGMA_PX)
    return replace(points, status=status, sigma_px=sigma), fit_local_lines(grid, family, seen, sigma, good)


def _drop_faint(points: LinePoints) -> LinePoints:
    """Call points missing that are much fainter than the middle of the family."""
    good = points.status == LineStatus.OK
    if not good.any():
        return points
    faint = good & (points.contrast < MIN_RELATIVE_CONTRAST * np.median(points.contrast[good]))
    return replace(points, status=np.where(faint, int(LineStatus.MISSING), points.status))


def _supported(shape: tuple[int, ...], family: int, edges: Edges, points: LinePoints) -> BoolArray:
    """Nodes that touch at least one edge on which most of the line was found."""
    present = present_edges(edges, points)
    support = np.zeros(shape, dtype=bool)
    for offset in (0, 1):
        line, place = edges.line[present], edges.place[present] + offset
        support[(line, place) if family == 0 else (place, line)] = True
    return support


def present_edges(edges: Edges, points: LinePoints) -> BoolArray:
    """Edges on which at least half of the points are good."""
    seen = np.bincount(points.edge, weights=points.status == LineStatus.OK, minlength=len(edges.line))
    total = np.bincount(points.edge, minlength=len(edges.line))
    return (seen >= MIN_GOOD_PART * total) & (seen > 0)


def _trimmed(found: Refined) -> Refined:
    """Cut empty rows and columns off the border, so that both indices start at 0."""
    known = np.isfinite(found.nodes[..., 0])
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    first = rows[0], columns[0]
    cut = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    horizontal, vertical = found.edges
    edges = (
        replace(horizontal, line=horizontal.line - first[0], place=horizontal.place - first[1]),
        replace(vertical, line=vertical.line - first[1], place=vertical.place - first[0]),
    )
    smooth = replace(found.smooth, middle=found.smooth.middle - np.array(first))
    lines = tuple(LocalLines(each.coefficients[cut], each.covariance[cut]) for each in found.lines)
    kinds = found.kinds[0][cut[0]], found.kinds[1][cut[1]]
    scatter = None if found.scatter is None else found.scatter.at(*cut)
    return Refined(
        found.nodes[cut], found.sigma_px[cut], smooth, edges, found.points, (lines[0], lines[1]), kinds, scatter
    )


def stub_points(line_picture: LinePicture, found: Refined, family: int, way: int) -> tuple[Edges, LinePoints]:
    """Good points on the pieces of line that stick out beyond the last crossing (way +1 or -1)."""
    edges = stubs(found.nodes, family, way)
    profiles = line_picture.weights.profiles
    patches = cut_patches(edges, profiles, _edge_kinds(edges, found.kinds, family, way))
    points = measure_points(line_picture.grey, patches, line_picture.profiles, line_picture.sign)
    base = found.points[family]
    typical = np.median(base.contrast[base.status == LineStatus.OK])
    offset = np.hypot(points.u_px - patches.centre[:, 0], points.v_px - patches.centre[:, 1])
    good = points.status == LineStatus.OK
    good &= (offset < MAX_STUB_OFFSET_PX) & (points.contrast > MIN_STUB_CONTRAST * typical)
    names = ("u_px", "v_px", "sigma_px", "contrast", "status", "edge")
    return edges, LinePoints(*(getattr(points, name)[good] for name in names))
