"""Is it a line grid? Choice among candidate lattices, and plain refusal of what only resembles one."""

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt

from fringecal.detect.grid.lattice import Lattice
from fringecal.detect.grid.line_profile import LineProfile
from fringecal.detect.grid.nodes import NO_LENGTH_PX, Edges, along, edges_between
from fringecal.detect.grid.seeds import CoarseGrid
from fringecal.detect.picture_samples import brightness_at
from fringecal.errors import DetectionError

FloatArray = npt.NDArray[np.float64]

# Part of the lattice's edges along which a line is seen: near 1 for a grid, about 1/2 for false lattices.
MIN_PRESENT = 0.6
# A line is seen on an edge if it stands out by this part of the range of brightness in a cell: a ghost of a line does
# so by less.
MIN_RELATIVE_EDGE = 0.2
# Edges, cells or nodes that are looked at, evenly spread over the lattice: a share of them is known to 4 %.
MAX_CANDIDATE_EDGES = 200
# Fewer edges of a family than this say nothing of lines.
MIN_EDGES = 4
# Extrema of a lattice from which it is named in a refusal: five by five.
MIN_PATTERN = 25
# Rounds of leaving out what hangs on by points alone and growing anew; a slip is gone after the first.
MAX_REGROWTHS = 3
# Lines wider than this part of their spacing are the squares of a chessboard.
MAX_RELATIVE_WIDTH = 0.55
# The contrast half-way along an edge, as part of that nearer to its ends: a line keeps it, between dots it drops.
MIN_MIDDLE_CONTRAST = 0.6
# Brightness half-way between extrema, from 0 (as they) to 1 (as the cells' middle): on stripes the extrema are joined
# one way and apart the other; on a chessboard it is 1/2 both ways; of dots 1, and between dots 0.
STRIPE_PART = 0.2
CHESSBOARD_PARTS = (0.25, 0.75)
# Places in a cell, closer than most lines are wide.
CELL_PARTS = np.linspace(0.0, 1.0, 11)
# Ways in which one family of a lattice may run along the diagonals of the other: rows by columns, columns by rows.
SHEARS = ((1, 0), (-1, 0), (0, 1), (0, -1))
# Places on an edge, as parts of its length, that are clear of both crossings.
THIRDS = ((0.3, 0.34, 0.38), (0.46, 0.5, 0.54), (0.62, 0.66, 0.7))
# Places across an edge, as parts of the spacing: ground to either side, clear of this line and the next, and the line,
# sampled at least so often and closely enough not to step over one that is a pixel wide.
BESIDE = (0.3, 0.35, 0.4)
LINE_PART = 0.1
MIN_LINE_SAMPLES, SAMPLES_PER_PX = 5, 0.3


def choose_coarse(grey: npt.NDArray[np.float32], candidates: list[CoarseGrid]) -> CoarseGrid:
    """Choose the candidate lattice with most edges that are lines.

    Raises
    ------
    DetectionError
        If no candidate has lines along most of its edges; names a chessboard or dots.
    """
    best, best_score = None, 0.0
    most_contrast = float(np.ptp(grey))
    for candidate in candidates:
        if candidate.lattice.whole_cells() * most_contrast <= best_score:
            continue
        candidate, present, contrast = _along_lines(grey, candidate)
        # Contrast and whole cells in the score: extrema within the cells form lattices too, but on faint
        # ghosts of lines; and points half-way along the lines form one of half the spacing without cells.
        score = present * contrast * candidate.lattice.whole_cells()
        if present > MIN_PRESENT and score > best_score:
            best, best_score = candidate, score
    if best is None:
        what = _largest_pattern(grey, candidates)
        raise DetectionError(
            f"no line grid found: {what}; photograph grid paper square-on and in focus, 6 to 120 px per line"
        )
    return replace(best, lattice=_joined(grey, best))


def _along_lines(grey: npt.NDArray[np.float32], candidate: CoarseGrid) -> tuple[CoarseGrid, float, float]:
    """Turn a lattice that counts along a diagonal, or every other line, to its lines; also its line evidence.

    The points alone cannot tell: where a neighbour of the seed is covered or off its place, the diagonal or the
    next but one serves the growth as well.
    """
    lattice = candidate.lattice
    best = candidate, *_line_evidence(grey, candidate)
    others = [partial(lattice.sheared, *shear) for shear in SHEARS]
    others += [partial(lattice.halved, rows=1, columns=2), partial(lattice.halved, rows=2, columns=1)]
    for other in others:
        if best[1] > MIN_PRESENT:
            break
        turned = replace(candidate, lattice=other())
        # By cells too: of a grid counted twice as finely hardly any are whole.
        other_way = turned, *_line_evidence(grey, turned)
        best = max(best, other_way, key=lambda each: each[1] * each[0].lattice.whole_cells())
    return best


