"""Epipolar lines in the picture: along each of them lie the points that one plane through camera and projector cuts.

A point above the plate shows the fringes of a plate point farther along its line. So along a line, in the direction
away from the projector as the camera sees it, the projector's rays come in their order, and three things follow for
opaque surfaces that hide nothing under them: absolute phase never runs back; across a shadow it is the same at both
ends, because one ray grazes the edge and ends where the shadow ends; and a surface that falls by a fringe leaves a
shadow as wide as a fringe of the plate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.projector import RigCalibration

Array = NDArray[np.float64]

_NODES = 9  # along each side of the picture, at which the direction is computed: it bends slowly
_TEST_MM = 1.0  # height by which the direction is found
_DIFFERENCE_PX = 0.5


@dataclass(frozen=True)
class EpipolarLines:
    """Direction of the epipolar lines all over a picture, and which way phase grows with height along them.

    Parameters
    ----------
    along_columns
        True where lines run rather along columns; else along rows.
    forward
        1 if row or column numbers grow in the direction in which a raised point's fringes lie, else -1.
    slope
        Pixels across for each pixel along, as ``slope[0] + slope[1] a + slope[2] b``, a along and b across, px.
    rising
        Sign of the phase that a raised point gains.
    """

    along_columns: bool
    forward: int
    slope: tuple[float, float, float]
    rising: int


def epipolar_lines(calibration: RigCalibration) -> EpipolarLines:
    """Find the epipolar lines of a rig from where raised points' projector rays end on the plate."""
    camera, model = calibration.camera, calibration.model
    u, v = (
        g.ravel() for g in np.meshgrid(*(np.linspace(0, n - 1, _NODES) for n in (camera.width_px, camera.height_px)))
    )
    rays = camera.rays(u, v)
    x, y = rays.at(_TEST_MM)
    foot_x, foot_y = model.foot(x, y, np.full(x.shape, _TEST_MM))
    toward = np.stack([foot_x - rays.ax, foot_y - rays.ay], axis=-1)
    in_picture = np.linalg.solve(_plate_per_px(calibration, u, v), toward[..., None])[..., 0]
    gain = model.phase(x, y, _TEST_MM) - model.phase(rays.ax, rays.ay, 0.0)
    along_columns = bool(np.median(np.abs(in_picture[:, 1])) > np.median(np.abs(in_picture[:, 0])))
    along, across = (in_picture[:, 1], in_picture[:, 0]) if along_columns else (in_picture[:, 0], in_picture[:, 1])
    at = (v, u) if along_columns else (u, v)
    design = np.column_stack([np.ones(u.size), *at])
    slope = np.linalg.lstsq(design, across / along, rcond=None)[0]
    return EpipolarLines(
        along_columns, int(np.sign(np.median(along))), tuple(slope.tolist()), int(np.sign(np.median(gain)))
    )


def _plate_per_px(calibration: RigCalibration, u: Array, v: Array) -> Array:
    """Derivatives of the plate point under a pixel, mm/px, (n, 2, 2): rows x and y, columns u and v."""
    h = _DIFFERENCE_PX
    right, left = calibration.camera.rays(u + h, v), calibration.camera.rays(u - h, v)
    below, above = calibration.camera.rays(u, v + h), calibration.camera.rays(u, v - h)
    rows = [[right.ax - left.ax, below.ax - above.ax], [right.ay - left.ay, below.ay - above.ay]]
    return np.moveaxis(np.array(rows), -1, 0) / (2 * h)
