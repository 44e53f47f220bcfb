"""Distortion where a reader can check it: nine places of the picture, and what neglecting it costs."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.camera.distortion.distortion_test import DistortionTest

Array = NDArray[np.float64]

_ROWS = (("top", 0.0), ("middle", 0.5), ("bottom", 1.0))
_COLUMNS = (("left", 0.0), ("centre", 0.5), ("right", 1.0))


def check_points(test: DistortionTest, shape: tuple[int, int], *, mm_per_px: float | None = None) -> pd.DataFrame:
    """Tabulate, at the crossings nearest to nine places, how far they lie from where a straight view has them.

    Parameters
    ----------
    test
        The examined distortion.
    shape
        (H, W) of the picture, px.
    mm_per_px
        Mean factor; with it the last column is in the table: the error, mm, of a position from the best plane
        view of the grid, that is what neglecting the lens costs there.

    Returns
    -------
    pandas.DataFrame
        place, u and v of the crossing, its distance from the best plane view along u and v, and by how much the
        lens moves it away from its centre (negative: toward it), all px.
    """
    rows = []
    for v_name, v_share in _ROWS:
        for u_name, u_share in _COLUMNS:
            place = np.array([u_share * (shape[1] - 1), v_share * (shape[0] - 1)])
            nearest = int(np.argmin(np.hypot(*(test.points_px - place).T)))
            point, off = test.points_px[nearest], test.residual_before_px[nearest]
            outward = float(test.lens.outward_px(point[None, :])[0])
            rows.append((f"{v_name} {u_name}", *point, *off, outward))
    names = ["place", "u / px", "v / px", "off along u / px", "off along v / px", "outward / px"]
    table = pd.DataFrame(rows, columns=names)
    if mm_per_px is not None:
        table["neglected / mm"] = mm_per_px * np.hypot(table["off along u / px"], table["off along v / px"])
    return table


def effect_of_neglect_px(test: DistortionTest) -> Array:
    """Distance (n,), px, of every crossing from the best plane view: its error if the lens is neglected.

    The plane view is fitted to all crossings and takes its share of the distortion up in scale and tilt, as any
    calibration on the same grid does; the lens's displacement itself is larger.
    """
    return np.hypot(*test.residual_before_px.T)