def _joined(grey: npt.NDArray[np.float32], coarse: CoarseGrid) -> Lattice:
    """The lattice without what hangs on by no more than points: there its index may have slipped.

    Behind a cover, or along a scratch, growth may pass over points that are no crossings, a little less than a
    spacing apart each. Only cells with a line on all four sides are trusted, and of these the largest patch
    joined side by side; from it the lattice grows anew.
    """
    lattice = coarse.lattice
    for _ in range(MAX_REGROWTHS):
        kept = _largest_patch(*_lines_seen(grey, lattice.nodes(), coarse.sign))
        if not kept.any() or kept.sum() == lattice.member.size:
            break
        grown = lattice.regrown(kept)
        if grown.member.size == kept.sum():
            return grown
        lattice = grown
    return lattice


def _lines_seen(
    grey: npt.NDArray[np.float32], nodes: FloatArray, sign: int
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Whether a line is seen from every node to the next, along rows and along columns, (rows, columns)."""
    least = MIN_RELATIVE_EDGE * _cell_range(grey, nodes)
    seen = np.zeros((2, *nodes.shape[:2]), dtype=bool)
    for family in (0, 1):
        edges = edges_between(nodes, family)
        row, column = (edges.line, edges.place) if family == 0 else (edges.place, edges.line)
        contrast = _contrast_at_thirds(grey, edges, sign, peak=True, most=len(edges.line))
        seen[family, row, column] = contrast.min(axis=0) > least
    return seen[0], seen[1]


def _largest_patch(along_rows: npt.NDArray[np.bool_], along_columns: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Nodes (rows, columns) of the largest patch of whole cells that are joined side by side."""
    cells = along_rows[:-1, :-1] & along_rows[1:, :-1] & along_columns[:-1, :-1] & along_columns[:-1, 1:]
    _, label, stats, _ = cv2.connectedComponentsWithStats(cells.astype(np.uint8), connectivity=4)
    largest = label == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA]) if len(stats) > 1 else np.zeros_like(cells)
    nodes = np.zeros(along_rows.shape, dtype=bool)
    for down in (slice(None, -1), slice(1, None)):
        for right in (slice(None, -1), slice(1, None)):
            nodes[down, right] |= largest
    return nodes


def _largest_pattern(grey: npt.NDArray[np.float32], candidates: list[CoarseGrid]) -> str:
    """Say what the largest lattice of extrema might be, if there is a large one."""
    if not candidates or candidates[0].lattice.member.size < MIN_PATTERN:
        return "no regular pattern of crossings"
    return f"the picture shows {_other_pattern(grey, candidates[0].lattice.nodes(), candidates[0].sign)}"


def _line_evidence(grey: npt.NDArray[np.float32], candidate: CoarseGrid) -> tuple[float, float]:
    """Part of the edges with a line all along their middle, and its median contrast: the weaker family's."""
    if not candidate.lattice.whole_cells():
        return 0.0, 0.0
    nodes = candidate.lattice.nodes()
    least = MIN_RELATIVE_EDGE * _cell_range(grey, nodes)
    present, typical = 1.0, np.inf
    for family in (0, 1):
        edges = edges_between(nodes, family)
        if len(edges.line) < MIN_EDGES:
            return 0.0, 0.0
        contrast = _contrast_at_thirds(grey, edges, candidate.sign, peak=True).min(axis=0)
        present = min(present, float(np.mean(contrast > least)))
        typical = min(typical, float(np.median(contrast)))
    return present, typical


