"""Brightness along a path across the lines of one family: what the eye checks of a grid picture."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from fringecal.detect.grid.grid_search import Family, GridDetection
from fringecal.errors import DetectionError

FloatArray = npt.NDArray[np.float64]

# Samples along a section: two to a pixel show all that the picture holds.
STEP_PX = 0.5
# Lines that a section must cross to show their spacing twice.
MIN_CROSSED = 3


@dataclass(frozen=True)
class LineSection:
    """A section across the lines of a family.

    Parameters
    ----------
    distance_px, grey
        Way along the section and brightness there, (n,).
    line_px
        Way at which the found lines lie, (m,).
    """

    distance_px: FloatArray
    grey: FloatArray
    line_px: FloatArray


def line_section(picture: npt.NDArray[np.generic], detection: GridDetection, family: Family) -> LineSection:
    """Sample the picture across the lines of a family, midway between the two middle lines of the other one.

    Parameters
    ----------
    picture
        Grey picture, (H, W).
    detection
        The grid found in it.
    family
        Which lines are crossed.

    Raises
    ------
    DetectionError
        Fewer than three lines are crossed there.
    """
    nodes = np.full((detection.row.max() + 1, detection.column.max() + 1, 2), np.nan)
    nodes[detection.row, detection.column] = np.stack([detection.u_px, detection.v_px], axis=1)
    if family == "horizontal":
        nodes = nodes.transpose(1, 0, 2)
    middle = 0.5 * (nodes[:-1] + nodes[1:])
    counts = np.isfinite(middle[..., 0]).sum(axis=1)
    # The fullest path, and of equally full ones that nearest to the middle.
    best = int(np.argmax(counts - np.abs(np.arange(len(counts)) - len(counts) / 2) / len(counts)))
    crossed = middle[best][np.isfinite(middle[best, :, 0])]
    if len(crossed) < MIN_CROSSED:
        raise DetectionError(f"no section crosses {MIN_CROSSED} {family} lines; photograph more of the grid")
    line = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(crossed, axis=0).T))])
    way = np.arange(0.0, line[-1], STEP_PX)
    at = [np.interp(way, line, crossed[:, axis]) for axis in (1, 0)]
    grey = ndimage.map_coordinates(np.asarray(picture, dtype=float), at, order=1, mode="nearest")
    return LineSection(way, grey, line)
