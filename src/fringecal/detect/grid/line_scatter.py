"""How the scatter of a grid's crossings hangs together: neighbours share points, and all share the lines' profile."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from fringecal.detect.grid.crossings import ENOUGH_POINTS, MIN_SIGMA_PX, LocalLines
from fringecal.detect.grid.shape_map import Deviations

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Crossings along a line that can share a point: one rests on two pieces of line beside it, or four where these are
# short.
SHARED_LAGS = 3


@dataclass(frozen=True)
class LineScatter:
    """Covariance of the crossings of a grid, in the parts of which it is made.

    Parameters
    ----------
    normals
        (n, 2, 2): by row the normal, as (u, v), along which the crossing's horizontal and vertical line err.
    bands
        (n, 2, 4): covariance, px squared, of a line's error at the crossing with its errors there and at the next three
        crossings along it, for the horizontal and for the vertical line.
    common_px
        (modes, n, 2): shift of all crossings by one standard uncertainty of what they have in common, the width and
        blur of the lines; modes are independent.
    """

    normals: FloatArray
    bands: FloatArray
    common_px: FloatArray

    def at(self, row: IntArray | slice, column: IntArray | slice) -> "LineScatter":
        """Of some sites alone, where the arrays hold all sites, (rows, columns) in place of n."""
        return LineScatter(self.normals[row, column], self.bands[row, column], self.common_px[:, row, column])

    def picked(self, keep: BoolArray | IntArray) -> "LineScatter":
        """Of some of the crossings alone."""
        return LineScatter(self.normals[keep], self.bands[keep], self.common_px[:, keep])


def line_bands(
    shape: tuple[int, int], family: int, seen: Deviations, sigma_px: FloatArray, usable: BoolArray, lines: LocalLines
) -> FloatArray:
    """Covariance (rows, columns, SHARED_LAGS + 1) of a family's offsets with those at the next crossings, px squared.

    Parameters
    ----------
    shape, family, seen, sigma_px, usable
        As `fit_local_lines` had them.
    lines
        What it found.
    """
    line, place = seen.line[usable], seen.place[usable]
    row, column = (line, np.floor(place)) if family == 0 else (np.floor(place), line)
    sites = np.stack([row, column], axis=1).astype(np.int64)
    weight = 1 / np.maximum(sigma_px[usable], MIN_SIGMA_PX) ** 2
    return np.asarray(_bands(shape, 1 - family, sites, place - np.floor(place), weight, lines.covariance[..., 0, :]))


@njit(cache=True)
def _bands(shape, axis, sites, part, weight, solution):  # type: ignore[no-untyped-def] # pragma: no cover
    """Sum over points what they add to the offsets of two crossings; see `crossings._moments` for who counts where."""
    rows, columns = shape
    down, right = 1 - axis, axis
    near = np.zeros((rows, columns, 2), np.int64)
    bands = np.zeros((rows, columns, SHARED_LAGS + 1))
    shares = np.zeros(SHARED_LAGS + 1)
    for n in range(len(part)):
        for step in (0, 1):
            i, j = sites[n, 0] + step * down, sites[n, 1] + step * right
            if 0 <= i < rows and 0 <= j < columns:
                near[i, j, step] += 1
    for n in range(len(part)):
        for step in (-1, 0, 1, 2):
            i, j = sites[n, 0] + step * down, sites[n, 1] + step * right
            shares[step + 1] = 0.0
            if 0 <= i < rows and 0 <= j < columns and (0 <= step <= 1 or near[i, j].min() < ENOUGH_POINTS):
                t = part[n] - step
                share = weight[n] * (solution[i, j, 0] + t * (solution[i, j, 1] + t * solution[i, j, 2]))
                shares[step + 1] = share if np.isfinite(share) else 0.0
        for first in range(SHARED_LAGS + 1):
            for second in range(first, SHARED_LAGS + 1):
                both = shares[first] * shares[second]
                if both != 0.0:
                    i, j = sites[n, 0] + (first - 1) * down, sites[n, 1] + (first - 1) * right
                    bands[i, j, second - first] += both / weight[n]
    return bands
