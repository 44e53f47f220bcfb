"""A grid whose crossings were measured elsewhere: indexed points in, the same value as from a picture out."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.detect.grid.grid_search import FAMILIES, MIN_LINES, GridDetection, GridLine
from fringecal.detect.grid.line_points import LineStatus
from fringecal.detect.grid.line_profile import LineProfile
from fringecal.detect.grid.line_scatter import LineScatter
from fringecal.errors import DetectionError
from fringecal.numerics import robust_sd

_LEAST_SIGMA_PX = 0.01  # of a corner or dot: less no detector reaches on pixels
_SECOND_DIFFERENCE_SD = 6**0.5  # of independent points of unit standard deviation


def grid_of_crossings(
    row: ArrayLike,
    column: ArrayLike,
    u_px: ArrayLike,
    v_px: ArrayLike,
    *,
    shape: tuple[int, int],
    sigma_px: ArrayLike = 0.02,
    scatter: LineScatter | None = None,
) -> GridDetection:
    """Return a detected grid from crossings that another program measured.

    Its lines run through the crossings themselves; width and blur of the lines are not known, and stand as 0.

    Parameters
    ----------
    row, column
        Whole-number index of every crossing, (n,); any origin, rows downward and columns to the right.
    u_px, v_px
        Position of every crossing, px, (n,).
    shape
        (height, width) of the picture, px.
    sigma_px
        Standard uncertainty of a crossing per axis, px: one for all, or (n,).
    scatter
        Covariance of the crossings, where it is known; else they count as independent.

    Raises
    ------
    DetectionError
        Indices that are not whole numbers or stand twice, positions that are not finite, or fewer than 3 x 3 lines.

    Examples
    --------
    >>> row, column = (index.ravel() for index in np.mgrid[0:4, 0:5])
    >>> grid = grid_of_crossings(row, column, 10.0 + 20 * column, 12.0 + 20 * row, shape=(100, 120))
    >>> len(grid.family("horizontal")), len(grid.family("vertical"))
    (4, 5)
    """
    columns = [np.asarray(values, float) for values in (row, column, u_px, v_px)]
    if {values.shape for values in columns} != {(columns[0].size,)}:
        raise DetectionError("one row, column, u and v for each crossing are needed, as lists of one length")
    index, points = np.stack(columns[:2]), np.stack(columns[2:])
    if not (np.all(index == np.rint(index)) and np.all(np.isfinite(points))):
        raise DetectionError("rows and columns are whole numbers, positions finite; leave out crossings without one")
    sites = (index - index.min(axis=1, keepdims=True)).astype(np.int64)
    if np.unique(sites, axis=1).shape[1] < sites.shape[1]:
        raise DetectionError("two crossings have one row and column; index each once")
    if min(len(np.unique(line)) for line in sites) < MIN_LINES:
        raise DetectionError(f"crossings of {MIN_LINES} x {MIN_LINES} lines at least are needed to determine a lens")
    sigma = np.broadcast_to(np.asarray(sigma_px, float), sites[0].shape).copy()
    lines = tuple(
        GridLine(family, k, points[0, pick], points[1, pick], sigma[pick], np.full(pick.sum(), int(LineStatus.OK)))
        for family, site in zip(FAMILIES, sites, strict=True)
        for k in range(int(site.max()) + 1)
        for pick in [site == k]
        if pick.any()
    )
    return GridDetection(
        sites[0], sites[1], points[0], points[1], sigma, lines, shape, "dark", LineProfile(0.0, 0.0), scatter=scatter
    )


def grid_of_board(points_px: ArrayLike, shape: tuple[int, ...]) -> GridDetection:
    """Return the corners or dots of a board as a detected grid.

    Parameters
    ----------
    points_px
        Places (u, v) of all corners, (rows, columns, 2), px; NaN where one is hidden.
    shape
        (height, width) of the picture, px.

    Raises
    ------
    DetectionError
        Fewer than 3 x 3 of them.

    Notes
    -----
    How well a corner is placed is told by its neighbours, between which a picture bends evenly: the scatter of second
    differences along rows and columns over the square root of 6.

    Examples
    --------
    >>> corners = np.stack(np.meshgrid(20.0 * np.arange(4), 20.0 * np.arange(3)), axis=-1) + 10
    >>> grid = grid_of_board(corners, (60, 90))
    >>> grid.column.tolist()[:4], grid.u_px.tolist()[:4]
    ([0, 1, 2, 3], [10.0, 30.0, 50.0, 70.0])
    """
    points = np.asarray(points_px, float)
    row, column = np.nonzero(np.isfinite(points).all(axis=2))
    u, v = points[row, column].T
    bends = [_bends(points), _bends(points.transpose(1, 0, 2))]
    scatter = robust_sd(np.concatenate(bends)) / _SECOND_DIFFERENCE_SD if sum(map(len, bends)) else 0.0
    sigma = max(scatter, _LEAST_SIGMA_PX)
    return grid_of_crossings(row, column, u, v, shape=(shape[0], shape[1]), sigma_px=sigma)


def _bends(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return second differences along the rows, without what all have in common, px."""
    bend = np.diff(points, n=2, axis=1).reshape(-1, 2)
    bend = bend[np.isfinite(bend).all(axis=1)]
    return (bend - np.median(bend, axis=0)).ravel() if len(bend) else np.zeros(0)
