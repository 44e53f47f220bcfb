"""Distance between the lines of a grid, in px, once the lens is taken out."""

import math

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.lens.radial_lens import RadialLens
from fringecal.detect import FAMILIES, Family, GridDetection
from fringecal.errors import FitError
from fringecal.uncertainty import Estimate

#: Pairs of neighbouring crossings: with fewer a mean has no scatter to speak of.
MIN_STEPS = 3


def line_spacing_px(detection: GridDetection, lens: RadialLens | None = None) -> dict[Family, Estimate]:
    """Mean distance, px, between neighbouring lines of each family over the whole picture.

    Parameters
    ----------
    detection
        The grid found in the picture.
    lens
        A lens to take out first; without one the distances are those seen.

    Returns
    -------
    dict
        For the horizontal lines the distance from one to the next, down the picture, and for the vertical ones
        across it. u is that of the mean over the lines between which distances were taken; tilt makes distances
        differ, and is part of it.

    Raises
    ------
    FitError
        Fewer than three neighbouring pairs of a family were found.
    """
    nodes = np.full((detection.row.max() + 1, detection.column.max() + 1, 2), np.nan)
    points = np.stack([detection.u_px, detection.v_px], axis=1)
    nodes[detection.row, detection.column] = points if lens is None else lens.undistort(points)
    return {family: _mean_step(np.diff(nodes, axis=axis), axis) for axis, family in enumerate(FAMILIES)}


def _mean_step(steps: NDArray[np.float64], axis: int) -> Estimate:
    """Mean length of the steps (rows, columns, 2), and u from the means of the gaps between lines."""
    length = np.hypot(steps[..., 0], steps[..., 1])
    seen = np.isfinite(length)
    if seen.sum() < MIN_STEPS:
        raise FitError(f"{seen.sum()} pairs of neighbouring crossings give no spacing; {MIN_STEPS} are needed")
    count = seen.sum(axis=1 - axis)
    gaps = np.where(seen, length, 0.0).sum(axis=1 - axis)[count > 0] / count[count > 0]
    dof = max(1, len(gaps) - 1)
    u = float(gaps.std(ddof=min(1, len(gaps) - 1))) / math.sqrt(len(gaps))
    return Estimate(float(length[seen].mean()), u, "px", f"spacing of the {FAMILIES[axis]} lines", dof)
