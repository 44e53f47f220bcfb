"""How straight the lines of a grid are: distance of their points from the best straight line."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.detect import Family, GridDetection
from fringecal.errors import DetectionError

Array = NDArray[np.float64]

#: Points of a line, and lines of a family: two always lie on a straight line.
MIN_POINTS = 3
#: Points of a line whose curvature is asked for: with fewer it is noise, and the centre would follow it.
MIN_BOW_POINTS = 12


def deviations_px(points_px: Array) -> Array:
    """Signed distances (n,), px, of points (n, 2) from their best straight line (total least squares).

    Examples
    --------
    >>> np.abs(deviations_px(np.array([[0.0, 0.0], [1.0, 0.3], [2.0, 0.0]]))).round(3).tolist()
    [0.1, 0.2, 0.1]
    """
    centred = points_px - points_px.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    return centred @ (axes[1] if axes[1, 1] >= 0 else -axes[1]) + 0.0


def straightness(detection: GridDetection, *, moved: list[Array] | None = None) -> pd.DataFrame:
    """Straightness of every line, from all its good points.

    Parameters
    ----------
    detection
        The grid found in the picture.
    moved
        Positions (n, 2) of every line's good points to use instead, for example undistorted ones.

    Returns
    -------
    pandas.DataFrame
        One row per line: family, index, points, rms_px, max_px.
    """
    rows = []
    for line, points in zip(detection.lines, line_points(detection) if moved is None else moved, strict=True):
        if len(points) >= MIN_POINTS:
            off = deviations_px(points)
            rms, largest = float(np.sqrt(np.mean(off**2))), float(np.abs(off).max())
            rows.append((line.family, line.index, len(points), rms, largest))
    return pd.DataFrame(rows, columns=["family", "index", "points", "rms_px", "max_px"])


def line_points(detection: GridDetection) -> list[Array]:
    """Good points (n, 2), px, of every line."""
    return [np.stack([line.u_px, line.v_px], axis=1)[line.good] for line in detection.lines]


def family_rms_px(table: pd.DataFrame, family: str) -> float:
    """Root mean square distance from straight over all points of a family, px (0 if it has no line)."""
    part = table[table["family"] == family]
    total = float(part["points"].sum())
    return float(np.sqrt((part["points"] * part["rms_px"] ** 2).sum() / total)) if total else 0.0


def straight_centre_px(detection: GridDetection) -> tuple[float, float]:
    """Point (u, v), px, through which the lines of both families look straight.

    Radial distortion bends every line but those through its centre. The curvature of the lines of a family is
    nearly proportional to their distance from that centre; its zero is found by a straight line. A tilted
    camera moves this point without any lens at fault.

    Raises
    ------
    DetectionError
        If the lines of a family have no curvature that changes over the picture.
    """
    return _zero_curvature(detection, "vertical"), _zero_curvature(detection, "horizontal")


def _zero_curvature(detection: GridDetection, family: Family) -> float:
    """Coordinate across a family's lines, px, at which their curvature is zero."""
    places, curvatures = [], []
    for line in detection.family(family):
        along, across = (line.u_px, line.v_px) if family == "horizontal" else (line.v_px, line.u_px)
        along, across = along[line.good], across[line.good]
        if len(along) < MIN_BOW_POINTS:
            continue
        centre = 0.5 * (along.min() + along.max())
        half = 0.5 * np.ptp(along)
        curvature, _, place = np.polyfit((along - centre) / half, across, 2)
        places.append(place)
        curvatures.append(curvature / half**2)
    slope, offset = np.polyfit(places, curvatures, 1) if len(places) > MIN_POINTS else (0.0, 0.0)
    if slope == 0.0:
        raise DetectionError(f"the {family} lines have no curvature that varies over the picture: no centre")
    return float(-offset / slope)