def _contrast_at_thirds(
    grey: npt.NDArray[np.float32], edges: Edges, sign: int, *, peak: bool, most: int = MAX_CANDIDATE_EDGES
) -> FloatArray:
    """Signed brightness on edges less that 3/8 of the spacing beside them, at three places (3, n) on each.

    On the edge it is the peak or the mean within a tenth of the spacing.
    """
    pick = np.unique(np.linspace(0, len(edges.line) - 1, most).astype(int))
    start, step, spacing = edges.start[pick], (edges.end - edges.start)[pick], edges.spacing[pick]
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1)
    normal *= (spacing / np.maximum(np.hypot(step[:, 0], step[:, 1]), NO_LENGTH_PX))[:, None]
    samples = max(MIN_LINE_SAMPLES, int(SAMPLES_PER_PX * np.median(spacing)))
    beside_after = np.array(BESIDE)
    across = np.concatenate([-beside_after[::-1], np.linspace(-LINE_PART, LINE_PART, samples), beside_after])
    ground = len(BESIDE)
    thirds = []
    for third in THIRDS:
        middle = [(start + t * step)[:, None, :] + across[None, :, None] * normal[:, None, :] for t in third]
        sections = sign * np.mean([_sampled(grey, at) for at in middle], axis=0)
        beside = 0.5 * (sections[:, :ground].mean(axis=1) + sections[:, -ground:].mean(axis=1))
        inside = sections[:, ground:-ground]
        thirds.append((inside.max(axis=1) if peak else inside.mean(axis=1)) - beside)
    return np.array(thirds)


def _sampled(grey: npt.NDArray[np.float32], at: FloatArray) -> FloatArray:
    """Picture at points (n, m, 2), bilinear."""
    return brightness_at(grey, at[..., 0], at[..., 1])


def _half_cell(nodes: FloatArray) -> FloatArray:
    """Step from a node to the middle of a cell beside it, px."""
    return 0.5 * (along(nodes, 0) + along(nodes, 1))


def _cell_range(grey: npt.NDArray[np.float32], nodes: FloatArray) -> float:
    """Median over the cells of the range of brightness in each.

    Between points that lie within the cells, faint ghosts of lines are seen; the range knows the true ones.
    """
    row, column = np.nonzero(np.isfinite(nodes[..., 0]))
    pick = np.unique(np.linspace(0, len(row) - 1, MAX_CANDIDATE_EDGES).astype(int))
    right, down = (along(nodes, family)[row[pick], column[pick], None, :] for family in (0, 1))
    s, t = (part.ravel()[None, :, None] for part in np.meshgrid(CELL_PARTS, CELL_PARTS))
    cells = _sampled(grey, nodes[row[pick], column[pick], None, :] + s * right + t * down)
    return float(np.median(np.ptp(cells, axis=1)))


def _brightness(grey: npt.NDArray[np.float32], at: FloatArray) -> float:
    """Median brightness at the known ones of the points (rows, columns, 2)."""
    known = at[np.isfinite(at[..., 0])]
    pick = np.unique(np.linspace(0, len(known) - 1, MAX_CANDIDATE_EDGES).astype(int))
    return float(np.median(_sampled(grey, known[pick][None])))


def refuse_other_patterns(grey: npt.NDArray[np.float32], nodes: FloatArray, profile: LineProfile, sign: int) -> None:
    """Refuse chessboards and dots: between their extrema the 'line' is too wide, or pinched in the middle.

    Raises
    ------
    DetectionError
        Naming what the picture shows instead of a line grid.
    """
    for family in (0, 1):
        edges = edges_between(nodes, family)
        spacing = float(np.median(edges.spacing))
        first, middle, last = np.median(_contrast_at_thirds(grey, edges, sign, peak=False), axis=1)
        pinched = middle < MIN_MIDDLE_CONTRAST * (first + last) / 2
        if pinched or profile.width_px > MAX_RELATIVE_WIDTH * spacing:
            raise DetectionError(f"no line grid found: the picture shows {_other_pattern(grey, nodes, sign)}")


def _other_pattern(grey: npt.NDArray[np.float32], nodes: FloatArray, sign: int) -> str:
    """Name a periodic pattern that is not a line grid, by the brightness between its extrema."""
    node, cell = _brightness(grey, nodes), _brightness(grey, nodes + _half_cell(nodes))
    if sign * (node - cell) <= 0:
        return "a periodic pattern without lines"
    parts = [(_brightness(grey, nodes + 0.5 * along(nodes, family)) - node) / (cell - node) for family in (0, 1)]
    if min(parts) < STRIPE_PART and max(parts) > 1 - STRIPE_PART:
        return "stripes or fringes, lines of one direction only"
    if all(CHESSBOARD_PARTS[0] < part < CHESSBOARD_PARTS[1] for part in parts):
        return "a chessboard; several poses of it give the lens (capture kind board, fringecal lens)"
    return "spots (dots, bricks, texture) but no lines that run through; for dots ask for --pattern dots"
