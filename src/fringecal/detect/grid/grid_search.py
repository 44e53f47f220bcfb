"""Find a ruled grid in a picture: its indexed crossings and sub-pixel points along every line."""

import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from fringecal.detect.boards import MIN_SIDE_PX
from fringecal.detect.grid.candidates import choose_coarse, refuse_other_patterns
from fringecal.detect.grid.line_points import LineStatus
from fringecal.detect.grid.line_profile import LineProfile
from fringecal.detect.grid.line_scatter import LineScatter
from fringecal.detect.grid.line_weights import fit_weights
from fringecal.detect.grid.nodes import edges_between
from fringecal.detect.grid.refinement import LinePicture, Refined, present_edges, refine_grid, stub_points
from fringecal.detect.grid.seeds import coarse_grids
from fringecal.errors import DetectionError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Polarity = Literal["auto", "dark", "light"]
Family = Literal["horizontal", "vertical"]
FAMILIES: tuple[Family, Family] = ("horizontal", "vertical")

MIN_LINES = 3  # of each family: two determine no change of scale
# Of the edges between crossings that were found, this part at least must show the line.
MIN_JOINED = 0.7


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
        Width and blur of the lines, px; of the light ones where there are two weights.
    scatter
        Covariance of the crossings, in parts; None where it is not known and they count as independent. `sigma_px`
        holds what each crossing has beside the parts that all have in common.
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
    scatter: LineScatter | None = None

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
    try:
        line_picture, found = _refined(grey, signs, keep_places=False)
    except NotRefinedError as error:
        # Coarse places may all be off to one side, out of reach, where thin lines are a whole number of pixels apart.
        try:
            line_picture, found = _refined(grey, signs, keep_places=True)
        except DetectionError:
            raise error from None
    _refuse_fragments(found)
    return _detection(line_picture, found)


class NotRefinedError(DetectionError):
    """A lattice of candidates was found, and no lines were measured where it says."""


def _refined(
    grey: npt.NDArray[np.float32], signs: tuple[int, ...], *, keep_places: bool
) -> tuple[LinePicture, Refined]:
    """Find a lattice of candidates and measure its lines."""
    coarse = choose_coarse(grey, coarse_grids(grey, signs=signs, keep_places=keep_places))
    nodes = coarse.lattice.nodes()
    weights = fit_weights(grey, coarse.sign, (edges_between(nodes, 0), edges_between(nodes, 1)))
    refuse_other_patterns(grey, nodes, weights.profiles[0], coarse.sign)
    try:
        return refine_grid(LinePicture(grey, weights, coarse.sign), nodes)
    except DetectionError as error:
        raise NotRefinedError(str(error)) from error


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
        raise DetectionError("the picture has the same brightness everywhere and shows no grid; take it again")
    return grey


def _refuse_fragments(found: Refined) -> None:
    """Refuse what has too few lines, or whose crossings are mostly not joined (bricks, texture)."""
    rows, columns = found.nodes.shape[:2]
    if rows < MIN_LINES or columns < MIN_LINES:
        raise DetectionError(
            f"no grid found: only {rows} x {columns} lines that cross, {MIN_LINES} x {MIN_LINES} needed"
        )
    for family, edges, points in zip(FAMILIES, found.edges, found.points, strict=True):
        present = float(np.mean(present_edges(edges, points)))
        if present < MIN_JOINED:
            raise DetectionError(
                f"no grid found: {family} lines join only {present:.0%} of the neighbouring crossings "
                "(a brick wall does this); photograph a sheet whose lines run through"
            )


def _detection(line_picture: LinePicture, found: Refined) -> GridDetection:
    """Assemble the result: crossings, and lines with the stubs that leave the grid."""
    row, column = np.nonzero(np.isfinite(found.nodes[..., 0]))
    position = found.nodes[row, column]
    height, width = line_picture.grey.shape
    return GridDetection(
        row.astype(np.int64),
        column.astype(np.int64),
        position[:, 0],
        position[:, 1],
        found.sigma_px[row, column],
        tuple(_family_lines(line_picture, found, 0) + _family_lines(line_picture, found, 1)),
        (height, width),
        "light" if line_picture.sign > 0 else "dark",
        line_picture.profiles[0],
        None if found.scatter is None else found.scatter.at(row, column),
    )


def _family_lines(line_picture: LinePicture, found: Refined, family: int) -> list[GridLine]:
    """All lines of a family, their points sorted along them."""
    sets = [(found.edges[family], found.points[family])]
    sets += [stub_points(line_picture, found, family, way) for way in (1, -1)]
    line = np.concatenate([edges.line[points.edge] for edges, points in sets])
    columns = [
        np.concatenate([getattr(points, name) for _, points in sets]) for name in ("u_px", "v_px", "sigma_px", "status")
    ]
    order = np.lexsort((columns[family], line))
    bounds = np.searchsorted(line[order], np.arange(found.nodes.shape[family] + 1))
    return [
        GridLine(FAMILIES[family], k, *(values[order[first:last]] for values in columns))
        for k, (first, last) in enumerate(itertools.pairwise(bounds))
        if last > first
    ]
